"""Coverage of 95 % intervals by system, domain and noise, as a table in Markdown.

    python3 studies/coverage/coverage.py [--repeats 1000] [--only TEXT ..]

Needs numpy, scipy and `cargo build --release`. Shares no code with the tool: systems, integrators and noises are its own.
Finished fits are kept in `target/coverage`; remove it after a change of the tool.
"""

import argparse
from collections import Counter

import numpy as np

from fits import cell, chance, table
from noises import NOISES, record
from plants import PLANTS

# remarks that warn of the intervals
WARNINGS = ("intervals",)


def make(key, number):
    plant, domain, noise = PLANTS[key[0]], key[1], key[2]
    noisy = record(plant, noise, chance(*key, number))
    columns = dict(plant.inputs)
    columns.update({name: noisy[:, o] for o, name in enumerate(plant.names)})
    options = ["--domain", domain, *plant.options.get(domain, [])]
    return plant.text, [table(plant.time, columns)], options, plant.truth


def summary(fits, truth):
    """Coverage and bias of every parameter over the fits that ended well, and how often there is a warning."""
    good = [f for f in fits if f.get("termination") == "converged"]
    rows = {}
    for name, value in truth.items():
        found = [f["parameters"][name] for f in good]
        found = [p for p in found if p["interval"] is not None]
        hits = [p["interval"][0] <= value <= p["interval"][1] for p in found]
        errors = np.array([p["value"] - value for p in found])
        size = np.sqrt(np.mean([(p["error"] or np.nan) ** 2 for p in found])) if found else np.nan
        scatter = np.std(errors) if found else np.nan
        rows[name] = {
            "coverage": 100 * np.mean(hits) if hits else np.nan,
            "bias": np.mean(errors) / scatter if found else np.nan,
            "ratio": size / scatter if found else np.nan,
        }
    remarks = Counter(about for f in good for about in {about for about, _ in f["remarks"]})
    warned = np.mean([any(a in WARNINGS for a, _ in f["remarks"]) for f in good]) if good else np.nan
    return rows, len(good), remarks, 100 * warned


def main():
    parse = argparse.ArgumentParser()
    parse.add_argument("--repeats", type=int, default=1000)
    parse.add_argument("--only", nargs="*", default=[])
    parse.add_argument("--detail", action="store_true", help="every parameter and all remarks")
    asked = parse.parse_args()
    print("| system | domain | noise | covers, % | worst parameter | largest bias | error over scatter | warned, % |")
    print("|---|---|---|---|---|---|---|---|")
    for plant in PLANTS.values():
        for domain in plant.domains:
            for noise in NOISES:
                key = [plant.name, domain, noise]
                if not all(any(part in k for k in key) for part in asked.only):
                    continue
                fits = cell("coverage", key, make, asked.repeats)
                rows, good, remarks, warned = summary(fits, plant.truth)
                mean = np.mean([r["coverage"] for r in rows.values()])
                worst = min(rows, key=lambda name: rows[name]["coverage"])
                drawn = max(rows, key=lambda name: abs(rows[name]["bias"]))
                ratio = np.exp(np.mean([np.log(r["ratio"]) for r in rows.values()]))
                lost = "" if good == len(fits) else f" ({len(fits) - good} lost)"
                print(
                    f"| {plant.name} | {domain} | {noise}{lost} | {mean:.1f} | `{worst}` {rows[worst]['coverage']:.1f}"
                    f" | `{drawn}` {rows[drawn]['bias']:+.2f} | {ratio:.2f} | {warned:.0f} |",
                    flush=True,
                )
                if asked.detail:
                    print("   ", *(f"{k} {r['coverage']:.0f}/{r['bias']:+.2f}/{r['ratio']:.2f}" for k, r in rows.items()), dict(remarks))


if __name__ == "__main__":
    main()
