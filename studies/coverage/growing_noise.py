"""Coverage of 95 % intervals under noise that grows with the signal and under Student's law, by a generator that shares no code with fdm.

python growing_noise.py FDM [REPEATS]   (needs numpy and scipy; FDM is the program)
"""

import json
import subprocess
import sys
import tempfile
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.integrate import solve_ivp

OSCILLATOR = """model oscillator {
  input u;
  state x, v;
  param k = 4 in [0.1, 40], d = 0.5 in [0, 10], b = 3, mu = 0.2 in [-5, 5];
  %s
  der(x) = v;
  der(v) = -k*x - d*v - mu*x^3 + b*u;
  output y = x, w = v;
  %s
}
"""
TANKS = """model tanks {
  input u;
  state h = h0, g = 1;
  param a = 0.5 in [0.01, 5], c = 0.3 in [0.01, 5], h0 = 2 in [0.1, 10];
  %s
  der(h) = u - a*sqrt(max(h, 1e-6));
  der(g) = a*sqrt(max(h, 1e-6)) - c*sqrt(max(g, 1e-6));
  output y = h, w = g;
  %s
}
"""


def oscillator(t, z, u):
    k, d, b, mu = 4.0, 0.6, 3.0, 0.3
    return [z[1], -k * z[0] - d * z[1] - mu * z[0] ** 3 + b * u]


def tanks(t, z, u):
    a, c = 0.6, 0.4
    return [u - a * np.sqrt(max(z[0], 1e-6)), a * np.sqrt(max(z[0], 1e-6)) - c * np.sqrt(max(z[1], 1e-6))]


MODELS = {
    "oscillator": (OSCILLATOR, oscillator, [0.0, 0.0], {"k": 4.0, "d": 0.6, "b": 3.0, "mu": 0.3}, 20.0),
    "tanks": (TANKS, tanks, [3.0, 1.0], {"a": 0.6, "c": 0.4, "h0": 3.0}, 30.0),
}
NOISES = {
    "growing": lambda y, random: (0.01 * np.std(y) + 0.1 * np.abs(y)) * random.standard_normal(len(y)),
    "student": lambda y, random: 0.05 * np.std(y) * random.standard_t(3, len(y)),
}
WAYS = {
    "growing, plain": ("growing", "", "", []),
    "growing, noise model": (
        "growing",
        "param s = 0.01, p = 0.05, r = 0.01, e = 0.05;",
        "noise y = s + p*abs(y), w = r + e*abs(w);",
        [],
    ),
    "student, huber": ("student", "", "", ["--loss", "huber"]),
    "student, student": ("student", "", "", ["--loss", "student"]),
}


def response(name, n):
    _, rates, start, _, duration = MODELS[name]
    t = np.arange(n) * duration / n
    u = 0.5 + np.where((t // (duration / 7)) % 2 < 1, 1.0, -0.4)
    z, rows = np.array(start), []
    for k in range(n):
        rows.append(z)
        if k + 1 < n:
            step = solve_ivp(rates, (t[k], t[k + 1]), z, args=(u[k],), rtol=1e-10, atol=1e-12, method="DOP853")
            z = step.y[:, -1]
    return t, u, np.array(rows)


def held(fdm, folder, case):
    name, way, repeat, (t, u, clean) = case
    text, _, _, truth, _ = MODELS[name]
    noise, params, lines, options = WAYS[way]
    random = np.random.default_rng([sum(map(ord, name + way)), repeat])
    y = clean + np.column_stack([NOISES[noise](clean[:, k], random) for k in range(2)])
    stem = Path(folder) / f"{name}-{list(WAYS).index(way)}-{repeat}"
    model, data = stem.with_suffix(".fdm"), stem.with_suffix(".csv")
    model.write_text(text % (params, lines))
    np.savetxt(data, np.column_stack([t, u, y]), delimiter=",", header="t,u,y,w", comments="", fmt="%.17g")
    command = [fdm, "fit", str(model), "--data", str(data), "--zoh", "u", "--json", "-q", "--steps", "4", *options]
    done = subprocess.run(command, capture_output=True, text=True)
    if done.returncode != 0:
        return None, done.stderr
    fit = json.loads(done.stdout)
    inside, quantile = [], 1.959964
    for p in fit["parameters"]:
        if p["name"] in truth and p["standard_error"]:
            error = p["corrected_error"] or p["standard_error"]
            freedom = p["freedom"]
            reach = stats.t.ppf(0.975, freedom) if freedom else quantile
            inside.append(abs(p["value"] - truth[p["name"]]) <= reach * error)
    told = any("noise_variation" in o for o in fit["outputs"])
    return inside, told


def main():
    fdm, repeats = sys.argv[1], int(sys.argv[2]) if len(sys.argv) > 2 else 200
    for name in MODELS:
        for n in [150, 600]:
            record = response(name, n)
            for way in WAYS:
                with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(2) as pool:
                    cases = [(name, way, repeat, record) for repeat in range(repeats)]
                    found = list(pool.map(lambda case: held(fdm, folder, case), cases))
                good = [f for f in found if f[0] is not None]
                share = np.mean([i for f in good for i in f[0]]) if good else float("nan")
                told = np.mean([f[1] for f in good]) if good else float("nan")
                failed = len(found) - len(good)
                print(f"{name:11} {n:4} {way:21} held {100*share:5.1f} %  told {100*told:5.1f} %  failed {failed}", flush=True)


if __name__ == "__main__":
    main()
