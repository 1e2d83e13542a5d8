"""Cases that showed what diagnoses passed over, each asked as a command; one line a case.

    python3 studies/world/findings.py FOLDER [--fdm target/release/fdm] [--only offset,form]

Steady offsets, both forms of an equation, a static delay, outputs in every tenth row, a law outside the catalogue and as
an effect of the user's own, an open-loop manoeuvre, and a comparison on validation runs.
"""

import argparse
import json
from pathlib import Path

import numpy as np

from asking import limited, parsed
from noises import Noise
from score import ROOT, named, said

STEP = 0.02
SAMPLES = 500


def moved(rates, begin, inputs, step=STEP, sub=10):
    """Runge-Kutta of fourth order over an input that is straight between samples; states at the samples."""
    x, found, h = np.array(begin, dtype=float), [], step / sub
    for k in range(len(inputs)):
        found.append(x.copy())
        if k + 1 == len(inputs):
            break
        for s in range(sub):
            u = [inputs[k] + (inputs[k + 1] - inputs[k]) * (s + part) / sub for part in (0, 0.5, 1)]
            a = rates(x, u[0])
            b = rates(x + h / 2 * a, u[1])
            c = rates(x + h / 2 * b, u[1])
            d = rates(x + h * c, u[2])
            x = x + h / 6 * (a + 2 * b + 2 * c + d)
    return np.array(found)


def steps(rng, samples, longest, levels, still=25):
    """Steps of random length and height, after stillness."""
    values, at = np.zeros(samples), still
    while at < samples:
        end = at + int(rng.integers(longest // 4, longest))
        values[at:end] = rng.uniform(*levels)
        at = end
    return values


def save(path, head, columns):
    path.parent.mkdir(parents=True, exist_ok=True)
    rows = [",".join("" if np.isnan(v) else f"{v:.9g}" for v in row) for row in np.column_stack(columns)]
    path.write_text(head + "\n" + "\n".join(rows) + "\n")
    return path


def times(samples, step=STEP):
    return step * np.arange(samples)


class Asker:
    def __init__(self, command, folder):
        self.command, self.folder = command, folder

    def text(self, name, text):
        path = self.folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        return path

    def run(self, *words, seconds=300):
        done = limited([self.command, *[str(w) for w in words], "--threads", "1"], seconds)
        return parsed(done["out"]), done

    def diagnosis(self, model, runs, *options):
        data = [word for run in runs for word in ("--data", run)]
        return self.run("diagnose", model, *data, "--json", "--quiet", *options)


SWAY = """model sway "a body on a spring, pushed" {{
  input F [N];
  state x [m] = {begin}, v [m/s] = {begin};
  const M = 2 [kg];
  param k = 8 [N/m], c = 1 [N*s/m];
  der(x) = v;
  {balance}
  output x_m [m] = x{second};
}}
"""
DER, NEWTON = "der(v) = (F - k*x - c*v)/M;", "M*der(v) = F - k*x - c*v;"


def sway(rng, constant=0.0, coulomb=0.0, cogging=0.0, samples=SAMPLES):
    """Records of a body at the equilibrium that a constant force has shifted; position and rate."""
    force = steps(rng, samples, 120, (-4, 4))

    def rates(x, u):
        push = u - 8.6 * x[0] - 1.15 * x[1] + constant - coulomb * np.tanh(x[1] / 1e-3) + cogging * np.sin(40 * x[0])
        return np.array([x[1], push / 2])

    return force, moved(rates, [constant / 8.6, 0.0], force, sub=60 if coulomb else 10)


def offset(ask, rng):
    """A constant force of which the output shows ten times its noise, in three runs and one for validation."""
    model = ask.text("offset.fdm", SWAY.format(begin="free", balance=DER, second=""))
    files = []
    for k in range(4):
        force, x = sway(rng, constant=8.6 * 0.05)
        files.append(save(ask.folder / f"offset_{k}.csv", "t [s],F [N],x_m [m]",
                          [times(len(force)), force, x[:, 0] + 0.005 * rng.standard_normal(len(force))]))
    found, done = ask.diagnosis(model, files[:3], "--validation", files[3])
    good = found["verdict"] == "effect_found" and len(found["causes"]) == 1
    return good, said(found), done


def form(ask, rng):
    """Coulomb friction in both forms of the same equation."""
    files = []
    for k in range(3):
        force, x = sway(rng, coulomb=0.4)
        noise = rng.standard_normal((2, len(force)))
        files.append(save(ask.folder / f"form_{k}.csv", "t [s],F [N],x_m [m],v_m [m/s]",
                          [times(len(force)), force, x[:, 0] + 0.004 * noise[0], x[:, 1] + 0.01 * noise[1]]))
    answers = []
    for name, balance in (("der", DER), ("newton", NEWTON)):
        model = ask.text(f"form_{name}.fdm", SWAY.format(begin=0, balance=balance, second=";\n  output v_m [m/s] = v"))
        found, done = ask.diagnosis(model, files[:2], "--validation", files[2])
        rms = [o["rms_after"] for o in found["outputs"]]
        answers.append((named(found), rms, done, said(found)))
    (one, a, _, first), (other, b, done, second) = answers
    alike = one == other and np.allclose(a, b, rtol=1e-3)
    return alike and "coulomb_friction" in first, f"{first} | {second}; RMS alike to {np.max(np.abs(np.array(a) / b - 1)):.0e}", done


def delay(ask, rng):
    """A model without states, late by 0.020 s; its own delay, and as what is missing."""
    n, step = 600, 0.005
    t = times(n, step)
    wave = lambda t: np.sin(7 * t) + 0.6 * np.sin(19 * t + 1) + 0.4 * np.sin(31 * t + 2)
    file = save(ask.folder / "delay.csv", "t [s],u [1],y [1]", [t, wave(t), 2 * wave(t - 0.02) + 0.02 * rng.standard_normal(n)])
    own = ask.text("delay.fdm", "model late { input u [1]; param K = 1 [1], tau = 0.01 in [0, 0.2] [s]; output y [1] = K*delay(u, tau); }\n")
    none = ask.text("no_delay.fdm", "model late { input u [1]; param K = 1 [1]; output y [1] = K*u; }\n")
    fit, done = ask.run("fit", own, "--data", file, "--json", "--quiet")
    tau = next(p for p in fit["parameters"] if p["name"] == "tau")
    found, _ = ask.diagnosis(none, [file])
    value = [p["value"] for c in found["causes"] for p in c["parameters"]]
    good = abs(tau["value"] - 0.02) < 3 * tau["standard_error"] and len(value) == 1 and abs(value[0] - 0.02) < 0.001
    return good, f"fit: {tau['value']:.5f} +- {tau['standard_error']:.5f} s; diagnosis: {said(found)}, {value}", done


def sparse(ask, rng):
    """Outputs in every tenth row, twenty records of the right model: what is remarked, and what is found."""
    step, n = 0.002, 5000
    wrong, remarks, done = 0, 0, None
    model = ask.text("sparse.fdm", SWAY.format(begin=0, balance=DER, second=""))
    for k in range(20):
        force = steps(rng, n, 1200, (-4, 4), 250)
        x = moved(lambda x, u: np.array([x[1], (u - 8.6 * x[0] - 1.15 * x[1]) / 2]), [0, 0], force, step, 1)
        seen = np.full(n, np.nan)
        seen[::10] = x[::10, 0] + 0.005 * rng.standard_normal(n // 10)
        file = save(ask.folder / f"sparse_{k}.csv", "t [s],F [N],x_m [m]", [times(n, step), force, seen])
        fit, done = ask.run("fit", model, "--data", file, "--json", "--quiet")
        assert fit, done["error"]
        remarks += "orrelates" in json.dumps(fit)
        if k < 3:
            found, _ = ask.diagnosis(model, [file])
            wrong += found["verdict"] != "no_effect_found"
    return remarks <= 1 and wrong == 0, f"remarks of a correlation: {remarks} of 20; another verdict: {wrong} of 3", done


COGGING = """effect cogging(x: state, v: state) unless known(der(v)) or x == v "cogging of {x} in the equation of {v}" {
  param ripple = 0;
  nuisance teeth in [1, 200] try 10, 20, 40, 80;
  nuisance phase = 0 in [-4, 4] try 0, 1.57;
  add der(v) += ripple*sin(teeth*x + phase);
}
"""


def cogging(ask, rng):
    """A law outside the catalogue; and as an effect of the user's own, whose text is fitted again."""
    files = []
    for k in range(4):
        force, x = sway(rng, cogging=0.25)
        files.append(save(ask.folder / f"cogging_{k}.csv", "t [s],F [N],x_m [m]",
                          [times(len(force)), force, x[:, 0] + 0.005 * rng.standard_normal(len(force))]))
    model = ask.text("cogging.fdm", SWAY.format(begin=0, balance=DER, second=""))
    outside, _ = ask.diagnosis(model, files[:3], "--validation", files[3])
    law = outside["verdict"] == "law"
    effects, written = ask.text("mine.fdm", COGGING), ask.folder / "cogging_written.fdm"
    found, done = ask.diagnosis(model, files[:3], "--validation", files[3], "--effects", effects, "--write", written)
    names = [c["effect"] for c in found["causes"]]
    again = {"code": None, "seconds": 0.0}
    if written.exists():
        _, again = ask.run("fit", written, *[w for f in files[:3] for w in ("--data", f)], "--json", "--quiet")
    good = law and names == ["cogging"] and again["code"] == 0 and again["seconds"] < 20
    return good, (f"outside: {said(outside)}, {outside['verdict']}; own effect: {said(found)}; "
                  f"refit: code {again['code']}, {again['seconds']:.1f} s"), done


def multistep(ask, rng):
    """A random multistep without a loop, of a body whose drag is missing: no controller."""
    told, names, done = 0, [], None
    for k in range(3):
        files = []
        for r in range(2):
            force = steps(rng, SAMPLES, 60, (-6, 6), 5)
            x = moved(lambda x, u: np.array([x[1], (u - 8.6 * x[0] - 1.15 * x[1] - 1.5 * x[1] * abs(x[1])) / 2]), [0, 0], force)
            noise = rng.standard_normal((2, len(force)))
            files.append(save(ask.folder / f"multistep_{k}_{r}.csv", "t [s],F [N],x_m [m],v_m [m/s]",
                              [times(len(force)), force, x[:, 0] + 0.005 * noise[0], x[:, 1] + 0.01 * noise[1]]))
        model = ask.text("multistep.fdm", SWAY.format(begin=0, balance=DER, second=";\n  output v_m [m/s] = v"))
        found, done = ask.diagnosis(model, files)
        feedback = json.dumps(found.get("feedback"))
        told += "controller" in feedback or "pilot" in feedback
        names.append(said(found))
    return told == 0, f"a controller is said in {told} of 3; {'; '.join(names)}", done


def comparison(ask, rng):
    """Coulomb friction left out, and in: an error of about 0.006 on three validation runs in place of 0.00086."""
    files = []
    noise = Noise("AR(1)", SAMPLES, 0.00085, [0.8])
    for k in range(5):
        force, x = sway(rng, coulomb=0.06)
        files.append(save(ask.folder / f"compare_{k}.csv", "t [s],F [N],x_m [m]",
                          [times(len(force)), force, x[:, 0] + noise.draw(x[:, 0], rng)]))
    naive = SWAY.format(begin=0, balance=DER, second="")
    right = naive.replace("c*v)", "c*v - f*tanh(v/creep))").replace(
        "c = 1 [N*s/m];", "c = 1 [N*s/m], f = 0.1 [N];\n  const creep = 0.001 [m/s];")
    for name, text in (("naive", naive), ("right", right)):
        model = ask.text(f"{name}.fdm", text)
        _, done = ask.run("fit", model, "--data", files[0], "--data", files[1], "--out", ask.folder / name, "--force", "--quiet")
        assert done["code"] == 0, done["error"]
    validation = [word for file in files[2:] for word in ("--data", file)]
    _, done = ask.run("compare", ask.folder / "naive", ask.folder / "right", *validation)
    told = [line.strip() for line in done["out"].splitlines() if line.startswith(("x_m:", " compare_"))]
    good = any("predicts better" in line and "could be chance" not in line for line in told)
    return good, "; ".join(told), done


CASES = {f.__name__: f for f in (offset, form, delay, sparse, cogging, multistep, comparison)}


def main():
    given = argparse.ArgumentParser()
    given.add_argument("folder", type=Path)
    given.add_argument("--fdm", default=str(ROOT / "target" / "release" / "fdm"))
    given.add_argument("--only", default="")
    given.add_argument("--seed", type=int, default=1)
    asked = given.parse_args()
    for name, case in CASES.items():
        if asked.only and name not in asked.only.split(","):
            continue
        rng = np.random.default_rng([asked.seed, *name.encode()])
        good, words, done = case(Asker(asked.fdm, asked.folder / name), rng)
        print(f"| {name} | {words} | {done['seconds']:.1f} s | {'good' if good else 'WRONG' if good is not None else '?'} |", flush=True)


if __name__ == "__main__":
    main()
