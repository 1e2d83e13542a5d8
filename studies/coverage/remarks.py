"""How often each remark is made about fits of the right model: what chance alone says, over a panel of records.

    python3 studies/coverage/remarks.py [--repeats 250]

Needs numpy, scipy and `cargo build --release`; 2,000 fits with 250 repeats. Each remark may be made as often as its level says (1 or 5 %).
"""

import argparse
from collections import Counter

import numpy as np
from scipy.signal import lsim

from fits import cell, chance, table
from noises import first_order, white
from plants import PLANTS

PLANT = PLANTS["delay"]


def moved(time, chance):
    """A random multistep of the input."""
    return np.repeat(chance.choice([-1.0, -0.5, 0.0, 0.5, 1.0], size=len(time)), 8)[: len(time)]


def answer(time, u):
    """The response of the plant, an input straight between samples: exact between the places of a fine grid."""
    p = PLANT.truth
    count = max(20 * (len(time) - 1), 4000)
    fine = np.linspace(time[0], time[-1], count + 1)
    late = np.interp(np.maximum(fine - p["tau"], time[0]), time, u)
    system = ([[0.0, 1.0], [-p["w2"], -p["d"]]], [[0.0], [p["K"]]], [[1.0, 0.0]], [[0.0]])
    return np.interp(time, fine, lsim(system, late, fine - fine[0])[1])


def make(key, number):
    condition, random = key[0], chance(*key, number)
    text, options, noise, runs = PLANT.text, ["--domain", "time"], white, 1
    time = np.arange(400) * 0.05
    known = None
    if condition == "known noise":
        known = 0.05
    elif condition == "every 10th row":
        time = np.arange(1500) * 0.05
    elif condition == "uneven":
        time = np.cumsum(0.1 * random.uniform(0.4, 1.6, 150))
        time -= time[0]
    elif condition == "12 samples":
        time = np.arange(12) * 0.4
    elif condition == "30 samples":
        time = np.arange(30) * 0.25
    elif condition == "long, white":
        time = np.arange(2000) * 0.05
    elif condition == "AR(1)":
        time, noise = np.arange(1200) * 0.05, first_order
    elif condition == "several runs":
        runs = 4
    records = []
    for _ in range(runs):
        u = moved(time, random)
        y = answer(time, u)
        y = y + 0.05 * noise(random, len(time), PLANT)
        if condition == "every 10th row":
            y = np.where(np.arange(len(time)) % 10 == 0, y, np.nan)
        records.append(table(time, {"u": u, "y": y}))
    if known:
        options += ["--noise", f"y={known}"]
    return text, records, options, PLANT.truth


CONDITIONS = ["long, white", "AR(1)", "every 10th row", "uneven", "known noise", "12 samples", "30 samples", "several runs"]


def kind(about, sentence):
    """Remarks about an input say one of two things."""
    if about == "input":
        return "feedback" if "follows the output" in sentence else "input"
    return about


def main():
    parse = argparse.ArgumentParser()
    parse.add_argument("--repeats", type=int, default=250)
    parse.add_argument("--only", nargs="*", default=CONDITIONS, help="conditions")
    asked = parse.parse_args()
    kinds = ["input", "feedback", "offset", "colour", "variance", "white p < 0.01"]
    print("| records | fits | " + " | ".join(f"{k}, %" for k in kinds) + " | covers, % | others |")
    print("|---|---|" + "---|" * (len(kinds) + 2))
    for condition in asked.only:
        found = [f for f in cell("remarks", [condition], make, asked.repeats) if f.get("termination") == "converged"]
        count = Counter(k for f in found for k in {kind(*r) for r in f["remarks"]})
        count["white p < 0.01"] = sum(any(p < 0.01 for p in f["white"]) for f in found)
        hits = [p["interval"][0] <= PLANT.truth[n] <= p["interval"][1] for f in found for n, p in f["parameters"].items() if p["interval"]]
        others = {k: v for k, v in count.items() if k not in kinds}
        shares = " | ".join(f"{100 * count[k] / max(len(found), 1):.1f}" for k in kinds)
        said = ", ".join(f"{k} {100 * v / len(found):.0f}" for k, v in sorted(others.items()))
        print(f"| {condition} | {len(found)} | {shares} | {100 * np.mean(hits):.1f} | {said} |", flush=True)


if __name__ == "__main__":
    main()
