"""How often the doctor finds a fault in clean records whose input is a command, without a model and beside one.

    python3 studies/right/commands.py FDM FOLDER [--draws 10] [--seed 5]

Ten kinds of input; the output is a first-order lag, exact for a held input, with 2 % of noise. At most 1 of 100 may have a finding.
"""

import argparse
import collections
import csv
import json
import subprocess
from pathlib import Path

import numpy as np

N, DT = 400, 0.05
TEXT = """model lag { input u; state x = free; param a = 1 in [0.01, 20] [1/s], b = 1 in [-50, 50] [1/s];
  der(x) = -a*x + b*u; output y = x; }
"""


def held_sine(g):
    every = int(g.integers(3, 12))
    k = np.arange(N) // every * every
    return np.sin(g.uniform(0.03, 0.12) * k)


def feedback(g):
    """A controller that holds what it made of a noisy sensor."""
    every = int(g.integers(4, 10))
    slow = np.cumsum(g.normal(size=N // every + 1)) * 0.2
    return np.repeat(slow, every)[:N]


def doublet(g):
    u, begin, long, high = np.zeros(N), int(g.integers(30, 120)), int(g.integers(10, 40)), g.uniform(0.2, 3)
    u[begin:begin + long], u[begin + long:begin + 2 * long] = high, -high
    return u + (g.uniform(-1, 1) if g.random() < 0.5 else 0)


def multistep(g):
    u, k = np.zeros(N), 40
    unit, high = int(g.integers(8, 20)), g.uniform(0.2, 3)
    for count, side in [(3, 1), (2, -1), (1, 1), (1, -1)]:
        u[k:k + count * unit] = side * high
        k += count * unit
    return u + 0.25


def noise(g):
    """A pseudo-random binary sequence."""
    unit = int(g.integers(3, 9))
    return np.repeat(g.integers(0, 2, N // unit + 1) * 2.0 - 1, unit)[:N]


def heater(g):
    """On where a slow temperature is below its set point, in parts of a hundred."""
    k = np.arange(N)
    return np.round(np.clip(60 * np.sin(0.03 * k + g.uniform(0, 6)), 0, 40), 0)


def stick(g):
    """A hand at a stick of 24 steps, at rest before and behind."""
    k = np.arange(N - 120)
    move = np.sin(0.05 * k) * np.sin(np.pi * k / len(k))
    return np.round(12 * np.r_[np.zeros(60), move, np.zeros(60)]) / 12


KINDS = {
    "held noise": lambda g: np.repeat(g.normal(size=N // 10 + 1), 10)[:N],
    "staircase": lambda g: np.round(np.clip(np.arange(N) // int(g.integers(15, 40)) * 0.1, 0, 1), 3),
    "gears": lambda g: np.repeat(g.integers(1, 6, N // 25 + 1), 25)[:N] * 1.0,
    "rest, then a sine": lambda g: g.uniform(-1, 1) + np.r_[np.zeros(60), np.sin(0.1 * np.arange(N - 60))],
    "held sine": held_sine,
    "held feedback": feedback,
    "doublet": doublet,
    "3-2-1-1": multistep,
    "binary noise": noise,
    "heater": heater,
    "stick": stick,
}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("fdm")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=10)
    parser.add_argument("--seed", type=int, default=5)
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    (a.folder / "lag.fdm").write_text(TEXT)
    g, rows, counts = np.random.default_rng(a.seed), [], collections.Counter()
    for kind, make in KINDS.items():
        for draw in range(a.draws):
            u, pole, gain, x, y = make(g), g.uniform(0.5, 3), g.uniform(0.5, 4), 0.0, []
            keeps = np.exp(-pole * DT)
            for v in u:
                y.append(x)
                x = keeps * x + (1 - keeps) / pole * gain * v
            y = np.array(y)
            y = y + 0.02 * y.std() * g.normal(size=N)
            path = a.folder / "record.csv"
            np.savetxt(path, np.c_[np.arange(N) * DT, u, y], delimiter=",", header="t [s],u,y", comments="", fmt="%.9g")
            for way, words in [("alone", []), ("beside", [a.folder / "lag.fdm"])]:
                zoh = ["--zoh", "u"] if words else []
                done = subprocess.run([a.fdm, "doctor", *words, "--data", path, *zoh, "--json"], capture_output=True, text=True)
                found = [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"]
                counts[way] += bool(found)
                rows += [[kind, draw, way, f["fault"], "+".join(f["channels"]), f["what"][:120]] for f in found]
    with open(a.folder / "commands.csv", "w", newline="") as file:
        csv.writer(file).writerows([["kind", "draw", "way", "fault", "channels", "what"], *rows])
    for row in rows:
        print(*row)
    total = len(KINDS) * a.draws
    print(f"records with a finding: {counts['alone']} of {total} alone, {counts['beside']} of {total} beside the model")


if __name__ == "__main__":
    main()
