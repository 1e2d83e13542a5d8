"""A fourth panel for `fdm doctor`, by other means than the three before: a car, an underwater vehicle, two axes of a helicopter and a chain of reactions,
integrated by the implicit midpoint rule, driven by random telegraphs through a smooth edge, by chirps and by pulses; sensors with a resolution.
Ten single faults, four pairs, ten records without a fault. It is run once.

    python3 studies/doctor/fourth_panel.py FOLDER [--fdm target/release/fdm] [--seed 2718] [--limit 60s]

A single fault is right when it is the first finding, with its channel and repair; a pair when both are among the findings with their repairs.
"""

import argparse
import json
import math
import random
import subprocess
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TURN = 2 * math.pi


# ---- motion
def midpoint(rate, x, n, dt, parts=4):
    """The implicit midpoint rule, its equation solved by iteration; the states at each sample."""
    rows, h = [], dt / parts
    for k in range(n):
        rows.append(list(x))
        for i in range(parts):
            t, new = k * dt + (i + 0.5) * h, list(x)
            for _ in range(12):
                slope = rate(t, [0.5 * (a + b) for a, b in zip(x, new)])
                new = [a + h * s for a, s in zip(x, slope)]
            x = new
    return rows


def edges(luck, size, span, usual, rise):
    """Levels at random times, with straight edges between them."""
    points, t, level = [(0.0, 0.0)], luck.uniform(0.2, 0.6) * usual, 0.0
    while t < span:
        points += [(t, level), (t + rise, level := size * luck.uniform(-1, 1))]
        t += rise + usual * luck.uniform(0.4, 1.6)
    points.append((span + usual, level))

    def at(s):
        for (a, u), (b, v) in zip(points, points[1:]):
            if a <= s <= b:
                return u + (v - u) * (s - a) / max(b - a, 1e-12)
        return points[-1][1]
    return at


def chirp(luck, size, span, slow, fast):
    phase, start = luck.uniform(0, TURN), luck.uniform(0.02, 0.08) * span
    return lambda t: 0.0 if t < start else size * math.sin(phase + TURN * (slow * (t - start) + 0.5 * (fast - slow) * (t - start) ** 2 / span))


def pulses(luck, size, span, usual):
    """Raised cosines of either sign."""
    places, t = [], usual * luck.uniform(0.3, 0.7)
    while t < span:
        places.append((t, usual * luck.uniform(0.3, 0.6), size * luck.choice([-1, 1]) * luck.uniform(0.5, 1)))
        t += usual * luck.uniform(0.8, 1.4)
    return lambda s: sum(0.5 * h * (1 - math.cos(TURN * (s - a) / w)) for a, w, h in places if a < s < a + w)


def near(luck, value):
    return value * luck.uniform(0.82, 1.2)


# ---- what moves: interval, channels as (name, unit, role, noise, values), text of the model
def car(luck):
    n, dt, speed = 900, 0.02, luck.uniform(18, 30)
    steer = edges(luck, 0.05, n * dt, 1.8, 0.25)
    yv, yr, yd, nv, nr, nd = near(luck, -5.0), near(luck, 1.2), near(luck, 70.0), near(luck, 1.1), near(luck, -4.5), near(luck, 45.0)
    rows = midpoint(lambda t, x: [yv * x[0] + (yr - speed) * x[1] + yd * steer(t), nv * x[0] + nr * x[1] + nd * steer(t), x[1]], [0.0] * 3, n, dt)
    text = """model car "single track" {{
  input steer [rad];
  state v [m/s], r [rad/s], psi [rad];
  param Yv = -5 [1/s], Yr = 1.2 [m/s], Yd = 70 [m/s^2], Nv = 1.1 [1/m/s], Nr = -4.5 [1/s], Nd = 45 [1/s^2];
  const U = {speed} [m/s];
  der(v) = Yv*v + (Yr - U)*r + Yd*steer;
  der(r) = Nv*v + Nr*r + Nd*steer;
  der(psi) = r;
  output v_m [m/s] = v, r_m [rad/s] = r, psi_m [rad] = psi;
}}""".format(speed=repr(speed))
    return dt, [("steer", "rad", "input", 0, [steer(k * dt) for k in range(n)]), ("v_m", "m/s", "output", 0.02, [r[0] for r in rows]),
                ("r_m", "rad/s", "output", 0.003, [r[1] for r in rows]), ("psi_m", "rad", "output", 0.002, [r[2] for r in rows])], text


def diver(luck):
    """Heave of an underwater vehicle with linear and quadratic drag, and its depth."""
    n, dt = 800, 0.1
    thrust = pulses(luck, 12.0, n * dt, 8.0)
    mass, lin, quad = near(luck, 20.0), near(luck, 6.0), near(luck, 25.0)
    rows = midpoint(lambda t, x: [(thrust(t) - lin * x[0] - quad * x[0] * abs(x[0])) / mass, x[0]], [0.0, 2.0], n, dt)
    text = """model diver "heave" {
  input thrust [N];
  state w [m/s], depth [m] = free;
  param m = 20 in [1, 200] [kg], d1 = 6 [kg/s], d2 = 25 [kg/m];
  der(w) = (thrust - d1*w - d2*w*abs(w))/m;
  der(depth) = w;
  output w_m [m/s] = w, depth_m [m] = depth;
}"""
    return dt, [("thrust", "N", "input", 0, [thrust(k * dt) for k in range(n)]), ("w_m", "m/s", "output", 0.01, [r[0] for r in rows]),
                ("depth_m", "m", "output", 0.02, [r[1] for r in rows])], text


def hover(luck):
    n, dt = 1000, 0.02
    lat, lon = chirp(luck, 0.08, n * dt, 0.1, 1.2), edges(luck, 0.08, n * dt, 2.5, 0.1)
    lp, la, mq, mb, cross = near(luck, -4.0), near(luck, 20.0), near(luck, -2.5), near(luck, 11.0), near(luck, 0.6)

    def rate(t, x):
        p, q, phi, theta = x
        return [lp * p + cross * q + la * lat(t) - 3.0 * phi, mq * q - cross * p + mb * lon(t) - 2.0 * theta, p + q * math.sin(phi) * math.tan(theta), q * math.cos(phi)]
    rows = midpoint(rate, [0.0] * 4, n, dt)
    text = """model hover "roll and pitch with attitude feedback" {
  input lat, lon;
  state p [rad/s], q [rad/s], phi [rad], theta [rad];
  param Lp = -4 [1/s], Lq = 0.6 [1/s], La = 20 [1/s^2], Lphi = -3 [1/s^2], Mq = -2.5 [1/s], Mp = -0.6 [1/s], Mb = 11 [1/s^2], Mtheta = -2 [1/s^2];
  der(p) = Lp*p + Lq*q + La*lat + Lphi*phi;
  der(q) = Mq*q + Mp*p + Mb*lon + Mtheta*theta;
  der(phi) = p + q*sin(phi)*tan(theta);
  der(theta) = q*cos(phi);
  output p_m [rad/s] = p, q_m [rad/s] = q;
}"""
    return dt, [("lat", None, "input", 0, [lat(k * dt) for k in range(n)]), ("lon", None, "input", 0, [lon(k * dt) for k in range(n)]),
                ("p_m", "rad/s", "output", 0.004, [r[0] for r in rows]), ("q_m", "rad/s", "output", 0.004, [r[1] for r in rows]),
                ("phi", "rad", "other", 0.002, [r[2] for r in rows]), ("theta", "rad", "other", 0.002, [r[3] for r in rows])], text


def chain(luck):
    """A to B to C in a stirred tank whose temperature is given."""
    n, dt = 700, 0.25
    heat, feed = edges(luck, 12.0, n * dt, 25.0, 3.0), chirp(luck, 0.2, n * dt, 0.01, 0.06)
    k1, e1, k2, e2, d = near(luck, 0.12), near(luck, 7000), near(luck, 0.05), near(luck, 9000), 0.08
    warm = lambda t: 330 + heat(t)
    arrhenius = lambda t, e: math.exp(-e * (1 / warm(t) - 1 / 330))

    def rate(t, x):
        a, b = x
        one, two = k1 * arrhenius(t, e1) * a, k2 * arrhenius(t, e2) * b
        return [d * (1 + feed(t) - a) - one, one - two - d * b]
    rows = midpoint(rate, [0.5, 0.3], n, dt)
    text = """model chain "A to B to C" {
  input T [K], feed [mol/l];
  state A [mol/l] = free, B [mol/l] = free;
  param k1 = 0.12 in [0.001, 2] [1/s], E1 = 7000 in [0, 30000] [K], k2 = 0.05 in [0.001, 2] [1/s], E2 = 9000 in [0, 30000] [K];
  const D = 0.08 [1/s], T0 = 330 [K];
  let first = k1*exp(-E1*(1/T - 1/T0))*A;
  let second = k2*exp(-E2*(1/T - 1/T0))*B;
  der(A) = D*(feed - A) - first;
  der(B) = first - second - D*B;
  output A_m [mol/l] = A, B_m [mol/l] = B;
}"""
    return dt, [("T", "K", "input", 0, [warm(k * dt) for k in range(n)]), ("feed", "mol/l", "input", 0, [1 + feed(k * dt) for k in range(n)]),
                ("A_m", "mol/l", "output", 0.004, [r[0] for r in rows]), ("B_m", "mol/l", "output", 0.003, [r[1] for r in rows])], text


MADE = {"car": car, "diver": diver, "hover": hover, "chain": chain}


class Log:
    """Columns as lists [name, unit or none, role, values]; the first one is the time."""

    def __init__(self, kind, seed, folder):
        luck = random.Random(f"{seed}")
        dt, channels, text = MADE[kind](luck)
        self.model = folder / f"{kind}_{seed.replace(' ', '_')}.fdm"
        self.model.write_text(text + "\n")
        self.dt, n = dt, len(channels[0][4])
        self.columns = [["t", "s", "time", [round(k * dt, 6) for k in range(n)]]]
        for name, unit, role, noise, values in channels:
            # a converter of its own resolution
            step = noise / 3 if noise else 1e-6
            self.columns.append([name, unit, role, [step * round((v + luck.gauss(0, noise)) / step) for v in values]])

    def write(self, path):
        title = lambda c: c[0] if c[1] is None else f"{c[0]} [{c[1]}]"
        rows = zip(*(c[3] for c in self.columns))
        path.write_text("\n".join([",".join(map(title, self.columns))] + [",".join(f"{v:.10g}" for v in row) for row in rows]) + "\n")

    def of(self, wanted):
        return [c for c in self.columns if c[2] in wanted]


def scatter(values):
    mean = sum(values) / len(values)
    return math.sqrt(sum((v - mean) ** 2 for v in values) / len(values))


# ---- faults: each changes a column or the log, and says what a finding must hold
def unit(log, column, luck):
    factor = {"rad": 360 / TURN, "rad/s": 360 / TURN, "m/s": 1 / 0.514444, "m": 1 / 0.3048}[column[1]]
    column[1], column[3] = None, [factor * v for v in column[3]]
    return {"fault": {"unit"}, "names": {column[0]}, "factor": 1 / factor}


def sign(log, column, luck):
    column[3] = [-v for v in column[3]]
    return {"fault": {"sign", "axes"}, "names": {column[0]}, "factor": -1}


def swap(log, column, luck):
    other = luck.choice([c for c in log.of({"output"}) if c is not column])
    column[3], other[3] = other[3], column[3]
    return {"fault": {"swapped", "axes"}, "names": {column[0], other[0]}}


def late(log, column, luck):
    by, old = luck.uniform(4, 9), column[3]
    at = lambda s: old[0] if s <= 0 else old[int(s)] + (s - int(s)) * (old[min(int(s) + 1, len(old) - 1)] - old[int(s)])
    column[3] = [at(k - by) for k in range(len(old))]
    return {"fault": {"delay"}, "names": {column[0]}, "delay": by * log.dt}


def smooth(log, column, luck):
    """A first-order lag in the sensor, with noise behind it."""
    lag, out, y = luck.uniform(8, 15), [], column[3][0]
    noise = scatter([b - a for a, b in zip(column[3], column[3][1:])]) / 2
    for v in column[3]:
        y += (v - y) / (lag + 0.5)
        out.append(y + luck.gauss(0, noise))
    column[3] = out
    return {"fault": {"filtered"}, "names": {column[0]}}


def zero(log, column, luck):
    by = luck.choice([-1, 1]) * luck.uniform(0.6, 1.1) * scatter(column[3])
    column[3] = [v + by for v in column[3]]
    return {"fault": {"offset"}, "names": {column[0]}, "offset": -by}


def jump(log, column, luck):
    at, by = luck.randrange(len(column[3]) // 4, 3 * len(column[3]) // 4), luck.choice([-1, 1]) * scatter(column[3])
    column[3] = [v + by * (k >= at) for k, v in enumerate(column[3])]
    return {"fault": {"zero_shift"}, "names": {column[0]}}


def clock(log, column, luck):
    old, n = column[3], len(column[3])
    place = [k * (1 - 14 / n) for k in range(n)]
    column[3] = [old[int(s)] + (s - int(s)) * (old[min(int(s) + 1, n - 1)] - old[int(s)]) for s in place]
    return {"fault": {"drift"}, "names": {column[0]}}


def wild(log, column, luck):
    big = 8 * scatter(column[3])
    for k in luck.sample(range(12, len(column[3]) - 12), 4):
        column[3][k] += luck.choice([-1, 1]) * big * luck.uniform(0.7, 1.3)
    return {"fault": {"spikes"}, "names": {column[0]}}


def frozen(log, column, luck):
    n = len(column[3])
    at, long = luck.randrange(n // 4, n // 2), n // 18
    column[3][at:at + long] = [column[3][at]] * long
    return {"fault": {"stuck"}, "names": {column[0]}}


def rail(log, column, luck):
    top = sorted(column[3])[int(0.93 * len(column[3]))]
    column[3] = [min(v, top) for v in column[3]]
    return {"fault": {"clipped"}, "names": {column[0]}}


def hole(log, column, luck):
    for k in luck.sample(range(len(column[3])), 5):
        column[3][k] = 9999.0
    return {"fault": {"sentinel"}, "names": {column[0]}}


def lost(log, column, luck):
    n = len(log.columns[0][3])
    at = luck.randrange(n // 3, 2 * n // 3)
    for c in log.columns:
        del c[3][at:at + n // 30]
    return {"fault": {"gap"}, "names": {"t"}}


def shaky(log, column, luck):
    log.columns[0][3] = [t + 0.15 * log.dt * luck.gauss(0, 1) if k else t for k, t in enumerate(log.columns[0][3])]
    return {"fault": {"uneven_time"}, "names": {"t"}}


def milli(log, column, luck):
    log.columns[0][1], log.columns[0][3] = None, [1000 * t for t in log.columns[0][3]]
    return {"fault": {"time_unit"}, "names": {"t"}, "time": "ms"}


def slow(log, column, luck):
    column[3] = [column[3][k - k % 4] for k in range(len(column[3]))]
    return {"fault": {"held_samples"}, "names": {column[0]}}


def coarse(log, column, luck):
    step = (max(column[3]) - min(column[3])) / 18
    column[3] = [step * round(v / step) for v in column[3]]
    return {"fault": {"quantised"}, "names": {column[0]}}


OUT, ANY = {"output"}, {"output", "input"}
PLACED = [(unit, {"output", "other"}), (sign, ANY), (swap, OUT), (late, OUT), (smooth, OUT), (zero, OUT), (jump, OUT), (clock, OUT), (wild, OUT), (frozen, OUT),
          (rail, OUT), (hole, ANY), (lost, {"time"}), (shaky, {"time"}), (milli, {"time"}), (slow, OUT), (coarse, OUT)]


def places(log, fault, roles):
    units = {"rad", "rad/s", "m/s", "m"}
    return [c for c in log.of(roles) if fault is not unit or c[1] in units]


def right(finding, wanted):
    repair = finding.get("repair") or {}
    change = next((c for n, c in sorted(repair.get("channels", {}).items()) if n in wanted["names"]), {})
    close = lambda key, usual, part: abs(change.get(key, usual) - wanted[key]) <= part * abs(wanted[key])
    return (finding["fault"] in wanted["fault"] and bool(wanted["names"] & set(finding["channels"])) and bool(repair.get("line"))
            and ("factor" not in wanted or close("factor", 1, 0.03)) and ("offset" not in wanted or close("offset", 0, 0.25))
            and ("delay" not in wanted or close("delay", 0, 0.25)) and ("time" not in wanted or repair.get("time_unit") == wanted["time"]))


def judged(arguments, log, name):
    path, begin = arguments.folder / f"{name}.csv", time.time()
    log.write(path)
    command = [arguments.fdm, "doctor", log.model, "--data", path, "--json", "-q", "--time-limit", arguments.limit]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode == 2:
        return None, time.time() - begin, done.stderr.strip()[:300]
    found = [f for f in json.loads(done.stdout)["findings"] if f["severity"] == "finding"]
    return found, time.time() - begin, "; ".join(f"{f['fault']} {','.join(f['channels'])} ({f['log_odds']:.0f})" for f in found) or "nothing"


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default=str(ROOT / "target/release/fdm"))
    parser.add_argument("--seed", default="2718")
    parser.add_argument("--limit", default="60s")
    parser.add_argument("--check", action="store_true", help="write the models and check their texts, judge nothing")
    arguments = parser.parse_args()
    arguments.folder.mkdir(parents=True, exist_ok=True)
    kinds, luck, took = sorted(MADE), random.Random(f"panel {arguments.seed}"), []
    if arguments.check:
        for kind in kinds:
            log = Log(kind, "check", arguments.folder)
            print(kind, subprocess.run([arguments.fdm, "check", log.model], capture_output=True, text=True))
        return
    planned = luck.sample(PLACED, 10)
    good = 0
    for k, (fault, roles) in enumerate(planned):
        options = [kind for kind in kinds if places(Log(kind, "look", arguments.folder), fault, roles)]
        log = Log(luck.choice(options), f"{arguments.seed} single {k}", arguments.folder)
        wanted = fault(log, luck.choice(places(log, fault, roles)), luck)
        found, seconds, said = judged(arguments, log, f"single_{k}")
        took.append(seconds)
        named = bool(found) and right(found[0], wanted)
        good += named
        mark = "RIGHT" if named else "later" if any(right(f, wanted) for f in found or []) else "WRONG"
        print(f"{mark}  {fault.__name__} in {','.join(sorted(wanted['names']))} of {log.model.stem.split('_')[0]}, {seconds:.1f} s: {said}", flush=True)
    both = one = count = 0
    while count < 4:
        log = Log(luck.choice(kinds), f"{arguments.seed} pair {count}", arguments.folder)
        chosen = [(fault, places(log, fault, roles)) for fault, roles in luck.sample([f for f in PLACED if f[0] is not swap], 2)]
        if not all(options for _, options in chosen):
            continue
        where = [luck.choice(options) for _, options in chosen]
        if where[0] is where[1]:
            continue
        wanted = [fault(log, column, luck) for (fault, _), column in zip(chosen, where)]
        found, seconds, said = judged(arguments, log, f"pair_{count}")
        took.append(seconds)
        hits = [any(right(f, w) for f in found or []) for w in wanted]
        both, one, count = both + all(hits), one + any(hits), count + 1
        names = " and ".join(f"{fault.__name__} in {','.join(sorted(w['names']))}" for (fault, _), w in zip(chosen, wanted))
        print(f"{sum(hits)} of 2  {names} of {log.model.stem.split('_')[0]}, {seconds:.1f} s: {said}", flush=True)
    alarms = 0
    for k in range(10):
        log = Log(kinds[k % 4], f"{arguments.seed} clean {k}", arguments.folder)
        found, seconds, said = judged(arguments, log, f"clean_{k}")
        took.append(seconds)
        alarms += found is None or bool(found)
        print(f"clean  {log.model.stem.split('_')[0]}, {seconds:.1f} s: {said}", flush=True)
    print(f"single faults named first with the right repair: {good} of 10")
    print(f"pairs with both named: {both} of 4, at least one in {one}")
    print(f"records without a fault that have a finding: {alarms} of 10")
    print(f"time: median {sorted(took)[len(took) // 2]:.1f} s, longest {max(took):.1f} s")


if __name__ == "__main__":
    main()
