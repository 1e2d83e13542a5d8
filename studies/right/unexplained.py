"""What `fdm fit` says first of records that do not belong to their model, and how often it says so of records that do.

    python3 studies/right/unexplained.py FDM FOLDER [--draws 3] [--clean 40] [--seed 11]

A second-order plant with two outputs, integrated by SciPy, with 2 % of noise; the text starts away from the truth. Eight kinds of wrong record. Scores:
3 the cause is named in the first lines, 2 the output is named, 1 the result is doubted, 0 nothing.
"""

import argparse
import csv
import json
import subprocess
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

TEXT = """model plant {
  input u [N];
  state x [m] = free, v [m/s] = free;
  param k = 2 in [0.1, 50] [1/s^2], d = 0.5 in [0, 20] [1/s], b = 1 in [-20, 20] [1/kg];
  der(x) = v;
  der(v) = b*u - k*x - d*v;
  output place [m] = x, speed [m/s] = v;
}
"""


def record(g):
    n, dt = 300, 0.05
    t = np.arange(n) * dt
    w, phase = g.uniform(0.5, 4, 3), g.uniform(0, 6, 3)
    force = lambda s: sum(np.sin(a * s + p) for a, p in zip(w, phase))
    k, d, b = g.uniform(3, 8), g.uniform(0.4, 1.5), g.uniform(0.7, 2)
    rate = lambda s, z: [z[1], b * force(s) - k * z[0] - d * z[1]]
    z = solve_ivp(rate, (0, t[-1]), g.normal(size=2) * 0.2, t_eval=t, rtol=1e-9, atol=1e-10).y
    z = z + 0.02 * z.std(axis=1, keepdims=True) * g.normal(size=z.shape)
    return {"t [s]": t, "u": force(t), "place": z[0], "speed": z[1]}


def sign(r, g):
    r["speed"] = -r["speed"]


def degrees(r, g):
    r["speed"] = r["speed"] * 180 / np.pi


def millimetres(r, g):
    r["place"] = r["place"] * 1000


def gravity(r, g):
    r["speed"] = r["speed"] * 9.80665


def swapped(r, g):
    r["place"], r["speed"] = r["speed"], r["place"]


def shifted(r, g):
    late = 24
    speed = r["speed"][:-late]
    for name in r:
        r[name] = r[name][late:]
    r["t [s]"] = r["t [s]"] - r["t [s]"][0]
    r["speed"] = speed


def column(r, g):
    n = len(r["place"])
    r["speed"] = np.sin(0.11 * np.arange(n)) + 0.02 * g.normal(size=n)


def constant(r, g):
    r["speed"] = np.full_like(r["speed"], 0.31)


def offset(r, g):
    r["place"] = r["place"] + 100


# kind, plant, outputs it touches, words that name the cause
KINDS = [
    ("wrong sign", sign, {"speed"}, ("sign",)),
    ("degrees", degrees, {"speed"}, ("unit", "factor", "multipl", "scale")),
    ("millimetres", millimetres, {"place"}, ("unit", "factor", "multipl", "scale")),
    ("times g", gravity, {"speed"}, ("unit", "factor", "multipl", "scale")),
    ("swapped channels", swapped, {"place", "speed"}, ("swap", "place", "exchange")),
    ("shifted time", shifted, {"speed"}, ("late", "delay")),
    ("wrong column", column, {"speed"}, ("not explained",)),
    ("constant output", constant, {"speed"}, ("never change", "constant", "not explained")),
    ("offset of 100", offset, {"place"}, ("offset", "too large", "too small")),
]


def said(fdm, folder, r):
    folder.mkdir(parents=True, exist_ok=True)
    names = list(r)
    table = np.column_stack([r[n] for n in names])
    np.savetxt(folder / "record.csv", table, delimiter=",", header=",".join(names), comments="", fmt="%.8g")
    (folder / "model.fdm").write_text(TEXT)
    words = [fdm, "fit", folder / "model.fdm", "--data", folder / "record.csv"]
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, timeout=300)
    told = subprocess.run([*map(str, words), "--json"], capture_output=True, text=True, timeout=300)
    lines = [line for line in done.stdout.splitlines() if line.strip()]
    head = lines[1:3] if len(lines) > 2 and lines[2].startswith("`fdm doctor`") else lines[1:2]
    return " ".join(head), json.loads(told.stdout) if told.stdout.strip() else {}, done


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("fdm")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=3)
    parser.add_argument("--clean", type=int, default=40)
    parser.add_argument("--seed", type=int, default=11)
    a = parser.parse_args()
    g, rows, scores = np.random.default_rng(a.seed), [], []
    for kind, plant, outputs, cause in KINDS:
        for draw in range(a.draws):
            r = record(g)
            plant(r, g)
            head, found, done = said(a.fdm, a.folder / "case", r)
            named = [o for o in outputs if f"`{o}`" in head]
            score = 3 if named and any(w in head for w in cause) else 2 if named else 1 if "remarks" in head or "did not" in head else 0
            scores.append(score)
            rows.append([kind, draw, done.returncode, score, head[:300]])
    alarms = 0
    for draw in range(a.clean):
        head, found, done = said(a.fdm, a.folder / "case", record(g))
        told = [x for x in found.get("remarks", []) if x["about"] == "unexplained"]
        alarms += bool(told)
        if told:
            rows.append(["clean", draw, done.returncode, "", head[:300]])
    with open(a.folder / "unexplained.csv", "w", newline="") as file:
        csv.writer(file).writerows([["kind", "draw", "exit", "score", "first"], *rows])
    for kind in dict.fromkeys(r[0] for r in rows if r[0] != "clean"):
        print(f"{kind:18} {[r[3] for r in rows if r[0] == kind]}")
    print(f"mean score {np.mean(scores):.2f} of 3 over {len(scores)}; unexplained in {alarms} of {a.clean} clean fits")


if __name__ == "__main__":
    main()
