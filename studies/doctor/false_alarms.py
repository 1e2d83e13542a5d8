"""How often the doctor finds something in records by themselves that have no fault. The kinds are written without a look at its tests.

    python3 studies/doctor/false_alarms.py FOLDER [--fdm target/release/fdm] [--records 50] [--seed 3]
"""

import argparse
import collections
import json
import math
import random
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = 800


def coloured(dice, pole):
    """An AR(1) process of unit deviation."""
    value, values = dice.gauss(0, 1), []
    for _ in range(SAMPLES):
        value = pole * value + math.sqrt(1 - pole**2) * dice.gauss(0, 1)
        values.append(value)
    return values


def walk(dice):
    value, values = 0.0, []
    for _ in range(SAMPLES):
        value += dice.gauss(0, 1)
        values.append(value)
    return values


def oscillation(dice, decay):
    """A lightly damped answer with noise of two percent."""
    omega, phase = 2 * math.pi * dice.uniform(0.004, 0.05), dice.uniform(0, 6)
    return [math.exp(-decay * k / SAMPLES) * math.cos(omega * k + phase) + dice.gauss(0, 0.02) for k in range(SAMPLES)]


def steps(dice):
    """An input as a computer commands it: a level that is kept, and no noise."""
    values = []
    while len(values) < SAMPLES:
        values += [round(dice.uniform(-1, 1), 2)] * dice.randint(20, 120)
    return values[:SAMPLES]


def pulses(dice):
    """A doublet on a rest of zero."""
    begin, long, high = dice.randint(50, 300), dice.randint(10, 80), dice.uniform(0.1, 2)
    level = lambda k: high if begin <= k < begin + long else -high if begin + long <= k < begin + 2 * long else 0.0
    return [level(k) for k in range(SAMPLES)]


def heavy(dice):
    """Turbulence: bursts, whose deviation wanders."""
    scale = coloured(dice, 0.98)
    return [math.exp(0.7 * s) * v for s, v in zip(scale, coloured(dice, 0.8))]


KINDS = {
    "white noise": lambda d: coloured(d, 0.0),
    "AR(1), 0.95": lambda d: coloured(d, 0.95),
    "random walk": walk,
    "decaying oscillation": lambda d: oscillation(d, 4),
    "steady oscillation": lambda d: oscillation(d, 0),
    "steps of an input": steps,
    "doublet": pulses,
    "bursts": heavy,
    "AR(1), three digits": lambda d: [float(f"{v:.3g}") for v in coloured(d, 0.95)],
    "AR(1), twelve bits": lambda d: [round(v * 400) / 400 for v in coloured(d, 0.95)],
}


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--records", type=int, default=50)
    parser.add_argument("--seed", type=int, default=3)
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    for kind, made in KINDS.items():
        dice, alarms, faults = random.Random(f"{arguments.seed} {kind}"), 0, collections.Counter()
        for k in range(arguments.records):
            columns = [made(dice) for _ in range(4)]
            rows = [f"{0.02 * i:.6g}," + ",".join(f"{c[i]:.8g}" for c in columns) for i in range(SAMPLES)]
            path = arguments.folder / f"{kind.replace(' ', '_').replace(',', '')}_{k}.csv"
            path.write_text("t [s],a [m],b [m],c [m],d [m]\n" + "\n".join(rows) + "\n")
            told = subprocess.run([arguments.fdm, "doctor", "--data", path, "--json"], capture_output=True, text=True, check=True)
            findings = [f for f in json.loads(told.stdout)["findings"] if f["severity"] == "finding"]
            alarms += bool(findings)
            faults.update({f["fault"] for f in findings})
        named = ", ".join(f"{fault} {n}" for fault, n in faults.most_common())
        print(f"{kind:24} {alarms:4} of {arguments.records}  {named}", flush=True)


if __name__ == "__main__":
    main()
