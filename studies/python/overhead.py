"""What the Python door costs: import and a fit, a million samples of ten channels, and one evaluation of the residuals of W1.

    python studies/python/overhead.py

Needs the wheel (`python/wheel`), and runs from the root of the repository. Times are the least of several, in milliseconds or microseconds.
"""

import subprocess
import sys
import time

import fdm
import numpy as np


def least(work, repeats, inner=1):
    best = np.inf
    for _ in range(repeats):
        begun = time.perf_counter()
        for _ in range(inner):
            work()
        best = min(best, (time.perf_counter() - begun) / inner)
    return best


FIRST = """
import time
begun = time.perf_counter()
import fdm
imported = time.perf_counter()
fdm.Model("models/ship_roll_decay/model.fdm").fit("models/ship_roll_decay/run.csv")
print(imported - begun, time.perf_counter() - begun)
"""


def first_fit():
    """Seconds of the import, and of import and fit of the tanker, in new processes."""
    times = []
    for _ in range(5):
        ended = subprocess.run([sys.executable, "-W", "ignore", "-c", FIRST], capture_output=True, text=True, check=True)
        times.append([float(v) for v in ended.stdout.split()])
    return np.min(times, axis=0)


def large_arrays():
    """Milliseconds to take 10^6 x 10 numbers, by the order of the matrix."""
    names = [f"y{k}" for k in range(10)]
    model = fdm.Model.from_text("model wide { param a = 1; " + " ".join(f"output {n} = a;" for n in names) + " }")
    rows = np.random.default_rng(0).standard_normal((1_000_000, 10))
    by_column = np.asfortranarray(rows)
    return {
        order: 1e3 * least(lambda whole=whole: fdm._run.Campaign.of(model, {n: whole[:, k] for k, n in enumerate(names)}), 7)
        for order, whole in (("columns (Fortran)", by_column), ("rows (C)", rows))
    }


def residuals_of_w1():
    """Microseconds of one evaluation: residuals, with Jacobian, into arrays that are there, and by `Model.residuals`."""
    model = fdm.Model("models/manoeuvring_ship/model.fdm")
    t = 0.1 * np.arange(601)
    outputs = {"u_m": 7.7 + 0.01 * np.sin(7 * t), "v_m": 0.01 * np.sin(5 * t), "r_m": 0.01 * np.sin(3 * t)}
    run = fdm.Run(t=t, inputs={"rudder": 0.3 * np.sin(0.2 * t)}, outputs=outputs)
    residuals = model.prepare(run, noise=dict.fromkeys(outputs, 1.0))
    theta = residuals.start.copy()
    into = np.empty(len(residuals)), np.empty((len(residuals), len(theta)))
    ways = {
        "r": lambda: residuals.r(theta),
        "r and J": lambda: residuals(theta),
        "r and J into arrays": lambda: residuals(theta, out=into),
        "Model.residuals": lambda: model.residuals(run, theta),
    }
    return {name: 1e6 * least(way, 400, 5) for name, way in ways.items()}


if __name__ == "__main__":
    imported, fitted = first_fit()
    print(f"import {1e3 * imported:.0f} ms, import and fit of the tanker {1e3 * fitted:.0f} ms")
    for order, milliseconds in large_arrays().items():
        print(f"10^6 x 10 in {order}: {milliseconds:.0f} ms")
    for way, microseconds in residuals_of_w1().items():
        print(f"W1, {way}: {microseconds:.1f} us")
