"""The aircraft of `aircraft.py` in the vertical plane, flown by a controller of which no column tells: neither the elevator nor its
command is recorded, only the attitude that was asked for and the stick beside it. Made without any code of fdm (DOP853).

    python3 studies/six_dof/controlled.py make target/controlled
    python3 studies/six_dof/controlled.py fit target/controlled --fdm target/release/fdm --from states|positions --model nominal|tables|true [options of `fdm fit`]

The nominal model takes the stick for the elevator. The others have a controller whose gains are estimated: in `tables` beside smooth tables
of lift, drag and pitching moment, in `true` beside the equations of the simulator.
"""

import numpy as np
from scipy.integrate import solve_ivp

import aircraft
from aircraft import C, G, JY, LENGTH, M, RATE, RHO, S, THRUST

NAMES, MORE = ["x", "z", "theta"], ["V", "alpha", "q"]
DEVIATIONS = dict(x=0.003, z=0.003, theta=0.003, V=0.1, alpha=0.006, q=0.01)
LONGITUDINAL = ["CL0", "CLa", "CLq", "CLde", "CD0", "K", "CDX", "Cm0", "Cma", "Cmq", "Cmde", "CmX", "a1", "star", "tau", "Te", "loss"]
# gains of attitude, of its integral and of the pitch rate; the elevator's middle
TRUE = {name: aircraft.TRUE[name] for name in LONGITUDINAL} | dict(Kp=0.5, Ki=0.4, Kq=0.12, middle=-0.03)
INPUTS = ["stick", "target"]


def rates(state, u, k=TRUE):
    _, _, theta, vx, vz, q, still, de, summed = state
    stick, target = u
    speed, alpha = np.hypot(vx, vz), np.arctan2(vz, vx)
    qS, qh = 0.5 * RHO * speed**2 * S, q * C / (2 * speed)
    held = min(max(still, 0.0), 1.0)
    eff = 1 - k["loss"] * (1 - held)
    lift = k["CL0"] + k["CLa"] * ((1 + np.sqrt(held)) / 2) ** 2 * alpha + k["CLq"] * qh + k["CLde"] * de
    drag = k["CD0"] + k["K"] * lift**2 + k["CDX"] * (1 - held)
    pitch = k["Cm0"] + k["Cma"] * alpha + k["Cmq"] * qh + eff * k["Cmde"] * de + k["CmX"] * (1 - held)
    along = qS * (lift * np.sin(alpha) - drag * np.cos(alpha)) + THRUST
    down = -qS * (lift * np.cos(alpha) + drag * np.sin(alpha))
    command = k["middle"] + stick + k["Kp"] * (theta - target) + k["Ki"] * summed + k["Kq"] * q
    wanted = 0.5 * (1 - np.tanh(k["a1"] * (alpha - k["star"])))
    return np.array([
        vx * np.cos(theta) + vz * np.sin(theta), vz * np.cos(theta) - vx * np.sin(theta), q,
        along / M - G * np.sin(theta) - q * vz, down / M + G * np.cos(theta) + q * vx, qS * C * pitch / JY,
        (wanted - still) / k["tau"], (command - de) / k["Te"], theta - target,
    ])


def demands(seed, grid):
    """Stick and target, held between samples: 3-2-1-1 of the stick and steps of the target; every second run is pulled into the stall."""
    rng = np.random.default_rng(500 + seed)
    u = np.zeros((len(grid), 2))
    u[:, 1] = 0.05
    at, sign = 0.4 + 0.4 * rng.random(), rng.choice([-1.0, 1.0])
    for part in np.array([3, 2, 1, 1]) * (0.2 + 0.1 * rng.random()):
        u[(grid >= at) & (grid < at + part), 0] = 0.08 * sign
        at, sign = at + part, -sign
    at = 3.0 + rng.random()
    if seed % 2:
        u[(grid >= at) & (grid < at + 0.8), 0] = -0.35
    for size in (0.15 if seed % 2 == 0 else 0.5, -0.1, 0.1):
        u[grid >= at, 1] = 0.05 + size
        at += 1.2 + 0.4 * rng.random()
    return u


def record(seed):
    grid = np.arange(0, LENGTH + 1e-9, 1 / RATE)
    u = demands(seed, grid)
    rng = np.random.default_rng(1500 + seed)
    speed, alpha = 13 + rng.uniform(-1, 1), 0.06
    x = np.array([
        *rng.uniform(-1, 1, 2), 0.05 + 0.03 * rng.standard_normal(), speed * np.cos(alpha), speed * np.sin(alpha), 0.1 * rng.standard_normal(),
        1.0, TRUE["middle"], 0.0,
    ])
    rows = [x]
    for k in range(len(grid) - 1):
        x = solve_ivp(lambda t, s: rates(s, u[k]), (0, 1 / RATE), x, method="DOP853", rtol=1e-9, atol=1e-10).y[:, -1]
        rows.append(x)
    rows = np.array(rows)
    exact = np.column_stack([rows[:, :3], np.hypot(rows[:, 3], rows[:, 4]), np.arctan2(rows[:, 4], rows[:, 3]), rows[:, 5]])
    return grid, u, exact, exact + np.array([DEVIATIONS[n] for n in NAMES + MORE]) * rng.standard_normal(exact.shape)


BODY = """
  const m = 2 [kg], S = 0.45 [m^2], c = 0.28 [m], rho = 1.2 [kg/m^3], g = 9.80665 [m/s^2], thrust = 1.9 [N], Jy = 0.12 [kg*m^2];
  state x = free [m], z = free [m], theta = free [rad], vx = free [m/s], vz = free [m/s], q = free [rad/s];
  let speed = hypot(vx, vz) [m/s], alpha = atan2(vz, vx) [rad], air = max(speed, 1) [m/s], qS = rho*speed^2/2*S [N], qh = q*c/(2*air) [1];
  der(x) = vx*cos(theta) + vz*sin(theta);
  der(z) = vz*cos(theta) - vx*sin(theta);
  der(theta) = q;
  m*der(vx) = qS*(lift*sin(alpha) - drag*cos(alpha)) + thrust - m*g*sin(theta) - m*q*vz;
  m*der(vz) = -qS*(lift*cos(alpha) + drag*sin(alpha)) + m*g*cos(theta) + m*q*vx;
  Jy*der(q) = qS*c*pitch;
  output x_m [m] = x, z_m [m] = z, theta_m [rad] = theta;
"""
STATES = "  output V_m [m/s] = speed, alpha_m [rad] = alpha, q_m [rad/s] = q;\n"
CONTROLLER = """
  param Kp = 0.3 in [-5, 5] [1], Ki = 0.1 in [-5, 5] [1/s], Kq = 0 in [-5, 5] [s], middle = 0 [rad], Te = 0.1 in [0.01, 1] [s];
  state de = middle [rad], summed = 0 [rad*s];
  der(summed) = theta - target;
  der(de) = (middle + stick + Kp*(theta - target) + Ki*summed + Kq*q - de)/Te;
"""
MODELS = {
    "nominal": aircraft.NOMINAL.replace("let da = aileron [rad], dr = rudder [rad], eff = 1;", "").replace("elevator", "stick"),
    "tables": CONTROLLER + aircraft.TABLES[: aircraft.TABLES.index("  state de")].replace(", Te = 0.1 in [0.01, 1] [s]", "")
    + aircraft.TABLES[aircraft.TABLES.index("  let eff") :],
    "true": CONTROLLER + """
  param CL0 = 0.2, CLa = 5, CLq = 3, CLde = 0.3, CD0 = 0.03 in [0, 1], K = 0.05 in [0, 1], CDX = 0.1;
  param Cm0 = 0, Cma = -0.6, Cmq = -8, Cmde = -0.7, CmX = -0.05;
  param a1 = 12 in [2, 60], star = 0.3 in [0.1, 0.6] [rad], tau = 0.2 in [0.02, 2] [s], loss = 0.2 in [0, 1];
  state X = 1 [1];
  let still = (1 - tanh(a1*(alpha - star)))/2 [1];
  der(X) = (still - X)/tau;
""" + aircraft.STALL[aircraft.STALL.index("  let held") :],
}


def make(folder):
    aircraft.write_runs(folder, INPUTS, NAMES + MORE, record)
    for kind, own in MODELS.items():
        for measured in ("states", "positions"):
            outputs = STATES if measured == "states" else ""
            text = f"model controlled {{\n  input stick [rad], target [rad];\n{own}{BODY}{outputs}}}\n"
            (folder / f"{kind}_{measured}.fdm").write_text(text)


if __name__ == "__main__":
    aircraft.main(__doc__, aircraft.Flight(INPUTS, list(MODELS), TRUE), make)
