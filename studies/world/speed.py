"""How long a large diagnosis takes, and how much memory: six bodies in a row (12 states), ten runs of 10,000 samples, about 1,000 candidates.

    python3 studies/world/speed.py FOLDER [--fdm target/release/fdm] [--threads 2] [--catalogue FIELDS] [--only EFFECTS]

Drag of the third body is hidden. Prints the number of candidates, seconds of the clock and of the processor, and the most memory.
"""

import argparse
import json
import resource
import subprocess
import time
from pathlib import Path

import numpy as np

from score import ROOT, said

BODIES, RUNS, SAMPLES, STEP = 6, 10, 10_000, 0.02
DRAG = 0.15


def text():
    """The model without drag; springs and dampers between neighbours and to the wall, forces on both ends."""
    names = range(1, BODIES + 1)
    lines = ['model chain "six bodies in a row, forces on the first and the last" {', "  input F [N], G [N];"]
    lines += [f"  state x{k} [m] = 0, v{k} [m/s] = 0;" for k in names]
    lines += [f"  const M{k} = {1 + 0.1 * k:.1f} [kg];" for k in names]
    lines += [f"  param k{k} = 8 [N/m], c{k} = 0.3 [N*s/m];" for k in names]
    for k in names:
        force = f" - k{k}*(x{k} - x{k - 1}) - c{k}*(v{k} - v{k - 1})" if k > 1 else f" - k{k}*x{k} - c{k}*v{k}"
        if k < BODIES:
            force += f" + k{k + 1}*(x{k + 1} - x{k}) + c{k + 1}*(v{k + 1} - v{k})"
        push = {1: "F", BODIES: "G"}.get(k, "0")
        lines += [f"  der(x{k}) = v{k};", f"  der(v{k}) = ({push}{force})/M{k};"]
    lines += [f"  output y{k} [m] = x{k};" for k in names]
    return "\n".join(lines) + "\n}\n"


def motion(rng, plant):
    """Inputs of one run, and positions of a plant by Runge-Kutta with two steps a sample."""
    force = np.zeros((SAMPLES, 2))
    for j in range(2):
        at = 25
        while at < SAMPLES:
            end = at + int(rng.integers(30, 300))
            force[at:end, j] = rng.uniform(-6, 6)
            at = end
    mass = 1 + 0.1 * np.arange(1, BODIES + 1)
    stiffness, damping = 8 * np.exp(0.1 * plant.standard_normal(BODIES)), 0.3 * np.ones(BODIES)

    def rates(x, u):
        stretch, rate = np.diff(x[:BODIES], prepend=0.0), np.diff(x[BODIES:], prepend=0.0)
        spring = stiffness * stretch + damping * rate
        push = -spring
        push[:-1] += spring[1:]
        push[0] += u[0]
        push[-1] += u[1]
        push[2] -= DRAG * x[BODIES + 2] * abs(x[BODIES + 2])
        return np.concatenate([x[BODIES:], push / mass])

    x, found, h = np.zeros(2 * BODIES), np.empty((SAMPLES, BODIES)), STEP / 2
    for k in range(SAMPLES):
        found[k] = x[:BODIES]
        if k + 1 < SAMPLES:
            for s in range(2):
                u = [force[k] + (force[k + 1] - force[k]) * (s + part) / 2 for part in (0, 0.5, 1)]
                a = rates(x, u[0])
                b = rates(x + h / 2 * a, u[1])
                c = rates(x + h / 2 * b, u[1])
                x = x + h / 6 * (a + 2 * b + 2 * c + rates(x + h * c, u[2]))
    return force, found


def main():
    given = argparse.ArgumentParser()
    given.add_argument("folder", type=Path)
    given.add_argument("--fdm", default=str(ROOT / "target" / "release" / "fdm"))
    given.add_argument("--threads", default="2")
    given.add_argument("--catalogue", default="")
    given.add_argument("--only", default="", help="effects, with commas between them")
    asked = given.parse_args()
    asked.folder.mkdir(parents=True, exist_ok=True)
    model = asked.folder / "chain.fdm"
    model.write_text(text())
    files = [asked.folder / f"run_{k + 1}.csv" for k in range(RUNS)]
    for k, file in enumerate(files):
        if file.exists():
            continue
        rng = np.random.default_rng([7, k])
        # the plant is the same in all runs
        plant = np.random.default_rng(7)
        force, found = motion(rng, plant)
        table = np.column_stack([STEP * np.arange(SAMPLES), force, found + 0.01 * rng.standard_normal(found.shape)])
        head = "t [s],F [N],G [N]," + ",".join(f"y{k + 1} [m]" for k in range(BODIES))
        np.savetxt(file, table, delimiter=",", header=head, comments="", fmt="%.9g")
    command = [asked.fdm, "diagnose", str(model), *[w for f in files for w in ("--data", str(f))],
               "--json", "--quiet", "--threads", asked.threads]
    command += ["--catalogue", asked.catalogue] if asked.catalogue else []
    command += ["--only", asked.only] if asked.only else []
    begun = time.monotonic()
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    clock, used = time.monotonic() - begun, resource.getrusage(resource.RUSAGE_CHILDREN)
    diagnosis = json.loads(done.stdout) if done.stdout else None
    print(f"code {done.returncode} {done.stderr[-300:]}")
    if diagnosis:
        steps = diagnosis.get("steps") or [{"ranking": []}]
        print(f"{len(steps[0]['ranking'])} candidates in the first of {len(steps)} searches; {said(diagnosis)}")
        print(diagnosis.get("notes"))
    print(f"{clock:.0f} s of the clock, {used.ru_utime + used.ru_stime:.0f} s of the processor, {used.ru_maxrss / 1e6:.2f} GB")


if __name__ == "__main__":
    main()
