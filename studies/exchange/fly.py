"""Models of `fdm export --to jsbsim` in JSBSim beside `fdm simulate`: 20 s at `RATE` Hz (120), within 1 % of each output's range.

usage: fly.py FDM [MODELS]   (a program of fdm, the folder `models`; needs the package jsbsim and NumPy)
"""

import csv
import io
import os
import re
import subprocess
import sys
import tempfile

import jsbsim
import numpy as np

RATE = float(os.environ.get("RATE", "120"))
END = 20.0

AIRCRAFT = """<?xml version="1.0"?>
<fdm_config name="carrier" version="2.0" release="BETA">
 <fileheader><author>fdm</author><filecreationdate>2026-01-01</filecreationdate><version>1</version><description>carries a system</description></fileheader>
 <metrics><wingarea unit="M2">1</wingarea><wingspan unit="M">1</wingspan><chord unit="M">1</chord>
  <location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location></metrics>
 <mass_balance><ixx unit="KG*M2">1</ixx><iyy unit="KG*M2">1</iyy><izz unit="KG*M2">1</izz><emptywt unit="KG">1</emptywt>
  <location name="CG" unit="M"><x>0</x><y>0</y><z>0</z></location></mass_balance>
 <ground_reactions/>
 <system file="model"/>
 <aerodynamics><axis name="DRAG"/><axis name="SIDE"/><axis name="LIFT"/><axis name="ROLL"/><axis name="PITCH"/><axis name="YAW"/></aerodynamics>
</fdm_config>
"""

# model, values, what the inputs do
CASES = [
    ("t33", {"p(0)": -21.1, "beta(0)": -0.991, "r(0)": 0.974}, None),
    ("delays", {}, lambda t: 10.0 * np.sin(0.4 * t)),
    ("tclab", {}, lambda t: 50.0 + 30.0 * np.sin(0.2 * t)),
    ("lynx_hare", {}, None),
    ("pendulum_free_swing", {}, None),
]


def run(*words):
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}\n{done.stderr}")
    return done.stdout


def main():
    fdm = sys.argv[1]
    models = sys.argv[2] if len(sys.argv) > 2 else "models"
    print("| model | largest difference, of each output's range |")
    print("|---|---|")
    for name, sets, wave in CASES:
        with tempfile.TemporaryDirectory() as folder:
            model = os.path.join(models, name, "model.fdm")
            values = [w for item in sets.items() for w in ("--set", f"{item[0]}={item[1]}")]
            place = os.path.join(folder, "aircraft", "carrier")
            os.makedirs(os.path.join(place, "Systems"))
            open(os.path.join(place, "carrier.xml"), "w").write(AIRCRAFT)
            system = os.path.join(place, "Systems", "model.xml")
            try:
                run(fdm, "export", model, "--to", "jsbsim", "-o", system, *values)
            except RuntimeError as error:
                print(f"| {name} | refused: {str(error).splitlines()[-1]} |")
                continue
            text = open(model).read()
            inputs = re.findall(r"^\s*input\s+(\w+)", text, re.M)
            units = dict(re.findall(r"^\s*input\s+(\w+).*?(\[[^]]*\])", text, re.M))
            t = np.arange(int(END * RATE) + 1) / RATE
            u = wave(t) if wave else None
            path = os.path.join(folder, "run.csv")
            with open(path, "w") as file:
                writer = csv.writer(file)
                writer.writerow(["t"] + [f"{i} {units.get(i, '')}".strip() for i in inputs])
                for k in range(len(t)):
                    writer.writerow([repr(float(t[k]))] + [repr(float(u[k])) for _ in inputs])
            out = run(fdm, "simulate", model, "--data", path, *values)
            rows = list(csv.reader(io.StringIO(out)))
            names = [cell.split("[")[0].strip() for cell in rows[0]][1:]
            wanted = np.array([[float(c) for c in row] for row in rows[1:]])[:, 1:]
            root = re.search(r'fcs_function name="(fdm/\w+)/', open(system).read()).group(1)
            flown = jsbsim.FGFDMExec(folder, None)
            flown.set_debug_level(0)
            flown.set_aircraft_path("aircraft")
            # the components take their rate when they are read
            flown.set_dt(1.0 / RATE)
            flown.load_model("carrier")
            for i in inputs:
                flown[f"{root}/{i}"] = u[0]
            # the first pass computes the outputs at 0
            flown.run_ic()
            found = [[flown[f"{root}/{n}"] for n in names]]
            for k in range(len(t) - 1):
                for i in inputs:
                    flown[f"{root}/{i}"] = u[k + 1]
                flown.run()
                found.append([flown[f"{root}/{n}"] for n in names])
            found = np.array(found)
            off = max(float(np.max(abs(found[:, k] - wanted[:, k])) / (np.ptp(wanted[:, k]) or 1.0)) for k in range(len(names)))
            print(f"| {name} | {off:.1e} |", flush=True)


main()
