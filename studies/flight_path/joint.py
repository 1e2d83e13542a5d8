"""Flight-path reconstruction beside aerodynamics in one likelihood, and in two steps: coverage of the 95 % intervals of both.

    python3 studies/flight_path/joint.py FOLDER --fdm target/release/fdm [--repeats 200]

Flights are made without any code of fdm (DOP853). Two steps are: errors of the sensors and the wind from the kinematics alone, which measured
accelerations and rates drive; then the aerodynamics with these values taken for known. One likelihood is `models/flight_path/joint.fdm`. The same
output-error fits, the same records. Finished flights are kept in the folder.
"""

import argparse
import json
import subprocess
import time
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

M, IY, S, C, RHO, G, THRUST = 1100.0, 1800.0, 16.0, 1.5, 1.1, 9.80665, 1300.0
AERO = dict(CL0=0.25, CLa=5.1, CLde=0.42, CD0=0.032, K=0.055, Cm0=0.02, Cma=-0.95, Cmq=-14.0, Cmde=-1.25)
SENSORS = dict(bax=0.06, baz=-0.1, bq=0.004, Ka=1.08, ba=-0.012, wind=6.0)
NAMES = ["ax_m", "az_m", "q_m", "theta_m", "V_m", "alpha_m", "ahead_m", "down_m"]
UNITS = ["m/s^2", "m/s^2", "rad/s", "rad", "m/s", "rad", "m/s", "m/s"]
NOISE = np.array([0.05, 0.08, 0.003, 0.004, 0.4, 0.004, 0.15, 0.15])
DT, LENGTH = 0.05, 40.0
GRID = np.arange(0, LENGTH + 1e-9, DT)

KINEMATICS = """
model kinematics "errors of the sensors and wind, from kinematics alone" {
  input ax [m/s^2], az [m/s^2], q [rad/s];
  const g = 9.80665 [m/s^2];
  state u = free [m/s], w = free [m/s], theta = free [rad];
  param bax = 0 [m/s^2], baz = 0 [m/s^2], bq = 0 [rad/s], Ka = 1 in [0.5, 2] [1], ba = 0 [rad], wind = 0 [m/s];
  let rate = q - bq [rad/s];
  der(u) = ax - bax - rate*w - g*sin(theta);
  der(w) = az - baz + rate*u + g*cos(theta);
  der(theta) = rate;
  output theta_m [rad] = theta, V_m [m/s] = hypot(u, w), alpha_m [rad] = Ka*atan2(w, u) + ba;
  output ahead_m [m/s] = u*cos(theta) + w*sin(theta) - wind, down_m [m/s] = w*cos(theta) - u*sin(theta);
}
"""


def elevator():
    """3-2-1-1 about the trim, and a slow pull and push."""
    u = np.full(len(GRID), -0.028)
    at, sign = 2.0, -1.0
    for part in (1.8, 1.2, 0.6, 0.6):
        u[(GRID >= at) & (GRID < at + part)] += sign * 0.035
        at, sign = at + part, -sign
    slow = (GRID > 14) & (GRID < 34)
    u[slow] += 0.02 * np.sin(2 * np.pi * (GRID[slow] - 14) / 10)
    return u


def forces(x, de):
    u, w, q, _ = x
    v, a = np.hypot(u, w), np.arctan2(w, u)
    lift = AERO["CL0"] + AERO["CLa"] * a + AERO["CLde"] * de
    drag = AERO["CD0"] + AERO["K"] * lift**2
    push = RHO * v * v * S / 2
    moment = AERO["Cm0"] + AERO["Cma"] * a + AERO["Cmq"] * q * C / (2 * v) + AERO["Cmde"] * de
    ax = (push * (lift * np.sin(a) - drag * np.cos(a)) + THRUST) / M
    az = -push * (lift * np.cos(a) + drag * np.sin(a)) / M
    return ax, az, push * C * moment / IY


def exact():
    """What perfect sensors with these errors, and without noise, show."""
    de = elevator()

    def rates(t, x):
        ax, az, dq = forces(x, np.interp(t, GRID, de))
        u, w, q, th = x
        return [ax - q * w - G * np.sin(th), az + q * u + G * np.cos(th), dq, q]

    x = np.array([50.0, 2.2, 0.0, 0.05])
    rows = [x]
    for a, b in zip(GRID[:-1], GRID[1:]):
        x = solve_ivp(rates, (a, b), x, method="DOP853", rtol=1e-10, atol=1e-11).y[:, -1]
        rows.append(x)
    x = np.array(rows)
    shown = []
    for row, d in zip(x, de):
        ax, az, _ = forces(row, d)
        u, w, q, th = row
        shown.append([
            ax + SENSORS["bax"], az + SENSORS["baz"], q + SENSORS["bq"], th, np.hypot(u, w), SENSORS["Ka"] * np.arctan2(w, u) + SENSORS["ba"],
            u * np.cos(th) + w * np.sin(th) - SENSORS["wind"], w * np.cos(th) - u * np.sin(th),
        ])
    return de, np.array(shown)


def written(path, titles, columns):
    np.savetxt(path, np.column_stack(columns), delimiter=",", header=",".join(titles), comments="", fmt="%.9g")


def fitted(fdm, model, record, *extra):
    done = subprocess.run([fdm, "fit", str(model), "--data", str(record), "--integration-accuracy", "1e-6", "--threads", "1", "--json", "--quiet", *extra], capture_output=True, text=True)
    if done.returncode == 2:
        raise RuntimeError(done.stderr[:1000])
    found = json.loads(done.stdout)
    return found["termination"], {p["name"]: p for p in found["parameters"]}


def value_and_interval(p):
    error = p.get("corrected_error") or p.get("standard_error")
    interval = p.get("interval")
    return p["value"], error, interval or ([p["value"] - 1.96 * error, p["value"] + 1.96 * error] if error else None)


def flight(folder, fdm, joint, number, de, shown):
    kept = folder / f"flight{number}.json"
    if kept.exists():
        return json.loads(kept.read_text())
    rng = np.random.default_rng(7000 + number)
    noisy = shown + NOISE * rng.standard_normal(shown.shape)
    titles = ["t [s]", "elevator [rad]"] + [f"{n} [{u}]" for n, u in zip(NAMES, UNITS)]
    record = folder / "flight.csv"
    written(record, titles, [GRID, de, noisy])
    # accelerations and the rate drive the kinematics
    driving = folder / "kinematics.csv"
    written(
        driving, ["t [s]", "ax [m/s^2]", "az [m/s^2]", "q [rad/s]"] + titles[5:],
        [GRID, noisy[:, 0], noisy[:, 1], noisy[:, 2], noisy[:, 3:]],
    )
    answers = {}
    end, found = fitted(fdm, joint, record)
    answers["joint"] = [end, {n: value_and_interval(found[n]) for n in [*AERO, *SENSORS]}]
    end, first = fitted(fdm, folder / "kinematics.fdm", driving)
    known = [w for n in SENSORS for w in ("--set", f"{n}={first[n]['value']:.12g}", "--fix", n)]
    ended, second = fitted(fdm, joint, record, *known)
    parts = {n: value_and_interval(second[n]) for n in AERO} | {n: value_and_interval(first[n]) for n in SENSORS}
    answers["two steps"] = [end if end != "converged" else ended, parts]
    kept.write_text(json.dumps(answers))
    return answers


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default="target/release/fdm")
    parser.add_argument("--repeats", type=int, default=200)
    parser.add_argument("--record", type=Path, help="write one noisy flight there, and stop")
    a = parser.parse_args()
    a.folder.mkdir(parents=True, exist_ok=True)
    joint = Path(__file__).resolve().parents[2] / "models/flight_path/joint.fdm"
    (a.folder / "kinematics.fdm").write_text(KINEMATICS)
    de, shown = exact()
    print(f"airspeed {shown[:, 4].min():.1f} to {shown[:, 4].max():.1f} m/s, angle of attack "
          f"{np.degrees((shown[:, 5] - SENSORS['ba']) / SENSORS['Ka']).min():.1f} to "
          f"{np.degrees((shown[:, 5] - SENSORS['ba']) / SENSORS['Ka']).max():.1f} deg")
    if a.record:
        rng = np.random.default_rng(1)
        noisy = shown + NOISE * rng.standard_normal(shown.shape)
        titles = ["t [s]", "elevator [rad]"] + [f"{n} [{u}]" for n, u in zip(NAMES, UNITS)]
        np.savetxt(a.record, np.column_stack([GRID, de, noisy]), delimiter=",", header=",".join(titles), comments="", fmt="%.4g")
        return
    began = time.time()
    flights = [flight(a.folder, a.fdm, joint, k, de, shown) for k in range(a.repeats)]
    print(f"{len(flights)} flights, {time.time() - began:.0f} s")
    print("| parameter | truth | joint: bias over scatter | error over scatter | covers, % | two steps: bias over scatter | error over scatter | covers, % | scatter, two steps over joint |")
    print("|---|---|---|---|---|---|---|---|---|")
    for name, truth in (AERO | SENSORS).items():
        row, scatters = [], []
        for way in ("joint", "two steps"):
            good = [f[way][1][name] for f in flights if f[way][0] == "converged"]
            values = np.array([g[0] for g in good])
            errors = np.array([g[1] or np.nan for g in good])
            inside = [g[2] is not None and g[2][0] <= truth <= g[2][1] for g in good]
            scatter = values.std()
            scatters.append(scatter)
            row += [f"{(values.mean() - truth) / scatter:+.2f}", f"{np.sqrt(np.mean(errors**2)) / scatter:.2f}", f"{100 * np.mean(inside):.1f}"]
        print(f"| {name} | {truth} | " + " | ".join(row) + f" | {scatters[1] / scatters[0]:.2f} |")
    for way in ("joint", "two steps"):
        print(way, "converged:", sum(f[way][0] == "converged" for f in flights))


if __name__ == "__main__":
    main()
