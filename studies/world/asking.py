"""Runs the command with a limit on processor time, keeps its answers, and reads what a written model does."""

import json
import re
import resource
import subprocess
import tempfile
import time
from pathlib import Path

import numpy as np

# seconds of processor time for an answer, and of the clock, as the machine may be shared
LIMIT = 60
CLOCK = 3600


def limited(command, seconds=LIMIT):
    """Output, exit code and processor time; a code of None where the limit is reached."""
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    begun = time.monotonic()
    try:
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=CLOCK,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1)))
        code, out, err = (done.returncode if done.returncode >= 0 else None), done.stdout, done.stderr
    except subprocess.TimeoutExpired as late:
        code, out, err = None, "", str(late)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    used = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    return {"code": code, "out": out, "error": err[-600:], "seconds": used, "clock": time.monotonic() - begun}


def parsed(text):
    try:
        return json.loads(text)
    except json.JSONDecodeError:
        return None


def parameters(text):
    """Params of a model's text that one value for all runs have, and that are estimated."""
    found = []
    for line in re.sub(r"//[^\n]*", "", text).split(";"):
        declared = re.match(r"\s*(?:model[^{]*\{\s*)?param\s+(.*)", line, re.S)
        if declared and "per run" not in declared[1] and not re.search(r"\bfixed\b", declared[1]):
            outside = re.sub(r"\[[^\]]*\]|\"[^\"]*\"", "", declared[1])
            found += [part.strip().split()[0].split("=")[0] for part in outside.split(",") if part.strip()]
    return found


def responses(command, model, runs, validation, options=()):
    """What the text as it stands does on each run, as {output: values}: only what belongs to a run is estimated.

    The runs that were fitted are estimated together, as their outputs share weights; each validation run by itself."""
    text = Path(model).read_text()
    free = "= free" in text or re.search(r"\bper run\b", re.sub(r"//[^\n]*", "", text))
    found = []
    if not free:
        for run in [*runs, *validation]:
            done = limited([command, "simulate", str(model), "--data", str(run), "--json", "--threads", "1", *options])
            channels = (parsed(done["out"]) or [{}])[0].get("channels", [])
            found.append({c["name"]: np.array(c["values"], dtype=float) for c in channels} or None)
        return found
    fixed = [a for name in parameters(text) for a in ("--fix", name)]
    for together in [runs, *([v] for v in validation)]:
        data = [a for run in together for a in ("--data", str(run))]
        with tempfile.TemporaryDirectory() as folder:
            where = Path(folder, "result")
            limited([command, "fit", str(model), *data, *fixed, "--quiet", "--threads", "1", "--out", str(where), *options])
            for run in together:
                tables = list(where.glob(f"run_*_{Path(run).stem}.csv"))
                found.append(modelled(tables[0]) if tables else None)
    return found


def modelled(path):
    """The model's outputs in a run's table."""
    lines = path.read_text().splitlines()
    head = [h.split("[")[0].strip() for h in lines[0].split(",")]
    values = np.array([[float(c) if c.strip() else np.nan for c in row.split(",")] for row in lines[1:]])
    return {h.removesuffix("_model"): values[:, j] for j, h in enumerate(head) if h.endswith("_model")}


def answer(command, model, runs, validation, folder, options=(), searched=(), seconds=LIMIT):
    """One diagnosis in so many seconds of processor time, its written text, a refit of that, and what it simulates to; kept in the folder.

    `options` are those of all commands, `searched` those of the diagnosis alone."""
    kept = folder / "answer.json"
    if kept.exists():
        return json.loads(kept.read_text())
    folder.mkdir(parents=True, exist_ok=True)
    written = folder / "written.fdm"
    written.unlink(missing_ok=True)
    asked = [command, "diagnose", str(model)]
    for run in runs:
        asked += ["--data", str(run)]
    for run in validation:
        asked += ["--validation", str(run)]
    asked += ["--json", "--quiet", "--threads", "1", "--write", str(written), *options, *searched]
    done = limited(asked, seconds)
    found = {"command": " ".join(asked), "code": done["code"], "seconds": done["seconds"], "error": done["error"]}
    found["diagnosis"] = parsed(done["out"]) if done["code"] is not None else None
    if found["diagnosis"] and written.exists() and found["diagnosis"].get("causes"):
        refit = [command, "fit", str(written), "--json", "--quiet", "--threads", "1", *options]
        for run in runs:
            refit += ["--data", str(run)]
        again = limited(refit)
        result = parsed(again["out"]) if again["code"] is not None else None
        found["refit"] = {
            "code": again["code"], "seconds": again["seconds"], "error": again["error"],
            "termination": result.get("termination") if result else None,
            "outputs": [{k: o.get(k) for k in ("name", "run", "rms")} for o in result["outputs"]] if result else None,
        }
        does = responses(command, written, runs, validation, options)
        found["does"] = [{k: list(v) for k, v in d.items()} if d else None for d in does]
    kept.write_text(json.dumps(found))
    return found
