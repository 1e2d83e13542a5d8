"""Motion of a family with hidden effects: fourth-order Runge-Kutta in fine steps, many columns (parameter sets) at once.

Arrays end with (runs, columns). Inputs are straight between samples. What acts on an input is applied to its record on
the grid of half steps, before the equations are integrated.
"""

from dataclasses import dataclass, field

import numpy as np


@dataclass
class Hidden:
    """An effect and its place; `size` 0 is without it. `fixed` holds what the truth knows beside the size."""

    kind: str
    place: str
    other: str = ""
    # what is physical: +1, -1, or 0 for both signs
    sign: int = 1
    fixed: dict = field(default_factory=dict)

    @property
    def key(self):
        return f"{self.kind}({self.place}{', ' + self.other if self.other else ''})"


# size 1 is all of what the place has: largest input, deviation of an output, force of an equation, length of a run
INPUT = ("input_bias", "input_gain", "dead_zone", "saturation", "backlash", "delay", "lag", "curve")
OUTPUT = ("output_bias", "drift")
EQUATION = ("coulomb", "drag", "cubic", "constant", "cogging", "root", "radiation", "gust")


def term(effect, x, names, moment):
    """What an effect of size 1 adds to the balance of its equation."""
    at = x[names.index(effect.place)]
    other = x[names.index(effect.other)] if effect.other else None
    if effect.kind == "coulomb":
        return -np.tanh(at / effect.fixed["creep"])
    if effect.kind == "drag":
        return -at * np.abs(at)
    if effect.kind == "cubic":
        return -(other**3)
    if effect.kind == "constant":
        return np.ones_like(at)
    if effect.kind == "cogging":
        return np.sin(effect.fixed["teeth"] * other + effect.fixed["phase"])
    if effect.kind == "root":
        return -np.sqrt(np.maximum(at, 0))
    if effect.kind == "radiation":
        return -((at / effect.fixed["surroundings"]) ** 4 - 1)
    if effect.kind == "gust":
        return np.broadcast_to(moment, at.shape)
    raise KeyError(effect.kind)


def chain(values, largest, effects, step, length):
    """An input on the fine grid (fine, runs) as the plant feels it (fine, runs, columns), effect after effect."""
    columns = max([len(size) for _, size in effects], default=1)
    felt = np.repeat(values[:, :, None], columns, axis=2)
    for effect, size in effects:
        if not np.any(size):
            continue
        if effect.kind == "input_bias":
            felt = felt + size * largest
        elif effect.kind == "input_gain":
            felt = felt * (1 + size)
        elif effect.kind == "dead_zone":
            width = size * largest
            felt = felt - np.clip(felt, -width, width)
        elif effect.kind == "saturation":
            limit = np.maximum(1 - size, 0.02) * largest
            felt = np.clip(felt, -limit, limit)
        elif effect.kind == "curve":
            part = felt / largest
            felt = felt + size * largest * (part**2 if effect.fixed["even"] else part**3)
        elif effect.kind == "backlash":
            width, moved = size * largest, felt[0].copy()
            for k in range(len(felt)):
                moved = np.clip(moved, felt[k] - width, felt[k] + width)
                felt[k] = moved
        elif effect.kind == "lag":
            # exact for straight pieces; a time constant of 0 follows at once
            T = np.maximum(size * length, 1e-9 * step)
            keep = np.exp(-step / T)
            new, late, last = felt.copy(), felt[0].copy(), felt[0].copy()
            for k in range(1, len(felt)):
                slope = (felt[k] - last) / step
                last = felt[k]
                late = (late - (last - slope * step) + slope * T) * keep + last - slope * T
                new[k] = late
            felt = new
        elif effect.kind == "delay":
            back = np.asarray(size) * length / step
            whole = np.floor(back).astype(int)
            part = back - whole
            index = np.arange(len(felt))[:, None]
            first = np.clip(index - whole, 0, None)
            second = np.clip(index - whole - 1, 0, None)
            across = np.arange(columns)[None, :]
            felt = np.stack(
                [
                    felt[:, r][first, across] * (1 - part) + felt[:, r][second, across] * part
                    for r in range(felt.shape[1])
                ],
                axis=1,
            )
    return felt


def fine(record, sub):
    """A record (samples, ...) on the grid of half steps."""
    n = len(record)
    at = np.linspace(0, n - 1, (n - 1) * 2 * sub + 1)
    low = np.minimum(at.astype(int), n - 2)
    part = (at - low).reshape(-1, *[1] * (record.ndim - 1))
    return record[low] * (1 - part) + record[low + 1] * part


def bounded(x):
    """What diverges stays a number."""
    return np.clip(np.nan_to_num(x, nan=1e12), -1e12, 1e12)


class Motion:
    """Simulates a family over the records of its inputs (samples, inputs, runs)."""

    def __init__(self, family, inputs, gusts=None, refine=1):
        self.family, self.inputs, self.sub = family, inputs, family.sub * refine
        self.names = [s.name for s in family.states]
        self.grid = fine(inputs, self.sub)
        self.gust = fine(gusts, self.sub) if gusts is not None else None
        self.length = family.step * (len(inputs) - 1)
        self.half = family.step / self.sub / 2
        self.largest = {name: np.max(np.abs(inputs[:, i])) for i, name in enumerate(family.inputs)}

    def felt(self, effects, columns, settled=False):
        """Inputs as the plant feels them: (fine, inputs, runs, columns)."""
        grid = np.repeat(self.grid[:1], 2, axis=0) if settled else self.grid
        parts = []
        for i, name in enumerate(self.family.inputs):
            acting = [(e, s) for e, s in effects if e.place == name and e.kind in INPUT]
            if settled:
                acting = [(e, s) for e, s in acting if e.kind not in ("lag", "delay")]
            one = chain(grid[:, i], self.largest[name], acting, self.half, self.length)
            parts.append(np.broadcast_to(one, (*one.shape[:2], columns)))
        return np.stack(parts, axis=1)

    def rates(self, x, u, p, effects, special, moment):
        force = {}
        for effect, size in effects:
            force[effect.place] = force.get(effect.place, 0) + size * term(effect, x, self.names, moment)
        out = np.empty_like(x)
        for j, rate in enumerate(self.family.rates(x, u, p, force, special)):
            out[j] = rate
        return out

    def run(self, p, effects=(), start=None, settle=False):
        """States at the samples (samples, states, runs, columns), and inputs as felt there.

        `start` is (states, runs, columns); with `settle` the motion begins where it comes to rest by itself."""
        effects = [(e, np.atleast_1d(np.asarray(s, float))) for e, s in effects]
        columns = max([1, *[np.size(v) for v in p.values()], *[len(s) for _, s in effects]])
        if start is not None:
            columns = max(columns, start.shape[2])
        runs = self.inputs.shape[2]
        acting = [(e, s) for e, s in effects if e.kind in EQUATION]
        special = {e.kind: s for e, s in effects if e.kind not in INPUT + OUTPUT + EQUATION}
        if start is None:
            start = np.repeat(np.array(self.family.rest(p), float).reshape(len(self.names), 1, -1), runs, axis=1)
        x = np.broadcast_to(start, (len(self.names), runs, columns)).copy()
        if settle:
            u = self.felt(effects, columns, settled=True)[0]
            still = [(e, s) for e, s in acting if e.kind != "gust"]
            for _ in range(self.family.settling):
                x = self.advance(x, u, u, u, p, still, special, 0, 0, 0)
            x = bounded(x)
        u = self.felt(effects, columns)
        moment = self.gust if self.gust is not None else np.zeros((len(u), runs))
        moment = moment[:, :, None]
        out = [x]
        for k in range(0, len(u) - 1, 2):
            x = self.advance(x, u[k], u[k + 1], u[k + 2], p, acting, special, moment[k], moment[k + 1], moment[k + 2])
            if (k // 2 + 1) % self.sub == 0:
                x = bounded(x)
                out.append(x)
        return np.array(out), u[:: 2 * self.sub]

    def advance(self, x, u0, u1, u2, p, effects, special, m0, m1, m2):
        h = 2 * self.half
        a = self.rates(x, u0, p, effects, special, m0)
        b = self.rates(x + h / 2 * a, u1, p, effects, special, m1)
        c = self.rates(x + h / 2 * b, u1, p, effects, special, m1)
        d = self.rates(x + h * c, u2, p, effects, special, m2)
        return x + h / 6 * (a + 2 * b + 2 * c + d)

    def outputs(self, p, effects=(), start=None, settle=False, scales=None):
        """Outputs at the samples (samples, outputs, runs, columns) and the initial states."""
        with np.errstate(all="ignore"):
            x, u = self.run(p, effects, start, settle)
        x_, u_ = np.moveaxis(x, 1, 0), np.moveaxis(u, 1, 0)
        y = np.stack(np.broadcast_arrays(*self.family.measured(x_, u_, p)), axis=1)
        ramp = (np.arange(len(x)) / (len(x) - 1))[:, None, None]
        for effect, size in effects:
            if effect.kind in OUTPUT:
                o = list(self.family.outputs).index(effect.place)
                y[:, o] += size * scales[effect.place] * (ramp if effect.kind == "drift" else 1)
        return y, x[0]
