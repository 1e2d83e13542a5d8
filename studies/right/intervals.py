"""Intervals that hold, or say that they do not; and how often the headline of a clean fit asks for its remarks to be read.

    python3 studies/right/intervals.py target/release/fdm [--repeats 100] [--out intervals.csv]

Needs numpy and scipy. Systems, integrators and noises are those of `studies/coverage` and two more; nothing of them is the tool's.
A fit warns where a remark says that intervals may hold less often (`intervals`, `short`).
"""

import argparse
import collections
import csv
import os
import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "coverage"))

parse = argparse.ArgumentParser()
parse.add_argument("program")
parse.add_argument("--repeats", type=int, default=100)
parse.add_argument("--out", default="")
parse.add_argument("--only", nargs="*", default=[], help="words that the name of a cell holds")
ASKED = parse.parse_args()
os.environ["FDM"] = str(Path(ASKED.program).resolve())
os.environ.setdefault("FDM_COVERAGE", tempfile.mkdtemp())

import numpy as np  # noqa: E402

from fits import cell, chance, table  # noqa: E402
from noises import NOISES  # noqa: E402
from plants import PLANTS, Plant, steps  # noqa: E402

WARNINGS = ("intervals", "short", "undetermined", "bound")
# as in the headline of the page and the table
QUIET = ("table", "iteration", "untested", "bridged", "short", "regressors")


def degenerate():
    """Two rates that the record hardly tells apart: their estimates correlate by more than 0.99."""
    time = np.arange(60) * 0.1
    text = """model degenerate "two stages in series, from a short record" {
  input u [1];
  state a [1] = 0, b [1] = 0;
  param K = 1 [1], p = 1.5 in [0, 100] [1/s], s = 0.7 in [0, 100] [1/s];
  der(a) = s*(u - a);
  der(b) = p*(K*a - b);
  output y [1] = b;
}
"""

    def rates(t, x, moved, p):
        return [p["s"] * (moved(t)["u"] - x[0]), p["p"] * (p["K"] * x[0] - x[1])]

    truth = {"K": 1.3, "p": 1.6, "s": 0.9}
    u = steps(time, [(0.5, 1.0)])
    return Plant("degenerate", text, truth, time, {"u": u}, rates, lambda x, u, p: [x[1]], ["y"], [0, 0], domains=("time",))


def motor():
    """New: a motor with viscous friction, current and speed measured."""
    time = np.arange(400) * 0.02
    u = steps(time, [(0.2, 6), (1.5, -6), (2.6, 4), (3.8, 0), (4.4, -3), (5.6, 5), (7, 0)])
    text = """model motor "a motor with friction" {
  input u [V];
  state i [A] = 0, w [rad/s] = 0;
  param R = 1.5 [ohm], L = 0.2 [V*s/A], k = 0.3 [V*s], b = 0.01 [N*m*s];
  const J = 0.02 [kg*m^2];
  der(i) = (u - R*i - k*w)/L;
  der(w) = (k*i - b*w)/J;
  output current [A] = i, speed [rad/s] = w;
}
"""

    def rates(t, x, moved, p):
        return [(moved(t)["u"] - p["R"] * x[0] - p["k"] * x[1]) / p["L"], (p["k"] * x[0] - p["b"] * x[1]) / 0.02]

    truth = {"R": 2.0, "L": 0.3, "k": 0.4, "b": 0.02}
    return Plant("motor", text, truth, time, {"u": u}, rates, lambda x, u, p: [x[0], x[1]], ["current", "speed"], [0, 0])


def heater():
    """New: a heated block that loses heat by convection and radiation."""
    time = np.arange(300) * 10.0
    q = steps(time, [(0, 40), (500, 120), (1000, 20), (1400, 90), (2000, 0), (2400, 130)])
    text = """model heater "a heated block" {
  input q [W];
  state T [K] = 300;
  param C = 350 [J/K], h = 0.25 [W/K], e = 0.6 [1];
  const T0 = 293 [K], s = 2e-9 [W/K^4];
  der(T) = (q - h*(T - T0) - e*s*(T^4 - T0^4))/C;
  output temperature [K] = T;
}
"""

    def rates(t, x, moved, p):
        loss = p["h"] * (x[0] - 293.0) + p["e"] * 2e-9 * (x[0] ** 4 - 293.0**4)
        return [(moved(t)["q"] - loss) / p["C"]]

    truth = {"C": 420.0, "h": 0.3, "e": 0.8}
    return Plant("heater", text, truth, time, {"q": q}, rates, lambda x, u, p: [x[0]], ["temperature"], [300.0], domains=("time",))


ALL = {**PLANTS, **{p.name: p for p in [degenerate(), motor(), heater()]}}


def make(key, number):
    plant, domain, noise = ALL[key[0]], key[1], key[2]
    random = chance(*key, number)
    clean = plant.response()
    columns = dict(plant.inputs)
    for o, name in enumerate(plant.names):
        size = plant.noise * np.std(clean[:, o])
        columns[name] = clean[:, o] + size * NOISES[noise](random, len(clean), plant)
    # the truth is straight between samples, although commands step there
    straight = [word for name in plant.inputs for word in ("--linear", name)]
    options = ["--domain", domain, *straight, *plant.options.get(domain, [])]
    return plant.text, [table(plant.time, columns)], options, plant.truth


def cells():
    for name, plant in ALL.items():
        for domain in plant.domains:
            for noise in ["white", "AR(1) 0.9", "1/f"]:
                yield name, domain, noise


def judged(fits, truth):
    good = [f for f in fits if f.get("termination") == "converged"]
    pairs = [(n, p["interval"]) for f in good for n, p in f["parameters"].items() if p["interval"]]
    hits = {n: np.mean([i[0] <= truth[n] <= i[1] for name, i in pairs if name == n]) for n in truth if any(name == n for name, _ in pairs)}
    said = [{about for about, _ in f["remarks"]} for f in good]
    # what raised the headline, and in how many fits
    raised = collections.Counter(about for s in said for about in s - set(QUIET))
    return {
        "converged": len(good),
        "covers": 100 * np.mean(list(hits.values())) if hits else np.nan,
        "worst": 100 * min(hits.values()) if hits else np.nan,
        "warned": 100 * np.mean([bool(s & set(WARNINGS)) for s in said]) if good else np.nan,
        "coloured": 100 * np.mean(["colour" in s for s in said]) if good else np.nan,
        "correlated": 100 * np.mean(["correlated" in s for s in said]) if good else np.nan,
        "headline": 100 * np.mean([bool(s - set(QUIET)) for s in said]) if good else np.nan,
        "raised": " ".join(f"{about}:{count}" for about, count in raised.most_common()),
    }


def main():
    rows, kinds = [], ["converged", "covers", "worst", "warned", "coloured", "correlated", "headline"]
    print("| system | domain | noise | " + " | ".join(kinds) + " | right or said | raised by |")
    print("|---|---|---|" + "---|" * (len(kinds) + 2))
    for key in cells():
        if not all(any(word in part for part in key) for word in ASKED.only):
            continue
        row = judged(cell("right", list(key), make, ASKED.repeats), ALL[key[0]].truth)
        right = 92.0 <= row["covers"] <= 97.5 or row["warned"] >= 95.0
        print("| " + " | ".join(key) + " | " + " | ".join(f"{row[k]:.1f}" for k in kinds) + f" | {'yes' if right else 'NO'} | {row['raised']} |", flush=True)
        rows.append([*key, *(f"{row[k]:.1f}" for k in kinds), right, row["raised"]])
    clean = [float(r[3 + kinds.index("headline")]) for r in rows if r[2] == "white"]
    print(f"{sum(r[-2] for r in rows)} of {len(rows)} cells right or said; headline on {np.mean(clean):.1f} % of clean fits")
    if ASKED.out:
        with open(ASKED.out, "w", newline="") as out:
            csv.writer(out).writerows([["system", "domain", "noise", *kinds, "right", "raised_by"], *rows])


if __name__ == "__main__":
    main()
