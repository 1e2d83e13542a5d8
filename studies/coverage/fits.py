"""Many fits by the command, two at a time; what was done is kept, so that a study goes on where it was interrupted."""

import json
import os
import subprocess
import tempfile
import zlib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from scipy.stats import t as student

ROOT = Path(__file__).resolve().parents[2]
COMMAND = os.environ.get("FDM", str(ROOT / "target" / "release" / "fdm"))
KEPT = Path(os.environ.get("FDM_COVERAGE", str(ROOT / "target" / "coverage")))


def chance(*key):
    """Random numbers that belong to a key, whatever else is done."""
    return np.random.default_rng([zlib.crc32(repr(k).encode()) for k in key])


def table(time, columns):
    """A record as text; what is not a number is left empty."""
    lines = ["t," + ",".join(columns)]
    for k, t in enumerate(time):
        cells = (f"{c[k]:.12g}" if np.isfinite(c[k]) else "" for c in columns.values())
        lines.append(f"{t:.12g}," + ",".join(cells))
    return "\n".join(lines) + "\n"


def fit(text, records, options):
    """The JSON of one fit; none where there is no result."""
    with tempfile.TemporaryDirectory() as folder:
        model = Path(folder, "model.fdm")
        model.write_text(text)
        command = [COMMAND, "fit", str(model), "--json", "--quiet", "--threads", "1"]
        for k, record in enumerate(records):
            data = Path(folder, f"run_{k + 1}.csv")
            data.write_text(record)
            command += ["--data", str(data)]
        done = subprocess.run(command + options, capture_output=True, text=True, check=False)
    try:
        return json.loads(done.stdout)
    except json.JSONDecodeError:
        return {"failed": done.stderr[-400:]}


def interval(parameter):
    """The 95 % interval as it is printed."""
    if parameter.get("limit") is not None:
        return sorted([parameter["value"], parameter["limit"]])
    error = parameter["corrected_error"]
    freedom = parameter["freedom"] if error is not None else None
    error = parameter["standard_error"] if error is None else error
    if error is None:
        return None
    reach = error * (student.ppf(0.975, max(freedom, 1.0)) if freedom else 1.959963984540054)
    return [parameter["value"] - reach, parameter["value"] + reach]


def kept(result, truth):
    """What a study keeps of a fit."""
    if "failed" in result:
        return result
    parameters = {}
    for p in result["parameters"]:
        if p["name"] in truth:
            error = p["corrected_error"] if p["corrected_error"] is not None else p["standard_error"]
            parameters[p["name"]] = {"value": p["value"], "error": error, "interval": interval(p), "status": p["status"]}
    remarks = [[r["about"], r["sentence"]] for r in result["remarks"]]
    white = [o["whiteness"]["p_value"] for o in result["outputs"] if o.get("whiteness")]
    return {"termination": result["termination"], "parameters": parameters, "remarks": remarks, "white": white}


def one(work):
    """A fit of a study: its number and what is kept of it."""
    make, key, number = work
    text, records, options, truth = make(key, number)
    return number, kept(fit(text, records, options), truth)


def cell(study, key, make, repeats):
    """All repeats of one cell, those that are missing done now."""
    KEPT.mkdir(parents=True, exist_ok=True)
    name = "".join(c if c.isalnum() else "_" for c in "-".join([study, *key]))
    path = KEPT / f"{name}.ndjson"
    done = {}
    if path.exists():
        for line in path.read_text().splitlines():
            try:
                entry = json.loads(line)
            except json.JSONDecodeError:
                continue  # the line at which it was interrupted
            done[entry["number"]] = entry["fit"]
    missing = [(make, key, k) for k in range(repeats) if k not in done]
    if missing:
        with path.open("a") as out, ProcessPoolExecutor(int(os.environ.get("FDM_PROCESSES", "2"))) as pool:
            for number, found in pool.map(one, missing, chunksize=4):
                done[number] = found
                out.write(json.dumps({"number": number, "fit": found}) + "\n")
                out.flush()
    return [done[k] for k in range(repeats)]
