"""Likelihoods without a maximum and the wrong basin: 60 records with noise in proportion and 60 of few samples with a variance for each output; and 60
clean ones of the same models, with more samples than unknowns and noise of one size, of which nothing is to be said.

python3 likelihoods.py PROGRAM [RESULTS.csv] [RECORDS]

The maximum of the likelihood is sought by Nelder and Mead from several starts (SciPy), with responses in closed form. A fit is right where its
log-likelihood is within 0.1 of that, or all its 95 % intervals hold the true values; said where it ends with exit code 1. The rest is wrong without
a word. Clean records are quiet where no remark speaks of the likelihood, false otherwise.
"""

import csv
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

# matrices are small: threads would only wait for each other
os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from scipy.linalg import expm
from scipy.optimize import minimize

LINE = """model line {
  time [h];
  state l [1] = free;
  param k = 1 in [0, 100] [1/h], rel = 0.1 in [0.001, 1] [1];
  der(l) = k;
  output y [1] = l;
  noise y = rel*abs(y);
}
"""
BOUNDED = LINE.replace("state l [1] = free;", "param l0 = 0.2 in [0, 100] [1]; state l [1] = l0;")
SATURATION = """model saturation {
  time [h];
  param a = 5 in [0, 1000] [1], k = 0.5 in [0.001, 20] [1/h], b = 0.5 in [0, 100] [1], rel = 0.1 in [0.001, 1] [1];
  state x [1] = b;
  der(x) = k*(a - x);
  output y [1] = x;
  noise y = rel*abs(y);
}
"""
CHAIN = """model chain {
  time [min];
  state a [1] = free, b [1] = free, c [1] = free, d [1] = free;
  param k1 = 0.1 in [0, 10] [1/min], k2 = 0.1 in [0, 10] [1/min], k2l = 0.1 in [0, 10] [1/min], k3 = 0.1 in [0, 10] [1/min], k3l = 0.1 in [0, 10] [1/min];
  reactions { a -> b : k1*a; b -> c : k2*b; b -> 0 : k2l*b; c -> d : k3*c; c -> 0 : k3l*c; }
  output A [1] = a, B [1] = b, C [1] = c, D [1] = d;
}
"""
EXCHANGE = """model exchange {
  time [min];
  state a [1] = free, b [1] = free, c [1] = free;
  param p = 0.1 in [0, 10] [1/min], q = 0.1 in [0, 10] [1/min], r = 0.1 in [0, 10] [1/min];
  der(a) = -p*a + q*b;
  der(b) = p*a - q*b - r*b;
  der(c) = r*b;
  output A [1] = a, B [1] = b, C [1] = c;
}
"""


def normal(residuals, deviations):
    return -0.5 * np.sum((residuals / deviations) ** 2 + 2 * np.log(deviations) + np.log(2 * np.pi))


def best(cost, starts, low, high):
    """The least cost within bounds, by a simplex that begins again where it ended."""
    found = (np.inf, None)
    for start in starts:
        at = np.clip(start, low, high)
        for _ in range(3):
            at = minimize(cost, at, method="Nelder-Mead", options={"maxfev": 2000, "xatol": 1e-9, "fatol": 1e-9}).x
        value = cost(at)
        if value < found[0]:
            found = (value, at)
    return found


def proportional(kind, seed):
    """Text, times, samples, truth and the reference's log-likelihood."""
    rng = np.random.default_rng(1000 + seed)
    if kind == "saturation":
        truth = {"a": 10.0, "k": 0.3, "b": 0.4, "rel": 0.2}
        t = np.arange(0, 12.0)
        shape = lambda v: v[0] + (v[2] - v[0]) * np.exp(-np.clip(v[1], -50, 50) * t)
        low, high = np.array([0, 0.001, 0, 0.001]), np.array([1000, 20, 100, 1])
        text = SATURATION
    else:
        truth = {"l(0)" if kind == "line" else "l0": 0.2, "k": 3.0, "rel": 0.2}
        t = np.arange(0, 15.0)
        shape = lambda v: v[0] + v[1] * t
        low, high = np.array([-np.inf if kind == "line" else 0, 0, 0.001]), np.array([np.inf, 100, 1])
        text = LINE if kind == "line" else BOUNDED
    values = np.array(list(truth.values()))
    y = shape(values)
    z = y * (1 + values[-1] * rng.normal(size=len(t)))

    def cost(v):
        if np.any(v < low) or np.any(v > high):
            return np.inf
        with np.errstate(all="ignore"):
            s = v[-1] * np.abs(shape(v))
            l = normal(z - shape(v), s) if np.all(s > 0) else -np.inf
        return -l if np.isfinite(l) else np.inf

    starts = [values, np.array([*values[:-1] * 0.7, 0.1]), np.array([*values[:-1] * 1.4, 0.3])]
    if kind == "line":
        starts.append(np.array([-0.8, 3.1, 0.4]))
    return text, ["y"], t, z[:, None], truth, lambda: -best(cost, starts, low, high)[0]


def chemistry(kind, rng, t, noise):
    """Text, outputs, samples, truth and the reference of a model whose outputs have a variance each; `noise` gives that of the true outputs."""
    if kind == "chain":
        names, x0 = ["k1", "k2", "k2l", "k3", "k3l"], [30, 92, 1.5, 0]
        rates = np.array([0.15, 0.045, 0.03, 0.2, 0.03])
        matrix = lambda k: np.array([[-k[0], 0, 0, 0], [k[0], -k[1] - k[2], 0, 0], [0, k[1], -k[3] - k[4], 0], [0, 0, k[3], 0]])
        text, outputs = CHAIN, ["A", "B", "C", "D"]
    else:
        names, x0 = ["p", "q", "r"], [20, 3, 0.5]
        rates = np.array([0.1, 0.04, 0.06])
        matrix = lambda k: np.array([[-k[0], k[1], 0], [k[0], -k[1] - k[2], 0], [0, k[2], 0]])
        text, outputs = EXCHANGE, ["A", "B", "C"]
    shape = lambda k, x: expm(matrix(k) * t[:, None, None]) @ x
    y = shape(rates, x0)
    z = y + noise(y) * rng.normal(size=y.shape)
    truth = dict(zip(names, rates))

    def cost(v):
        k = v[: len(rates)]
        if np.any(k < 0) or np.any(k > 10):
            return np.inf
        squares = np.mean((z - shape(k, v[len(rates) :])) ** 2, axis=0)
        return 0.5 * len(t) * np.sum(np.log(np.maximum(squares, 1e-20)) + 1 + np.log(2 * np.pi))

    start = np.array([*rates, *x0], dtype=float)
    return text, outputs, z, truth, lambda: -best(cost, [start, start * 1.2 + 0.01], -np.inf, np.inf)[0]


def few(kind, seed):
    t = np.array([0, 15, 30, 60, 120, 180.0]) if kind == "chain" else np.array([0, 5, 15, 40, 90.0])
    text, outputs, z, truth, reference = chemistry(kind, np.random.default_rng(2000 + seed), t, lambda y: 0.08 * y)
    if kind == "chain":
        z[:, 0] = np.maximum(z[:, 0], 1)
        z[z[:, 1] < 2, 1] = 0
    return text, outputs, t, z, truth, reference


def clean(kind, seed):
    t = np.linspace(0, 180 if kind == "chain" else 90, [12, 16, 24][seed % 3])
    noise = lambda y: 0.04 * np.max(np.abs(y), axis=0)
    text, outputs, z, truth, reference = chemistry(kind, np.random.default_rng(3000 + seed), t, noise)
    return text, outputs, t, z, truth, reference


def run(program, folder, text, outputs, t, z):
    unit = "h" if "time [h]" in text else "min"
    (folder / "m.fdm").write_text(text)
    rows = [",".join([f"time [{unit}]", *(f"{o} [1]" for o in outputs)])]
    rows += [",".join([f"{s:g}", *(f"{v:.6g}" for v in row)]) for s, row in zip(t, z)]
    (folder / "r.csv").write_text("\n".join(rows) + "\n")
    done = subprocess.run([program, "fit", "m.fdm", "--data", "r.csv", "--json", "-q"], cwd=folder, capture_output=True, text=True)
    return done.returncode, json.loads(done.stdout) if done.stdout.strip() else {}


def main():
    program = str(Path(sys.argv[1]).resolve())
    results = sys.argv[2] if len(sys.argv) > 2 else None
    count = int(sys.argv[3]) if len(sys.argv) > 3 else 60
    table, totals = [], {}
    with tempfile.TemporaryDirectory() as folder:
        groups = [("proportional", proportional, ["line", "bounded", "saturation"]), ("few", few, ["chain", "exchange"])]
        groups.append(("clean", clean, ["chain", "exchange"]))
        for group, make, kinds in groups:
            for seed in range(count):
                kind = kinds[seed % len(kinds)]
                text, outputs, t, z, truth, reference = make(kind, seed)
                # the reference sees what is written
                code, found = run(program, Path(folder), text, outputs, t, z)
                reached = found.get("log_likelihood")
                known = {p["name"]: p for p in found.get("parameters", [])}
                errors = {n: (known[n].get("corrected_error") or known[n].get("standard_error")) for n in truth if n in known}
                holds = all(
                    errors.get(n) and abs(known[n]["value"] - v) <= 1.96 * errors[n]
                    or (known[n].get("limit") is not None and min(known[n]["value"], known[n]["limit"]) <= v <= max(known[n]["value"], known[n]["limit"]))
                    for n, v in truth.items() if n in known
                ) and bool(known)
                # the reference takes its time, and is asked where it decides
                asked = code == 0 and (group == "proportional" or group == "few" and not holds)
                reference = reference() if asked else float("nan")
                likeliest = reached is not None and reached >= reference - 0.1
                verdict = "said" if code == 1 else "right" if likeliest or holds else "wrong"
                if group == "clean":
                    verdict = "false" if any(r["about"] == "likelihood" for r in found.get("remarks", [])) else "quiet"
                totals.setdefault(group, {}).setdefault(verdict, 0)
                totals[group][verdict] += 1
                shown = "" if reached is None else f"{reached:.3f}"
                table.append([group, kind, seed, code, shown, f"{reference:.3f}", int(holds), verdict])
                # what has been found stays when the study is stopped
                print(*table[-1], flush=True)
    if results:
        with open(results, "w", newline="") as file:
            csv.writer(file).writerows([["group", "kind", "seed", "exit", "log_likelihood", "reference", "holds", "verdict"], *table])
    for group, counts in totals.items():
        print(group, " ".join(f"{verdict} {n}" for verdict, n in sorted(counts.items())))


if __name__ == "__main__":
    main()
