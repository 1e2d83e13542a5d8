"""A second panel for `fdm doctor`, made by other means than the first: vehicles and processes with integrators of their own, other real records,
other inputs, faults written anew. Twelve single faults, eight pairs, twenty records without a fault. It is run once.

    python3 studies/doctor/second_panel.py FOLDER [--fdm target/release/fdm] [--seed 77] [--part clean|cases] [--list]

A single fault is right when it is the first finding, with its channel and repair. A pair is right when both are among the findings with their
repairs, and nothing else stands before them.
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
DEG = math.pi / 180


# ---- integration and inputs
def integrate(f, x, n, dt, parts=8):
    """Runge and Kutta's fourth order; the states at each sample."""
    rows, h = [], dt / parts
    for k in range(n):
        rows.append(list(x))
        for i in range(parts):
            t = k * dt + i * h
            a = f(t, x)
            b = f(t + h / 2, [v + h / 2 * d for v, d in zip(x, a)])
            c = f(t + h / 2, [v + h / 2 * d for v, d in zip(x, b)])
            d = f(t + h, [v + h * e for v, e in zip(x, c)])
            x = [v + h / 6 * (p + 2 * q + 2 * r + s) for v, p, q, r, s in zip(x, a, b, c, d)]
    return rows


def sweep(dice, size, length, low=0.05, high=0.8):
    """A frequency sweep that fades in and out."""
    begin, phase = dice.uniform(0.02, 0.1) * length, dice.uniform(0, 2 * math.pi)
    span = length * dice.uniform(0.75, 0.85)

    def at(t):
        s = (t - begin) / span
        if not 0 <= s <= 1:
            return 0.0
        turn = low * s + (high - low) * (math.exp(3 * s) - 1 - 3 * s) / (3 * (math.exp(3) - 1))
        return size * math.sin(math.pi * min(1, 8 * s, 8 * (1 - s)) / 2) * math.sin(2 * math.pi * turn * span + phase)
    return at


def telegraph(dice, size, length, usual):
    """Steps between levels at random times."""
    edges, t = [], dice.uniform(0.3, 1) * usual
    while t < length:
        edges.append((t, size * dice.choice([-1, -0.5, 0, 0.5, 1])))
        t += dice.expovariate(1 / usual) + 0.3 * usual
    return lambda t: next((level for at, level in reversed(edges) if t >= at), 0.0)


# ---- vehicles and processes: columns (name, unit, role, values), and the text of their model
def aircraft(dice):
    """A light aircraft in coupled motion about all axes; the model knows its short period alone."""
    n, dt, speed = 900, 0.04, dice.uniform(45, 70)
    elevator, aileron = sweep(dice, 0.04, n * dt), telegraph(dice, 0.05, n * dt, 2.0)
    za, ma, mq, md, lp, ld, lb, yb, nb, nr, npr = (
        -1.4 * dice.uniform(0.8, 1.2), -9 * dice.uniform(0.8, 1.2), -2.2 * dice.uniform(0.8, 1.2), -14 * dice.uniform(0.8, 1.2),
        -5.0, 12.0, -4.0, -0.2, 3.0, -0.5, -0.3)

    def f(t, x):
        a, q, th, b, p, r, ph, ps = x
        e, l = elevator(t), aileron(t)
        g = 9.80665 / speed
        return [q + za * a + g * (math.cos(th) * math.cos(ph) - 1), ma * a + mq * q + md * e,
                q * math.cos(ph) - r * math.sin(ph), yb * b - r + g * math.sin(ph) * math.cos(th),
                lb * b + lp * p + ld * l, nb * b + nr * r + npr * p,
                p + math.tan(th) * (q * math.sin(ph) + r * math.cos(ph)), (q * math.sin(ph) + r * math.cos(ph)) / math.cos(th)]
    rows = integrate(f, [0.0] * 8, n, dt)
    column = lambda k: [r[k] for r in rows]
    columns = [("de", "rad", "input", [elevator(k * dt) for k in range(n)])]
    for name, unit, k, noise in [("alpha_m", "rad", 0, 0.0008), ("q_m", "rad/s", 1, 0.002), ("theta", "rad", 2, 0.0006),
                                 ("p", "rad/s", 4, 0.003), ("r", "rad/s", 5, 0.002), ("phi", "rad", 6, 0.001), ("psi", "rad", 7, 0.001)]:
        role = "output" if name.endswith("_m") else "other"
        columns.append((name, unit, role, [v + dice.gauss(0, noise) for v in column(k)]))
    text = """model light_aircraft "short period" {
  input de [rad];
  state alpha [rad], q [rad/s];
  param Za = -1.4 [1/s], Ma = -9 [1/s^2], Mq = -2.2 [1/s], Md = -14 [1/s^2], b1 = 0 [rad/s], b2 = 0 [rad/s^2];
  der(alpha) = q + Za*alpha + b1;
  der(q) = Ma*alpha + Mq*q + Md*de + b2;
  output alpha_m [rad] = alpha, q_m [rad/s] = q;
}"""
    return dt, columns, text


def ferry(dice):
    """A ship by Nomoto's second order, with its track."""
    n, dt = 700, 1.0
    rudder = telegraph(dice, 0.25, n * dt, 45.0)
    gain, lag, cubic = 0.06 * dice.uniform(0.8, 1.2), 18 * dice.uniform(0.8, 1.2), 900.0

    def f(t, x):
        r, psi, px, py = x
        return [(gain * rudder(t) - r - cubic * r**3) / lag, r, 7 * math.cos(psi), 7 * math.sin(psi)]
    rows = integrate(f, [0.0] * 4, n, dt)
    columns = [("rudder", "rad", "input", [rudder(k * dt) for k in range(n)])]
    for name, unit, role, k, noise in [("r_m", "rad/s", "output", 0, 2e-4), ("psi_m", "rad", "output", 1, 0.004)]:
        columns.append((name, unit, role, [row[k] + dice.gauss(0, noise) for row in rows]))
    text = """model ferry "Nomoto with a cubic term" {
  input rudder [rad];
  state r [rad/s], psi [rad];
  param K = 0.06 [1/s], T = 18 [s], c = 900 [s^2];
  der(r) = (K*rudder - r - c*r^3/1[rad^2])/T;
  der(psi) = r;
  output r_m [rad/s] = r, psi_m [rad] = psi;
}"""
    text = text.replace("c*r^3/1[rad^2]", "c*r^3").replace("c = 900 [s^2]", "c = 900 [s^2/rad^2]")
    return dt, columns, text


def reactor(dice):
    """A stirred tank with a first-order exothermic reaction; temperature and concentration."""
    n, dt = 600, 0.5
    coolant, feed = telegraph(dice, 4.0, n * dt, 25.0), telegraph(dice, 0.15, n * dt, 40.0)
    k0, e, ua, heat = 0.06 * dice.uniform(0.8, 1.2), 6500.0, 0.09 * dice.uniform(0.8, 1.2), 18.0

    def f(t, x):
        c, temp = x
        rate = k0 * math.exp(-e * (1 / temp - 1 / 320)) * c
        return [0.05 * (1 + feed(t) - c) - rate, 0.05 * (310 - temp) + heat * rate + ua * (308 + coolant(t) - temp)]
    rows = integrate(f, [0.45, 313.0], n, dt)
    columns = [("Tc", "K", "input", [308 + coolant(k * dt) for k in range(n)]),
               ("cf", "mol/l", "input", [1 + feed(k * dt) for k in range(n)]),
               ("c_m", "mol/l", "output", [r[0] + dice.gauss(0, 0.003) for r in rows]),
               ("T_m", "K", "output", [r[1] + dice.gauss(0, 0.05) for r in rows])]
    text = """model tank "stirred tank" {
  input Tc [K], cf [mol/l];
  state c [mol/l] = free, T [K] = free;
  param k0 = 0.06 in [0.001, 1] [1/s], E = 6500 in [0, 20000] [K], ua = 0.09 in [0.001, 1] [1/s], h = 18 in [0, 100] [K*l/mol];
  const D = 0.05 [1/s], Tf = 310 [K], T0 = 320 [K];
  let rate = k0*exp(-E*(1/T - 1/T0))*c;
  der(c) = D*(cf - c) - rate;
  der(T) = D*(Tf - T) + h*rate + ua*(Tc - T);
  output c_m [mol/l] = c, T_m [K] = T;
}"""
    return dt, columns, text


def drive(dice):
    """A motor with an elastic load: current in, both angles and the motor's rate out."""
    n, dt = 800, 0.01
    current = sweep(dice, 2.0, n * dt, 0.3, 4.0)
    kt, d, k, jm, jl, dm = 0.5 * dice.uniform(0.8, 1.2), 0.05, 60 * dice.uniform(0.8, 1.2), 0.02, 0.05, 0.03

    def f(t, x):
        am, wm, al, wl = x
        twist = k * (am - al) + d * (wm - wl)
        return [wm, (kt * current(t) - dm * wm - twist) / jm, wl, twist / jl]
    rows = integrate(f, [0.0] * 4, n, dt)
    columns = [("i", "A", "input", [current(k * dt) for k in range(n)])]
    for name, unit, k_, noise in [("motor", "rad", 0, 0.004), ("motor_rate", "rad/s", 1, 0.05), ("load", "rad", 2, 0.004)]:
        columns.append((name, unit, "output", [row[k_] + dice.gauss(0, noise) for row in rows]))
    text = """model drive "two masses" {
  input i [A];
  state am [rad], wm [rad/s], al [rad], wl [rad/s];
  param kt = 0.5 [N*m/A], k = 60 [N*m/rad], d = 0.05 [N*m*s/rad], dm = 0.03 [N*m*s/rad];
  const Jm = 0.02 [kg*m^2], Jl = 0.05 [kg*m^2];
  let twist = k*(am - al) + d*(wm - wl);
  der(am) = wm;
  der(wm) = (kt*i - dm*wm - twist)/Jm;
  der(al) = wl;
  der(wl) = twist/Jl;
  output motor [rad] = am, motor_rate [rad/s] = wm, load [rad] = al;
}"""
    return dt, columns, text


MADE = {"aircraft": aircraft, "ferry": ferry, "reactor": reactor, "drive": drive}
REAL = [("pendulum_dfki/model.fdm", "pendulum_dfki/ddp.csv"), ("tclab/model.fdm", "tclab/step_1.csv"),
        ("tclab/model.fdm", "tclab/sine_1.csv"), ("trex550/rigid_body.fdm", "trex550/second_half.csv"),
        ("goodman_ship/model.fdm", "goodman_ship/noise_2_percent.csv"), ("t33/model.fdm", "t33/noise_2_percent.csv"),
        ("pendulum_free_swing/model.fdm", "pendulum_free_swing/run.csv"), ("water_pump/model.fdm", "water_pump/test.csv")]


class Table:
    """A record in memory: titles with units, roles, columns, the first of which is the time."""

    def __init__(self, model, titles, roles, columns):
        self.model, self.titles, self.roles, self.columns = model, titles, roles, columns

    @staticmethod
    def made(kind, dice, folder, tag):
        dt, columns, text = MADE[kind](dice)
        model = folder / f"{kind}.fdm"
        model.write_text(text + "\n")
        time_ = [round(k * dt, 9) for k in range(len(columns[0][3]))]
        digits = lambda values: [float(f"{v:.7g}") for v in values]
        return Table(model, ["t [s]"] + [f"{c[0]} [{c[1]}]" for c in columns], ["time"] + [c[2] for c in columns],
                     [time_] + [digits(c[3]) for c in columns])

    @staticmethod
    def real(model, path, arguments):
        lines = [l.split(",") for l in (MODELS / path).read_text().splitlines() if l and not l.startswith("#")]
        columns = [[float(c) if c.strip() else math.nan for c in col] for col in zip(*lines[1:])]
        shown = json.loads(subprocess.run([arguments.fdm, "show", MODELS / model, "--stage", "model", "--json"], capture_output=True, text=True).stdout)
        role = {q["name"]: q["role"] for q in shown["names"] if q["role"] in ("input", "output")}
        roles = ["time"] + [role.get(t.split(" [")[0].strip(), "other") for t in lines[0][1:]]
        return Table(MODELS / model, [t.strip() for t in lines[0]], roles, columns)

    def copy(self):
        return Table(self.model, list(self.titles), list(self.roles), [list(c) for c in self.columns])

    def name(self, k):
        return self.titles[k].split(" [")[0]

    def unit(self, k):
        return self.titles[k].split("[")[1].rstrip("]") if "[" in self.titles[k] else None

    def write(self, path):
        cell = lambda v: "" if v != v else repr(v)
        path.write_text("\n".join([",".join(self.titles)] + [",".join(map(cell, row)) for row in zip(*self.columns)]) + "\n")


def deviation(values):
    known = [v for v in values if v == v]
    mean = sum(known) / len(known)
    return math.sqrt(sum((v - mean) ** 2 for v in known) / len(known))


# ---- faults: change a table, and say what a finding must hold
def rescaled(factors):
    def plant(table, k, dice):
        factor, silent = dice.choice(factors[table.unit(k)]), dice.random() < 0.5
        name = table.name(k)
        table.columns[k] = [v * factor for v in table.columns[k]]
        if silent:
            table.titles[k] = name
        return {"faults": {"unit"}, "names": {name}, "factor": 1 / factor}
    return plant


def celsius(table, k, dice):
    name = table.name(k)
    table.columns[k], table.titles[k] = [v - 273.15 for v in table.columns[k]], name
    return {"faults": {"unit"}, "names": {name}, "shift": 273.15}


def negated(table, k, dice):
    table.columns[k] = [-v for v in table.columns[k]]
    return {"faults": {"sign", "axes"}, "names": {table.name(k)}, "factor": -1}


def exchanged(table, pair, dice):
    a, b = pair
    table.columns[a], table.columns[b] = table.columns[b], table.columns[a]
    return {"faults": {"swapped", "axes"}, "names": {table.name(a), table.name(b)}, "from": table.name(b)}


def late(table, k, dice):
    by, old = dice.choice([4, 7, 10]), table.columns[k]
    table.columns[k] = [old[max(i - by, 0)] for i in range(len(old))]
    interval = (table.columns[0][-1] - table.columns[0][0]) / (len(old) - 1)
    return {"faults": {"delay"}, "names": {table.name(k)}, "delay": by * interval, "interval": interval}


def shifted(table, k, dice):
    by = dice.choice([-1, 1]) * dice.uniform(0.5, 1.2) * deviation(table.columns[k])
    table.columns[k] = [v + by for v in table.columns[k]]
    return {"faults": {"offset"}, "names": {table.name(k)}, "shift": -by}


def spiked(table, k, dice):
    size, values = deviation(table.columns[k]), table.columns[k]
    for i in dice.sample(range(10, len(values) - 10), 4):
        values[i] += dice.choice([-1, 1]) * size * dice.uniform(5, 9)
    return {"faults": {"spikes"}, "names": {table.name(k)}}


def frozen(table, k, dice):
    values = table.columns[k]
    length = len(values) // dice.choice([12, 20, 30])
    at = dice.randrange(len(values) // 5, len(values) * 3 // 5)
    values[at:at + length] = [values[at]] * length
    return {"faults": {"stuck"}, "names": {table.name(k)}}


def railed(table, k, dice):
    values = sorted(table.columns[k])
    rail = values[int(0.92 * len(values))]
    table.columns[k] = [min(v, rail) for v in table.columns[k]]
    return {"faults": {"clipped"}, "names": {table.name(k)}}


def empty(table, k, dice):
    for i in dice.sample(range(len(table.columns[k])), 6):
        table.columns[k][i] = -999.0
    return {"faults": {"sentinel"}, "names": {table.name(k)}}


def lost(table, _, dice):
    n = len(table.columns[0])
    at, length = dice.randrange(n // 3, n * 2 // 3), n // 40
    table.columns = [c[:at] + c[at + length:] for c in table.columns]
    return {"faults": {"gap"}, "names": {"t"}}


def busy(table, _, dice):
    t = table.columns[0]
    dt = (t[-1] - t[0]) / (len(t) - 1)
    table.columns[0] = [v + min(0.45, abs(dice.gauss(0, 0.12))) * dt for v in t]
    return {"faults": {"uneven_time"}, "names": {"t"}}


def coarse(table, k, dice):
    values = table.columns[k]
    step = (max(values) - min(values)) / 20
    table.columns[k] = [round(step * math.floor(v / step), 12) for v in values]
    return {"faults": {"quantised"}, "names": {table.name(k)}}


def slow(table, k, dice):
    every, values = dice.choice([3, 5]), table.columns[k]
    table.columns[k] = [values[i - i % every] for i in range(len(values))]
    return {"faults": {"held_samples"}, "names": {table.name(k)}}


def ticks(table, _, dice):
    table.columns[0], table.titles[0] = [1000 * t for t in table.columns[0]], "t"
    return {"faults": {"time_unit"}, "names": {"t"}, "time": "ms"}


def repeated_rows(table, _, dice):
    for i in dice.sample(range(10, len(table.columns[0]) - 10), 12):
        for column in table.columns[1:]:
            column[i] = column[i - 1]
    return {"faults": {"doubled_rows"}, "names": {"t"}}


def turned(table, k, dice):
    """A heading that is shown between 0 and 360 degrees."""
    turn = 2 * math.pi
    table.columns[k] = [(3 * v + 3.0) % turn for v in table.columns[k]]
    return {"faults": {"wrapped"}, "names": {table.name(k)}, "wrap": turn}


FACTORS = {"rad": [1 / DEG], "rad/s": [1 / DEG], "deg": [DEG], "deg/s": [DEG], "m/s": [1 / 0.514444, 3.6], "ft/s": [0.3048]}
FAULTS = [
    ("unit", rescaled(FACTORS), lambda t, k: t.unit(k) in FACTORS),
    ("celsius", celsius, lambda t, k: t.unit(k) == "K" and t.roles[k] == "output"),
    ("sign", negated, lambda t, k: True),
    ("exchange", exchanged, "pair"),
    ("late", late, lambda t, k: t.roles[k] != "input"),
    ("zero", shifted, lambda t, k: t.roles[k] == "output" and t.unit(k) in ("rad", "rad/s", "K", "mol/l")),
    ("spikes", spiked, lambda t, k: t.roles[k] != "input"),
    ("frozen", frozen, lambda t, k: t.roles[k] != "input"),
    ("rail", railed, lambda t, k: t.roles[k] != "input"),
    ("sentinel", empty, lambda t, k: True),
    ("lost rows", lost, "time"),
    ("jitter", busy, "time"),
    ("coarse", coarse, lambda t, k: t.roles[k] != "input"),
    ("slow sensor", slow, lambda t, k: t.roles[k] != "input"),
    ("milliseconds", ticks, "time"),
    ("repeated rows", repeated_rows, "time"),
]


def places(table, wanted):
    if wanted == "time":
        return [None]
    moving = [k for k in range(1, len(table.columns)) if deviation(table.columns[k]) > 0 and (
        table.roles[k] != "other" or table.name(k) in ("phi", "theta", "p", "r", "psi", "phi_m", "theta_m", "r_m"))]
    if wanted == "pair":
        measured = [k for k in moving if table.roles[k] != "input"]
        return [(a, b) for i, a in enumerate(measured) for b in measured[i + 1:] if table.unit(a) == table.unit(b)]
    return [k for k in moving if wanted(table, k)]


def matches(finding, wanted):
    if finding["fault"] not in wanted["faults"] or not wanted["names"] & set(finding["channels"]):
        return False
    repair = finding.get("repair") or {}
    changes = repair.get("channels", {})
    change = next((changes[n] for n in sorted(wanted["names"]) if n in changes), {})
    if "factor" in wanted and abs(change.get("factor", 1) / wanted["factor"] - 1) > 0.03:
        return False
    if "shift" in wanted and abs(change.get("offset", 0) / wanted["shift"] - 1) > 0.25:
        return False
    if "delay" in wanted and abs(change.get("delay", 0) - wanted["delay"]) > max(0.2 * wanted["delay"], 1.01 * wanted["interval"]):
        return False
    if "time" in wanted and repair.get("time_unit") != wanted["time"]:
        return False
    return bool(repair.get("line"))


def judged(arguments, table, path):
    table.write(path)
    begin = time.time()
    limit = ["--time-limit", arguments.limit] if arguments.limit else []
    command = [arguments.fdm, "doctor", str(table.model), "--data", str(path), "--json", *limit]
    done = subprocess.run(command, capture_output=True, text=True)
    took = time.time() - begin
    if done.returncode == 2:
        return None, took, done.stderr.strip().splitlines()[:2]
    return [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"], took, ""


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--seed", type=int, default=77)
    parser.add_argument("--part", choices=["clean", "cases"], help="only the records without a fault, or only the faults")
    parser.add_argument("--limit", help="longest time for a record, such as 60s")
    parser.add_argument("--list", action="store_true", help="write the records and what is planted, judge nothing")
    arguments = parser.parse_args()
    folder = arguments.folder
    folder.mkdir(parents=True, exist_ok=True)
    dice = random.Random(arguments.seed)
    made = lambda k: Table.made(sorted(MADE)[k % 4], random.Random(f"{arguments.seed} {k}"), folder, k)
    real = [Table.real(*pair, arguments) for pair in REAL]
    clean = [(f"made {k}", made(k)) for k in range(12)] + [(path, t) for (_, path), t in zip(REAL, real)]
    say = lambda found: "; ".join(f"{f['fault']} {','.join(f['channels'])} ({f['log_odds']:.0f})" for f in found) or "nothing"
    alarms, times = 0, []
    for k, (title, table) in enumerate(clean):
        if arguments.list:
            table.write(folder / f"clean_{k}.csv")
            continue
        if arguments.part == "cases":
            continue
        found, took, said = judged(arguments, table.copy(), folder / f"clean_{k}.csv")
        times.append(took)
        alarms += bool(found) or found is None
        print(f"clean  {title} ({table.model.stem}), {took:.1f} s: {said if found is None else say(found)}", flush=True)
    right = both = one = 0
    pool = lambda: dice.choice([made(100 + dice.randrange(1000)), made(100 + dice.randrange(1000)), dice.choice(real)]).copy()
    order = FAULTS * 2
    dice.shuffle(order)
    count = 0
    while count < (0 if arguments.part == "clean" else 20):
        table, planted = pool(), [order[count], *([order[-1 - count]] if count >= 12 else [])]
        expected, words, used = [], [], set()
        for title, plant, wanted in planted:
            options = [p for p in places(table, wanted) if not used & set(p if isinstance(p, tuple) else [p])]
            if not options:
                break
            place = dice.choice(options)
            used |= set(place if isinstance(place, tuple) else [place])
            wanted_finding = plant(table, place, dice)
            expected.append(wanted_finding)
            words.append(f"{title} in {','.join(sorted(wanted_finding['names']))}")
        if len(expected) < len(planted) or len({w for w in words}) < len(words):
            continue
        if arguments.list:
            table.write(folder / f"case_{count}.csv")
            print(f"{count} {table.model}: {'; '.join(words)}")
            count += 1
            continue
        found, took, said = judged(arguments, table, folder / f"case_{count}.csv")
        times.append(took)
        hits = [any(matches(f, e) for f in found or []) for e in expected]
        first = [any(matches(f, e) for e in expected) for f in (found or [])[:len(expected)]]
        good = all(hits) and len(first) == len(expected) and all(first)
        if len(expected) == 1:
            right += good
        else:
            both, one = both + all(hits), one + any(hits)
        mark = "RIGHT" if good else "later" if all(hits) else "part " if any(hits) else "WRONG"
        print(f"{mark}  {' and '.join(words)} ({table.model.parent.name}/{table.model.stem}), {took:.1f} s: {said if found is None else say(found)}", flush=True)
        count += 1
    if not arguments.list:
        print(f"single faults named first with the right repair: {right} of 12")
        print(f"pairs with both named: {both} of 8, at least one in {one}")
        print(f"records without a fault that have a finding: {alarms} of {len(clean)}")
        print(f"time: median {sorted(times)[len(times) // 2]:.1f} s, longest {max(times):.1f} s")


if __name__ == "__main__":
    main()
