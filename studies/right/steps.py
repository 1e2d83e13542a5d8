"""True integration error against the claimed one: random models with limits, events, kinks, knots, jumps and none, by another integrator.

python3 studies/right/steps.py PROGRAM [COUNT_OF_EACH_KIND] [OUT.csv] [FIRST_SEED]

Each model is written as text, simulated by `PROGRAM simulate`, and integrated by DOP853 at 1e-12, begun anew at every sample and at every
instant where a limit is met or left, an event happens, or a branch changes. Printed: by kind, how many true errors are at most the claimed
one or 1e-8 of the range.
"""
import csv
import json
import pathlib
import subprocess
import sys
import tempfile

import numpy as np
from scipy.integrate import solve_ivp

TIGHT = dict(method="DOP853", rtol=1e-12, atol=1e-13)


def pieces(f, switches, t0, t1, x):
    """Integrates f(t, x) and stops at the first zero of any switch; returns time, state and which."""
    for s in switches:
        s.terminal = True
    o = solve_ivp(f, (t0, t1), x, events=switches or None, max_step=(t1 - t0) / 4, **TIGHT)
    which = next((k for k, e in enumerate(o.t_events or []) if len(e)), None) if o.status == 1 else None
    return o.t[-1], o.y[:, -1], which


def limit_model(rng):
    low, high = -rng.uniform(0.1, 0.5), rng.uniform(0.1, 0.5)
    k, a, b = rng.uniform(0.5, 2), rng.uniform(-0.5, 1), rng.uniform(0.2, 2)
    text = (f"model m {{ input u; state d = 0, z = 0; der(d) = {k!r}*u - {a!r}*d; limit d in [{low!r}, {high!r}]; "
            f"der(z) = {b!r}*(d - z) ; output y = d; output w = z; }}")

    def step(u):
        free = lambda t, x: [k * u(t) - a * x[0], b * (x[0] - x[1])]

        def run(t, t1, x):
            bound = next((v for v in (low, high) if x[0] == v), None)
            side = 0.0 if bound is None else np.sign(bound)
            held = bound is not None and side * (k * u(t) - a * bound) > 1e-14
            for _ in range(60):
                if t1 - t < 1e-14:
                    break
                if held:
                    leave = lambda t, x: side * (k * u(t) - a * bound)
                    leave.direction = -1
                    t, x, hit = pieces(lambda t, x: [0.0, b * (bound - x[1])], [leave], t, t1, x)
                    x[0] = bound
                    held = hit is None
                    if held:
                        break
                else:
                    up, down = (lambda t, x: x[0] - high), (lambda t, x: low - x[0])
                    up.direction = down.direction = 1
                    t, x, hit = pieces(free, [up, down], t, t1, x)
                    if hit is None:
                        break
                    bound = (high, low)[hit]
                    side, held, x[0] = np.sign(bound), True, bound
            return x

        return run

    return text, [0.0, 0.0], step, lambda x: x


def event_model(rng):
    k, b, gain, level = rng.uniform(0.5, 2), rng.uniform(0.2, 2), rng.uniform(-0.8, -0.2), rng.uniform(0.1, 0.4)
    text = (f"model m {{ input u; state d = 0, z = 0; der(d) = {k!r}*u - 0.3*d; der(z) = {b!r}*(d - z); "
            f"when d > {level!r} {{ d = {gain!r}*d; }} output y = d; output w = z; }}")

    def step(u):
        def run(t, t1, x):
            for _ in range(60):
                hit = lambda t, x: x[0] - level
                hit.direction = 1
                t, x, which = pieces(lambda t, x: [k * u(t) - 0.3 * x[0], b * (x[0] - x[1])], [hit], t, t1, x)
                if which is None:
                    break
                x[0] = gain * level
            return x

        return run

    return text, [0.0, 0.0], step, lambda x: x


def kink_model(rng):
    return shaped(rng, rng.uniform(0.1, 0.4), ["clip", "max", "abs", "if"])


def table_model(rng):
    return shaped(rng, rng.uniform(0.1, 0.4), ["table"])


def jump_model(rng):
    return shaped(rng, rng.uniform(0.1, 0.4), ["jump"])


def smooth_model(rng):
    return shaped(rng, rng.uniform(0.1, 0.4), ["tanh"])


def shaped(rng, c, shapes):
    """A servo whose second state sees the first through one of the shapes: smooth branches between levels, lowest first."""
    b, k = rng.uniform(0.3, 2), rng.uniform(1, 4)
    shape = rng.choice(shapes)
    line = lambda x0, y0, x1, y1: lambda d: y0 + (y1 - y0) * (d - x0) / (x1 - x0)
    knots = [(-2 * c, -1), (-c, -0.5), (c, 0.1), (3 * c, 0.9)]
    between = [line(*a, *b) for a, b in zip(knots[:-1], knots[1:])]
    text_of, levels, branches = {
        "clip": (f"clip(d, -{c!r}, {c!r})", [-c, c], [lambda d: -c, lambda d: d, lambda d: c]),
        "max": (f"max(d, {c!r})", [c], [lambda d: c, lambda d: d]),
        "abs": (f"abs(d - {c!r})", [c], [lambda d: c - d, lambda d: d - c]),
        "if": (f"(if d > {c!r} then 2*d - {c!r} else d)", [c], [lambda d: d, lambda d: 2 * d - c]),
        "table": ("g(d)", [x for x, _ in knots], [lambda d: -1, *between, lambda d: 0.9]),
        "jump": (f"(if d > {c!r} then 1 else -0.5)", [c], [lambda d: -0.5, lambda d: 1]),
        "tanh": (f"tanh(d/{c!r})", [], [lambda d: np.tanh(d / c)]),
    }[shape]
    table = "table g(a) = linear { " + ", ".join(f"{x!r}: {y!r}" for x, y in knots) + " }; "
    text = (f"model m {{ input u; {table if shape == 'table' else ''}state d = 0, z = 0; "
            f"der(d) = {k!r}*u - {b!r}*d - 0.5*z; der(z) = {text_of} - z; output y = d; output w = z; }}")

    def step(u):
        def run(t, t1, x):
            branch = int(np.searchsorted(levels, x[0]))
            while t1 - t > 1e-14:
                ways = []
                for way, level in ((1, levels[branch:branch + 1]), (-1, levels[max(branch - 1, 0):branch])):
                    for at in level:
                        leaves = lambda t, x, at=at: x[0] - at
                        leaves.direction = way
                        ways.append((way, leaves))
                f = lambda t, x: [k * u(t) - b * x[0] - 0.5 * x[1], branches[branch](x[0]) - x[1]]
                t, x, which = pieces(f, [leaves for _, leaves in ways], t, t1, x)
                if which is None:
                    break
                branch += ways[which][0]
            return x

        return run

    return text, [0.0, 0.0], step, lambda x: x


KINDS = {"limits": limit_model, "events": event_model, "kinks": kink_model, "knots": table_model, "jumps": jump_model,
         "smooth": smooth_model}


def record(rng):
    n, h = int(rng.integers(20, 50)), rng.choice([0.05, 0.1, 0.25])
    t = h * np.arange(n)
    w, p = rng.uniform(0.5, 2.5, 3), rng.uniform(0, 6.3, 3)
    return t, sum(np.sin(a * t + q) for a, q in zip(w, p)) * rng.uniform(0.5, 1.5)


def one(program, folder, kind, seed):
    rng = np.random.default_rng(seed)
    text, x, step, output = KINDS[kind](rng)
    t, u = record(rng)
    (folder / "m.fdm").write_text(text)
    with open(folder / "r.csv", "w") as file:
        file.write("t,u\n" + "".join(f"{float(a)!r},{float(b)!r}\n" for a, b in zip(t, u)))
    done = subprocess.run([program, "simulate", "m.fdm", "--data", "r.csv", "--json"], cwd=folder, capture_output=True, text=True)
    document = json.loads(done.stdout)
    run = document[0]
    y = np.array([c["values"] for c in run["channels"] if c["name"] in ("y", "w")], float).T
    claimed = np.inf if run["integration_error"] is None else run["integration_error"]
    advance = step(lambda s: np.interp(s, t, u))
    exact = [output(np.array(x, float))]
    for a, b in zip(t[:-1], t[1:]):
        x = advance(a, b, np.array(x, float))
        exact.append(output(x))
    exact = np.array(exact)
    true = max(np.max(np.abs(y[:, k] - exact[:, k])) / np.ptp(exact[:, k]) for k in range(y.shape[1]))
    return true, claimed, run["steps"], done.returncode


def main():
    program = str(pathlib.Path(sys.argv[1]).resolve())
    count = int(sys.argv[2]) if len(sys.argv) > 2 else 100
    first = int(sys.argv[4]) if len(sys.argv) > 4 else 0
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for kind in KINDS:
            found = [one(program, pathlib.Path(folder), kind, first + seed) for seed in range(count)]
            rows += [(kind, first + seed, *row) for seed, row in enumerate(found)]
            steps = sum(row[2] for row in found) / count
            bounded = sum(true <= max(claimed, 1e-8) for true, claimed, *_ in found)
            wrong = sum(true > 1e-3 for true, *_ in found)
            worst = max(true for true, *_ in found)
            print(f"{kind}: {bounded} of {count} bounded by the claim or 1e-8, {wrong} above 1e-3, largest true error {worst:.1e}, "
                  f"{steps:.0f} steps in the mean")
    if len(sys.argv) > 3:
        with open(sys.argv[3], "w", newline="") as file:
            writer = csv.writer(file)
            writer.writerow(["kind", "seed", "true", "claimed", "steps", "code"])
            writer.writerows((k, s, f"{a:.3e}", f"{b:.3e}", n, c) for k, s, a, b, n, c in rows)


main()
