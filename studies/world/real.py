"""Asks `fdm diagnose` for real records with naive models, in two forms each, and compares with the known physics.

    python3 studies/world/real.py DATA ANSWERS [--fdm target/release/fdm] [--apart] [--only NAMES]

DATA is a folder with the records (`buck/buck_id.csv` and so on, each folder with its source and licence in meta.txt).
Four records are kept apart: they are asked with `--apart` only, and then alone.
"""

import argparse
import re
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from asking import answer
from score import ROOT, build_of, grouped, said

# effects that stand in for physics that has a name: those that the catalogue calls so, and some of sensors
STAND_INS = {"output_scale", "temperature_scale", "sensor_position", "thermometer_position", *re.findall(
    r"^effect (\w+)\([^{]*\bas stand_in\b", (ROOT / "models" / "effects.fdm").read_text(), re.M)}


@dataclass
class Record:
    name: str
    # where the naive text says `BALANCE inertia | state | right side`, both forms are written
    text: str
    # known physics: every item must be found, by one of its names (effect, places)
    physics: list
    runs: object
    # largest RMS of the recommended model on the fitted runs, by output
    most: dict = field(default_factory=dict)
    validation: object = None
    apart: bool = False
    why: str = ""
    options: tuple = ()


def form(text, newton):
    lines = []
    for line in text.strip().splitlines():
        if line.strip().startswith("BALANCE"):
            inertia, state, right = (part.strip() for part in line.strip()[7:].split("|"))
            line = f"  {inertia}*der({state}) = {right};" if newton else f"  der({state}) = ({right})/{inertia};"
        if line.strip().startswith("NEWTON") or line.strip().startswith("SOLVED"):
            if line.strip().startswith("NEWTON") != newton:
                continue
            line = "  " + line.strip()[7:]
        lines.append(line)
    return "\n".join(lines) + "\n"


def read(path):
    """Columns of a table, whatever its heading is like."""
    rows = [r for r in path.read_text().splitlines() if r.strip()]
    return np.array([[float(c) for c in r.split(",")] for r in rows[1:]])


def even(table, step, begin=0.0, end=np.inf):
    """Columns on an even grid, linear between samples; time from 0."""
    time = table[:, 0]
    grid = np.arange(max(time[0], begin), min(time[-1], end) + 1e-9, step)
    return np.column_stack([grid - grid[0], *(np.interp(grid, time, c) for c in table[:, 1:].T)])


def released(table, column, step):
    """A decay from its largest angle on."""
    first = int(np.argmax(np.abs(table[:, column])))
    return even(table[first:][:, [0, column]], step)


def tanker(number):
    def runs(data):
        table = read(data / f"ship_roll_decay/kvlcc2_rolldecay_{number}.csv")
        found = released(table, 4 if number == 21337 else 1, 0.1)
        return {"decay": ("t [s],roll [deg]", np.column_stack([found[:, 0], np.rad2deg(found[:, 1])]))}

    return runs


ROLL = """
model tanker_roll "free roll of a tanker, linear" {
  state phi "roll angle" [rad] = free;
  state p "roll rate" [rad/s] = free;
  const I = 1.25 [1] "inertia with added mass, over the ship's own";
  param C = 7.5 in [0, 100] [1/s^2] "restoring moment";
  param B = 0.06 [1/s] "damping";
  param zero = 0 [deg] "zero of the gauge";
  der(phi) = p;
  BALANCE I | p | -C*phi - B*p
  output roll [deg] = rad2deg(phi) + zero;
}
"""

SWING = """
model swing "free swing of a pendulum" {
  state theta "angle, hanging at pi" [rad] = free;
  state omega [rad/s] = free;
  const J = 0.0033 [kg*m^2] "moment of inertia";
  param G = 0.21 in [0, 10] [N*m] "weight times arm";
  param b = 0.0002 [N*m*s] "viscous friction";
  der(theta) = omega;
  BALANCE J | omega | -G*sin(theta - pi) - b*omega
  output angle [rad] = theta;
}
"""

DRIVEN = """
model driven "pendulum with a motor" {
  input tau "measured torque" [N*m];
  state q "angle" [rad] = free;
  state w "rate" [rad/s] = free;
  param J = 0.06 in [0.001, 1] [kg*m^2] "moment of inertia";
  param G = 1.0 in [0, 10] [N*m] "weight times arm";
  param b = 0.05 [N*m*s] "viscous friction";
  der(q) = w;
  BALANCE J | w | tau - G*sin(q) - b*w
  output angle [rad] = q;
  output rate [rad/s] = w;
}
"""

DOUBLE = """
model double_pendulum "two links with a motor each, no friction" {
  input tau1 [N*m], tau2 [N*m];
  state q1 [rad] = free, q2 [rad] = free, w1 [rad/s] = free, w2 [rad/s] = free;
  param a1 = 0.11 in [0.01, 1] [kg*m^2] "inertia of the first link with the second's mass";
  param a2 = 0.024 in [0.002, 0.5] [kg*m^2] "inertia of the second link";
  param a3 = 0.033 in [0, 0.5] [kg*m^2] "coupling";
  param b1 = 3.4 in [0, 20] [N*m] "weight of both at the first joint";
  param b2 = 1.1 in [0, 10] [N*m] "weight of the second link";
  let m11 = a1 + a2 + 2*a3*cos(q2);
  let m12 = a2 + a3*cos(q2);
  let r1 = tau1 + a3*sin(q2)*(2*w1*w2 + w2^2) - b1*sin(q1) - b2*sin(q1 + q2);
  let r2 = tau2 - a3*sin(q2)*w1^2 - b2*sin(q1 + q2);
  der(q1) = w1;
  der(q2) = w2;
  NEWTON m11*der(w1) + m12*der(w2) = r1;
  NEWTON m12*der(w1) + a2*der(w2) = r2;
  SOLVED der(w1) = (a2*r1 - m12*r2)/(m11*a2 - m12^2);
  SOLVED der(w2) = (m11*r2 - m12*r1)/(m11*a2 - m12^2);
  output angle1 [rad] = q1;
  output angle2 [rad] = q2;
  output rate1 [rad/s] = w1;
  output rate2 [rad/s] = w2;
}
"""

BUCK = """
model buck "buck converter, linear" {
  time [ms];
  input u [V];
  state v "voltage" [V] = free;
  state s "slope" [V/ms] = free;
  param m = 0.01 in [1e-5, 10] [ms^2] "coil times capacitor";
  param d = 0.05 in [0, 10] [ms] "losses";
  param K = -12 [1] "gain";
  param u0 = 3.4 [V];
  der(v) = s;
  BALANCE m | s | K*(u - u0) - v - d*s
  output y [V] = v;
}
"""

PLANT = """
model plant "water pumping plant, linear, one mode" {
  input speed [1];
  state h "pressure" [1] = free;
  param T = 60 in [1, 2000] [s] "time constant";
  param K = 1000 [1] "gain";
  param u0 = 3.1 [1];
  BALANCE T | h | K*(speed - u0) - h
  output level [1] = h;
}
"""

HEATER = """
model heater "one heater, one body" {
  input Q "power" [%];
  state T "above the room" [K] = 0;
  const C = 20 [J/K] "heat capacity";
  param P = 0.15 [W/%] "power by percent";
  param U = 0.1 [W/K] "loss to the room";
  param room = 22 [degC] per run "the room, from which every run begins";
  BALANCE C | T | P*Q - U*T
  output sensor [degC] = T + room;
}
"""

HEATERS = """
model heaters "two heaters beside each other" {
  input Q1 [%], Q2 [%];
  state T1 [K] = 0, T2 [K] = 0;
  const C = 20 [J/K] "heat capacity of each";
  param P1 = 0.15 [W/%], P2 = 0.08 [W/%];
  param U = 0.1 [W/K] "loss to the room", Ux = 0.03 [W/K] "from one to the other";
  param room = 20.5 [degC] per run;
  BALANCE C | T1 | P1*Q1 - U*T1 - Ux*(T1 - T2)
  BALANCE C | T2 | P2*Q2 - U*T2 + Ux*(T1 - T2)
  output sensor1 [degC] = T1 + room;
  output sensor2 [degC] = T2 + room;
}
"""

HOVER = """
model hover "roll and pitch of a helicopter in hover, rigid body" {
  input lat [1], lon [1];
  state p "roll rate" [rad/s] = free, q "pitch rate" [rad/s] = free;
  const Ix = 0.06 [kg*m^2], Iy = 0.17 [kg*m^2];
  param Lp = -0.5 in [-2, 0] [N*m*s], Llat = 1.1 [N*m];
  param Mq = -1.3 in [-6, 0] [N*m*s], Mlat = 0 [N*m], Mlon = 3.2 [N*m];
  BALANCE Ix | p | Lp*p + Llat*lat
  BALANCE Iy | q | Mq*q + Mlat*lat + Mlon*lon
  output p_m [rad/s] = p;
  output q_m [rad/s] = q;
}
"""

GASOIL = """
model gas_oil "cracking of gas oil, every step of first order" {
  time [h];
  state y1 "gas oil" [1] = 1, y2 "gasoline" [1] = 0;
  const W = 1 [1];
  param k1 = 6 in [0, 100] [1/h], k2 = 5 in [0, 100] [1/h], k3 = 1 in [0, 100] [1/h];
  BALANCE W | y1 | -(k1 + k3)*y1
  BALANCE W | y2 | k1*y1 - k2*y2
  output gas_oil [1] = y1;
  output gasoline [1] = y2;
}
"""

PINENE = """
model pinene "isomerisation of alpha-pinene, the dimer final" {
  time [min];
  state y1 "alpha-pinene" [%] = 100, y2 "dipentene" [%] = 0, y3 "allo-ocimene" [%] = 0, y4 "pyronene" [%] = 0, y5 "dimer" [%] = 0;
  const W = 1 [1];
  param k1 = 6e-5 in [0, 1] [1/min], k2 = 3e-5 in [0, 1] [1/min], k3 = 2e-5 in [0, 1] [1/min], k4 = 2e-4 in [0, 1] [1/min];
  BALANCE W | y1 | -(k1 + k2)*y1
  BALANCE W | y2 | k1*y1
  BALANCE W | y3 | k2*y1 - (k3 + k4)*y3
  BALANCE W | y4 | k3*y3
  BALANCE W | y5 | k4*y3
  output alpha_pinene [%] = y1, dipentene [%] = y2, alloocimene [%] = y3, pyronene [%] = y4, dimer [%] = y5;
}
"""

METHANOL = """
model methanol "methanol to hydrocarbons, every step of first order" {
  time [h];
  state y1 "methanol and ether" [1] = 1, y2 "olefins" [1] = 0, y3 "paraffins and aromatics" [1] = 0;
  const W = 1 [1];
  param k1 = 3 in [0, 100] [1/h], k2 = 1 in [0, 100] [1/h], k3 = 0.1 in [0, 100] [1/h];
  BALANCE W | y1 | -(k1 + k2)*y1
  BALANCE W | y2 | k1*y1 - k3*y2
  BALANCE W | y3 | k2*y1 + k3*y2
  output methanol [1] = y1, olefins [1] = y2, paraffins [1] = y3;
}
"""


def one(path, head, make):
    return lambda data: {Path(path).stem: (head, make(read(data / path)))}


def begun(table):
    """With a row at time 0, at which the states are those of the text and nothing was measured."""
    return np.vstack([[0.0, *np.full(table.shape[1] - 1, np.nan)], table])


def doubles(*numbers):
    head = "t [s],angle1 [rad],angle2 [rad],rate1 [rad/s],rate2 [rad/s],tau1 [N*m],tau2 [N*m]"
    return lambda data: {
        f"trajectory_{n}": (head, even(read(data / f"double_pendulum_dfki/trajectory_{n}.csv"), 0.02)) for n in numbers}


def heaters(*names):
    return lambda data: {
        n: ("t [s],sensor [degC],Q [%]", even(read(data / f"tclab/{n}.csv")[:, [0, 1, 3]], 2.0)) for n in names}


def halves(which):
    def runs(data):
        table = read(data / "heli_trex550/trex550_hovertest.csv")[:, [0, 1, 2, 8, 9]]
        half = len(table) // 2
        return {which: ("t [s],lat [1],lon [1],p_m [rad/s],q_m [rad/s]", even(table[:half] if which == "first" else table[half:], 0.04))}

    return runs


def friction(place, *torques):
    own = [(name, [place]) for name in ("coulomb_friction", "stribeck_friction", "lugre_friction")]
    return own + [("joint_friction", [torque, place]) for torque in torques]


def curve(of, state):
    return [("input_curvature", [of]), ("input_curve", [of]), ("static_curve", [state, of])]


RECORDS = [
    Record("tanker_21337", ROLL, [[("quadratic_damping", ["p"])], [("cubic_stiffness", ["p", "phi"])]], tanker(21337), {"roll": 0.0245}),
    Record("tanker_21338", ROLL, [[("quadratic_damping", ["p"])], [("cubic_stiffness", ["p", "phi"])]], tanker(21338), {"roll": 0.05}),
    Record("tanker_21340", ROLL, [], tanker(21340), why="at 15.5 kn linear lift damping dominates: nothing, or small quadratic terms, is missing"),
    Record("swing", SWING, [friction("omega")],
           one("pendulum_free_swing/single_pendulum_1khz.csv", "t [s],angle [rad]", lambda t: even(t[:, :2], 0.025)), {"angle": 0.0195}),
    Record("driven_pendulum", DRIVEN, [friction("w")],
           one("pendulum_dfki/pd_sysid.csv", "t [s],angle [rad],rate [rad/s],tau [N*m]", lambda t: even(t, 0.01))),
    Record("driven_swing_up", DRIVEN, [friction("w")],
           one("pendulum_dfki/energy_shaping.csv", "t [s],angle [rad],rate [rad/s],tau [N*m]", lambda t: even(t, 0.02, 0, 8)), apart=True),
    Record("double_pendulum", DOUBLE, [friction("w1", "tau1"), friction("w2", "tau2")], doubles("00", "01"), validation=doubles("02")),
    Record("double_pendulum_others", DOUBLE, [friction("w1", "tau1"), friction("w2", "tau2")], doubles("02", "12"), validation=doubles("00"), apart=True),
    Record("buck", BUCK, [curve("u", "s")],
           one("buck/buck_id.csv", "t [ms],u [V],y [V]", lambda t: np.column_stack([1e3 * t[:, 0], t[:, 1:]])),
           validation=one("buck/buck_valid.csv", "t [ms],u [V],y [V]", lambda t: np.column_stack([1e3 * t[:, 0], t[:, 1:]]))),
    Record("water_plant", PLANT, [curve("speed", "h")],
           one("water_pump_plant/training_set.csv", "t [s],speed [1],level [1]", lambda t: t),
           validation=one("water_pump_plant/test_set.csv", "t [s],speed [1],level [1]", lambda t: t)),
    Record("heater", HEATER, [[("sensor_lag", ["sensor"]), ("actuator_lag", ["Q"]), ("dead_volume", ["T"]), ("slow_mode", ["T"])]],
           heaters("validation_experiment_env_2_step_50_run_1", "validation_experiment_env_2_sin_5_50_run_1"),
           validation=heaters("validation_experiment_env_2_sin_2_50_run_1"),
           why="a lag of the sensor is one of the heater: the body between them is linear and begins at rest"),
    Record("heater_pair", HEATERS, [[("sensor_lag", ["sensor1"]), ("actuator_lag", ["Q1"]), ("sensor_lag", ["sensor2"]), ("actuator_lag", ["Q2"])]],
           one("tclab/apm_energy_balance_mimo.csv", "t [s],Q1 [%],Q2 [%],sensor1 [degC],sensor2 [degC]", lambda t: even(t[:, :5], 2.0)), apart=True),
    Record("hover", HOVER, [[("input_delay", ["lat"])], [("input_delay", ["lon"])]], halves("first"), validation=halves("second")),
    Record("gas_oil", GASOIL, [[("reaction_order", ["y1"]), ("quadratic_term", ["y1", "y1"]), ("quadratic_damping", ["y1"])]],
           one("kinetics_cops/gasoil.csv", "t [h],gas_oil [1],gasoline [1]", lambda t: t), why="cracking is of second order; y1 is positive, so that y1^2 is y1*abs(y1)"),
    Record("pinene", PINENE, [[("missing_coupling", ["y3", "y5"]), ("reverse_reaction", ["k4"])]],
           one("kinetics_cops/pinene.csv", "t [min],alpha_pinene [%],dipentene [%],alloocimene [%],pyronene [%],dimer [%]", begun),
           why="the dimer goes back to allo-ocimene"),
    Record("methanol", METHANOL, [[("product_term", ["y1", "y2"]), ("autocatalysis", ["y1", "y2"]), ("autocatalysis", ["y2"])]],
           one("kinetics_cops/methanol.csv", "t [h],methanol [1],olefins [1],paraffins [1]", lambda t: t), apart=True,
           why="methanol reacts with olefins to more of them"),
]


def written(folder, runs):
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for name, (head, rows) in runs.items():
        files.append(folder / f"{name}.csv")
        np.savetxt(files[-1], rows, delimiter=",", header=head, comments="", fmt="%.10g")
    return files


def judged(record, found, tables):
    """A row of the table, and what is wrong."""
    d = found["diagnosis"]
    if d is None:
        return "no answer", [f"no answer ({found['error'].strip().splitlines()[-1] if found['error'].strip() else 'out of time'})"], ["", ""]
    causes, wrong = d["causes"], []
    missing = []
    for names in record.physics:
        right = [{"effect": e, "targets": t} for e, t in names]
        if not any(grouped(right, c) for c in causes):
            missing.append(names[0][0] + "(" + ", ".join(names[0][1]) + ")")
    if missing:
        wrong.append("lacks " + " and ".join(missing))
    if not record.physics and d["verdict"] == "effect_found" and any(c["effect"] in STAND_INS for c in causes):
        wrong.append("stand-ins where little is missing")
    known = {effect for names in record.physics for effect, _ in names}
    stand_ins = [c["effect"] for c in causes if c["effect"] in STAND_INS - known]
    if stand_ins and record.physics:
        wrong.append("stand-ins: " + ", ".join(stand_ins))
    errors = {True: [], False: []}
    for o in d["outputs"]:
        errors[o["validation"]].append(f"{o['output']} {o['rms_before']:.3g} -> {o['rms_after']:.3g}")
        if o["validation"] and o["rms_after"] > 1.002 * o["rms_before"]:
            wrong.append(f"validation worse: {o['output']}")
        if not o["validation"] and o["output"] in record.most and o["rms_after"] > record.most[o["output"]]:
            wrong.append(f"{o['output']} above {record.most[o['output']]}")
        does = dict(zip(tables, found.get("does", []))).get(o["run"])
        if causes and "does" in found:
            if not does or o["output"] not in does:
                wrong.append(f"written text does not simulate on {o['run']}")
                continue
            rms = np.sqrt(np.mean((tables[o["run"]][o["output"]] - np.array(does[o["output"]])) ** 2))
            if abs(rms / o["rms_after"] - 1) > 0.005:
                wrong.append(f"printed {o['output']} {o['rms_after']:.3g}, simulates to {rms:.3g}")
    if "refit" in found and (found["refit"]["code"] != 0 or found["refit"]["termination"] != "converged"):
        wrong.append(f"refit: code {found['refit']['code']}, {found['refit']['termination']}, {found['refit']['seconds']:.0f} s")
    return said(d), wrong, ["; ".join(errors[False]), "; ".join(errors[True])]


def sizes(front):
    """The best models by number of effects: plain RMS on fitted and validation runs, with what is against them."""
    rows = []
    for model in front:
        names = ", ".join(f"{e['effect']}({', '.join(e['targets'])})" for e in model["effects"]) or "as it is"
        rms = "; ".join(
            f"{o['output']} {o['rms_training']:.3g}" + ("" if o["rms_validation"] is None else f" / {o['rms_validation']:.3g}")
            for o in model["outputs"] if o["rms_training"] is not None)
        crossed = model.get("error_cross_validated")
        rows.append((names, rms, "" if crossed is None else f"{crossed:.2f}",
                     "recommended" if model["recommended"] else model.get("objection") or ""))
    return rows


def main():
    given = argparse.ArgumentParser()
    given.add_argument("data", type=Path)
    given.add_argument("answers", type=Path)
    given.add_argument("--fdm", default=str(ROOT / "target" / "release" / "fdm"))
    given.add_argument("--apart", action="store_true", help="the four records kept apart, and only these")
    given.add_argument("--only", default="")
    given.add_argument("--options", default="", help="further options of the diagnosis, for all records")
    given.add_argument("--form", choices=("der", "Newton"), help="one form only")
    given.add_argument("--seconds", type=int, default=300, help="of processor time for a diagnosis")
    asked = given.parse_args()
    further = tuple(asked.options.split())
    kept = asked.answers / build_of(asked.fdm) / ("real" + "".join(c if c.isalnum() else "_" for c in asked.options))
    print(f"build {build_of(asked.fdm)}\n\n| record | form | said | fitted runs | validation run | wrong | s |\n|---|---|---|---|---|---|---|")
    right, total, tables_by_size = 0, 0, []
    for record in RECORDS:
        if record.apart != asked.apart or not any(w in record.name for w in asked.only.split(",")):
            continue
        names = []
        for newton in (False, True):
            if asked.form and newton != (asked.form == "Newton"):
                continue
            folder = kept / (record.name + ("_newton" if newton else "_der"))
            runs = record.runs(asked.data)
            validation = record.validation(asked.data) if record.validation else {}
            tables = {}
            for name, (head, rows) in {**runs, **validation}.items():
                tables[name] = {h.split("[")[0].strip(): rows[:, j] for j, h in enumerate(head.split(","))}
            files, checks = written(folder, runs), written(folder, validation)
            (folder / "model.fdm").write_text(form(record.text, newton))
            found = answer(asked.fdm, folder / "model.fdm", files, checks, folder, record.options, further, asked.seconds)
            answered, wrong, errors = judged(record, found, tables)
            d = found["diagnosis"]
            names.append(d and [(c["effect"], c["targets"]) for c in d["causes"]])
            if len(names) == 2 and names[0] != names[1]:
                wrong.append("otherwise than as der(x) =")
            right, total = right + (not wrong), total + 1
            tables_by_size.append((record.name, "Newton" if newton else "der", sizes(d.get("front", [])) if d else []))
            print(f"| {record.name} | {'Newton' if newton else 'der'} | {answered} | {errors[0]} | {errors[1]} | {'; '.join(wrong) or '-'} | {found['seconds']:.0f} |", flush=True)
    print(f"\n{right} of {total} with nothing wrong\n\n| record | form | model | RMS fitted / validation | cross-validated, naive 1 | |\n|---|---|---|---|---|---|")
    for name, how, rows in tables_by_size:
        for row in rows:
            print(f"| {name} | {how} | {' | '.join(row)} |")


if __name__ == "__main__":
    main()
