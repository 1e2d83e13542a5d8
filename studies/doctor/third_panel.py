"""A third panel for `fdm doctor`, made by other means than both before: models as `fdm new` writes them, records integrated here by small Euler steps,
pulses, pseudo-random steps and pulled-out sines as inputs, coloured and rounded noise, faults written anew. Twenty faults one by one, eight pairs,
twenty records without a fault. It is run once.

    python3 studies/doctor/third_panel.py FOLDER [--fdm target/release/fdm] [--seed 3141] [--part clean,single,pairs]

A single fault is right when it is the first finding, at its channel, with its repair. A pair is right when both are among the findings with their
repairs; "first" counts those before which nothing else stands.
"""

import argparse
import json
import math
import random
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"


# ---- inputs
def levels(dice, n, high, shortest, longest):
    """Pseudo-random steps of a few samples each, between samples never: as a computer commands."""
    values = []
    while len(values) < n:
        values += [high * dice.choice([-1, 0, 1])] * dice.randint(shortest, longest)
    return values[:n]


def pulses(dice, n, high, length):
    """Single pulses of either sign with long rests."""
    values, at = [0.0] * n, dice.randint(length // 2, length)
    while at + length < n:
        sign = dice.choice([-1, 1])
        for k in range(at, at + length):
            values[k] = sign * high
        at += dice.randint(2 * length, 5 * length)
    return values


def slow_sines(dice, n, high):
    """Three sines, of which none repeats within the record."""
    tones = [(dice.uniform(1.3, 9.0) * 2 * math.pi / n, dice.uniform(0, 6.3)) for _ in range(3)]
    return [high * sum(math.sin(w * k + p) for w, p in tones) / 2 for k in range(n)]


def sensor(dice, values, size, pole=0.0, digit=None):
    """Noise of first order, and the last digit of a converter."""
    left, out = 0.0, []
    for v in values:
        left = pole * left + math.sqrt(1 - pole * pole) * dice.gauss(0, size)
        v += left
        out.append(digit * round(v / digit) if digit else v)
    return out


# ---- what moves: interval, columns (name, unit, role, values)
def quadrotor(dice):
    n, dt, parts = 1200, 0.01, 10
    command = levels(dice, n, 0.06, 8, 60) if dice.random() < 0.5 else pulses(dice, n, 0.1, 20)
    tau, gain, damping, bias = 0.05 * dice.uniform(0.8, 1.25), 60 * dice.uniform(0.8, 1.25), -1.2 * dice.uniform(0.8, 1.25), dice.gauss(0, 0.02)
    motor = p = phi = 0.0
    rows = []
    for k in range(n):
        rows.append((p + bias, phi))
        for i in range(parts):
            h, late = dt / parts, command[max(k - 1, 0)]
            motor += h * (late - motor) / tau
            p += h * (gain * motor + damping * p)
            phi += h * p
    rate = sensor(dice, [r[0] for r in rows], 0.01)
    angle = sensor(dice, [r[1] for r in rows], 0.003, 0.3)
    return dt, [("command", "1", "input", command), ("p_m", "rad/s", "output", rate), ("phi_m", "rad", "output", angle)]


def servo(dice):
    n, dt, parts = 1000, 0.005, 25
    voltage = slow_sines(dice, n, 8.0) if dice.random() < 0.5 else levels(dice, n, 9.0, 20, 120)
    k, inertia, friction, coil = 0.05 * dice.uniform(0.8, 1.25), 0.012 * dice.uniform(0.8, 1.25), 0.02 * dice.uniform(0.8, 1.25), 1e-3
    i = w = a = 0.0
    rows = []
    for s in range(n):
        rows.append((i, w, a))
        for j in range(parts):
            h = dt / parts
            # the record says lines between samples where it moves slowly
            i += h * (voltage[s] - 1.2 * i - 10 * k * w) / coil
            w += h * (10 * k * i - friction * w) / inertia
            a += h * w
    columns = [("voltage", "V", "input", voltage)]
    for c, (name, unit, size, digit) in enumerate([("current", "A", 0.05, None), ("rate", "1/s", 0.1, None), ("angle", "1", 0.0, 0.001)]):
        columns.append((name, unit, "output", sensor(dice, [r[c] for r in rows], size, 0.0, digit)))
    return dt, columns


def heater(dice):
    n, dt, parts = 700, 4.0, 20
    power = [max(0.0, v) for v in levels(dice, n, 8.0, 30, 90)]
    room = [293 + 0.8 * math.sin(2 * math.pi * k / n * dice.uniform(0.8, 1.2)) for k in range(n)]
    heat, loss, lag = 10 * dice.uniform(0.8, 1.25), 0.1 * dice.uniform(0.8, 1.25), 20 * dice.uniform(0.8, 1.25)
    body = seen = 293.0
    rows = []
    for k in range(n):
        rows.append(seen)
        for _ in range(parts):
            h = dt / parts
            body += h * (power[k] + loss * (room[k] - body)) / heat
            seen += h * (body - seen) / lag
    return dt, [("power", "W", "input", power), ("ambient", "K", "input", sensor(dice, room, 0.02)), ("T", "K", "output", sensor(dice, rows, 0.08, 0.4))]


def batch(dice):
    n, dt, parts = 500, 10.0, 50
    jacket = [330 + v for v in levels(dice, n, 12.0, 25, 80)]
    k_ref, energy, cooling, rise = 1e-3 * dice.uniform(0.7, 1.2), 5e4 * dice.uniform(0.85, 1.15), 2e-3 * dice.uniform(0.8, 1.25), 12 * dice.uniform(0.8, 1.25)
    a, temp = 2.0 * dice.uniform(0.8, 1.2), 318.0
    rows = []
    for k in range(n):
        rows.append((a, temp))
        for _ in range(parts):
            h = dt / parts
            rate = k_ref * math.exp(-energy / 8.31446 * (1 / temp - 1 / 330)) * a
            a -= h * rate
            temp += h * (rise * rate + cooling * (jacket[k] - temp))
    return dt, [("jacket", "K", "input", jacket), ("A", "mol/L", "output", sensor(dice, [r[0] for r in rows], 0.01)),
                ("T", "K", "output", sensor(dice, [r[1] for r in rows], 0.1, 0.3))]


KINDS = {"quadrotor_axis": quadrotor, "servo": servo, "thermal": heater, "batch": batch}
REAL = [("tclab/model.fdm", "tclab/sine_2.csv"), ("pendulum_dfki/model.fdm", "pendulum_dfki/energy_shaping.csv"),
        ("pendulum_dfki/viscous.fdm", "pendulum_dfki/ddp.csv"), ("delays/model.fdm", "delays/run.csv"),
        ("t33/model.fdm", "t33/clean.csv"), ("goodman_ship/model.fdm", "goodman_ship/clean.csv"),
        ("ship_roll_decay/linear.fdm", "ship_roll_decay/run.csv"), ("trex550/flap.fdm", "trex550/first_half.csv")]


class Sheet:
    """A record: for every column its name, unit (or none), role and values."""

    def __init__(self, model, columns):
        self.model, self.columns = model, [list(c) for c in columns]

    def copy(self):
        return Sheet(self.model, [(n, u, r, list(v)) for n, u, r, v in self.columns])

    def write(self, path):
        title = lambda c: c[0] if c[1] is None else f"{c[0]} [{c[1]}]"
        cell = lambda v: "" if v != v else f"{v:.9g}"
        rows = zip(*(c[3] for c in self.columns))
        path.write_text("\n".join([",".join(map(title, self.columns))] + [",".join(map(cell, row)) for row in rows]) + "\n")


def made(arguments, kind, tag):
    dice = random.Random(f"{arguments.seed} {kind} {tag}")
    model = arguments.folder / f"{kind}.fdm"
    if not model.exists():
        subprocess.run([arguments.fdm, "new", model.name, "--kind", kind.replace("_", "-")], cwd=arguments.folder, check=True, capture_output=True)
    dt, columns = KINDS[kind](dice)
    clock = [round(k * dt, 9) for k in range(len(columns[0][3]))]
    return Sheet(model, [("t", "s", "time", clock), *columns])


def real(arguments, model, path):
    lines = [line.split(",") for line in (MODELS / path).read_text().splitlines() if line and not line.startswith("#")]
    shown = subprocess.run([arguments.fdm, "show", MODELS / model, "--stage", "model", "--json"], capture_output=True, text=True)
    roles = {q["name"]: q["role"] for q in json.loads(shown.stdout)["names"]}
    columns = []
    for k, title in enumerate(lines[0]):
        name, _, unit = title.strip().partition(" [")
        values = [float(row[k]) if row[k].strip() else math.nan for row in lines[1:]]
        role = "time" if k == 0 else roles.get(name, "other")
        columns.append((name, unit.rstrip("]") or None, role if role in ("time", "input", "output") else "other", values))
    return Sheet(MODELS / model, columns)


# ---- faults: each changes a sheet and says what a finding must hold
def size(values):
    known = [v for v in values if v == v]
    mean = sum(known) / len(known)
    return math.sqrt(sum((v - mean) ** 2 for v in known) / len(known))


def interval(sheet):
    t = sheet.columns[0][3]
    return (t[-1] - t[0]) / (len(t) - 1)


def other_unit(factor, shift=0.0, silent=True):
    def plant(sheet, k, dice):
        column = sheet.columns[k]
        column[3] = [factor * v + shift for v in column[3]]
        if silent:
            column[1] = None
        return {"faults": {"unit"}, "names": {column[0]}, "factor": 1 / factor, **({"offset": -shift / factor} if shift else {})}
    return plant


def minus(sheet, k, dice):
    sheet.columns[k][3] = [-v for v in sheet.columns[k][3]]
    return {"faults": {"sign"}, "names": {sheet.columns[k][0]}, "factor": -1}


def crossed(sheet, k, dice):
    outputs = [j for j, c in enumerate(sheet.columns) if c[2] == "output" and j != k]
    j = dice.choice(outputs)
    a, b = sheet.columns[k], sheet.columns[j]
    a[3], b[3] = b[3], a[3]
    return {"faults": {"swapped"}, "names": {a[0], b[0]}}


def behind(by):
    def plant(sheet, k, dice):
        values = sheet.columns[k][3]
        sheet.columns[k][3] = [values[max(i - by, 0)] for i in range(len(values))]
        return {"faults": {"delay"}, "names": {sheet.columns[k][0]}, "delay": by * interval(sheet)}
    return plant


def all_behind(sheet, k, dice):
    outputs = [c for c in sheet.columns if c[2] == "output"]
    for c in outputs:
        c[3] = [c[3][max(i - 8, 0)] for i in range(len(c[3]))]
    return {"faults": {"delay"}, "names": {c[0] for c in outputs}, "delay": 8 * interval(sheet)}


def smoothed(sheet, k, dice):
    """A first-order filter of twelve samples, in the sensor's box: its own noise behind it."""
    values, y, out = sheet.columns[k][3], sheet.columns[k][3][0], []
    for v in values:
        y += (v - y) * (1 - math.exp(-1 / 12))
        out.append(y)
    rough = size([b - a for a, b in zip(values, values[1:])]) / 2
    sheet.columns[k][3] = [v + dice.gauss(0, rough) for v in out]
    return {"faults": {"filtered"}, "names": {sheet.columns[k][0]}}


def biased(sheet, k, dice):
    by = dice.choice([-1, 1]) * 0.8 * size(sheet.columns[k][3])
    sheet.columns[k][3] = [v + by for v in sheet.columns[k][3]]
    return {"faults": {"offset"}, "names": {sheet.columns[k][0]}, "offset": -by}


def jumping(sheet, k, dice):
    values = sheet.columns[k][3]
    at, by = dice.randrange(len(values) // 3, 2 * len(values) // 3), dice.choice([-1, 1]) * 0.8 * size(values)
    sheet.columns[k][3] = [v + (by if i >= at else 0) for i, v in enumerate(values)]
    return {"faults": {"zero_shift"}, "names": {sheet.columns[k][0]}}


def other_clock(sheet, k, dice):
    values, n = sheet.columns[k][3], len(sheet.columns[k][3])
    place = [i * (1 - 15 / n) for i in range(n)]
    sheet.columns[k][3] = [values[int(p)] + (p - int(p)) * (values[min(int(p) + 1, n - 1)] - values[int(p)]) for p in place]
    return {"faults": {"drift"}, "names": {sheet.columns[k][0]}}


def outliers(sheet, k, dice):
    values, big = sheet.columns[k][3], 7 * size(sheet.columns[k][3])
    for i in dice.sample(range(8, len(values) - 8), 3):
        values[i] += dice.choice([-1, 1]) * big
    return {"faults": {"spikes"}, "names": {sheet.columns[k][0]}}


def frozen(sheet, k, dice):
    values = sheet.columns[k][3]
    at, long = dice.randrange(len(values) // 4, len(values) // 2), len(values) // 15
    values[at:at + long] = [values[at]] * long
    return {"faults": {"stuck"}, "names": {sheet.columns[k][0]}}


def cut(sheet, k, dice):
    ordered = sorted(sheet.columns[k][3])
    low, high = ordered[len(ordered) // 20], ordered[-len(ordered) // 20]
    sheet.columns[k][3] = [min(max(v, low), high) for v in sheet.columns[k][3]]
    return {"faults": {"clipped"}, "names": {sheet.columns[k][0]}}


def nothing_there(sheet, k, dice):
    for i in dice.sample(range(len(sheet.columns[k][3])), 4):
        sheet.columns[k][3][i] = -32768.0
    return {"faults": {"sentinel"}, "names": {sheet.columns[k][0]}}


def torn(sheet, k, dice):
    n = len(sheet.columns[0][3])
    at, long = dice.randrange(n // 4, n // 2), n // 25
    for c in sheet.columns:
        del c[3][at:at + long]
    return {"faults": {"gap"}, "names": {"t"}}


def shaky(sheet, k, dice):
    dt = interval(sheet)
    sheet.columns[0][3] = [t + 0.35 * dt * dice.random() for t in sheet.columns[0][3]]
    return {"faults": {"uneven_time"}, "names": {"t"}}


def thousands(sheet, k, dice):
    sheet.columns[0][3], sheet.columns[0][1] = [1000 * t for t in sheet.columns[0][3]], None
    return {"faults": {"time_unit"}, "names": {"t"}, "time": "ms"}


def twice(sheet, k, dice):
    for i in dice.sample(range(9, len(sheet.columns[0][3]) - 9), 9):
        for c in sheet.columns[1:]:
            c[3][i] = c[3][i - 1]
    return {"faults": {"doubled_rows"}, "names": {"t"}}


def rounded(sheet, k, dice):
    values = sheet.columns[k][3]
    step = (max(values) - min(values)) / 16
    sheet.columns[k][3] = [step * round(v / step) for v in values]
    return {"faults": {"quantised"}, "names": {sheet.columns[k][0]}}


DEG = 180 / math.pi
# title, what is planted, the models and the role or channel that it is planted in
SINGLES = [
    ("degrees per second", other_unit(DEG), ["quadrotor_axis"], "p_m"), ("degrees", other_unit(DEG), ["quadrotor_axis"], "phi_m"),
    ("degrees Celsius", other_unit(1, -273.15), ["thermal", "batch"], "T"), ("per cent", other_unit(100), ["quadrotor_axis"], "command"),
    ("sign of an output", minus, ["quadrotor_axis", "servo"], "output"), ("sign of an input", minus, ["quadrotor_axis", "servo"], "input"),
    ("crossed outputs", crossed, ["quadrotor_axis", "servo"], "output"), ("late output", behind(5), ["quadrotor_axis", "servo", "batch"], "output"),
    ("all outputs late", all_behind, ["servo"], "output"), ("filtered output", smoothed, ["quadrotor_axis", "servo"], "output"),
    ("zero", biased, ["servo", "batch"], "output"), ("zero that moves", jumping, ["servo", "quadrotor_axis", "batch"], "output"),
    ("another clock", other_clock, ["servo", "quadrotor_axis"], "output"), ("outliers", outliers, list(KINDS), "output"),
    ("frozen sensor", frozen, list(KINDS), "output"), ("rails", cut, ["quadrotor_axis", "servo"], "output"),
    ("missing values", nothing_there, list(KINDS), "output"), ("torn record", torn, list(KINDS), "time"),
    ("shaky stamps", shaky, list(KINDS), "time"), ("milliseconds", thousands, ["quadrotor_axis", "servo", "thermal"], "time"),
]
PAIRS = SINGLES + [("repeated rows", twice, list(KINDS), "time"), ("coarse", rounded, ["quadrotor_axis", "servo"], "output")]


def places(sheet, wanted):
    if wanted == "time":
        return [0]
    return [k for k, c in enumerate(sheet.columns) if c[0] == wanted or c[2] == wanted]


def is_right(finding, wanted):
    if finding["fault"] not in wanted["faults"] or not wanted["names"] & set(finding["channels"]):
        return False
    repair = finding.get("repair") or {}
    change = next((c for n, c in sorted(repair.get("channels", {}).items()) if n in wanted["names"]), {})
    near = lambda key, usual, part: abs(change.get(key, usual) - wanted[key]) <= part * abs(wanted[key])
    if "factor" in wanted and not near("factor", 1, 0.03) or "offset" in wanted and not near("offset", 0, 0.25):
        return False
    if "delay" in wanted and not near("delay", 0, 0.25):
        return False
    if "time" in wanted and repair.get("time_unit") != wanted["time"]:
        return False
    return bool(repair.get("line"))


def judged(arguments, sheet, name):
    path, begin = arguments.folder / name, time.time()
    sheet.write(path)
    command = [arguments.fdm, "doctor", str(sheet.model), "--data", str(path), "--json", "-q", "--time-limit", "60s"]
    done = subprocess.run(command, capture_output=True, text=True)
    took = time.time() - begin
    if done.returncode == 2:
        return None, took, done.stderr.strip()[:200]
    return [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"], took, ""


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--seed", type=int, default=3141)
    parser.add_argument("--part", default="single,pairs,clean")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    say = lambda found, said: said if found is None else "; ".join(f"{f['fault']} {','.join(f['channels'])} ({f['log_odds']:.0f})" for f in found) or "nothing"
    score, times = {}, []
    if "single" in arguments.part:
        right = 0
        for k, (title, plant, kinds, wanted) in enumerate(SINGLES):
            dice = random.Random(f"{arguments.seed} single {k}")
            kind = dice.choice(kinds)
            sheet = made(arguments, kind, 100 + k)
            expected = plant(sheet, dice.choice(places(sheet, wanted)), dice)
            found, took, said = judged(arguments, sheet, f"single_{k}.csv")
            times.append(took)
            good = bool(found) and is_right(found[0], expected)
            later = bool(found) and any(is_right(f, expected) for f in found)
            right += good
            mark = "RIGHT" if good else "later" if later else "WRONG"
            print(f"{mark}  {title} in {','.join(sorted(expected['names']))} of {kind}, {took:.1f} s: {say(found, said)}", flush=True)
        score["single faults named first with the right repair"] = f"{right} of {len(SINGLES)}"
    if "pairs" in arguments.part:
        both = one = count = tried = 0
        while count < 8:
            dice = random.Random(f"{arguments.seed} pair {tried}")
            tried += 1
            kind = dice.choice(sorted(KINDS))
            fitting = [f for f in PAIRS if kind in f[2] and f[1] not in (all_behind, crossed)]
            first, second = dice.sample(fitting, 2)
            sheet = made(arguments, kind, 200 + count)
            a, b = dice.choice(places(sheet, first[3])), dice.choice(places(sheet, second[3]))
            if a == b:
                continue
            expected = [first[1](sheet, a, dice), second[1](sheet, b, dice)]
            found, took, said = judged(arguments, sheet, f"pair_{count}.csv")
            times.append(took)
            hits = [any(is_right(f, e) for f in found or []) for e in expected]
            both, one, count = both + all(hits), one + any(hits), count + 1
            names = [f"{f[0]} in {','.join(sorted(e['names']))}" for f, e in zip((first, second), expected)]
            print(f"{sum(hits)} of 2  {' and '.join(names)} of {kind}, {took:.1f} s: {say(found, said)}", flush=True)
        score["pairs with both named"] = f"{both} of {count}, at least one in {one}"
    if "clean" in arguments.part:
        alarms = 0
        clean = [(f"{kind} {k}", made(arguments, kind, k)) for k in range(3) for kind in sorted(KINDS)]
        clean += [(f"{path} beside {model}", real(arguments, model, path)) for model, path in REAL]
        for k, (title, sheet) in enumerate(clean):
            found, took, said = judged(arguments, sheet, f"clean_{k}.csv")
            times.append(took)
            alarms += bool(found) or found is None
            print(f"clean  {title}, {took:.1f} s: {say(found, said)}", flush=True)
        score["records without a fault that have a finding"] = f"{alarms} of {len(clean)}"
    for what, figure in score.items():
        print(f"{what}: {figure}")
    print(f"time: median {sorted(times)[len(times) // 2]:.1f} s, longest {max(times):.1f} s")


if __name__ == "__main__":
    main()
