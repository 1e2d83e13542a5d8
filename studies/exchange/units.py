"""Units of `fdm export` in FMPy: validation, co-simulation beside `fdm simulate`, derivatives beside differences.

usage: units.py FDM LIBRARY [MODELS]   (a program of fdm, its library fdm_fmu, the folder `models`; needs FMPy and NumPy)
"""

import csv
import io
import os
import subprocess
import sys
import tempfile

import fmpy
import numpy as np
from fmpy.fmi2 import FMU2Model
from fmpy.fmi3 import FMU3Model
from fmpy.validation import validate_fmu

# model, record, values that both are given
CASES = [
    ("delays", "run.csv", {}),
    ("tclab", "step_1.csv", {}),
    ("t33", "clean.csv", {"p(0)": -21.1, "beta(0)": -0.991, "r(0)": 0.974}),
    ("ship_roll_decay", "run.csv", {"phi(0)": -0.167, "p(0)": 0.0}),
    ("pendulum_free_swing", "run.csv", {}),
    ("robertson", "run.csv", {}),
    ("lynx_hare", "run.csv", {}),
]


def table(text):
    """Names without units, and numbers, of a CSV."""
    rows = list(csv.reader(io.StringIO(text)))
    names = [cell.split("[")[0].strip() for cell in rows[0]]
    return names, np.array([[float(c) for c in row] for row in rows[1:]])


def run(*words):
    done = subprocess.run(words, capture_output=True, text=True)
    if done.returncode:
        raise RuntimeError(f"{' '.join(words)}\n{done.stderr}")
    return done.stdout


def free_names(fdm, model, sets):
    """Only the values that the model has."""
    kept = []
    for name, value in sets.items():
        tried = subprocess.run([fdm, "export", model, "--to", "c", "--set", f"{name}={value}"], capture_output=True)
        if tried.returncode == 0:
            kept += ["--set", f"{name}={value}"]
    return kept


def simulated(fmu, version, names, record, description):
    """Co-simulated outputs at the samples of the record."""
    time = record[:, 0] - record[0, 0]
    inputs = [v.name for v in description.modelVariables if v.causality == "input"]
    outputs = [v.name for v in description.modelVariables if v.causality == "output"]
    unzipped = fmpy.extract(fmu)
    of = {v.name: v.valueReference for v in description.modelVariables}
    arguments = dict(
        guid=description.guid, unzipDirectory=unzipped, modelIdentifier=description.coSimulation.modelIdentifier
    )
    columns = [record[:, names.index(name)] for name in inputs]
    if version == 2:
        from fmpy.fmi2 import FMU2Slave

        unit = FMU2Slave(**arguments)
        unit.instantiate()
        unit.setupExperiment(tolerance=1e-12, startTime=0.0)
        unit.enterInitializationMode()
        setter, getter = unit.setReal, unit.getReal
    else:
        from fmpy.fmi3 import FMU3Slave

        unit = FMU3Slave(**arguments)
        unit.instantiate()
        unit.enterInitializationMode(tolerance=1e-12, startTime=0.0)
        setter, getter = unit.setFloat64, unit.getFloat64
    references = [of[name] for name in inputs]
    if references:
        setter(references, [c[0] for c in columns])
    unit.exitInitializationMode()
    found = [getter([of[name] for name in outputs])]
    for k in range(len(time) - 1):
        h = time[k + 1] - time[k]
        if references:
            setter(references, [c[k] for c in columns])
            if version == 2:
                import ctypes

                n = len(references)
                slopes = [(c[k + 1] - c[k]) / h for c in columns]
                unit.fmi2SetRealInputDerivatives(
                    unit.component, (ctypes.c_uint * n)(*references), n, (ctypes.c_int * n)(*[1] * n), (ctypes.c_double * n)(*slopes)
                )
        unit.doStep(currentCommunicationPoint=time[k], communicationStepSize=h)
        if references and version == 3:
            setter(references, [c[k + 1] for c in columns])
        found.append(getter([of[name] for name in outputs]))
    unit.terminate()
    unit.freeInstance()
    return outputs, np.array(found)


def derivatives(fmu, version, description):
    """Largest difference of directional derivatives from central differences, as a part of the larger."""
    unzipped = fmpy.extract(fmu)
    kind = FMU2Model if version == 2 else FMU3Model
    unit = kind(guid=description.guid, unzipDirectory=unzipped, modelIdentifier=description.modelExchange.modelIdentifier)
    unit.instantiate()
    if version == 2:
        unit.setupExperiment(startTime=0.0)
        unit.enterInitializationMode()
        unit.exitInitializationMode()
        set_, get = unit.setReal, unit.getReal
    else:
        unit.enterInitializationMode(startTime=0.0)
        unit.exitInitializationMode()
        set_, get = unit.setFloat64, unit.getFloat64
    unit.enterContinuousTimeMode()
    variables = description.modelVariables
    states = [v.derivative.valueReference for v in variables if v.derivative is not None]
    unknowns = [v.valueReference for v in variables if v.derivative is not None or v.causality == "output"]
    knowns = states + [v.valueReference for v in variables if v.causality == "input"]
    knowns += [v.valueReference for v in variables if v.causality == "parameter" and v.variability == "tunable"]
    worst = 0.0
    for known in knowns:
        exact = np.array(unit.getDirectionalDerivative(unknowns, [known], [1.0]))
        at = get([known])[0]
        h = 1e-5 * max(abs(at), 1e-2)
        sides = []
        for side in (at - h, at + h):
            set_([known], [side])
            sides.append(np.array(get(unknowns)))
        set_([known], [at])
        difference = (sides[1] - sides[0]) / (2 * h)
        size = np.maximum(np.maximum(abs(exact), abs(difference)), 1e-14 * abs(sides[1]) / h * 1e7 + 1e-6)
        worst = max(worst, float(np.max(abs(exact - difference) / size, initial=0.0)))
    unit.terminate()
    unit.freeInstance()
    return worst


def main():
    fdm, library = sys.argv[1:3]
    models = sys.argv[3] if len(sys.argv) > 3 else "models"
    print("| model | FMI | problems that FMPy finds | largest difference from `fdm simulate`, of each output's range | derivatives |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for name, file, sets in CASES:
            model, path = os.path.join(models, name, "model.fdm"), os.path.join(models, name, file)
            values = free_names(fdm, model, sets)
            names, record = table(open(path).read())
            for version in (2, 3):
                fmu = os.path.join(folder, f"{name}{version}.fmu")
                run(fdm, "export", model, "--to", "fmu", "--fmi", str(version), "--library", library, "-o", fmu, *values)
                problems = validate_fmu(fmu)
                description = fmpy.read_model_description(fmu)
                held = [] if version == 2 else [w for v in description.modelVariables if v.causality == "input" for w in ("--zoh", v.name)]
                out = run(fdm, "simulate", model, "--data", path, "--integration-accuracy", "1e-12", *held, *values)
                wanted_names, wanted = table(out)
                outputs, found = simulated(fmu, version, names, record, description)
                off = 0.0
                for k, output in enumerate(outputs):
                    column = wanted[:, wanted_names.index(output)]
                    off = max(off, float(np.max(abs(found[:, k] - column)) / (np.ptp(column) or 1.0)))
                print(f"| {name} | {version}.0 | {problems or 'none'} | {off:.1e} | {derivatives(fmu, version, description):.1e} |", flush=True)


main()
