"""A small aircraft in six degrees of freedom with stall, lagging surfaces and loss of control effectiveness: records as motion capture
gives them, made without any code of fdm (quaternion, DOP853), models for `fdm fit`, and the figures of both.

    python3 studies/six_dof/aircraft.py make target/six_dof
    python3 studies/six_dof/aircraft.py fit target/six_dof --fdm target/release/fdm --from states|positions --model nominal|tables|true [options of `fdm fit`]
"""

import argparse
import json
import resource
import subprocess
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

M, S, B, C, RHO, G = 2.0, 0.45, 1.6, 0.28, 1.2, 9.80665
JX, JY, JZ, JXZ = 0.10, 0.12, 0.20, 0.01
THRUST = 1.9  # N, along x
TRUE = dict(
    CL0=0.25, CLa=4.8, CLq=5.0, CLde=0.35, CD0=0.04, K=0.06, CDX=0.25,
    Cm0=0.02, Cma=-0.9, Cmq=-11.0, Cmde=-0.9, CmX=-0.12,
    CYb=-0.45, CYdr=0.12, Clb=-0.06, Clp=-0.42, Clr=0.10, Clda=0.14, Cldr=0.01,
    Cnb=0.07, Cnp=-0.03, Cnr=-0.11, Cnda=-0.008, Cndr=-0.06,
    a1=18.0, star=0.27, tau=0.12, Te=0.06, loss=0.5,
)
# parameters that both models have, and those of the true equations alone
SHARED = [k for k in TRUE if k not in ("CDX", "CmX", "a1", "star", "tau", "Te", "loss")]
NAMES = ["north", "east", "down", "phi", "theta", "psi"]
MORE = ["V", "alpha", "beta", "p", "q", "r"]
DEVIATIONS = dict(
    north=0.003, east=0.003, down=0.003, phi=0.003, theta=0.003, psi=0.003,
    V=0.1, alpha=0.006, beta=0.006, p=0.01, q=0.01, r=0.01,
)
RATE, LENGTH = 50.0, 8.0
INPUTS = ["elevator", "aileron", "rudder"]
KINDS = ["nominal", "tables", "true"]


def matrix(q):
    """Body axes to those of the Earth."""
    w, x, y, z = q / np.linalg.norm(q)
    return np.array([
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ])


def angles(q):
    r = matrix(q)
    return np.arctan2(r[2, 1], r[2, 2]), -np.arcsin(r[2, 0]), np.arctan2(r[1, 0], r[0, 0])


def rates(state, command, k=TRUE):
    q, v, om, X, de = state[3:7], state[7:10], state[10:13], state[13], state[14:17]
    speed = np.linalg.norm(v)
    alpha, beta = np.arctan2(v[2], v[0]), np.arcsin(v[1] / speed)
    qbar = 0.5 * RHO * speed**2
    ph, qh, rh = om[0] * B / (2 * speed), om[1] * C / (2 * speed), om[2] * B / (2 * speed)
    held = min(max(X, 0.0), 1.0)
    part = ((1 + np.sqrt(held)) / 2) ** 2
    eff = 1 - k["loss"] * (1 - held)
    lift = k["CL0"] + k["CLa"] * part * alpha + k["CLq"] * qh + k["CLde"] * de[0]
    drag = k["CD0"] + k["K"] * lift**2 + k["CDX"] * (1 - held)
    side = k["CYb"] * beta + k["CYdr"] * de[2]
    roll = k["Clb"] * beta + k["Clp"] * ph + k["Clr"] * rh + eff * k["Clda"] * de[1] + k["Cldr"] * de[2]
    pitch = k["Cm0"] + k["Cma"] * alpha + k["Cmq"] * qh + eff * k["Cmde"] * de[0] + k["CmX"] * (1 - held)
    yaw = k["Cnb"] * beta + k["Cnp"] * ph + k["Cnr"] * rh + k["Cnda"] * de[1] + k["Cndr"] * de[2]
    sa, ca = np.sin(alpha), np.cos(alpha)
    force = qbar * S * np.array([lift * sa - drag * ca, side, -lift * ca - drag * sa]) + [THRUST, 0, 0]
    moment = qbar * S * np.array([B * roll, C * pitch, B * yaw])
    r = matrix(q)
    J = np.array([[JX, 0, -JXZ], [0, JY, 0], [-JXZ, 0, JZ]])
    dv = force / M + r.T @ [0, 0, G] - np.cross(om, v)
    dom = np.linalg.solve(J, moment - np.cross(om, J @ om))
    w, x, y, z = q
    dq = 0.5 * np.array([
        -x * om[0] - y * om[1] - z * om[2], w * om[0] + y * om[2] - z * om[1],
        w * om[1] - x * om[2] + z * om[0], w * om[2] + x * om[1] - y * om[0],
    ])
    still = 0.5 * (1 - np.tanh(k["a1"] * (alpha - k["star"])))
    return np.concatenate([r @ v, dq, dv, dom, [(still - X) / k["tau"]], (command - de) / k["Te"]])


def commands(seed, grid):
    """Steps and 3-2-1-1 in all surfaces, held between samples; the elevator of some runs pulls through the stall."""
    rng = np.random.default_rng(seed)
    u = np.zeros((len(grid), 3))
    u[:, 0] = -0.02
    sizes = [0.12 if seed % 2 == 0 else 0.3, 0.15, 0.15]
    for channel, size in enumerate(sizes):
        at, sign = 0.5 + 0.7 * channel + 0.3 * rng.random(), rng.choice([-1.0, 1.0])
        for part in np.array([3, 2, 1, 1]) * (0.25 + 0.15 * rng.random()):
            inside = (grid >= at) & (grid < at + part)
            # a pull is up elevator
            pull = -abs(size) if channel == 0 and sign < 0 else sign * size * (0.6 if channel == 0 else 1.0)
            u[inside, channel] += pull
            at, sign = at + part, -sign
    return u


def record(seed):
    grid = np.arange(0, LENGTH + 1e-9, 1 / RATE)
    u = commands(seed, grid)
    rng = np.random.default_rng(1000 + seed)
    phi, theta, psi = 0.1 * rng.standard_normal(), 0.05 + 0.03 * rng.standard_normal(), rng.uniform(-2, 2)
    h = np.array([phi, theta, psi]) / 2
    c, s = np.cos(h), np.sin(h)
    q = np.array([
        c[0] * c[1] * c[2] + s[0] * s[1] * s[2], s[0] * c[1] * c[2] - c[0] * s[1] * s[2],
        c[0] * s[1] * c[2] + s[0] * c[1] * s[2], c[0] * c[1] * s[2] - s[0] * s[1] * c[2],
    ])
    speed, alpha = 13 + rng.uniform(-1, 1), 0.05
    x = np.concatenate([
        rng.uniform(-1, 1, 3), q, [speed * np.cos(alpha), 0.2 * rng.standard_normal(), speed * np.sin(alpha)],
        0.1 * rng.standard_normal(3), [1.0], u[0],
    ])
    rows = [x]
    for k in range(len(grid) - 1):
        solved = solve_ivp(lambda t, s: rates(s, u[k]), (0, 1 / RATE), x, method="DOP853", rtol=1e-9, atol=1e-10)
        x = solved.y[:, -1]
        rows.append(x)
    rows = np.array(rows)
    euler = np.unwrap(np.array([angles(r[3:7]) for r in rows]), axis=0)
    v = rows[:, 7:10]
    speed = np.linalg.norm(v, axis=1)
    air = np.column_stack([speed, np.arctan2(v[:, 2], v[:, 0]), np.arcsin(v[:, 1] / speed)])
    exact = np.column_stack([rows[:, :3], euler, air, rows[:, 10:13]])
    noise = np.array([DEVIATIONS[n] for n in NAMES + MORE])
    return grid, u, exact, exact + noise * rng.standard_normal(exact.shape)


BODY = """
  const m = 2 [kg], S = 0.45 [m^2], b = 1.6 [m], c = 0.28 [m], rho = 1.2 [kg/m^3], g = 9.80665 [m/s^2], thrust = 1.9 [N];
  const Jx = 0.10 [kg*m^2], Jy = 0.12 [kg*m^2], Jz = 0.20 [kg*m^2], Jxz = 0.01 [kg*m^2];
  state pos[3] = free [m], phi = free [rad], theta = free [rad], psi = free [rad];
  state V[3] = free [m/s], w[3] = free [rad/s];
  let R[3, 3] [1] = dcm(phi, theta, psi);
  let turn [rad/s] = (w[2]*sin(phi) + w[3]*cos(phi))/cos(theta);
  let speed = norm(V) [m/s], alpha = atan2(V[3], V[1]) [rad], beta = asin(clip(V[2]/max(speed, 1), -1, 1)) [rad];
  let air = max(speed, 1) [m/s], qS = rho*speed^2/2*S [N];
  let ph = w[1]*b/(2*air) [1], qh = w[2]*c/(2*air) [1], rh = w[3]*b/(2*air) [1];
  let side = CYb*beta + CYdr*dr [1];
  let roll = Clb*beta + Clp*ph + Clr*rh + eff*Clda*da + Cldr*dr [1];
  let yaw = Cnb*beta + Cnp*ph + Cnr*rh + Cnda*da + Cndr*dr [1];
  let force[3] [N] = [qS*(lift*sin(alpha) - drag*cos(alpha)) + thrust, qS*side, -qS*(lift*cos(alpha) + drag*sin(alpha))];
  der(pos) = R*V;
  der(V) = force/m + transpose(R)*[0, 0, g] - cross(w, V);
  Jx*der(w[1]) - Jxz*der(w[3]) = qS*b*roll - (Jz - Jy)*w[2]*w[3] + Jxz*w[1]*w[2];
  Jy*der(w[2]) = qS*c*pitch - (Jx - Jz)*w[1]*w[3] - Jxz*(w[1]^2 - w[3]^2);
  Jz*der(w[3]) - Jxz*der(w[1]) = qS*b*yaw - (Jy - Jx)*w[1]*w[2] - Jxz*w[2]*w[3];
  der(phi) = w[1] + turn*sin(theta);
  der(theta) = w[2]*cos(phi) - w[3]*sin(phi);
  der(psi) = turn;
  output north_m [m] = pos[1], east_m [m] = pos[2], down_m [m] = pos[3];
  output phi_m [rad] = phi, theta_m [rad] = theta, psi_m [rad] = psi;
"""
STATES = """
  output V_m [m/s] = speed, alpha_m [rad] = alpha, beta_m [rad] = beta;
  output p_m [rad/s] = w[1], q_m [rad/s] = w[2], r_m [rad/s] = w[3];
"""
NOMINAL = """
  param CL0 = 0.2, CLa = 5, CLq = 0 fixed, CLde = 0.3, CD0 = 0.03 in [0, 1], K = 0.05 in [0, 1];
  param Cm0 = 0, Cma = -0.6, Cmq = -8, Cmde = -0.7;
  let da = aileron [rad], dr = rudder [rad], eff = 1;
  let lift = CL0 + CLa*alpha + CLq*qh + CLde*elevator [1];
  let drag = CD0 + K*lift^2 [1];
  let pitch = Cm0 + Cma*alpha + Cmq*qh + Cmde*elevator [1];
"""
STALL = """
  param CL0 = 0.2, CLa = 5, CLq = 3, CLde = 0.3, CD0 = 0.03 in [0, 1], K = 0.05 in [0, 1], CDX = 0.1;
  param Cm0 = 0, Cma = -0.6, Cmq = -8, Cmde = -0.7, CmX = -0.05;
  param a1 = 12 in [2, 60], star = 0.3 in [0.1, 0.6] [rad], tau = 0.2 in [0.02, 2] [s];
  param Te = 0.1 in [0.01, 1] [s], loss = 0.2 in [0, 1];
  state X = 1 [1], de = initial(elevator) [rad], da = initial(aileron) [rad], dr = initial(rudder) [rad];
  let still = (1 - tanh(a1*(alpha - star)))/2 [1];
  der(X) = (still - X)/tau;
  der(de) = (elevator - de)/Te;
  der(da) = (aileron - da)/Te;
  der(dr) = (rudder - dr)/Te;
  let held = clip(X, 0, 1) [1], eff = 1 - loss*(1 - held) [1];
  let lift = CL0 + CLa*((1 + sqrt(held + 1e-12))/2)^2*alpha + CLq*qh + CLde*de [1];
  let drag = CD0 + K*lift^2 + CDX*(1 - held) [1];
  let pitch = Cm0 + Cma*alpha + Cmq*qh + eff*Cmde*de + CmX*(1 - held) [1];
"""
# the nominal model with what bends over the angle of attack as smooth tables, and a lag in the surfaces: no equation of the stall
TABLES = """
  param CLq = 0, CLde = 0.3, K = 0.05 in [0, 1];
  param Cmq = -8, Cmde = -0.7, Te = 0.1 in [0.01, 1] [s];
  table CL(alpha [rad]) [1] = cubic {
    alpha: [-0.15, -0.05, 0.05, 0.15, 0.25, 0.35, 0.5, 0.7], CL: free [-0.5, 0, 0.5, 1, 1.3, 1.4, 1.5, 1.6]
  };
  table CDp(alpha [rad]) [1] = cubic { alpha: [-0.15, 0.05, 0.2, 0.35, 0.5, 0.7], CDp: free 0.04 };
  table Cm(alpha [rad]) [1] = cubic {
    alpha: [-0.15, -0.05, 0.05, 0.15, 0.25, 0.35, 0.5, 0.7], Cm: free [0.1, 0.03, -0.03, -0.1, -0.15, -0.2, -0.3, -0.4]
  };
  table control(alpha [rad]) [1] = cubic { alpha: [0, 0.1, 0.2, 0.3, 0.45, 0.7], control: [1, 1, 1, e4, e5, e6] };
  param e4 = 0.9 in [0, 1.5] [1], e5 = 0.8 in [0, 1.5] [1], e6 = 0.7 in [0, 1.5] [1];
  smooth CL by order 2; smooth CDp by order 2; smooth Cm by order 2;
  state de = initial(elevator) [rad], da = initial(aileron) [rad], dr = initial(rudder) [rad];
  der(de) = (elevator - de)/Te;
  der(da) = (aileron - da)/Te;
  der(dr) = (rudder - dr)/Te;
  let eff = control(alpha) [1];
  let lift = CL(alpha) + CLq*qh + CLde*de [1];
  let drag = CDp(alpha) + K*lift^2 [1];
  let pitch = Cm(alpha) + Cmq*qh + eff*Cmde*de [1];
"""
LATERAL = """
  param CYb = -0.3, CYdr = 0.1, Clb = -0.03, Clp = -0.3, Clr = 0.05, Clda = 0.1, Cldr = 0;
  param Cnb = 0.04, Cnp = 0, Cnr = -0.05, Cnda = 0, Cndr = -0.04;
"""


def model(kind, measured):
    own = {"nominal": NOMINAL, "tables": TABLES, "true": STALL}[kind]
    outputs = STATES if measured == "states" else ""
    return f"model aircraft {{\n  input elevator [rad], aileron [rad], rudder [rad];\n{own}{LATERAL}{BODY}{outputs}}}\n"


UNITS = dict(north="m", east="m", down="m", x="m", z="m", V="m/s", p="rad/s", q="rad/s", r="rad/s")


def write_runs(folder, inputs, names, record):
    """Twelve records as measured and as they are exactly; `record` makes one from its seed. Angles where no unit is known."""
    folder.mkdir(parents=True, exist_ok=True)
    titles = ["t [s]"] + [f"{n} [rad]" for n in inputs] + [f"{n}_m [{UNITS.get(n, 'rad')}]" for n in names]
    for seed in range(12):
        grid, u, exact, measured = record(seed)
        for name, y in (("run", measured), ("exact", exact)):
            table = np.column_stack([grid, u, y])
            np.savetxt(folder / f"{name}{seed}.csv", table, delimiter=",", header=",".join(titles), comments="", fmt="%.10g")
        speed, alpha = exact[:, names.index("V")], np.degrees(exact[:, names.index("alpha")])
        print(f"run{seed}: speed {speed.min():.1f} to {speed.max():.1f} m/s, alpha {alpha.min():.1f} to {alpha.max():.1f} deg")


def make(folder):
    write_runs(folder, INPUTS, NAMES + MORE, record)
    for kind in KINDS:
        for measured in ("states", "positions"):
            (folder / f"{kind}_{measured}.fdm").write_text(model(kind, measured))


@dataclass
class Flight:
    """What is asked of a folder of runs: the first eight may be fitted, the last four are predicted."""

    inputs: list
    # of every model, and those whose true values stand in the simulator's equations
    kinds: list
    true: dict

    def fit(self, asked, extra):
        result = asked.folder / f"result_{asked.model}_{asked.measured}"
        runs = [str(asked.folder / f"run{k}.csv") for k in range(asked.runs)]
        held = [word for name in self.inputs for word in ("--zoh", name)]
        command = [asked.fdm, "fit", str(asked.folder / f"{asked.model}_{asked.measured}.fdm"), "--data", *runs, *held, "--json",
                   "--out", str(result), "--force", "--quiet", *extra]
        began, used = time.time(), resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        done = subprocess.run(command, capture_output=True, text=True)
        used = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - used
        print(f"{asked.model} from {asked.measured}: exit code {done.returncode}, {time.time() - began:.1f} s, {used:.1f} s of processor time")
        if done.returncode == 2:
            print(done.stderr[:2000])
            return
        found = json.loads(done.stdout)
        print(f"  {found['termination']} after {found['iterations']} iterations, cost {found.get('cost')}")
        print("  " + "\n  ".join(done.stderr.splitlines()[:8]))
        self.parameters(found["parameters"])
        self.predictions(asked, result, held)

    def parameters(self, found):
        """Every parameter that the true equations have under the same name, in errors from its value there."""
        inside = []
        for p in found:
            if p["name"] in self.true and p.get("run") is None:
                error = p.get("corrected_error") or p.get("standard_error")
                off = (p["value"] - self.true[p["name"]]) / error if error else float("nan")
                inside.append(abs(off) < 1.96)
                print(f"  {p['name']:6} {p['value']:10.4f} true {self.true[p['name']]:8.4f} off {off:6.2f} errors")
        print(f"  within 95 %: {sum(inside)} of {len(inside)}")

    def predictions(self, asked, result, held):
        """Open loop; initial states of validation runs from their first second."""
        errors, first = [], 1 + len(self.inputs)
        for k in range(8, 12):
            command = [asked.fdm, "simulate", "--from-result", str(result), "--like", "run0", "--data", str(asked.folder / f"run{k}.csv"),
                       "--initial-from", "1", *held]
            done = subprocess.run(command, capture_output=True, text=True)
            lines = done.stdout.splitlines()
            if done.returncode == 2 or not lines:
                print("  " + done.stderr[:500])
                continue
            y = np.genfromtxt(lines, delimiter=",", skip_header=1)
            exact = np.genfromtxt(asked.folder / f"exact{k}.csv", delimiter=",", skip_header=1)[:, first : first + y.shape[1] - 1]
            errors.append([np.sqrt(np.mean((y[:, 1 + o] - exact[:, o]) ** 2)) / np.ptp(exact[:, o]) for o in range(y.shape[1] - 1)])
        if errors:
            print(f"  open-loop validation error, range-normalised RMS over outputs: {np.mean(errors):.4f} (by run {np.mean(errors, axis=1).round(4)})")


def main(description, flight, make):
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("what", choices=["make", "fit"])
    parser.add_argument("folder", type=Path)
    parser.add_argument("--fdm", default="target/release/fdm")
    parser.add_argument("--from", dest="measured", default="states", choices=["states", "positions"])
    parser.add_argument("--model", default="nominal", choices=flight.kinds)
    parser.add_argument("--runs", type=int, default=8, help="of the first eight, those that are fitted")
    # what it does not know is for `fdm fit`
    asked, extra = parser.parse_known_args()
    make(asked.folder) if asked.what == "make" else flight.fit(asked, extra)


if __name__ == "__main__":
    main(__doc__, Flight(INPUTS, KINDS, TRUE), make)
