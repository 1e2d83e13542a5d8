#!/usr/bin/env python3
"""The semantic test suite of SBML (https://github.com/sbmlteam/sbml-test-suite), every time course of it, read by `fdm import` and simulated.

The suite is no part of this project; its folder `cases/semantic` is given:

    python3 studies/right/sbml.py .../cases/semantic target/debug/fdm --csv results.csv

Of each case the file of the highest level and version is read (`--lowest`: of the lowest). What is wanted is compared at every time by the case's own
tolerances: |found - wanted| <= absolute + relative |wanted|. A case is `right`; `refused`, with the reason; `stopped`, where the simulation ends with
an error; or `wrong`: an answer that is not right.
"""

import argparse
import collections
import concurrent.futures
import csv
import math
import pathlib
import re
import subprocess
import tempfile
import xml.etree.ElementTree as ElementTree


def tag(element):
    return element.tag.rsplit("}", 1)[-1]


def settings(path):
    lines = (line.split(":", 1) for line in path.read_text().splitlines() if ":" in line)
    found = {key.strip(): value.strip() for key, value in lines}
    names = lambda key: [n.strip() for n in found.get(key, "").split(",") if n.strip()]
    return names("variables"), set(names("amount")), set(names("concentration")), float(found["absolute"]), float(found["relative"])


def is_time_course(folder):
    """Time courses of SBML core; packages (`comp`, `fbc`, `distrib`) are other languages."""
    about = (folder / f"{folder.name}-model.m").read_text(errors="replace")
    return "TimeCourse" in about.split("testType", 1)[-1].splitlines()[0] and not re.search(r"\b(comp|fbc|distrib):", about)


def shown(document, variable, amounts, concentrations, called):
    """What is asked for, in the names of the model that was written."""
    species = {e.get("id", e.get("name")): e for e in document.iter() if tag(e) in ("species", "specie")}
    own = called.get(variable, variable)
    if variable not in species:
        return own
    size = called.get(species[variable].get("compartment"), species[variable].get("compartment"))
    is_amount = species[variable].get("hasOnlySubstanceUnits") in ("true", "1")
    if variable in amounts and not is_amount:
        return f"{own}*{size}"
    if variable in concentrations and is_amount:
        return f"{own}/{size}"
    return own


def judge(folder, program, lowest):
    variables, amounts, concentrations, absolute, relative = settings(folder / f"{folder.name}-settings.txt")
    files = sorted(folder.glob(f"{folder.name}-sbml-l?v?.xml"))
    file = files[0 if lowest else -1]
    with open(folder / f"{folder.name}-results.csv") as handle:
        rows = [[cell.strip() for cell in row] for row in csv.reader(handle) if row and any(row)]
    header, rows = rows[0], [[float(c.replace("INF", "inf")) for c in row] for row in rows[1:]]
    place = tempfile.TemporaryDirectory()
    at = pathlib.Path(place.name)
    run = lambda *words: subprocess.run([program, *words], capture_output=True, text=True, cwd=at, timeout=120)
    found = run("import", str(file.resolve()), "-o", "m")
    if found.returncode != 0:
        return "refused", found.stderr
    report = (at / "m/IMPORT.md").read_text()
    called = dict(re.findall(r"^\| `(.*)` \| `(.*)` \|$", report, re.M))
    document = ElementTree.parse(file).getroot()
    model = (at / "m/model.fdm").read_text().rstrip()
    lines = [f"  output study_{k} = {shown(document, v, amounts, concentrations, called)};\n" for k, v in enumerate(header[1:])]
    (at / "m/model.fdm").write_text(model.removesuffix("}") + "".join(lines) + "}\n")
    (at / "grid.csv").write_text("time\n" + "".join(f"{row[0]!r}\n" for row in rows))
    done = run("simulate", "m/model.fdm", "--data", "grid.csv", "--no-project")
    if done.returncode != 0 or not done.stdout:
        return "stopped", done.stderr
    table = list(csv.DictReader(done.stdout.splitlines()))
    worst = (0.0, "")
    for wanted, row in zip(rows, table, strict=True):
        for k, name in enumerate(header[1:]):
            value, right = float(row.get(f"study_{k}") or "nan"), wanted[k + 1]
            if value == right or math.isnan(value) and math.isnan(right):
                continue
            apart = abs(value - right) / (absolute + relative * abs(right))
            apart = math.inf if math.isnan(apart) else apart
            worst = max(worst, (apart, f"{name} at {wanted[0]:g}: {value:g} for {right:g}"))
    notes = " ".join(line for line in found.stderr.splitlines() if "note" in line)
    return ("right", "") if worst[0] <= 1.0 else ("wrong", f"{worst[1]} ({worst[0]:.3g} tolerances) {notes}")


def kind(said):
    """A refusal without places and names."""
    lines = [line for line in said.splitlines() if line.strip()] or ["nothing said"]
    first = re.sub(r"^error: |\S*\.xml: |line \d+: ?", "", lines[0])
    return re.sub(r"[-+]?\d[\d.e+-]*", "#", re.sub(r"`[^`]*`", "`.`", first))[:150]


def main():
    arguments = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    arguments.add_argument("suite", type=pathlib.Path)
    arguments.add_argument("program")
    arguments.add_argument("--csv", type=pathlib.Path)
    arguments.add_argument("--lowest", action="store_true")
    arguments.add_argument("--cases", nargs="*", help="numbers of cases [default: all]")
    given = arguments.parse_args()
    program = str(pathlib.Path(given.program).resolve())
    folders = sorted(p for p in given.suite.iterdir() if p.is_dir() and (not given.cases or p.name in given.cases))
    folders = [p for p in folders if is_time_course(p)]

    def one(folder):
        try:
            return folder.name, *judge(folder, program, given.lowest)
        except subprocess.TimeoutExpired:
            return folder.name, "stopped", "longer than 120 s"

    with concurrent.futures.ThreadPoolExecutor(2) as pool:
        results = list(pool.map(one, folders))
    if given.csv:
        with open(given.csv, "w", newline="") as handle:
            csv.writer(handle).writerows([("case", "what", "why"), *((c, w, kind(s) if w != "wrong" else s) for c, w, s in results)])
    for what in ("right", "refused", "stopped", "wrong"):
        own = [(case, said) for case, found, said in results if found == what]
        print(f"{what}: {len(own)} of {len(results)}")
        if what in ("refused", "stopped"):
            for reason, count in collections.Counter(kind(said) for _, said in own).most_common():
                print(f"  {count:4} {reason}")
        if what == "wrong":
            for case, said in own:
                print(f"  {case} {said}")


if __name__ == "__main__":
    main()
