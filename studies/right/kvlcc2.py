"""Turns of the tanker KVLCC2 by the published coefficients, integrated apart from the library's part `std/ship_mmg`.

    python3 studies/right/kvlcc2.py target/release/fdm

Yasukawa and Yoshimura (2015), J. Marine Science and Technology 20:37-52: equations 4 to 26 and tables 1 to 4 at full scale, with the resistance of
the ship at the turns that hold 15.5 kn; the rudder moves 2.34 degrees a second. Prints advance at 90 degrees of heading and tactical diameter at 180,
in ship lengths, to both sides, beside those of the part, simulated by the program, and of the paper's own simulation. Needs NumPy and SciPy.
"""
import math
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from scipy.integrate import solve_ivp

L, DRAUGHT, VOLUME, XG, RHO = 320.0, 20.8, 312600.0, 11.2, 1025.0
DIAMETER, RUDDER, SPAN = 9.86, 112.5, 15.8
RESISTANCE, TURNS, SPEED, RATE = 0.00789, 1.2287884, 15.5 * 1852 / 3600, 2.34
UNIT = 0.5 * RHO * L**2 * DRAUGHT
MASS, MX, MY, JZ = RHO * VOLUME, 0.022 * UNIT, 0.223 * UNIT, 0.011 * UNIT * L**2
INERTIA = MASS * (0.25 * L) ** 2
ACCELERATED = np.array([[MASS + MX, 0, 0], [0, MASS + MY, XG * MASS], [0, XG * MASS, INERTIA + XG**2 * MASS + JZ]])


def motion(t, state, rudder):
    u, v, r, psi, _, _ = state
    delta = math.radians(math.copysign(min(RATE * t, abs(rudder)), rudder))
    speed, drift = math.hypot(u, v), math.atan2(-v, u)
    sway, yaw, push = v / speed, r * L / speed, 0.5 * RHO * L * DRAUGHT * speed**2
    hull = (
        push * (-RESISTANCE - 0.040 * sway**2 + 0.002 * sway * yaw + 0.011 * yaw**2 + 0.771 * sway**4),
        push * (-0.315 * sway + 0.083 * yaw - 1.607 * sway**3 + 0.379 * sway**2 * yaw - 0.391 * sway * yaw**2 + 0.008 * yaw**3),
        push * L * (-0.137 * sway - 0.049 * yaw - 0.030 * sway**3 - 0.294 * sway**2 * yaw + 0.055 * sway * yaw**2 - 0.013 * yaw**3),
    )
    at_propeller = drift + 0.48 * yaw
    wake = 0.65 * (1 + (1 - math.exp(-2.0 * abs(at_propeller))) * ((1.6 if at_propeller > 0 else 1.1) - 1))
    ratio = u * wake / (TURNS * DIAMETER)
    thrust = 0.2931 - 0.2753 * ratio - 0.1385 * ratio**2
    at_rudder = drift + 0.710 * yaw
    across = speed * (0.640 if at_rudder > 0 else 0.395) * at_rudder
    race = 1 + 0.50 * (math.sqrt(1 + 8 * thrust / (math.pi * ratio**2)) - 1)
    along = 1.09 * u * wake * math.sqrt(DIAMETER / SPAN * race**2 + 1 - DIAMETER / SPAN)
    normal = 0.5 * RHO * RUDDER * (along**2 + across**2) * 2.747 * math.sin(delta - math.atan2(across, along))
    forces = [
        hull[0] - (1 - 0.387) * normal * math.sin(delta) + (1 - 0.220) * RHO * TURNS**2 * DIAMETER**4 * thrust,
        hull[1] - (1 + 0.312) * normal * math.cos(delta),
        hull[2] + (0.5 + 0.312 * 0.464) * L * normal * math.cos(delta),
    ]
    turned = [(MASS + MY) * v * r + XG * MASS * r**2, -(MASS + MX) * u * r, -XG * MASS * u * r]
    rates = np.linalg.solve(ACCELERATED, np.add(forces, turned))
    return [*rates, r, u * math.cos(psi) - v * math.sin(psi), u * math.sin(psi) + v * math.cos(psi)]


def turn(rudder):
    def heading(angle):
        return lambda t, state, _: abs(state[3]) - angle

    events = [heading(math.pi / 2), heading(math.pi)]
    events[1].terminal = True
    found = solve_ivp(motion, (0, 1500), [SPEED, 0, 0, 0, 0, 0], "DOP853", args=(rudder,), rtol=1e-10, atol=1e-12, events=events, max_step=2)
    quarter, half = (found.y_events[k][0] for k in (0, 1))
    return abs(quarter[4]) / L, abs(half[5]) / L


MODEL = """model ship { input delta [deg], n [1/s]; use "std/ship_mmg" as ship(delta = deg2rad(delta), n = n);
  output heading [rad] = ship.heading, x [m] = ship.x, y [m] = ship.y; }
"""


def turn_of_the_part(program, rudder):
    time = np.arange(0, 1200.5, 1.0)
    with tempfile.TemporaryDirectory() as folder:
        model, record = Path(folder) / "ship.fdm", Path(folder) / "turn.csv"
        model.write_text(MODEL)
        rows = (f"{t},{math.copysign(min(RATE * t, abs(rudder)), rudder)},{TURNS}" for t in time)
        record.write_text("t [s],delta [deg],n [1/s]\n" + "\n".join(rows) + "\n")
        start = [f"--set=ship.u(0)={SPEED}", *(f"--set=ship.{s}(0)=0" for s in ("v", "r", "psi")), f"--set=ship.R0={RESISTANCE}"]
        said = subprocess.run([program, "simulate", model, record, *start, "--linear=delta", "-q", "--no-project"], capture_output=True, text=True, check=True)
    _, heading, x, y = np.array([[float(v) for v in row.split(",")] for row in said.stdout.splitlines()[1:]]).T
    at = [np.interp(angle, np.abs(heading), path) for angle, path in ((math.pi / 2, x), (math.pi, y))]
    return abs(at[0]) / L, abs(at[1]) / L


for side, rudder, paper in [("port", -35, (3.56, 3.59)), ("starboard", 35, (3.62, 3.71))]:
    own, part = turn(rudder), turn_of_the_part(sys.argv[1], rudder)
    print(f"{side:10} advance, tactical diameter: {own[0]:.3f}, {own[1]:.3f}; of the part {part[0]:.3f}, {part[1]:.3f}; of the paper's simulation {paper[0]}, {paper[1]}")
