"""Five systems, with integrators of their own: fourth-order Runge-Kutta in small steps, inputs straight between samples."""

from dataclasses import dataclass, field

import numpy as np

# steps between two samples
STEPS = 20


@dataclass
class Plant:
    """A model text, the truth behind its records, and what moves it."""

    name: str
    text: str
    truth: dict
    time: np.ndarray
    inputs: dict
    rates: object
    outputs: object
    names: list
    start: list
    options: dict = field(default_factory=dict)
    domains: tuple = ("time", "frequency")
    # noise: deviation over that of the output; neighbours and period of what oscillates, in samples
    noise: float = 0.05
    period: float = 12.0

    def response(self):
        """Outputs without noise, one column for each."""
        if not hasattr(self, "_response"):
            self._response = integrate(self)
        return self._response


def integrate(plant):
    """The outputs at all samples."""
    time, state = plant.time, np.array(plant.start, dtype=float)

    def moved(t):
        return {name: np.interp(t, time, values) for name, values in plant.inputs.items()}

    def at(t, x):
        return plant.outputs(x, moved(t), plant.truth)

    def rate(t, x):
        return np.array(plant.rates(t, x, moved, plant.truth))

    rows = [at(time[0], state)]
    for begin, end in zip(time[:-1], time[1:]):
        step = (end - begin) / STEPS
        for k in range(STEPS):
            t = begin + k * step
            a = rate(t, state)
            b = rate(t + step / 2, state + step / 2 * a)
            c = rate(t + step / 2, state + step / 2 * b)
            d = rate(t + step, state + step * c)
            state = state + step / 6 * (a + 2 * b + 2 * c + d)
        rows.append(at(end, state))
    return np.array(rows)


def steps(time, pieces):
    """An input that is so large from each of these moments on."""
    values = np.zeros_like(time)
    for begin, size in pieces:
        values[time >= begin] = size
    return values


def roll():
    """A ship that rolls: cubic stiffness, quadratic damping, a known moment."""
    time = np.arange(600) * 0.1
    moment = steps(time, [(1, 0.35), (3, -0.35), (6, 0.2), (9, -0.3), (13, 0.3), (15, 0), (24, -0.35), (26.5, 0.3), (31, 0)])
    text = """model roll "a ship that rolls" {
  input m [rad/s^2];
  state phi [rad] = free, p [rad/s] = free;
  param w2 = 2.2 in [0, 100] [1/s^2], k3 = 1 [1/(s^2*rad^2)], d1 = 0.05 [1/s], d2 = 0.1 [1/rad];
  der(phi) = p;
  der(p) = -w2*phi - k3*phi^3 - d1*p - d2*p*abs(p) + m;
  output roll [rad] = phi, rate [rad/s] = p;
}
"""

    def rates(t, x, moved, p):
        phi, rate = x
        return [rate, -p["w2"] * phi - p["k3"] * phi**3 - p["d1"] * rate - p["d2"] * rate * abs(rate) + moved(t)["m"]]

    truth = {"w2": 2.0, "k3": 1.6, "d1": 0.06, "d2": 0.3}
    return Plant("roll", text, truth, time, {"m": moment}, rates, lambda x, u, p: [x[0], x[1]], ["roll", "rate"], [0.25, 0.0])


def short_period():
    """The short period of an aircraft after 3-2-1-1 of the elevator."""
    time = np.arange(400) * 0.05
    elevator = steps(time, [(1, 0.05), (2.5, -0.05), (3.5, 0.05), (4, -0.05), (4.5, 0), (9, -0.04), (10.5, 0.04), (11.5, -0.04), (12, 0.04), (12.5, 0)])
    text = """model short_period "short period" {
  input e [rad];
  state a [rad], q [rad/s];
  param Za = -1 [1/s], Ze = -0.1 [1/s], Ma = -4 [1/s^2], Mq = -1.5 [1/s], Me = -8 [1/s^2];
  der(a) = Za*a + q + Ze*e;
  der(q) = Ma*a + Mq*q + Me*e;
  output alpha [rad] = a, rate [rad/s] = q;
}
"""

    def rates(t, x, moved, p):
        a, q = x
        e = moved(t)["e"]
        return [p["Za"] * a + q + p["Ze"] * e, p["Ma"] * a + p["Mq"] * q + p["Me"] * e]

    truth = {"Za": -1.2, "Ze": -0.15, "Ma": -5.0, "Mq": -1.8, "Me": -10.0}
    return Plant("short period", text, truth, time, {"e": elevator}, rates, lambda x, u, p: [x[0], x[1]], ["alpha", "rate"], [0, 0])


def delayed():
    """A second-order system whose input comes late."""
    time = np.arange(500) * 0.05
    u = steps(time, [(1, 1), (3, -1), (5, 0.5), (8, -0.5), (9, 1), (10.5, 0), (13, -1), (14, 1), (17, 0)])
    text = """model delayed "second order, input delay" {
  input u [1];
  state x [1], v [1/s];
  param K = 3 [1/s^2], d = 1.2 [1/s], w2 = 4 [1/s^2], tau = 0.2 in [0, 2] [s];
  der(x) = v;
  der(v) = -w2*x - d*v + K*delay(u, tau);
  output y [1] = x;
}
"""

    def rates(t, x, moved, p):
        late = moved(max(t - p["tau"], 0.0))["u"]
        return [x[1], -p["w2"] * x[0] - p["d"] * x[1] + p["K"] * late]

    truth = {"K": 4.0, "d": 1.5, "w2": 5.0, "tau": 0.27}
    return Plant("delay", text, truth, time, {"u": u}, rates, lambda x, u, p: [x[0]], ["y"], [0, 0])


def tank():
    """A tank that runs out through a hole."""
    time = np.arange(300) * 2.0
    pieces = [(0, 2.2), (60, 3.0), (140, 1.6), (220, 2.8), (300, 1.9), (380, 3.1), (450, 2.4), (520, 1.8)]
    inflow = steps(time, [(begin, 1e-4 * size) for begin, size in pieces])
    text = """model tank "a tank with a hole" {
  input u [m^3/s];
  state h [m] = free;
  const g = 9.81 [m/s^2];
  param b = 40 [1/m^2] "one over its area", c = 0.003 [1] "area of the hole over that of the tank";
  der(h) = b*u - c*sqrt(2*g*h);
  output level [m] = h;
}
"""

    def rates(t, x, moved, p):
        return [p["b"] * moved(t)["u"] - p["c"] * np.sqrt(19.62 * max(x[0], 0.0))]

    truth = {"b": 50.0, "c": 0.004}
    return Plant("tank", text, truth, time, {"u": inflow}, rates, lambda x, u, p: [x[0]], ["level"], [0.45])


def kinetics():
    """A substance that becomes another, which is lost: twelve samples."""
    time = np.arange(1, 13) * 1.0
    text = """model kinetics "A to B to C" {
  time [min];
  param A0 = 0.8 [1];
  state A [1] = A0, B [1] = 0;
  param k1 = 0.4 in [0, 10] [1/min], k2 = 0.2 in [0, 10] [1/min];
  der(A) = -k1*A;
  der(B) = k1*A - k2*B;
  output a [1] = A, b [1] = B;
}
"""

    def rates(t, x, moved, p):
        return [-p["k1"] * x[0], p["k1"] * x[0] - p["k2"] * x[1]]

    truth = {"A0": 1.0, "k1": 0.5, "k2": 0.15}
    # the first sample is a minute after the beginning of time, and the states begin there
    return Plant(
        "kinetics", text, truth, time, {}, rates, lambda x, u, p: [x[0], x[1]], ["a", "b"], [1.0, 0.0],
        domains=("time",), period=5.0,
    )


PLANTS = {plant.name: plant for plant in [roll(), short_period(), delayed(), tank(), kinetics()]}
