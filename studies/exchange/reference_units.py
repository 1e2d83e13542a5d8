"""Reference units of the Modelica Association as parts of a model: beside FMPy, and fitted.

usage: reference_units.py FDM SOURCES   (a program of fdm, a clone of Reference-FMUs; needs cc, FMPy and NumPy)
"""

import csv
import io
import os
import subprocess
import sys
import tempfile
import zipfile

import fmpy
import numpy as np

LIBRARIES = {2: "linux64", 3: "x86_64-linux"}
TIME = [round(0.1 * k, 10) for k in range(201)]
MODELS = {
    "VanDerPol": "param mu = 1; use fmu \"{unit}\" as v(mu = mu); output x0 = v.x0; output x1 = v.x1;",
    "Dahlquist": "param k = 1; use fmu \"{unit}\" as d(k = k); output x = d.x;",
    "Feedthrough": "input u; use fmu \"{unit}\" as f(Float64_continuous_input = u); output y = f.Float64_continuous_output;",
    "BouncingBall": "use fmu \"{unit}\" as b; output h = b.h; output v = b.v;",
    "Stair": "input u; use fmu \"{unit}\" as s; output y = u + s.counter;",
    "StateSpace": "input u; use fmu \"{unit}\" as s; output y = u;",
}


def built(sources, name, version, folder):
    """The unit, from its source in C; none where the version has no such unit."""
    description = os.path.join(sources, name, f"FMI{version}.xml")
    if not os.path.exists(description):
        return None
    library = os.path.join(folder, f"{name}.so")
    files = [f"src/fmi{version}Functions.c", f"{name}/model.c", "src/cosimulation.c"]
    flags = ["-O1", "-shared", "-fPIC", "-std=gnu99", f"-DFMI_VERSION={version}", "-DDISABLE_PREFIX"]
    include = ["-I", os.path.join(sources, "include"), "-I", os.path.join(sources, name)]
    subprocess.run(["cc", *flags, *include, *[os.path.join(sources, f) for f in files], "-lm", "-o", library], check=True)
    unit = os.path.join(folder, f"{name}{version}.fmu")
    with zipfile.ZipFile(unit, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.write(description, "modelDescription.xml")
        archive.write(library, f"binaries/{LIBRARIES[version]}/{name}.so")
    return unit


def table(text):
    rows = list(csv.reader(io.StringIO(text)))
    return [cell.split("[")[0].strip() for cell in rows[0]], np.array([[float(c) for c in row] for row in rows[1:]])


def written(path, columns):
    with open(path, "w", encoding="utf-8") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(repr(float(v)) for v in row) + "\n" for row in zip(*columns.values()))


def reference(unit, sets=None):
    """FMPy's own integration of the same rates."""
    return fmpy.simulate_fmu(
        unit, fmi_type="ModelExchange", relative_tolerance=1e-13, output_interval=0.1, stop_time=TIME[-1], start_values=sets or {}
    )


def main(fdm, sources):
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        written("run.csv", {"t": TIME, "u": np.sin(0.7 * np.array(TIME))})
        for version in (2, 3):
            for name, text in MODELS.items():
                unit = built(sources, name, version, folder)
                if unit is None:
                    continue
                model = f"{name}{version}.fdm"
                with open(model, "w", encoding="utf-8") as file:
                    file.write(f"model m {{ {text.format(unit=os.path.basename(unit))} }}")
                words = [fdm, "simulate", model, "--data", "run.csv", "--integration-accuracy", "1e-12"]
                done = subprocess.run(words, capture_output=True, text=True)
                if done.returncode:
                    print(f"{name}, FMI {version}: {done.stderr.strip().splitlines()[-1]}")
                    continue
                names, response = table(done.stdout)
                if name == "Feedthrough":
                    far = np.abs(response[:, 1] - np.sin(0.7 * response[:, 0])).max()
                else:
                    other = reference(unit)
                    far = max(np.abs(response[:, 1 + k] - other[y]).max() / np.ptp(other[y]) for k, y in enumerate(names[1:]))
                print(f"{name}, FMI {version}: off by {far:.1e} of the range")
            truth, chance = reference(f"VanDerPol{version}.fmu", {"mu": 1.37}), np.random.default_rng(5)
            noisy = {y: truth[y] + 0.05 * chance.standard_normal(len(truth)) for y in ("x0", "x1")}
            written("noisy.csv", {"t": TIME, **noisy})
            words = [fdm, "fit", f"VanDerPol{version}.fdm", "--data", "noisy.csv"]
            done = subprocess.run(words, capture_output=True, text=True)
            print(done.stdout + done.stderr)


if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit(__doc__)
    main(os.path.abspath(sys.argv[1]), os.path.abspath(sys.argv[2]))
