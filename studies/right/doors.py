#!/usr/bin/env python3
"""Knocks at the doors of the command from outside: `doors.py PROGRAM [CSV]`.

Each row is an attack: a folder that came from elsewhere, a file without end, an archive or a description that grows. It prints what was
refused (exit code 2 within 30 s, nothing written where nothing may be), and ends with 1 where something was not.
"""

import csv
import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

PROGRAM = os.path.abspath(sys.argv[1])
GAIN = "model gain {\n  input u;\n  param a = 1;\n  output y = a*u;\n}\n"
ROWS = []


def desk():
    folder = Path(tempfile.mkdtemp(prefix="doors-")) / "own"
    folder.mkdir()
    (folder / "gain.fdm").write_text(GAIN)
    rows = "".join(f"{k / 10},{1 + k % 3},{2 * (1 + k % 3)}\n" for k in range(21))
    (folder / "run.csv").write_text("t [s],u,y\n" + rows)
    return folder


def attack(name, folder, words, spared=None):
    held = lambda: spared.read_bytes() if spared.is_file() else spared.exists()  # noqa: E731
    before = held() if spared else None
    try:
        ended = subprocess.run([PROGRAM, *words.split()], cwd=folder, capture_output=True, text=True, timeout=30, stdin=subprocess.DEVNULL)
        code, said = ended.returncode, (ended.stderr.strip().splitlines() or [""])[-1]
    except subprocess.TimeoutExpired:
        code, said = "no end", ""
    touched = spared is not None and held() != before
    ROWS.append({"attack": name, "code": code, "refused": code == 2 and not touched, "said": said[:160]})


FIT = "fit gain.fdm --data run.csv -q"
for option, spared in [
    ("force = true", None),
    ("allow-units = true", None),
    ('report = "../page.html"', "../page.html"),
    ('plot = "../plot.svg"', "../plot.svg"),
    ('out = "deep/../../result"', "../result"),
    ('checkpoint = "../state"', "../state"),
]:
    d = desk()
    (d / "fdm.toml").write_text(f"[options]\n{option}\n")
    attack(f"project: {option}", d, FIT, d / spared if spared else None)
d = desk()
(d.parent / "notes.html").write_text("mine")
(d / "link.html").symlink_to("../notes.html")
(d / "fdm.toml").write_text('[options]\nreport = "link.html"\n')
attack("project: a link out of its folder", d, FIT, d.parent / "notes.html")
for option in ["force = true", "out = '../result'", "report = '../page.html'"]:
    d = desk()
    (d / "job.toml").write_text(f"command = 'fit'\nmodel = 'gain.fdm'\ndata = 'run.csv'\nstarts = 3\n{option}\n")
    attack(f"job: {option}", d, "plan job.toml -q --untimed")
if os.geteuid() == 0:
    d = desk()
    (d / "fdm.toml").write_text('model = "gain.fdm"\ndata = "run.csv"\n')
    os.chown(d / "fdm.toml", 54321, -1)
    attack("project of another user", d, "fit -q")
for words in [
    "fit gain.fdm --runs /dev/urandom -q",
    "fit gain.fdm --data /dev/zero -q",
    "fit gain.fdm --data run.csv --map-file /dev/zero -q",
    "diagnose gain.fdm --data run.csv --effects /dev/zero -q",
    "check /dev/zero",
    "plan /dev/zero",
    "run /dev/zero --out tasks",
    "verify /dev/zero --against gain.fdm",
]:
    attack(f"device: {words}", desk(), words)
d = desk()
(d / "fdm.toml").write_text('map = "/dev/zero"\n')
attack("device: map of a project", d, FIT)
for name in ["fdm.toml", "ship/experiment.toml", "result/result.json", "a.xml", "a.yaml"]:
    d = desk()
    (d / name).parent.mkdir(exist_ok=True)
    (d / name).symlink_to("/dev/zero")
    words = {"fdm.toml": "fit -q", "ship/experiment.toml": "reproduce ./ship", "result/result.json": "report result"}
    attack(f"device: {name}", d, words.get(name, f"import {name} --out new"))
with zipfile.ZipFile((d := desk()) / "a.fmu", "w", zipfile.ZIP_DEFLATED) as z:
    z.writestr("modelDescription.xml", "<fmiModelDescription" + "".join(f' a{k}="1"' for k in range(200_000)) + "/>")
(d / "unit.fdm").write_text('model m { input u; use fmu "a.fmu" as a; output y = u; }')
attack("unit: 200,000 attributes", d, "check unit.fdm")

width = max(len(row["attack"]) for row in ROWS)
for row in ROWS:
    print(f"{row['attack']:{width}}  {'refused' if row['refused'] else 'NOT REFUSED':11}  {row['code']}  {row['said']}")
refused = sum(row["refused"] for row in ROWS)
print(f"{refused} of {len(ROWS)} refused")
if len(sys.argv) > 2:
    with open(sys.argv[2], "w", newline="") as out:
        writer = csv.DictWriter(out, ["attack", "code", "refused"], extrasaction="ignore")
        writer.writeheader()
        writer.writerows(ROWS)
sys.exit(refused != len(ROWS))
