"""Commands that are held on another clock than the sensor's: is their delay right in both domains?

    python3 studies/right/edges.py FDM FOLDER [--draws 40] [--seed 5]

A second-order plant behind a lag of the command, integrated piece by piece by matrix exponentials. The command changes at instants of its own, the sensor is
sampled at others; a map says how late its stamps are. Of each fit: the delay, its error, and how many errors it is off.
"""

import argparse
import csv
import json
import subprocess
from pathlib import Path

import numpy as np
from scipy.linalg import expm

TEXT = """model plant {
  input u;
  state x = free, v = free;
  param k = 20 in [1, 200], d = 2 in [0, 20], b = 20 in [1, 200], late = 0.02 in [0, 0.5];
  der(x) = v;
  der(v) = b*delay(u, late) - k*x - d*v;
  output y = x;
}
"""


def record(g):
    dt, n = 0.04, 1500
    k, d, b, late = g.uniform(10, 40), g.uniform(1, 4), g.uniform(10, 40), g.uniform(0.01, 0.1)
    stamp = g.uniform(0.05, 0.95) * dt  # the sensor's sample of row i lies so long before the command of row i
    u = np.repeat(g.normal(size=n // 3 + 1), 3)[:n]
    a = np.array([[0, 1, 0], [-k, -d, b], [0, 0, 0]])
    sampled = np.arange(n) * dt - stamp
    edges = np.arange(n) * dt + late
    instants = np.unique(np.concatenate([sampled, edges]))
    z, y, at = np.zeros(3), {}, instants[0]
    for t in instants:
        z, at = expm(a * (t - at)) @ z, t
        y[t] = z[0]
        i = np.searchsorted(edges, t, side="right") - 1
        z[2] = u[i] if i >= 0 else 0.0
    out = np.array([y[t] for t in sampled])
    return np.arange(n) * dt, u, out + 0.02 * out.std() * g.normal(size=n), stamp, late


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("fdm")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--draws", type=int, default=40)
    parser.add_argument("--seed", type=int, default=5)
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    g, rows = np.random.default_rng(a.seed), []
    (a.folder / "model.fdm").write_text(TEXT)
    for draw in range(a.draws):
        t, u, y, stamp, late = record(g)
        table = np.column_stack([t, u, y])
        np.savetxt(a.folder / "run.csv", table, delimiter=",", header="t [s],u,y", comments="", fmt="%.9g")
        map_file = f'[channel.u]\nfrom = "u"\nhold = true\n[channel.y]\nfrom = "y"\ndelay = {stamp!r}\n'
        (a.folder / "map.toml").write_text(map_file)
        for domain in ["time", "frequency"]:
            words = [a.fdm, "fit", a.folder / "model.fdm", "--data", a.folder / "run.csv", "--map-file", a.folder / "map.toml", "--json", "--domain", domain]
            words += ["--band", "0.05:5"] if domain == "frequency" else []
            done = subprocess.run([*map(str, words)], capture_output=True, text=True, timeout=300)
            found = json.loads(done.stdout) if done.stdout.strip() else {"parameters": []}
            own = next((p for p in found["parameters"] if p["name"] == "late"), None)
            value, error = (own["value"], own["corrected_error"] or own["standard_error"]) if own else (np.nan, np.nan)
            rows.append([draw, domain, done.returncode, late, value, error, (value - late) / error if error else np.nan])
    with open(a.folder / "edges.csv", "w", newline="") as file:
        csv.writer(file).writerows([["draw", "domain", "exit", "late", "found", "error", "errors off"], *rows])
    for domain in ["time", "frequency"]:
        off = np.array([r[6] for r in rows if r[1] == domain], float)
        ms = 1000 * np.array([r[4] - r[3] for r in rows if r[1] == domain], float)
        held = np.mean(np.abs(off) < 1.96)
        print(f"{domain:10} within 1.96 errors {100 * held:.0f} % of {len(off)}; mean {np.nanmean(ms):+.2f} ms, rms {np.sqrt(np.nanmean(ms**2)):.2f} ms")


if __name__ == "__main__":
    main()
