"""Families of vehicles, machines, plants and reactions, each with a naive text in two forms and the effects that may be missing.

`force` of an equation is added to its balance, in the unit of the left side of Newton's form.
"""

from dataclasses import dataclass, field

import numpy as np

from motion import Hidden


@dataclass
class Quantity:
    name: str
    unit: str
    doc: str = ""


@dataclass
class Family:
    name: str
    # kept apart: not asked while anything is tuned
    apart: bool
    step: float
    sub: int
    samples: int
    # steps of Runge-Kutta until rest
    settling: int
    time: str
    states: list
    inputs: dict
    outputs: dict
    # name: (true value, unit, doc); and those that the text knows
    parameters: dict
    known: dict
    rates: object
    measured: object
    manoeuvre: object
    # balance of each state: (inertia or "", right side)
    balances: dict
    effects: list
    lets: str = ""
    starts: tuple = ("rest", "settled")
    # initial states where a record begins at rest, and how far a released one is from there
    begin: object = None
    released: object = None
    # other names of the same model beside those that hold for all families: (kind, place, start) -> [(kind, place, reason)]
    same: object = None
    # states and inputs have one sign, far from zero
    positive: bool = False
    # the only equation that an input enters, in proportion
    enters: dict = field(default_factory=dict)
    noise: tuple = (0.01, 0.05)
    outside: list = field(default_factory=list)

    def rest(self, p):
        return self.begin(p) if self.begin else [0.0] * len(self.states)

    def text(self, newton, free):
        """The naive model; `newton` has balances of forces, `free` estimates initial states."""
        lines = [f'model {self.name} "{self.name.replace("_", " ")}" {{']
        if self.time != "s":
            lines.append(f"  time [{self.time}];")
        for name, unit in self.inputs.items():
            lines.append(f"  input {name} [{unit}];")
        begin = self.rest({**{k: v[0] for k, v in self.parameters.items()}, **{k: v[0] for k, v in self.known.items()}})
        for state, value in zip(self.states, begin):
            lines.append(f'  state {state.name} [{state.unit}] = {"free" if free else f"{value:.6g}"} "{state.doc}";')
        for name, (value, unit, doc) in self.known.items():
            lines.append(f'  const {name} = {value:.6g} [{unit}] "{doc}";')
        for name, (value, unit, doc) in self.parameters.items():
            lines.append(f'  param {name} = {value:.6g} [{unit}] "{doc}";')
        if self.lets:
            lines.append(self.lets)
        for name, (inertia, right) in self.balances.items():
            if not inertia:
                lines.append(f"  der({name}) = {right};")
            elif newton:
                lines.append(f"  {inertia}*der({name}) = {right};")
            else:
                lines.append(f"  der({name}) = ({right})/{inertia};")
        for name, (unit, expression) in self.outputs.items():
            lines.append(f"  output {name} [{unit}] = {expression};")
        return "\n".join([*lines, "}", ""])


def pieces(rng, time, shortest, longest, levels):
    """Steps of random length and height."""
    values, at = np.zeros_like(time), rng.uniform(shortest, longest)
    while at < time[-1]:
        values[time >= at] = rng.uniform(*levels)
        at += rng.uniform(shortest, longest)
    return values


def swept(rng, time, low, high, size):
    """A sweep of frequency, from rest, quicker and quicker."""
    span = time[-1] - time[0]
    phase = 2 * np.pi * low * span / np.log(high / low) * ((high / low) ** (time / span) - 1)
    return size * np.sin(phase) * np.clip(time / (0.03 * span), 0, 1)


def multisine(rng, time, low, high, size):
    """Seven lines of random phase, faded in."""
    lines = np.geomspace(low, high, 7)
    sum_ = sum(np.sin(2 * np.pi * f * time + rng.uniform(0, 2 * np.pi)) for f in lines)
    return size * sum_ / np.max(np.abs(sum_)) * np.clip(time / (0.05 * time[-1]), 0, 1)


def moved(low, high, short, long):
    """Steps, a sweep or a multisine, drawn for each run."""

    def make(rng, time, size):
        kind = rng.integers(3)
        if kind == 0:
            return size * pieces(rng, time, short, long, (-1, 1))
        return (swept if kind == 1 else multisine)(rng, time, low, high, size)

    return make


def driven(kinds, inputs):
    """Hidden effects on an input."""
    signs = {"input_bias": 0, "input_gain": 0, "curve": 0}
    odd = {"curve": {"even": False}}
    return [Hidden(k, i, sign=signs.get(k, 1), fixed=dict(odd.get(k, {}))) for i in inputs for k in kinds]


SIGNAL = ("input_bias", "input_gain", "dead_zone", "saturation", "backlash", "delay", "lag", "curve")


def servo():
    """A motor that turns a load through a shaft, with a return spring on the load."""

    def rates(x, u, p, f, s):
        a, wa, b, wb = x
        shaft = p["c"] * (a - b) + p["d"] * (wa - wb)
        return [
            wa,
            (p["K"] * u[0] - p["bm"] * wa - shaft + f.get("wm", 0)) / p["Jm"],
            wb,
            (shaft - p["bl"] * wb - p["kl"] * b + f.get("wl", 0)) / p["Jl"],
        ]

    drive = moved(0.3, 9, 0.08, 0.7)

    def manoeuvre(rng, time):
        return drive(rng, time, rng.uniform(2, 4))[:, None]

    return Family(
        "servo_with_load", False, 0.01, 6, 350, 3000, "s",
        [Quantity("am", "rad", "angle of the motor"), Quantity("wm", "rad/s", "rate of the motor"),
         Quantity("al", "rad", "angle of the load"), Quantity("wl", "rad/s", "rate of the load")],
        {"i": "A"},
        {"motor": ("rad", "am"), "load": ("rad", "al")},
        {"bm": (0.0075, "N*m*s", "friction of the motor"), "c": (1.9, "N*m", "stiffness of the shaft"),
         "d": (0.006, "N*m*s", "damping of the shaft"), "bl": (0.011, "N*m*s", "friction of the load"),
         "kl": (0.4, "N*m", "return spring"), "Jl": (0.0062, "kg*m^2", "inertia of the load")},
        {"Jm": (0.0021, "kg*m^2", "inertia of the motor"), "K": (0.085, "N*m/A", "torque constant")},
        rates, lambda x, u, p: [x[0], x[2]], manoeuvre,
        {"am": ("", "wm"), "wm": ("Jm", "K*i - bm*wm - c*(am - al) - d*(wm - wl)"),
         "al": ("", "wl"), "wl": ("Jl", "c*(am - al) + d*(wm - wl) - bl*wl - kl*al")},
        driven(SIGNAL, ["i"])
        + [Hidden("coulomb", "wl"), Hidden("coulomb", "wm"), Hidden("drag", "wl"), Hidden("cubic", "wl", "al"),
           Hidden("constant", "wm", sign=0), Hidden("constant", "wl", sign=0),
           Hidden("output_bias", "load", sign=0), Hidden("output_bias", "motor", sign=0),
           Hidden("drift", "load", sign=0), Hidden("drift", "motor", sign=0)],
        enters={"i": "wm"},
        outside=[Hidden("cogging", "wm", "am", fixed={"teeth": 12}), Hidden("gust", "wl"), Hidden("gust", "wm")],
    )


def cart():
    """A cart on a rail between springs, pulled by a belt."""

    def rates(x, u, p, f, s):
        return [x[1], (p["K"] * u[0] - p["b"] * x[1] - p["k"] * x[0] + f.get("v", 0)) / p["M"]]

    drive = moved(0.2, 4, 0.2, 1.6)

    def manoeuvre(rng, time):
        return drive(rng, time, rng.uniform(3, 6))[:, None]

    def same(kind, place, start):
        shift = "the springs are linear and initial states are free: x - F/k obeys the equation without the force"
        late = "one linear equation between one input and one output, at rest before: late in, late out"
        if kind in ("constant", "input_bias") and start != "rest":
            return [("output_bias", "position", shift)]
        if kind == "output_bias" and start != "rest":
            return [("constant", "v", shift), ("input_bias", "e", shift)]
        if kind in ("delay", "lag") and start != "released":
            return [({"delay": "output_delay", "lag": "sensor_lag"}[kind], "position", late)]
        return []

    return Family(
        "cart_on_rail", True, 0.02, 6, 400, 4000, "s",
        [Quantity("x", "m", "position"), Quantity("v", "m/s", "speed")],
        {"e": "V"}, {"position": ("m", "x")},
        {"b": (2.2, "N*s/m", "friction of the rail"), "k": (24.0, "N/m", "springs"), "K": (1.7, "N/V", "drive")},
        {"M": (1.35, "kg", "mass of cart and load")},
        rates, lambda x, u, p: [x[0]], manoeuvre,
        {"x": ("", "v"), "v": ("M", "K*e - b*v - k*x")},
        driven([k for k in SIGNAL if k != "input_gain"], ["e"])
        + [Hidden("coulomb", "v"), Hidden("drag", "v"), Hidden("cubic", "v", "x"), Hidden("constant", "v", sign=0),
           Hidden("output_bias", "position", sign=0), Hidden("drift", "position", sign=0)],
        starts=("rest", "settled", "released"), released=lambda rng: [rng.choice([-1, 1]) * rng.uniform(0.15, 0.35), 0],
        same=same, enters={"e": "v"},
        outside=[Hidden("cogging", "v", "x", fixed={"teeth": 60})],
    )


def tanks():
    """Three tanks in a row with valves between them; two pumps."""

    def rates(x, u, p, f, s):
        a, b, c = x
        return [
            (u[0] - p["k12"] * (a - b) + f.get("h1", 0)) / p["A"],
            (p["k12"] * (a - b) - p["k23"] * (b - c) + f.get("h2", 0)) / p["A"],
            (u[1] + p["k23"] * (b - c) - p["k3"] * c + f.get("h3", 0)) / p["A"],
        ]

    def manoeuvre(rng, time):
        return np.stack(
            [0.09 + rng.uniform(0.6, 1) * pieces(rng, time, 80, 420, (-0.06, 0.08)),
             0.05 + rng.uniform(0.6, 1) * pieces(rng, time, 80, 420, (-0.04, 0.05))], axis=1)

    return Family(
        "tanks_in_a_row", False, 5.0, 3, 360, 2500, "s",
        [Quantity("h1", "dm", "level of the first tank"), Quantity("h2", "dm", "of the second"),
         Quantity("h3", "dm", "of the third")],
        {"q1": "dm^3/s", "q3": "dm^3/s"},
        {"l1": ("dm", "h1"), "l2": ("dm", "h2"), "l3": ("dm", "h3")},
        {"k12": (0.10, "dm^2/s", "valve 1 to 2"), "k23": (0.085, "dm^2/s", "valve 2 to 3"),
         "k3": (0.055, "dm^2/s", "outflow")},
        {"A": (3.0, "dm^2", "area of each tank")},
        rates, lambda x, u, p: [x[0], x[1], x[2]], manoeuvre,
        {"h1": ("A", "q1 - k12*(h1 - h2)"), "h2": ("A", "k12*(h1 - h2) - k23*(h2 - h3)"),
         "h3": ("A", "q3 + k23*(h2 - h3) - k3*h3")},
        driven(("input_bias", "input_gain", "delay", "lag", "saturation", "backlash"), ["q1"])
        + [Hidden("curve", "q1", sign=0, fixed={"even": True}), Hidden("input_gain", "q3", sign=0),
           Hidden("input_bias", "q3", sign=0), Hidden("dead_zone", "q3"),
           Hidden("root", "h3"), Hidden("root", "h2"), Hidden("constant", "h1", sign=0), Hidden("constant", "h2", sign=-1),
           Hidden("output_bias", "l2", sign=0), Hidden("output_bias", "l3", sign=0), Hidden("output_bias", "l1", sign=0),
           Hidden("drift", "l3", sign=0), Hidden("drift", "l1", sign=0)],
        starts=("settled",), begin=lambda p: [4.4 + 0 * p["k3"], 3.5 + 0 * p["k3"], 2.5 + 0 * p["k3"]],
        positive=True, enters={"q1": "h1", "q3": "h3"},
        outside=[Hidden("gust", "h2"), Hidden("gust", "h1")],
    )


def buck():
    """A buck converter: duty in, voltage and current out."""

    def rates(x, u, p, f, s):
        return [(p["V"] * u[0] - p["R"] * x[0] - x[1] + f.get("iL", 0)) / p["L"],
                (x[0] - p["G"] * x[1] + f.get("vC", 0)) / p["C"]]

    def manoeuvre(rng, time):
        size = rng.uniform(0.08, 0.15)
        return (0.45 + np.clip(moved(0.2, 3, 0.15, 1.2)(rng, time, size), -0.4, 0.5))[:, None]

    return Family(
        "buck_converter", True, 0.02, 6, 400, 4000, "ms",
        [Quantity("iL", "A", "current of the coil"), Quantity("vC", "V", "voltage of the capacitor")],
        {"d": "1"}, {"current": ("A", "iL"), "voltage": ("V", "vC")},
        {"R": (0.35, "ohm", "coil and switch"), "L": (0.22, "mH", "coil"), "G": (0.22, "S", "load"), "C": (0.09, "mF", "capacitor")},
        {"V": (24.0, "V", "supply")},
        rates, lambda x, u, p: [x[0], x[1]], manoeuvre,
        {"iL": ("L", "V*d - R*iL - vC"), "vC": ("C", "iL - G*vC")},
        driven([k for k in SIGNAL if k not in ("curve", "input_gain")], ["d"])
        + [Hidden("curve", "d", sign=0, fixed={"even": True}),
           Hidden("constant", "iL", sign=-1), Hidden("constant", "vC", sign=-1), Hidden("drag", "vC"), Hidden("drag", "iL"),
           Hidden("output_bias", "current", sign=0), Hidden("output_bias", "voltage", sign=0),
           Hidden("drift", "current", sign=0), Hidden("drift", "voltage", sign=0)],
        starts=("settled",), begin=lambda p: [2.3 + 0 * p["R"], 10 + 0 * p["R"]],
        positive=True, enters={"d": "iL"},
        outside=[Hidden("gust", "vC"), Hidden("gust", "iL")],
    )


def aircraft():
    """Longitudinal motion of a small aircraft about its trim."""

    def rates(x, u, p, f, s):
        a, q, h = x
        return [p["Za"] * a + q + p["Zd"] * u[0] + f.get("alpha", 0),
                (p["Ma"] * a + p["Mq"] * q + p["Md"] * u[0] + f.get("q", 0)) / p["I"], q]

    drive = moved(0.15, 2.5, 0.3, 2)

    def manoeuvre(rng, time):
        return drive(rng, time, rng.uniform(0.04, 0.09))[:, None]

    return Family(
        "small_aircraft", True, 0.04, 4, 400, 3000, "s",
        [Quantity("alpha", "rad", "angle of attack"), Quantity("q", "rad/s", "pitch rate"),
         Quantity("theta", "rad", "pitch attitude")],
        {"elevator": "rad"}, {"vane": ("rad", "alpha"), "gyro": ("rad/s", "q"), "attitude": ("rad", "theta")},
        {"Za": (-2.6, "1/s", "lift"), "Zd": (-0.28, "1/s", "lift of the elevator"), "Ma": (-36.0, "N*m", "static stability"),
         "Mq": (-8.5, "N*m*s", "damping"), "Md": (-58.0, "N*m", "effectiveness of the elevator")},
        {"I": (3.1, "kg*m^2", "moment of inertia")},
        rates, lambda x, u, p: [x[0], x[1], x[2]], manoeuvre,
        {"alpha": ("", "Za*alpha + q + Zd*elevator"), "q": ("I", "Ma*alpha + Mq*q + Md*elevator"), "theta": ("", "q")},
        driven([k for k in SIGNAL if k not in ("input_gain", "dead_zone")], ["elevator"])
        + [Hidden("dead_zone", "elevator"), Hidden("cubic", "q", "alpha", sign=0), Hidden("cubic", "alpha", "alpha", sign=0),
           Hidden("drag", "q"), Hidden("constant", "q", sign=0), Hidden("constant", "alpha", sign=0),
           Hidden("output_bias", "gyro", sign=0), Hidden("output_bias", "vane", sign=0), Hidden("output_bias", "attitude", sign=0),
           Hidden("drift", "gyro", sign=0), Hidden("drift", "attitude", sign=0), Hidden("drift", "vane", sign=0)],
        starts=("rest",),
        outside=[Hidden("gust", "alpha"), Hidden("gust", "q")],
    )


def ship():
    """A ship that rolls in waves of measured slope."""

    def rates(x, u, p, f, s):
        return [x[1], (-p["B"] * x[1] - p["C"] * (x[0] - p["r"] * u[0]) + f.get("p", 0)) / p["I"]]

    def manoeuvre(rng, time):
        peak = rng.uniform(0.08, 0.13)
        lines = peak * np.linspace(0.5, 2.2, 40) * rng.uniform(0.99, 1.01, 40)
        size = np.sqrt((lines / peak) ** -5 * np.exp(-1.25 * (lines / peak) ** -4))
        phases = rng.uniform(0, 2 * np.pi, 40)
        slope = np.sum(size * np.sin(2 * np.pi * lines * time[:, None] + phases), axis=1)
        return (rng.uniform(0.04, 0.08) * slope / np.std(slope))[:, None]

    def same(kind, place, start):
        shift = "the restoring moment is linear and initial states are free: phi - F/C obeys the equation without the moment"
        if kind in ("constant", "input_bias"):
            return [("output_bias", "roll", shift)]
        if kind == "output_bias" and place == "roll":
            return [("constant", "p", shift), ("input_bias", "slope", shift)]
        return []

    return Family(
        "ship_in_waves", False, 0.4, 4, 500, 3000, "s",
        [Quantity("phi", "rad", "roll angle"), Quantity("p", "rad/s", "roll rate")],
        {"slope": "rad"}, {"roll": ("rad", "phi"), "rate": ("rad/s", "p")},
        {"B": (0.075, "1/s", "damping over the ship's inertia"), "C": (0.42, "1/s^2", "restoring moment over the ship's inertia"),
         "r": (0.75, "1", "effective slope")},
        {"I": (1.18, "1", "inertia with added mass, over the ship's own")},
        rates, lambda x, u, p: [x[0], x[1]], manoeuvre,
        {"phi": ("", "p"), "p": ("I", "-B*p - C*(phi - r*slope)")},
        driven(("input_bias", "delay", "lag", "curve"), ["slope"])
        + [Hidden("drag", "p"), Hidden("cubic", "p", "phi", sign=0), Hidden("coulomb", "p"), Hidden("constant", "p", sign=0),
           Hidden("output_bias", "roll", sign=0), Hidden("output_bias", "rate", sign=0),
           Hidden("drift", "roll", sign=0), Hidden("drift", "rate", sign=0)],
        starts=("settled", "released"), released=lambda rng: [rng.choice([-1, 1]) * rng.uniform(0.1, 0.25), 0], same=same,
        enters={"slope": "p"},
        outside=[Hidden("gust", "p")],
    )


def reactor():
    """A batch reactor, A to B to C, with heat of reaction and a jacket."""

    def rates(x, u, p, f, s):
        a, b, T = x
        a_ = np.maximum(a, 1e-9)
        k = p["k1"] * np.exp(np.clip(p["E1"] * (1 / 330 - 1 / np.clip(T, 250, 500)), -30, 30))
        l = p["k2"] * np.exp(np.clip(p["E2"] * (1 / 330 - 1 / np.clip(T, 250, 500)), -30, 30))
        one = k * a_ * a_ ** s.get("order", 0)
        two = l * b
        back = s.get("reverse", 0) * b
        return [-one + back + f.get("A", 0), one - two - back + f.get("B", 0),
                (p["H1"] * one + p["UA"] * (u[0] - T) + f.get("T", 0)) / p["Cp"]]

    def manoeuvre(rng, time):
        return (325 + rng.uniform(-4, 8) + np.clip(pieces(rng, time, 12, 35, (-12, 14)), -15, 15))[:, None]

    def same(kind, place, start):
        if kind == "reverse":
            return [("missing_coupling", "A, B", "what B loses backwards is a part of k2*B, which is estimated, where temperatures vary little")]
        return []

    return Family(
        "batch_reactor", False, 0.5, 3, 240, 0, "min",
        [Quantity("A", "mol/L", "educt"), Quantity("B", "mol/L", "product"), Quantity("T", "K", "temperature")],
        {"Tj": "K"}, {"cA": ("mol/L", "A"), "cB": ("mol/L", "B"), "temperature": ("K", "T")},
        {"k1": (0.045, "1/min", "rate at 330 K"), "E1": (6800.0, "K", "activation of the first step"),
         "k2": (0.014, "1/min", "rate at 330 K"), "E2": (8200.0, "K", "activation of the second step"),
         "H1": (38.0, "kJ/mol", "heat of reaction"), "UA": (0.42, "kJ/(K*L*min)", "jacket")},
        {"Cp": (3.4, "kJ/(K*L)", "heat capacity"), "T0": (330.0, "K", "reference temperature")},
        rates, lambda x, u, p: [x[0], x[1], x[2]], manoeuvre,
        {"A": ("", "-r1"), "B": ("", "r1 - r2"), "T": ("Cp", "H1*r1 + UA*(Tj - T)")},
        driven(("input_bias", "input_gain", "delay", "lag"), ["Tj"])
        + [Hidden("order", "A"), Hidden("reverse", "k1"), Hidden("radiation", "T", fixed={"surroundings": 295}),
           Hidden("constant", "T", sign=-1), Hidden("output_bias", "temperature", sign=0), Hidden("output_bias", "cA", sign=0),
           Hidden("output_bias", "cB", sign=0), Hidden("drift", "temperature", sign=0), Hidden("drift", "cA", sign=0),
           Hidden("drift", "cB", sign=0)],
        lets="  let r1 = k1*exp(E1*(1/T0 - 1/T))*A;\n  let r2 = k2*exp(E2*(1/T0 - 1/T))*B;",
        starts=("released",), begin=lambda p: [2 + 0 * p["k1"], 0.05 + 0 * p["k1"], 320 + 0 * p["k1"]],
        released=lambda rng: [rng.uniform(-0.7, 0.7), rng.uniform(0, 0.3), rng.uniform(-5, 5)], same=same,
        positive=True, enters={"Tj": "T"},
        outside=[Hidden("gust", "T")],
    )


def vessel():
    """A heated block with a sensor behind a wall, in a room of measured temperature."""

    def rates(x, u, p, f, s):
        return [(p["P"] * u[0] - p["UA"] * (x[0] - u[1]) - p["Us"] * (x[0] - x[1]) + f.get("Th", 0)) / p["Ch"],
                (p["Us"] * (x[0] - x[1]) + f.get("Ts", 0)) / p["Cs"]]

    def manoeuvre(rng, time):
        room = 295 + rng.uniform(-2, 2) + 1.5 * np.sin(2 * np.pi * time / 1700 + rng.uniform(0, 6))
        return np.stack([np.clip(0.2 + pieces(rng, time, 60, 320, (-0.2, 0.75)), 0, 1), room], axis=1)

    return Family(
        "heated_vessel", True, 4.0, 2, 400, 2500, "s",
        [Quantity("Th", "K", "temperature of the block"), Quantity("Ts", "K", "temperature of the sensor")],
        {"heater": "1", "room": "K"}, {"block": ("K", "Th"), "sensor": ("K", "Ts")},
        {"P": (48.0, "W", "power of the heater"), "UA": (0.55, "W/K", "loss to the room"), "Us": (0.20, "W/K", "to the sensor"),
         "Cs": (9.0, "J/K", "sensor")},
        {"Ch": (95.0, "J/K", "block")},
        rates, lambda x, u, p: [x[0], x[1]], manoeuvre,
        {"Th": ("Ch", "P*heater - UA*(Th - room) - Us*(Th - Ts)"), "Ts": ("Cs", "Us*(Th - Ts)")},
        driven(("input_bias", "delay", "lag", "saturation", "dead_zone", "backlash"), ["heater"])
        + [Hidden("curve", "heater", sign=0, fixed={"even": True}), Hidden("radiation", "Th", fixed={"surroundings": 295}),
           Hidden("constant", "Th", sign=0), Hidden("output_bias", "sensor", sign=0), Hidden("output_bias", "block", sign=0),
           Hidden("drift", "sensor", sign=0), Hidden("drift", "block", sign=0)],
        starts=("settled",), begin=lambda p: [312 + 0 * p["P"], 312 + 0 * p["P"]],
        positive=True, enters={"heater": "Th", "room": "Th"},
        outside=[Hidden("gust", "Th")],
    )


FAMILIES = {f.name: f for f in (servo(), cart(), tanks(), buck(), aircraft(), ship(), reactor(), vessel())}
