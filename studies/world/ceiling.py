"""What a judge who knows the noise and every effect of the family would name: beside the figures of score.py.

    python3 studies/world/ceiling.py CASES [CASES ...]

For each case with one effect: the gain of every effect of its family in all records of the case, by the covariance that the noise was drawn
with, to first order in the parameters. Nobody who has records only can know as much: the noise has to be found, and the catalogue has five
times as many candidates. Very large effects are beyond first order: the judge misses a few of them. He names the effect that gains most, and believes it where a chance of 0.01 among all is passed.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from cases import NAMES, beside_parameters, drawn, gains
from families import FAMILIES
from motion import Hidden
from score import STEADY, matches

# nats behind the best that are still its group: odds of 100 : 1
GROUP = 4.6
CHANCE = 0.01


def judged(path):
    """Gain of the best, whether a right name is the best one, and whether one is in its group."""
    truth = json.loads(path.read_text())
    bench = drawn(FAMILIES[truth["family"]], "single", int(truth["case"].rsplit("-", 1)[1]), truth["attempt"])
    family = bench.family
    hidden = [(Hidden(h["kind"], h["place"], h["other"], fixed=h["fixed"]), h["size"]) for h in truth["hidden"]]
    y, _ = bench.simulate([(e, np.array([s])) for e, s in hidden])
    measured = bench.noisy(y[..., 0])
    record = np.loadtxt(path.parent / "run_1.csv", delimiter=",", skiprows=1)
    assert np.allclose(record[:, 1 + len(family.inputs):], measured[:, :, 0], rtol=1e-9, atol=1e-9), truth["case"]
    bench.runs += bench.validation
    base, records, off = beside_parameters(bench, [])
    found = gains(bench, [], off, base, records, off(bench.direction(measured[..., None], base, records))[:, 0])

    def right(effect):
        places = [effect.place] + [effect.other] * (effect.other != "")
        return any(matches(truth["right"][0], {"effect": n, "targets": places}) for n in NAMES.get(effect.kind, [effect.kind]))

    own = max(gain for key, gain in found.items() if right(next(e for e in family.effects if e.key == key)))
    best = max(found.values())
    believed = best > np.log(len(found) / CHANCE)
    return truth, bool(believed and own == best), bool(believed and own > best - GROUP)


def main():
    ask = argparse.ArgumentParser()
    ask.add_argument("cases", type=Path, nargs="+")
    rows = [judged(p) for folder in ask.parse_args().cases for p in sorted(folder.glob("*-single-*/truth.json"))]
    strong = [r for r in rows if r[0]["gain"] >= 15]
    weak = [r for r in rows if r[0]["gain"] < 15]
    steady = [r for r in strong if r[0]["hidden"][0]["kind"] in STEADY]

    def share(rows, column):
        return f"{np.mean([r[column] for r in rows]):.2f} ({sum(r[column] for r in rows)} of {len(rows)})" if rows else "-"

    print("| a judge who knows noise and family | |")
    print("|---|---|")
    print(f"| gain above 15: named first | {share(strong, 1)} |")
    print(f"| gain above 15: in the group | {share(strong, 2)} |")
    print(f"| gain 5 to 15: in the group | {share(weak, 2)} |")
    print(f"| constant forces, offsets, drifts: in the group | {share(steady, 2)} |")
    for truth, first, group in strong:
        if not first:
            print(f"- `{truth['case']}` {truth['hidden'][0]['kind']} {truth['gain']:.0f} nats, {truth['colour']}: " + ("in the group" if group else "not in the group"))


if __name__ == "__main__":
    main()
