"""Ten mistakes in the content of a record, scored from 0 to 3: a point each for being named, for being named first, for the right repair.

    python3 studies/doctor/mistakes.py FOLDER [--fdm target/release/fdm]
"""

import argparse
import json
import math
import random
from pathlib import Path

from panel import MODELS, ROOT, Record, clipped, delayed, fdm, milliseconds, repaired, scaled, sentinel, sign, stuck, swapped


def wrapped(record, name, dice):
    """A heading that jumps back at the end of its range, turning all the time."""
    values = [v + 0.4 * t for v, t in zip(record.column(name), record.columns[0])]
    record.put(name, [(v + math.pi) % (2 * math.pi) - math.pi for v in values])
    return {"fault": {"wrapped"}, "channels": {name}}


CASES = [
    ("swapped columns", "trex550", "first_half.csv", "phi_m", lambda r, n, d: swapped(r, n, d, other="theta_m")),
    ("degrees for radians", "trex550", "first_half.csv", "p_m", scaled(180 / math.pi)),
    ("milliseconds for seconds", "t33", "noise_2_percent.csv", "t", milliseconds),
    ("-9999 in five rows", "water_pump", "training.csv", "level", sentinel),
    ("frozen sensor", "water_pump", "training.csv", "level", stuck),
    ("the same run twice", "goodman_ship", "noise_2_percent.csv", "t", None),
    ("heading that wraps", "trex550", "first_half.csv", "psi_m", wrapped),
    ("opposite sign", "trex550", "first_half.csv", "q_m", sign),
    ("late channel", "trex550", "second_half.csv", "p_m", delayed(6)),
    ("saturated sensor", "ship_roll_decay", "run.csv", "roll", clipped),
]


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    total = 0
    for k, (title, model, file, name, plant) in enumerate(CASES):
        record = Record(MODELS / model / file)
        place = arguments.folder / f"mistake_{k}.csv"
        paths = [place]
        if plant is None:
            expected = {"fault": {"repeated"}, "channels": {"t"}}
            paths.append(MODELS / model / file)
        else:
            expected = plant(record, name, random.Random(k))
        record.write(place)
        words = [word for path in paths for word in ("--data", path)]
        done = fdm(arguments, "doctor", MODELS / model / "model.fdm", *words, "--json")
        if done.returncode == 2:
            print(f"0  {title}: refused: {done.stderr[:100]}", flush=True)
            continue
        found = [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"]
        named = [f for f in found if f["fault"] in expected["fault"] and expected["channels"] & set(f["channels"])]
        mended = bool(named) and repaired(named[0], expected, next(iter(expected["channels"])))
        points = (0 if not named else 1) + (1 if named and found[0] is named[0] else 0) + (1 if mended else 0)
        total += points
        first = f"{found[0]['channels']} {found[0]['fault']}" if found else "nothing"
        print(f"{points}  {title} in {name} of {model}: first {first}", flush=True)
    print(f"mean {total / len(CASES):.1f} of 3")


if __name__ == "__main__":
    main()
