"""Panels of seeded faults for `fdm doctor`: twenty faults one at a time, ten pairs, twenty records without a fault.

    python3 studies/doctor/panel.py FOLDER --seed 1 [--generator multistep|multisine] [--fdm target/release/fdm] [--only clean,single,pairs]

The first panel (seed 1, multistep) may be looked at while the doctor is made; the second (seed 2, multisine: other records, other inputs,
coloured noise) is run once. A fault counts as named when it is the first finding, at its channel, with its repair.
"""

import argparse
import functools
import csv
import json
import math
import random
import subprocess
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"


class Record:
    """Columns over time, as text files hold them."""

    def __init__(self, path):
        lines = [l for l in path.read_text().splitlines() if l and not l.startswith("#")]
        rows = list(csv.reader(lines))
        self.titles = [t.strip() for t in rows[0]]
        self.columns = [[float(c) if c.strip() else math.nan for c in col] for col in zip(*rows[1:])]

    def names(self):
        return [t.split(" [")[0] for t in self.titles]

    def column(self, name):
        return self.columns[self.names().index(name)]

    def unit(self, name):
        title = self.titles[self.names().index(name)]
        return title.split("[")[1].rstrip("]") if "[" in title else None

    def put(self, name, values):
        self.columns[self.names().index(name)] = list(values)

    def unstate(self, name):
        """The header states no unit any more: the numbers are another unit's."""
        self.titles[self.names().index(name)] = name

    def interval(self):
        t = self.columns[0]
        return (t[-1] - t[0]) / (len(t) - 1)

    def write(self, path):
        cell = lambda v: "" if v != v else repr(v)
        text = [",".join(self.titles)] + [",".join(cell(v) for v in row) for row in zip(*self.columns)]
        path.write_text("\n".join(text) + "\n")


def deviation(values):
    known = [v for v in values if v == v]
    mean = sum(known) / len(known)
    return math.sqrt(sum((v - mean) ** 2 for v in known) / len(known))


# ---- what the records are: model, inputs [unit, size], outputs, length, interval
SIMULATED = {
    1: [
        ("hydrofoil/model.fdm", {"h_c": ("m", 0.3)}, 10.0, 0.04, 0.02),
        ("manoeuvring_ship/model.fdm", {"rudder": ("rad", 0.15)}, 40.0, 0.2, 0.02),
        ("hfb320/no_delay.fdm", {"stick": ("deg", 3.0)}, 20.0, 0.05, 0.02),
    ],
    2: [
        ("hfb320/model.fdm", {"stick": ("deg", 3.0)}, 25.0, 0.05, 0.03),
        ("hydrofoil/model.fdm", {"h_c": ("m", 0.5)}, 12.0, 0.05, 0.03),
        ("vstol/two_dof.fdm", None, 20.0, 0.1, 0.03),
    ],
}
REAL = {
    1: ["trex550/model.fdm trex550/first_half.csv", "ship_roll_decay/model.fdm ship_roll_decay/run.csv",
        "water_pump/model.fdm water_pump/training.csv", "pendulum_dfki/model.fdm pendulum_dfki/sac.csv"],
    2: ["trex550/model.fdm trex550/second_half.csv", "tclab/model.fdm tclab/sine_2.csv",
        "water_pump/model.fdm water_pump/test.csv", "pendulum_dfki/model.fdm pendulum_dfki/energy_shaping.csv"],
}


print = functools.partial(print, flush=True)


def fdm(arguments, *words):
    return subprocess.run([arguments.fdm, *map(str, words)], capture_output=True, text=True, timeout=1800)


def channels(arguments, model):
    """Names of inputs and outputs with their units."""
    shown = json.loads(fdm(arguments, "show", model, "--stage", "model", "--json").stdout)
    named = lambda role: {q["name"]: q.get("unit") for q in shown["names"] if q["role"] == role}
    return named("input"), named("output")


def multistep(dice, n, dt, size, k):
    """3-2-1-1, one input after the other."""
    unit, start = 0.5 + 0.4 * dice.random(), 1.0 + 2.5 * k
    edges, level = [(start, 1), (start + 3 * unit, -1), (start + 5 * unit, 1), (start + 6 * unit, -1), (start + 7 * unit, 0)], 0
    values = []
    for i in range(n):
        level = next((s for at, s in reversed(edges) if i * dt >= at), 0)
        values.append(size * level)
    return values


def multisine(dice, n, dt, size, k):
    tones = [(f, dice.uniform(0, 2 * math.pi)) for f in [(2 + 3 * (i * 4 + k)) / (n * dt) for i in range(5)]]
    return [size * 0.5 * sum(math.sin(2 * math.pi * f * i * dt + p) for f, p in tones) for i in range(n)]


def simulated(arguments, folder, case, seed, generator):
    """A record of a model with parameters near its start values and noise of a part of each output's deviation."""
    model, inputs, length, dt, noise = case
    dice = random.Random(f"{model}/{seed}")
    model = MODELS / model
    known, outputs = channels(arguments, model)
    if inputs is None:
        inputs = {name: (unit, 0.05 if unit in ("rad", "m", "1", None) else 1.0) for name, unit in known.items()}
    n = int(length / dt) + 1
    drive = folder / f"drive_{seed}.csv"
    make = multistep if generator == "multistep" else multisine
    columns = {name: make(dice, n, dt, size, k) for k, (name, (unit, size)) in enumerate(inputs.items())}
    titles = ["t [s]"] + [f"{name} [{unit or 1}]" for name, (unit, _) in inputs.items()]
    rows = [[repr(i * dt)] + [repr(columns[name][i]) for name in inputs] for i in range(n)]
    drive.write_text("\n".join([",".join(titles)] + [",".join(r) for r in rows]) + "\n")
    out = folder / f"clean_{seed}.csv"
    done = fdm(arguments, "simulate", model, "--data", drive, "-o", out, "--force")
    if not out.exists():
        raise SystemExit(f"{model}: {done.stderr}")
    record = Record(out)
    for name, values in columns.items():
        if name not in record.names():
            record.titles.append(f"{name} [{inputs[name][0] or 1}]")
            record.columns.append(values)
    for name in outputs:
        sigma, left = noise * deviation(record.column(name)), 0.0
        noisy = []
        for v in record.column(name):
            # white in the first panel; first-order in the second
            fresh = dice.gauss(0, sigma)
            left = fresh if generator == "multistep" else 0.5 * left + fresh
            noisy.append(v + left)
        record.put(name, noisy)
    record.write(out)
    return model, out


# ---- faults: each takes a record and what it is to plant, and says what must be found
def lagged(values, by):
    """The values `by` samples later, between samples linear."""
    n = len(values)
    at = lambda x: values[0] if x <= 0 else values[min(int(x), n - 1)] + (x - int(x)) * (
        values[min(int(x) + 1, n - 1)] - values[min(int(x), n - 1)])
    return [at(i - by) for i in range(n)]


def scaled(factor):
    def plant(record, name, dice):
        record.put(name, [v * factor for v in record.column(name)])
        record.unstate(name)
        return {"fault": {"unit"}, "channels": {name}, "scale": 1 / factor}
    return plant


def sign(record, name, dice):
    record.put(name, [-v for v in record.column(name)])
    return {"fault": {"sign"}, "channels": {name}, "sign": -1}


def swapped(record, name, dice, other=None):
    a, b = record.column(name), record.column(other)
    record.put(name, b)
    record.put(other, a)
    return {"fault": {"swapped", "axes"}, "channels": {name, other}}


def delayed(by):
    def plant(record, name, dice):
        record.put(name, lagged(record.column(name), by))
        return {"fault": {"delay"}, "channels": {name}, "delay": by * record.interval()}
    return plant


def offset(record, name, dice):
    shift = 0.7 * deviation(record.column(name))
    record.put(name, [v + shift for v in record.column(name)])
    return {"fault": {"offset"}, "channels": {name}, "offset": -shift}


def spikes(record, name, dice):
    values, size = list(record.column(name)), 6 * deviation(record.column(name))
    for k in dice.sample(range(5, len(values) - 5), 5):
        values[k] += size * dice.choice([-1, 1])
    record.put(name, values)
    return {"fault": {"spikes"}, "channels": {name}}


def stuck(record, name, dice):
    values = list(record.column(name))
    length = max(12, len(values) // 20)
    first = dice.randrange(len(values) // 6, len(values) // 2)
    values[first:first + length] = [values[first]] * length
    record.put(name, values)
    return {"fault": {"stuck"}, "channels": {name}}


def clipped(record, name, dice):
    values = record.column(name)
    mean = sum(values) / len(values)
    rail = mean + 0.6 * (max(values) - mean)
    record.put(name, [min(v, rail) for v in values])
    return {"fault": {"clipped"}, "channels": {name}}


def sentinel(record, name, dice):
    values = list(record.column(name))
    for k in dice.sample(range(len(values)), 5):
        values[k] = -9999.0
    record.put(name, values)
    return {"fault": {"sentinel"}, "channels": {name}}


def dropout(record, name, dice):
    n = len(record.columns[0])
    first, length = dice.randrange(n // 4, n // 2), max(8, n // 30)
    record.columns = [c[:first] + c[first + length:] for c in record.columns]
    return {"fault": {"gap"}, "channels": {"t"}}


def doubled(record, name, dice):
    """The logger repeats rows under new stamps."""
    n = len(record.columns[0])
    rows = dice.sample(range(5, n - 5), 10)
    for k in rows:
        for column in record.columns[1:]:
            column[k] = column[k - 1]
    return {"fault": {"doubled_rows"}, "channels": {"t"}}


def jitter(record, name, dice):
    dt = record.interval()
    record.columns[0] = [t + dt * 0.25 * dice.uniform(-1, 1) for t in record.columns[0]]
    return {"fault": {"uneven_time"}, "channels": {"t"}}


def quantised(record, name, dice):
    values = record.column(name)
    step = (max(values) - min(values)) / 14
    record.put(name, [step * round(v / step) for v in values])
    return {"fault": {"quantised"}, "channels": {name}}


def milliseconds(record, name, dice):
    record.columns[0] = [1000 * t for t in record.columns[0]]
    record.titles[0] = record.titles[0].split(" [")[0]
    return {"fault": {"time_unit"}, "channels": {"t"}}


def held(record, name, dice):
    values = record.column(name)
    record.put(name, [values[k - k % 4] for k in range(len(values))])
    return {"fault": {"held_samples"}, "channels": {name}}


def drift(record, name, dice):
    values, n = record.column(name), len(record.columns[0])
    record.put(name, [lagged_at(values, k - 12 * k / n) for k in range(n)])
    return {"fault": {"drift"}, "channels": {name}}


def lagged_at(values, x):
    k = min(max(int(x), 0), len(values) - 2)
    return values[k] + (x - k) * (values[k + 1] - values[k])


def missing(record, name, dice):
    record.put(name, [0.0] * len(record.columns[0]))
    return {"fault": {"constant", "not_determined"}, "channels": {name}, "remark": True}


# name, plant, what it needs of a channel: role and units
FAULTS = [
    ("degrees for radians", scaled(180 / math.pi), "output", ("rad", "rad/s")),
    ("feet for metres", scaled(1 / 0.3048), "output", ("m", "m/s", "m/s^2")),
    ("radians for degrees", scaled(math.pi / 180), "any", ("deg", "deg/s")),
    ("sign of an output", sign, "output", None),
    ("sign of an input", sign, "input", None),
    ("swapped outputs", swapped, "pair", None),
    ("late output", delayed(6), "output", None),
    ("late input", delayed(6), "input", None),
    ("offset of an output", offset, "output", None),
    ("spikes", spikes, "output", None),
    ("stuck sensor", stuck, "output", None),
    ("saturated sensor", clipped, "output", None),
    ("sentinels", sentinel, "output", None),
    ("dropout", dropout, "time", None),
    ("doubled rows", doubled, "time", None),
    ("jitter", jitter, "time", None),
    ("coarse quantisation", quantised, "output", None),
    ("milliseconds", milliseconds, "time", None),
    ("held samples", held, "output", None),
    ("drift of a clock", drift, "output", None),
]


def candidates(record, inputs, outputs, wanted, units):
    measured = {n: u for n, u in outputs.items() if n in record.names()}
    given = {n: u for n, u in inputs.items() if n in record.names()}
    if wanted == "time":
        return [("t", None)] if len(measured) + len(given) > 1 else []
    if wanted == "pair":
        names = list(measured)
        return [(a, b) for i, a in enumerate(names) for b in names[i + 1:] if measured[a] == measured[b]]
    pool = {"output": measured, "input": given, "any": {**measured, **given}}[wanted]
    fits = lambda n: (units is None or record.unit(n) in units) and deviation(record.column(n)) > 0
    return [(n, None) for n in pool if fits(n)]


def judge(arguments, model, path):
    limit = ["--time-limit", arguments.limit] if arguments.limit else []
    done = fdm(arguments, "doctor", model, "--data", path, "--json", *limit)
    if done.returncode == 2:
        return None, done.stderr.strip().splitlines()[:1]
    found = json.loads(done.stdout)["findings"]
    return [f for f in found if f["severity"] == "finding"], found


def repaired(finding, expected, name):
    """Whether the repair is the right one, within a tenth (a delay: within two samples or a fifth)."""
    repair = finding.get("repair") or {}
    change = repair.get("channels", {}).get(name, {})
    near = lambda a, b, part: abs(a - b) <= part * abs(b)
    if "scale" in expected:
        return near(change.get("factor", 1), expected["scale"], 0.02)
    if "sign" in expected:
        return change.get("factor") == -1
    if "delay" in expected:
        return near(change.get("delay", 0), expected["delay"], 0.2)
    if "offset" in expected:
        return near(change.get("offset", 0), expected["offset"], 0.25)
    if expected["fault"] == {"time_unit"}:
        return repair.get("time_unit") == "ms"
    return bool(repair.get("line"))


def right(finding, expected):
    if finding["fault"] not in expected["fault"] or not expected["channels"] & set(finding["channels"]):
        return False
    return repaired(finding, expected, next(iter(expected["channels"])))


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--generator", choices=["multistep", "multisine"], default="multistep")
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--only", default="clean,single,pairs")
    parser.add_argument("--limit", help="longest time for a record, such as 60s")
    arguments = parser.parse_args()
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    dice = random.Random(arguments.seed)
    panel = 1 if arguments.seed % 2 else 2
    bases, clean = [], []
    for k, case in enumerate(SIMULATED[panel]):
        for repeat in range(5):
            made = simulated(arguments, folder, case, f"{arguments.seed}_{k}_{repeat}", arguments.generator)
            clean.append(made)
            if repeat == 0:
                bases.append(made)
    real = [tuple(MODELS / part for part in pair.split()) for pair in REAL[panel]]
    clean = clean[:16] + real
    bases += real
    score = {}
    if "clean" in arguments.only:
        bad = 0
        for model, path in clean[:20]:
            found, _ = judge(arguments, model, path)
            if found:
                bad += 1
                print(f"clean  {model.parent.name}/{path.name}: {found[0]['channels']} {found[0]['fault']}: {found[0]['what'][:90]} ({found[0]['log_odds']:.1f})")
            if found is None:
                print(f"clean  {model.parent.name}/{path.name}: refused {_}")
        score["clean records with a finding"] = f"{bad} of {len(clean[:20])}"
    plan = []
    for title, plant, wanted, units in FAULTS:
        fitting = []
        for model, path in bases:
            record, (inputs, outputs) = Record(path), channels(arguments, model)
            fitting += [(model, path, c) for c in candidates(record, inputs, outputs, wanted, units)]
        # every record has the same chance, whatever its number of channels
        models = sorted({(str(m), str(p)) for m, p, _ in fitting})
        if not models:
            print(f"no record for {title}")
            continue
        chosen = dice.choice(models)
        plan.append((title, plant, dice.choice([f for f in fitting if (str(f[0]), str(f[1])) == chosen])))
    if "single" in arguments.only:
        good = 0
        for title, plant, (model, path, (name, other)) in plan:
            record = Record(path)
            more = {"other": other} if other else {}
            expected = plant(record, name, random.Random(f"{arguments.seed}/{title}"), **more)
            place = folder / f"fault_{title.replace(' ', '_')}.csv"
            record.write(place)
            found, said = judge(arguments, model, place)
            ok = bool(found) and right(found[0], expected)
            anywhere = bool(found) and any(right(f, expected) for f in found)
            good += ok
            first = f"{found[0]['channels']} {found[0]['fault']} ({found[0]['log_odds']:.0f}) {found[0]['what'][:70]}" if found else f"nothing {said if found is None else ''}"
            print(f"{'RIGHT' if ok else 'later' if anywhere else 'WRONG'}  {title} in {name} of {model.parent.name}: {first}")
        score["named first with the right repair"] = f"{good} of {len(plan)}"
    if "pairs" in arguments.only:
        both = either = 0
        count = 0
        while count < 10:
            (a, plant_a, (model, path, (name_a, other_a))), (b, plant_b, _) = dice.sample(plan, 2)
            wanted = next(f for f in FAULTS if f[0] == b)
            record = Record(path)
            inputs, outputs = channels(arguments, model)
            options = [c for c in candidates(record, inputs, outputs, wanted[2], wanted[3]) if c[0] != name_a and c[0] != other_a and c[1] not in (name_a, other_a) or c[1] is None and c[0] != name_a]
            if not options:
                continue
            name_b, other_b = dice.choice(options)
            count += 1
            luck = random.Random(f"{arguments.seed}/{a}/{b}")
            expected = [plant_a(record, name_a, luck, **({"other": other_a} if other_a else {}))]
            expected.append(plant_b(record, name_b, luck, **({"other": other_b} if other_b else {})))
            place = folder / f"pair_{count}.csv"
            record.write(place)
            found, said = judge(arguments, model, place)
            hits = [bool(found) and any(right(f, e) for f in found) for e in expected]
            both += all(hits)
            either += any(hits)
            print(f"pair   {a} in {name_a} and {b} in {name_b} of {model.parent.name}: {sum(hits)} of 2; {[(f['channels'], f['fault']) for f in found or []]}")
        score["pairs with both named"] = f"{both} of {count}, at least one in {either}"
    for what, figure in score.items():
        print(f"{what}: {figure}")


if __name__ == "__main__":
    main()
