"""Inputs that were held, and inputs that were straight between samples: does `fdm fit` tell them apart?

    python3 studies/right/holds.py target/debug/fdm [records of each kind, 100] [results.csv]

Records are simulated exactly (by SciPy's matrix exponential, the input held or straight over each interval), by models of order 1 to 3, five kinds of input
signal, white noise, and coloured noise in every fourth. Nothing of the program is used to make them.
"""
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.linalg import expm

TEXTS = {
    1: "model m { input u; state x = free; param T = 1 in [0.01, 20], k = 1, b = 0; der(x) = (k*u - x)/T; output y = x + b; }",
    2: "model m { input u; state x = free, v = free; param w = 2 in [0.1, 20], z = 0.7 in [0.01, 3], k = 1, b = 0; der(x) = v;"
       " der(v) = w^2*(k*u - x) - 2*z*w*v; output y = x + b; }",
    3: "model m { input u; state x = free, v = free, a = 0; param w = 2 in [0.1, 20], z = 0.7 in [0.01, 3], k = 1, T = 0.2 in [0.01, 5], b = 0;"
       " der(a) = (u - a)/T; der(x) = v; der(v) = w^2*(k*a - x) - 2*z*w*v; output y = x + b, y2 = v; }",
}
SIGNALS = ["multisine", "noise", "sweep", "stick", "3-2-1-1"]


def system(order, rng):
    w, z, k, lag = rng.uniform(1.2, 3.5), rng.uniform(0.25, 0.9), rng.uniform(0.5, 2), rng.uniform(0.1, 0.3)
    if order == 1:
        lag = rng.uniform(0.4, 1.5)
        return [[-1 / lag]], [[k / lag]], [[1.0]]
    if order == 2:
        return [[0, 1], [-w * w, -2 * z * w]], [[0], [w * w * k]], [[1.0, 0]]
    a = [[0, 1, 0], [-w * w, -2 * z * w, w * w * k], [0, 0, -1 / lag]]
    return a, [[0], [0], [1 / lag]], [[1.0, 0, 0], [0, 1.0, 0]]


def signal(kind, n, dt, held, rng):
    t = np.arange(n) * dt
    if kind == "multisine":
        f = np.linspace(0.05, 1.2, 9) * rng.uniform(0.8, 1.2)
        return sum(np.sin(2 * np.pi * f[j] * t + rng.uniform(0, 6.3)) for j in range(9)) / 3
    if kind == "noise":
        u, x = rng.standard_normal(n), np.zeros(n)
        c = np.exp(-dt / rng.uniform(0.1, 0.6))
        for j in range(1, n):
            x[j] = c * x[j - 1] + np.sqrt(1 - c * c) * u[j]
        return x
    if kind == "sweep":
        rate = rng.uniform(0.8, 1.6) / t[-1]
        return np.sin(2 * np.pi * (0.05 + 0.5 * rate * t) * t)
    if kind == "stick":
        knots = np.cumsum(rng.uniform(0.3, 1.5, int(t[-1] / 0.3) + 3))
        u = np.interp(t, knots, rng.uniform(-1, 1, knots.size))
        # a hand rests now and then
        return np.where(np.abs(u) < 0.1, 0.0, u)
    unit, u = rng.uniform(0.3, 0.8), np.zeros(n)
    edges = np.cumsum([1.0, 3 * unit, 2 * unit, unit, unit])
    for begin, end, sign in zip(edges[:-1], edges[1:], [1, -1, 1, -1]):
        for again in (0, t[-1] / 2):
            u[(t >= begin + again) & (t < end + again)] = sign
    if not held:  # an actuator's own rate: several samples a stroke
        width = rng.integers(3, 7)
        u = np.convolve(np.pad(u, (width, 0), mode="edge"), np.ones(width) / width, mode="valid")[:n]
    return u


def record(number, held):
    rng = np.random.default_rng([57, number, held])
    order, kind = 1 + number % 3, SIGNALS[number % 5]
    n, dt = int(rng.integers(400, 1500)), rng.uniform(0.03, 0.08)
    u = signal(kind, n, dt, held, rng)
    a, b, c = system(order, rng)
    a, b, c = (np.array(part, dtype=float) for part in (a, b, c))
    size = len(a)
    block = np.zeros((size + 2, size + 2))
    block[:size, :size], block[:size, size:size + 1], block[size, size + 1] = a, b, 1 / dt
    block = expm(block * dt)
    x, y = np.zeros(size), np.zeros((n, len(c)))
    for j in range(n):
        y[j] = c @ x
        rise = 0.0 if held or j + 1 == n else u[j + 1] - u[j]
        x = block[:size, :size] @ x + block[:size, size] * u[j] + block[:size, size + 1] * rise
    noise = rng.standard_normal(y.shape)
    rho = 0.8 if number % 4 == 3 else 0.0
    for j in range(1, n):
        noise[j] = rho * noise[j - 1] + np.sqrt(1 - rho * rho) * noise[j]
    y += rng.uniform(0.01, 0.04) * y.std(axis=0) * noise
    return order, kind, rho, np.column_stack([np.arange(n) * dt, u, y])


def main():
    fdm, count = Path(sys.argv[1]).resolve(), int(sys.argv[2]) if len(sys.argv) > 2 else 100
    rows, totals = [], {}
    with tempfile.TemporaryDirectory() as folder:
        for held in (True, False):
            for number in range(count):
                order, kind, rho, table = record(number, held)
                model, data = Path(folder) / "m.fdm", Path(folder) / "r.csv"
                model.write_text(TEXTS[order])
                names = ["t", "u", "y", "y2"][: table.shape[1]]
                np.savetxt(data, table, delimiter=",", header=",".join(names), comments="", fmt="%.9g")
                done = subprocess.run([fdm, "fit", model, "--data", data, "--verbose"], capture_output=True, text=True, cwd=folder)
                # sentences are wrapped to the terminal
                noted, said = (" ".join(text.split()) for text in (done.stderr, done.stdout))
                taken = "is taken for held" in noted
                said_held = "went held between samples, not" in said
                said_linear = "went in straight lines, not" in said
                open_question = "does not say whether" in said
                told = (taken and not said_linear) or said_held
                totals.setdefault((held, kind), []).append(told)
                rows.append([int(held), number, order, kind, rho, done.returncode, int(taken), int(said_held), int(said_linear), int(open_question)])
    if len(sys.argv) > 3:
        head = "held,number,order,signal,rho,exit,taken,said_held,said_linear,undecided"
        Path(sys.argv[3]).write_text("\n".join([head] + [",".join(map(str, row)) for row in rows]) + "\n")
    for held in (True, False):
        of = {kind: told for (h, kind), told in totals.items() if h == held}
        print("held" if held else "linear", "told held:", sum(map(sum, of.values())), "of", sum(map(len, of.values())),
              {kind: f"{sum(told)}/{len(told)}" for kind, told in of.items()})


main()
