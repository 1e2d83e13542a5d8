"""Makes the cases of the second blind set: models, records, and the truth beside them.

    python3 studies/world/cases.py FOLDER [--families NAMES] [--apart] [--single 14] [--nothing 4] [--pairs 2] [--outside 3]

Needs numpy and scipy. A case's name is its seed: the same case has the same records whenever it is made. Cases that are
there are kept. Families that are kept apart are made with `--apart` only, and then alone.
"""

import argparse
import copy
import json
import os
import zlib
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np

from families import FAMILIES
from motion import EQUATION, INPUT, OUTPUT, Hidden, Motion, term
from noises import COLOURS, Noise, numbers
from oracle import Oracle, Point, Records, complement

BANDS = [(5, 15), (15, 60), (60, 1500)]
# largest sizes: parts of the largest input, of a run's length, of an output's deviation, of an equation's force
LARGEST = {
    "input_bias": 0.6, "input_gain": 0.5, "dead_zone": 0.5, "saturation": 0.7, "backlash": 0.4, "delay": 0.08, "lag": 0.08,
    "curve": 0.8, "output_bias": 1.5, "drift": 2.0, "order": 1.0, "reverse": 0.05,
}
# a smaller loss without noise is another name of the same model, nats
SAME = 0.05
# what lacks less is written beside the truth as a rival, nats
NEAR = 6.0
NAMES = {
    "input_bias": ["input_bias", "input_offset"],
    "input_gain": ["input_scale", "input_gain", "input_scale_factor"],
    "dead_zone": ["input_dead_zone"],
    "saturation": ["input_saturation"],
    "backlash": ["backlash"],
    "delay": ["input_delay"],
    "lag": ["actuator_lag"],
    "curve": ["input_curvature", "input_curve", "static_input_curve"],
    "output_bias": ["output_bias", "output_offset"],
    "drift": ["output_bias_drift", "output_drift", "sensor_drift"],
    "coulomb": ["coulomb_friction"],
    "drag": ["quadratic_damping"],
    "cubic": ["cubic_stiffness"],
    "constant": ["constant_force"],
    "root": ["root_outflow"],
    "radiation": ["radiation", "heat_radiation", "radiation_loss"],
    "order": ["reaction_order"],
    "reverse": ["reverse_reaction"],
}


def same_kinds(family, effect, start, size=None):
    """Kinds and places that are the same model, each with its reason."""
    kind, place, found = effect.kind, effect.place, []
    by_input = {i: x for i, x in family.enters.items()}
    force = "the input enters this equation alone, in proportion: its bias is a constant force there"
    if kind == "input_bias" and place in by_input:
        found.append(("constant", by_input[place], force))
    if kind == "constant":
        found += [("input_bias", i, force) for i, x in by_input.items() if x == place]
        if family.positive:
            found.append(("coulomb", place, f"{place} has one sign, so that friction is a constant force"))
    if kind == "drag" and family.positive:
        found.append(("quadratic_term", f"{place}, {place}", f"{place} has one sign, so that x*abs(x) is x^2"))
    if kind == "input_gain" and family.positive:
        found.append(("input_scale_asymmetry", place, f"{place} has one sign, so that i + k*abs(i) is a gain"))
    if kind == "curve":
        found.append(("input_square" if effect.fixed["even"] else "input_cube", place, "that is the curve"))
    if kind == "curve" and effect.fixed["even"] and place in by_input:
        found.append(("quadratic_term", f"{by_input[place]}, {place}", "the input enters this equation alone, in proportion"))
    if kind == "cubic" and effect.other == place:
        found.append(("cubic_damping", place, "the cube of a state in its own equation"))
    if kind in ("delay", "lag") and size is not None and abs(size) * (family.samples - 1) < 0.1:
        short = "shorter than a tenth of a sample: both take T*du/dt away, and differ by squares of T"
        found.append(("lag" if kind == "delay" else "delay", place, short))
    return found + (family.same(kind, place, start) if family.same else [])


def names_of(family, effect, size, start, rivals=None, whole=0.0):
    """Names that are right, each with its reason: decided by the equations and by simulation, before anything is asked."""
    right = []

    def add(kind, places, why):
        for name in NAMES.get(kind, [kind]):
            if not any(r["effect"] == name and r["targets"] == places for r in right):
                right.append({"effect": name, "targets": places, "why": why})

    add(effect.kind, [effect.place] + [effect.other] * (effect.other != ""), "the truth")
    for kind, places, why in same_kinds(family, effect, start, size):
        add(kind, places.split(", "), why)
        # and what is the same as that, where it is a kind that this set hides
        for also, there, reason in same_kinds(family, Hidden(kind, places), start) if kind in ("constant", "input_bias") else []:
            add(also, there.split(", "), f"{why}; {reason}")
    for key, lack in (rivals or {}).items():
        if lack < SAME:
            other = next(e for e in family.effects if e.key == key)
            why = f"computed: lacks {max(lack, 0):.3f} nats of {whole:.1f} without noise"
            add(other.kind, [other.place] + [other.other] * (other.other != ""), why)
            for kind, places, reason in same_kinds(family, other, start):
                add(kind, places.split(", "), f"{why}; {reason}")
    return right


def right_names(family, hidden, start, computed):
    """Names that are right for each hidden effect (with its size); `computed` holds the rivals."""
    near = computed.get("rivals_of_each") or [computed.get("rivals")] * len(hidden)
    whole = computed.get("gains_without_noise") or [computed.get("gain_without_noise", 0.0)] * len(hidden)
    named = zip(hidden, near, whole)
    return [names_of(family, e, s, start, rivals, gain) for (e, s), rivals, gain in named if e.kind in NAMES]


class Bench:
    """A family with true numbers, manoeuvres, noise and a kind of start: all of a case but what is hidden."""

    def __init__(self, family, rng, runs, validation, colour):
        self.family, self.rng, self.runs, self.validation = family, rng, runs, validation
        self.truth = {k: v[0] * float(np.exp(0.1 * rng.standard_normal())) for k, v in family.parameters.items()}
        self.known = {k: v[0] for k, v in family.known.items()}
        self.time = np.arange(family.samples) * family.step
        total = runs + validation
        self.inputs = np.stack([family.manoeuvre(rng, self.time) for _ in range(total)], axis=2)
        self.start = str(rng.choice(family.starts))
        self.free = self.start != "rest"
        n, correlation = family.samples, 0.1 * self.time[-1] * rng.uniform(0.1, 1)
        keep = np.exp(-family.step / correlation)
        gust = np.zeros((n, total))
        gust[0] = rng.standard_normal(total)
        for k in range(1, n):
            gust[k] = keep * gust[k - 1] + np.sqrt(1 - keep**2) * rng.standard_normal(total)
        self.motion = Motion(family, self.inputs, gust)
        self.values = {**self.known, **self.truth}
        self.shift = np.zeros((len(family.states), total))
        if self.start == "released":
            self.shift = np.array([family.released(rng) for _ in range(total)]).T
        self.scales = {name: 1.0 for name in family.outputs}
        y, start = self.simulate([])
        self.clean, self.begin = y[..., 0], start[..., 0]
        self.scales = {name: float(np.std(self.clean[:, o])) for o, name in enumerate(family.outputs)}
        level = np.exp(rng.uniform(*np.log(family.noise)))
        sizes = [s * level * np.exp(0.3 * rng.standard_normal()) for s in self.scales.values()]
        self.noises = [Noise(colour, n, s, numbers(colour, rng)) for s in sizes]
        self.seed = rng.integers(1 << 60)
        states, _ = self.motion.run({k: np.array([v]) for k, v in self.values.items()}, start=start)
        self.states = states[..., 0]
        self.spread = np.std(self.states, axis=(0, 2)) + 1e-9
        self.names = [s.name for s in family.states]

    def simulate(self, effects, motion=None):
        """Outputs and initial states of the truth with effects, columns of sizes."""
        motion = motion or self.motion
        values = {k: np.array([v]) for k, v in self.values.items()}
        columns = max([len(np.atleast_1d(s)) for _, s in effects], default=1)
        if self.start == "rest":
            begin = np.array(self.family.rest(values), float).reshape(len(self.shift), 1, -1)
            begin = np.repeat(np.repeat(begin, motion.inputs.shape[2], axis=1), columns, axis=2)
        elif self.family.settling:
            still = Motion(self.family, motion.inputs[:2])
            still.largest, still.length = motion.largest, motion.length
            _, begin = still.outputs(values, effects, settle=True, scales=self.scales)
        else:
            begin = np.array(self.family.rest(values), float).reshape(len(self.shift), 1, -1)
            begin = np.repeat(np.repeat(begin, motion.inputs.shape[2], axis=1), columns, axis=2)
        begin = begin + self.shift[:, :, None]
        return motion.outputs(values, effects, begin, scales=self.scales)

    def prepare(self, effect):
        """Nuisances of an effect, and the unit of its size; size 1 is as much as the equation has."""
        effect = copy.deepcopy(effect)
        if effect.kind == "coulomb":
            speed = self.states[:, self.names.index(effect.place)]
            effect.fixed["creep"] = float(np.sqrt(np.mean(speed**2)) * self.rng.uniform(0.01, 0.03))
        if effect.kind == "cogging":
            effect.fixed["phase"] = float(self.rng.uniform(0, 2 * np.pi))
        if effect.kind in EQUATION:
            x = np.moveaxis(self.states, 1, 0)
            basis = np.sqrt(np.mean(np.square(term(effect, x, self.names, self.motion.gust[:: 2 * self.motion.sub]))))
            j = self.names.index(effect.place)
            inertia = self.values.get(self.family.balances[effect.place][0], 1.0)
            force = inertia * np.sqrt(np.mean(np.diff(self.states[:, j], axis=0) ** 2)) / self.family.step
            return effect, 2.0 * force / basis
        return effect, LARGEST[effect.kind]

    def direction(self, y, base, records):
        """Whitened differences of the fitted runs, flat, one column each."""
        fitted = slice(0, self.runs)
        d = records.whiten(y[:, :, fitted] - base[:, :, fitted, None])
        return d.reshape(-1, d.shape[-1])

    def records(self, y, runs):
        deviations = np.stack(
            [np.stack([n.deviations(y[:, o, r]) for r in runs], axis=1) for o, n in enumerate(self.noises)], axis=1)
        return Records(y[:, :, runs], deviations, self.noises)

    def noisy(self, y):
        """Records with the noise of this case, whatever is hidden."""
        rng = np.random.default_rng(self.seed)
        out = y.copy()
        for r in range(y.shape[2]):
            for o, noise in enumerate(self.noises):
                out[:, o, r] += noise.draw(y[:, o, r], rng)
        return out

    def oracle(self, effects, runs):
        family = self.family
        motion = Motion(family, self.inputs[:, :, runs], np.zeros((family.samples, len(runs))))
        motion.largest = self.motion.largest
        return Oracle(motion, self.known, effects, self.scales, self.free, self.spread)

    def judged(self, effects, sizes):
        """Gains of the true structure over the naive one, on fitted and validation runs; and of leaving one out."""
        y, begin = self.simulate([(e, np.array([s])) for e, s in zip(effects, sizes)])
        y, begin = y[..., 0], begin[..., 0]
        measured = self.noisy(y)
        fitted, others = list(range(self.runs)), list(range(self.runs, self.runs + self.validation))
        records = self.records(y, fitted)
        records.measured = measured[:, :, fitted]
        validation = self.records(y, others) if others else None
        if others:
            validation.measured = measured[:, :, others]
        costs, checks, points = {}, {}, {}
        structures = {"naive": []} | ({"true": list(range(len(effects)))} if effects else {})
        if len(effects) > 1:
            structures |= {f"without {j}": [k for k in range(len(effects)) if k != j] for j in range(len(effects))}
        for name, chosen in structures.items():
            part = [effects[k] for k in chosen]
            first = Point(dict(self.truth), [sizes[k] for k in chosen], begin[:, fitted] if self.free else self.begin[:, fitted])
            points[name], costs[name] = self.oracle(part, fitted).fit(first, records)
            if others and name in ("naive", "true"):
                first = Point(points[name].values, points[name].sizes, begin[:, others] if self.free else self.begin[:, others])
                _, checks[name] = self.oracle(part, others).fit(first, validation, parameters=False)
        for found in (costs, checks):
            found.setdefault("true", found.get("naive"))
        return y, measured, costs, checks, points


def searched(bench, effect, largest, target):
    """The size whose gain is the target, by a scan of noise-free differences beside the naive model's parameters."""
    oracle = bench.oracle([], list(range(bench.runs)))
    sizes = largest * np.geomspace(1e-4, 1, 25)
    y, _ = bench.simulate([(effect, sizes)])
    records = bench.records(bench.clean, list(range(bench.runs)))
    _, J = oracle.linear(Point(dict(bench.truth), [], bench.begin[:, :bench.runs]), records)
    off = complement(J)
    gains = 0.5 * np.sum(off(bench.direction(y, bench.clean, records)) ** 2, axis=0)
    gains = np.where(np.isfinite(gains), gains, -1)
    above = np.flatnonzero(gains >= target)
    if not len(above) or above[0] == 0:
        return None
    k = above[0]
    at = np.interp(np.log(target), np.log(np.maximum(gains[[k - 1, k]], 1e-9)), np.log(np.abs(sizes[[k - 1, k]])))
    return float(np.sign(largest) * np.exp(at))


def gains(bench, beside, off, base, records, target):
    """What each effect of the family gains of whitened differences, beside what is in the truth already: by its best size of a grid, to first
    order in the parameters."""
    others, columns = [], []
    for other in bench.family.effects:
        if any(other.key == e.key for e, _ in beside):
            continue
        one, largest = bench.prepare(other)
        grid = largest * np.geomspace(0.003, 1, 7)
        grid = np.concatenate([grid, -grid]) if other.sign == 0 else grid
        others.append(one)
        columns.append(grid)
    count = sum(len(c) for c in columns)
    acting, at = [(e, np.full(count, s)) for e, s in beside], 0
    for one, grid in zip(others, columns):
        own = np.zeros(count)
        own[at:at + len(grid)] = grid
        at += len(grid)
        acting.append((one, own))
    y, _ = bench.simulate(acting)
    d = off(bench.direction(y, base, records))
    d = np.where(np.isfinite(d), d, 0)
    found, at = {}, 0
    for one, grid in zip(others, columns):
        part = d[:, at:at + len(grid)]
        at += len(grid)
        square = np.sum(part**2, axis=0) + 1e-30
        # between the sizes of the grid an effect is nearly in proportion, and below the smallest down to nothing
        lowest = np.where(np.abs(grid) == np.min(np.abs(grid)), 0.0, 0.4)
        amount = np.clip((part.T @ target) / square, lowest, 2.5)
        found[one.key] = float(np.max(amount * (part.T @ target) - 0.5 * amount**2 * square))
    return found


def beside_parameters(bench, beside):
    """The response with some effects, its records, and a projector off what the parameters and these effects' sizes can do."""
    runs = list(range(bench.runs))
    y, begin = bench.simulate([(e, np.array([s])) for e, s in beside])
    records = bench.records(bench.clean, runs)
    at = Point(dict(bench.truth), [s for _, s in beside], begin[:, runs, 0])
    _, J = bench.oracle([e for e, _ in beside], runs).linear(at, records)
    return y[..., 0], records, complement(J)


def rivals(bench, effects, sizes, which=0):
    """How much of the gain of one effect other effects of the family lack in its place without noise, and that gain, nats.

    What else is hidden stays there, and its size is fitted as the parameters are.
    """
    hidden = list(zip(effects, sizes))
    beside = [own for k, own in enumerate(hidden) if k != which]
    base, records, off = beside_parameters(bench, beside)
    y, _ = bench.simulate([(e, np.array([s])) for e, s in hidden])
    truth = off(bench.direction(y, base, records))[:, 0]
    whole = float(0.5 * truth @ truth)
    found = gains(bench, beside, off, base, records, truth)
    found.pop(effects[which].key, None)
    return {key: whole - gain for key, gain in found.items()}, whole


def near(found):
    """Rivals that lack little, the nearest first."""
    return dict(sorted(((k, v) for k, v in found.items() if v < NEAR), key=lambda kv: kv[1]))


def drawn(family, kind, number, attempt):
    """The bench of a case, before anything is hidden."""
    rng = np.random.default_rng([zlib.crc32(f"{family.name} {kind} {number}".encode()), attempt])
    runs = int(rng.choice([1, 2, 2, 3, 4])) if kind in ("single", "nothing") else int(rng.choice([2, 3]))
    validation = int(rng.random() < 0.6)
    return Bench(family, rng, runs, validation, COLOURS[number % len(COLOURS)])


def made(name, kind, number, folder):
    """One case in its folder; the truth, or none where the effect cannot have the gain."""
    family = FAMILIES[name]
    for attempt in range(40):
        bench = drawn(family, kind, number, attempt)
        rng, runs, validation, colour = bench.rng, bench.runs, bench.validation, bench.noises[0].colour
        newton = bool(rng.random() < 0.5)
        effects, sizes, band = [], [], None
        extra = {}
        if kind == "single":
            turn = np.random.default_rng(zlib.crc32(name.encode())).permutation(len(family.effects))
            effect = family.effects[turn[number % len(turn)]]
            band = (number + attempt // 4 + number // len(turn)) % 3
            target = float(np.exp(rng.uniform(*np.log(BANDS[band]))))
            effect, largest = bench.prepare(effect)
            largest *= effect.sign or rng.choice([-1, 1])
            size = searched(bench, effect, largest, target)
            if size is None or not np.isfinite(size):
                continue
            effects, sizes = [effect], [float(size)]
        elif kind == "pair":
            for k in rng.permutation(len(family.effects)):
                effect, largest = bench.prepare(family.effects[k])
                largest *= effect.sign or rng.choice([-1, 1])
                size = searched(bench, effect, largest, float(np.exp(rng.uniform(np.log(25), np.log(300)))))
                clash = any(e.place == effect.place and {e.kind, effect.kind} <= set(INPUT) | set(OUTPUT) for e in effects)
                if size is not None and np.isfinite(size) and not clash:
                    effects.append(effect)
                    sizes.append(float(size))
                if len(effects) == 2:
                    break
            if len(effects) < 2:
                continue
        elif kind == "outside":
            effect = family.outside[number % len(family.outside)]
            effect, largest = bench.prepare(effect)
            if effect.kind == "gust":
                y, _ = bench.simulate([(effect, np.array([0.05 * largest]))])
                ratio = max(
                    np.std(y[:, o, :, 0] - bench.clean[:, o]) / n.size for o, n in enumerate(bench.noises))
                effects, sizes = [effect], [float(0.05 * largest * np.exp(rng.uniform(np.log(2.5), np.log(8))) / ratio)]
            else:
                size = searched(bench, effect, largest, float(np.exp(rng.uniform(np.log(40), np.log(800)))))
                if size is None:
                    continue
                effects, sizes = [effect], [size]
        realised = None
        for _ in range(5):
            y, measured, costs, checks, points = bench.judged(effects, sizes)
            realised = costs["naive"] - costs["true"]
            if kind != "single" or not np.isfinite(realised):
                break
            if abs(np.log(max(realised, 0.5) / target)) < 0.22:
                break
            sizes = [sizes[0] * float(np.clip(np.sqrt(target / max(realised, 0.5)), 0.5, 2))]
            if abs(sizes[0]) > abs(largest):
                break
        if not np.isfinite(realised) or not np.isfinite(y).all():
            continue
        if kind == "single" and not BANDS[band][0] * 0.9 <= realised <= BANDS[band][1] * 1.1:
            continue
        if kind == "pair" and min(costs["without 0"], costs["without 1"]) - costs["true"] < 10:
            continue
        if kind == "single":
            lacks, whole = rivals(bench, effects, sizes)
            extra = {"rivals": near(lacks), "gain_without_noise": whole}
        if kind == "pair":
            found = [rivals(bench, effects, sizes, j) for j in range(2)]
            extra = {"rivals_of_each": [near(lacks) for lacks, _ in found], "gains_without_noise": [whole for _, whole in found]}
        break
    else:
        return None
    where = folder / f"{name}-{kind}-{number}"
    where.mkdir(parents=True, exist_ok=True)
    (where / "model.fdm").write_text(family.text(newton, bench.free))
    (where / "other_form.fdm").write_text(family.text(not newton, bench.free))
    head = [f"t [{family.time}]", *(f"{k} [{u}]" for k, u in family.inputs.items())]
    head += [f"{k} [{u}]" for k, (u, _) in family.outputs.items()]
    files = [f"run_{k + 1}.csv" for k in range(runs)] + ["validation.csv"] * validation
    for r, file in enumerate(files):
        rows = np.column_stack([bench.time, bench.inputs[:, :, r], measured[:, :, r]])
        np.savetxt(where / file, rows, delimiter=",", header=",".join(head), comments="", fmt="%.12g")
    np.save(where / "clean.npy", y)
    right = right_names(family, list(zip(effects, sizes)), bench.start, extra)
    truth = {
        "case": where.name, "family": name, "apart": family.apart, "kind": kind, "attempt": attempt,
        "hidden": [{"kind": e.kind, "place": e.place, "other": e.other, "size": s, "fixed": e.fixed} for e, s in zip(effects, sizes)],
        "right": right,
        "gain": None if any(e.kind == "gust" for e in effects) else float(realised),
        "each": [float(costs[f"without {j}"] - costs["true"]) for j in range(len(effects))] if kind == "pair" else None,
        "gain_validation": float(checks["naive"] - checks["true"]) if validation else None,
        "cost_naive_validation": float(checks["naive"]) if validation else None,
        "runs": runs, "validation": validation, "colour": colour,
        "noise": {o: {"numbers": n.numbers, "size": n.size} for o, n in zip(family.outputs, bench.noises)},
        "start": bench.start, "free": bench.free, "newton": newton,
        "parameters": bench.truth, "naive": points["naive"].values, **extra,
    }
    (where / "truth.json").write_text(json.dumps(truth, indent=1, default=float))
    return truth


def renamed(path):
    """The right names of a case that is there, written anew: they follow from its truth alone."""
    truth = json.loads(path.read_text())
    family = FAMILIES[truth["family"]]
    effects = [(Hidden(h["kind"], h["place"], h["other"], fixed=h["fixed"]), h["size"]) for h in truth["hidden"]]
    truth["right"] = right_names(family, effects, truth["start"], truth)
    path.write_text(json.dumps(truth, indent=1, default=float))


def one(work):
    name, kind, number, folder = work
    if (folder / f"{name}-{kind}-{number}" / "truth.json").exists():
        return None
    truth = made(name, kind, number, folder)
    return f"{name}-{kind}-{number}: " + ("no such size" if truth is None else (
        f"{', '.join(h['kind'] + '(' + h['place'] + ')' for h in truth['hidden']) or 'nothing'}, gain {truth['gain'] if truth['gain'] is None else round(truth['gain'], 1)},"
        f" {truth['colour']}, {truth['start']}, attempt {truth['attempt']}"))


def main():
    ask = argparse.ArgumentParser()
    ask.add_argument("folder", type=Path)
    ask.add_argument("--families", default="")
    ask.add_argument("--apart", action="store_true")
    for kind, count in (("single", 14), ("nothing", 4), ("pair", 2), ("outside", 3)):
        ask.add_argument(f"--{kind}", type=int, default=count)
    ask.add_argument("--first", type=int, default=0, help="number of the first case: others than before")
    ask.add_argument("--rename", action="store_true", help="write the right names of cases that are there anew")
    given = ask.parse_args()
    if given.rename:
        for path in given.folder.glob("*/truth.json"):
            renamed(path)
        return
    work = []
    for family in FAMILIES.values():
        chosen = family.name in given.families.split(",") if given.families else True
        if family.apart == given.apart and chosen:
            for kind in ("single", "nothing", "pair", "outside"):
                work += [(family.name, kind, n, given.folder) for n in range(given.first, given.first + getattr(given, kind))]
    # by number, so that a part of the set has all families
    work.sort(key=lambda w: w[2])
    with ProcessPoolExecutor(int(os.environ.get("FDM_PROCESSES", "1"))) as pool:
        for line in pool.map(one, work):
            if line:
                print(line, flush=True)


if __name__ == "__main__":
    main()
