#!/usr/bin/env python3
"""Problems of PEtab's benchmark collection in fdm and in AMICI, in one run: log-likelihood, its gradient, and processor time for each
gradient.

    python/wheel
    python3 -m venv target/amici
    target/amici/bin/pip install 'amici[petab]' target/wheels/fdm-*.whl
    target/amici/bin/python studies/exchange/gradients.py COLLECTION

AMICI is built from source and wants swig, cmake, a BLAS, HDF5 and a compiler of C++; so does each of its models. COLLECTION is the folder
Benchmark-Models. Both work on one thread of one process, at the same point: every start value a few per cent beside the nominal one.

A gradient is one call of each library. In fdm that is residuals and their exact Jacobian by all that is estimated (`Residuals`), with
steps that were chosen at that point before, as in a fit; `prepared in` is what the choice took. In AMICI it is `run_simulations` on all
conditions, by forward and by adjoint sensitivities, and its own `cpu_time_total` beside it. Middle and range are over the repeats.

Tolerances do not mean the same: fdm's steps bring each output's error below 1e-8 of its range, AMICI's `rtol` bounds local errors of
states. So every figure has beside it how far its log-likelihood and its gradient are from AMICI's at rtol 1e-12, the gradient as a part
of the largest component. fdm's gradient is told twice: by the Jacobian, for parameters that do not stand in the noise and where every
deviation is a number at that point; and for all, by differences of the log-likelihood that a fit tells.
"""

from __future__ import annotations

import argparse
import logging
import math
import re
import shutil
import statistics
import subprocess
import sys
import time
import tomllib
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import fdm
import numpy as np

PROBLEMS = [
    "Boehm_JProteomeRes2014",
    "Crauste_CellSystems2017",
    "Elowitz_Nature2000",
    "Fujita_SciSignal2010",
    "Schwen_PONE2014",
]


@dataclass
class Point:
    """Where both are asked: unscaled values by name, of the parameters that are estimated."""

    values: dict[str, float]
    log: dict[str, bool]

    def moved(self, name: str, step: float) -> dict[str, float]:
        """The values with one of them moved on its scale."""
        value = self.values[name]
        return {**self.values, name: value * 10**step if self.log[name] else value + step}

    def slope(self, name: str) -> float:
        """Derivative of the value by its scale."""
        return self.values[name] * math.log(10.0) if self.log[name] else 1.0


@dataclass
class Timed:
    """Milliseconds of the processor for each call."""

    all: list[float]

    @classmethod
    def of(cls, call: Callable[[], Any], repeats: int) -> Timed:
        call()
        spent = []
        for _ in range(repeats):
            # a call of less than the clock's tick is made often
            count, begun = 0, time.process_time()
            while count == 0 or time.process_time() - begun < 0.05:
                call()
                count += 1
            spent.append(1e3 * (time.process_time() - begun) / count)
        return cls(spent)

    def __str__(self) -> str:
        return f"{statistics.median(self.all):9.3f} ms ({min(self.all):.3f} to {max(self.all):.3f})"


class Fdm:
    """An imported problem."""

    def __init__(self, yaml: Path, folder: Path):
        shutil.rmtree(folder, ignore_errors=True)
        words = [sys.executable, "-m", "fdm", "import", str(yaml), "-o", str(folder)]
        subprocess.run(words, check=True, capture_output=True)
        found = re.search(r"Add (\S+) ", (folder / "IMPORT.md").read_text())
        self.added = float(found[1]) if found else 0.0
        self.text = (folder / "model.fdm").read_text()
        self.model = fdm.Model(folder / "model.fdm")
        options = tomllib.loads((folder / "fdm.toml").read_text()).get("options", {})
        self.runs = fdm.RunTable(folder / "runs.csv", **options)

    def log_likelihood(self, values: dict[str, float]) -> float:
        with warnings.catch_warnings():
            # that it has not converged
            warnings.simplefilter("ignore", fdm.ResultWarning)
            fit = self.model.fit(self.runs, set=self.own(values), iterations=0, progress=False)
        return float(fit.log_likelihood or math.nan) + self.added

    def differences(self, point: Point, step: float) -> dict[str, float]:
        """The gradient by differences of fourth order, on the scale of each parameter."""

        def by(name: str) -> float:
            at = {k: self.log_likelihood(point.moved(name, k * step)) for k in (-2, -1, 1, 2)}
            return (8 * (at[1] - at[-1]) - (at[2] - at[-2])) / (12 * step)

        return {name: by(name) for name in point.values}

    def deviations(self, values: dict[str, float]) -> tuple[dict[str, float], set[str]] | None:
        """Deviations of all outputs where they are numbers at these values, and the parameters in them."""
        found, names = {}, set()
        for output, expression in re.findall(r"^  noise (\w+)\s*= ([^;]*);", self.text, re.MULTILINE):
            named = set(re.findall(r"[A-Za-z_]\w*", expression))
            if not named <= set(values):
                return None
            found[output] = float(eval(expression.replace("^", "**"), {"__builtins__": {}}, values))
            names |= named
        return found, names

    def prepared(self, values: dict[str, float]) -> fdm.Residuals:
        known = self.deviations(values)
        return self.model.prepare(self.runs, set=self.own(values), noise=known[0] if known else None)

    def logarithm(self, name: str) -> str | None:
        """The parameter that stands for the logarithm of this one, where a prior was on that scale."""
        own = f"log10_{name}"
        return own if re.search(rf"^  param {own}\s*=", self.text, re.MULTILINE) else None

    def own(self, values: dict[str, float]) -> dict[str, float]:
        """Values under the model's names."""
        pairs = ((self.logarithm(name), name, value) for name, value in values.items())
        return {own: math.log10(value) for own, _, value in pairs if own} | {
            name: value for name, value in values.items() if not self.logarithm(name)}

    def gradient(self, residuals: fdm.Residuals, point: Point) -> dict[str, float] | None:
        """By the Jacobian, without the parameters of the noise."""
        known = self.deviations(point.values)
        if known is None:
            return None
        slopes = dict(zip(residuals.names, residuals.gradient()[1]))
        own = {name: self.logarithm(name) for name in point.values if name not in known[1]}
        return {name: slopes[log] if log else slopes[name] * point.slope(name) for name, log in own.items()}


class Amici:
    """A compiled model of AMICI with its data."""

    def __init__(self, yaml: Path, folder: Path):
        import petab.v1 as petab
        from amici.importers.petab.v1 import import_petab_problem
        from amici.sim import sundials
        from amici.sim.sundials.petab.v1 import create_edatas, simulate_petab
        from amici.sim.sundials.petab.v1._parameter_mapping import create_parameter_mapping

        self.sundials, self.simulate = sundials, simulate_petab
        self.problem = petab.Problem.from_yaml(str(yaml))
        self.model = import_petab_problem(self.problem, folder, model_name=folder.name)
        conditions = self.problem.get_simulation_conditions_from_measurement_df()
        self.data = create_edatas(amici_model=self.model, petab_problem=self.problem, simulation_conditions=conditions)
        self.map = create_parameter_mapping(
            petab_problem=self.problem, simulation_conditions=conditions, scaled_parameters=True, amici_model=self.model
        )
        table = self.problem.parameter_df
        estimated = table[table["estimate"] == 1]
        self.scales = {name: str(scale) for name, scale in estimated["parameterScale"].items()}
        self.nominal = {name: float(value) for name, value in estimated["nominalValue"].items()}
        self.bounds = {name: (float(row["lowerBound"]), float(row["upperBound"])) for name, row in estimated.iterrows()}

    def solver(self, rtol: float, method: str | None) -> Any:
        solver = self.model.create_solver()
        solver.set_relative_tolerance(rtol)
        solver.set_absolute_tolerance(rtol * 1e-4)
        # adjoint sensitivities set aside memory for so many steps, and the usual number is enough for what is timed
        solver.set_max_steps(100_000 if rtol < 1e-10 else 10_000)
        order, methods = self.sundials.SensitivityOrder, self.sundials.SensitivityMethod
        solver.set_sensitivity_order(order.first if method else order.none)
        if method:
            solver.set_sensitivity_method(getattr(methods, method))
        return solver

    def __call__(self, values: dict[str, float], solver: Any) -> tuple[float, dict[str, float]]:
        """Log-likelihood and its gradient on the parameters' scale; the data then hold these values."""
        found = self.simulate(
            self.problem,
            amici_model=self.model,
            solver=solver,
            problem_parameters=values,
            scaled_parameters=False,
            edatas=self.data,
            parameter_mapping=self.map,
            scaled_gradients=True,
        )
        return float(found["llh"]), dict(found["sllh"] or {})

    def integrated(self, solver: Any) -> float:
        """The integrators of all conditions at the values of the last call; milliseconds as they tell them."""
        results = self.sundials.run_simulations(self.model, solver, edata_list=self.data, num_threads=1)
        return sum(float(r.cpu_time_total) for r in results)


def point(amici: Amici, away: float) -> Point:
    """Values beside the nominal ones, in turn above and below, within the bounds."""
    values = {}
    for k, (name, value) in enumerate(amici.nominal.items()):
        low, high = amici.bounds[name]
        moved = value * (1 + away if k % 2 else 1 - away)
        values[name] = moved if low < moved < high else value * (1 - away if k % 2 else 1 + away)
    return Point(values, {name: scale == "log10" for name, scale in amici.scales.items()})


def apart(one: dict[str, float] | None, other: dict[str, float]) -> str:
    """The largest difference of two gradients, as a part of the largest component."""
    if not one:
        return "not told"
    largest = max(abs(v) for v in other.values())
    return f"{max(abs(one[name] - other[name]) for name in one) / largest:.1e} ({len(one)} of {len(other)} parameters)"


def told(name: str, options: argparse.Namespace) -> None:
    yaml, work = (options.collection / name / f"{name}.yaml").absolute(), Path(options.work).absolute()
    ours = Fdm(yaml, work / f"fdm_{name}")
    amici = Amici(yaml, work / f"amici_{name}")
    exact = amici.solver(1e-12, None)
    reference, nominal = amici(amici.nominal, exact)[0], ours.log_likelihood({})
    print(f"{name}: {len(amici.nominal)} estimated, {amici.model.nx_solver} states, {len(amici.data)} conditions", flush=True)
    print(f"  nominal log-likelihood: AMICI {reference:.6f}, fdm {nominal:.6f}, apart {nominal - reference:.1e}", flush=True)
    beside = point(amici, options.away)
    reference, gradient = amici(beside.values, amici.solver(1e-12, "forward"))
    if not gradient:
        print("  AMICI has no gradient beside the nominal values (try a smaller --away)")
        return
    ways = [(rtol, method) for rtol in options.rtol for method in ("forward", "adjoint")]
    for rtol, method in ways:
        solver = amici.solver(rtol, method)
        try:
            value, slopes = amici(beside.values, solver)
            own = statistics.median(amici.integrated(solver) for _ in range(options.repeats))
            timed = Timed.of(lambda: amici.integrated(solver), options.repeats)
        except Exception as e:  # what AMICI raises where a method does not serve
            print(f"  AMICI {method} rtol {rtol:.0e}: {e}")
            continue
        print(
            f"  AMICI {method:7} rtol {rtol:.0e}: {timed}, itself says {own:.3f} ms; log-likelihood off {value - reference:.1e},"
            f" gradient off {apart(slopes, gradient)}",
            flush=True,
        )
    begun = time.process_time()
    residuals = ours.prepared(beside.values)
    prepared = 1e3 * (time.process_time() - begun)
    out = (np.empty(len(residuals)), np.empty((len(residuals), len(residuals.names))))
    timed = Timed.of(lambda: residuals(out=out), options.repeats)
    off = ours.log_likelihood(beside.values) - reference
    by_jacobian = ours.gradient(residuals, beside)
    print(f"  fdm:                        {timed}, prepared in {prepared:.0f} ms; log-likelihood off {off:.1e},", end="")
    print(f" gradient off {apart(by_jacobian, gradient)}", flush=True)
    if len(beside.values) <= options.most:
        print(f"  fdm by differences: gradient off {apart(ours.differences(beside, 1e-3), gradient)}", flush=True)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collection", type=Path)
    parser.add_argument("--work", default="target/gradients")
    parser.add_argument("--repeats", type=int, default=11)
    parser.add_argument("--rtol", type=float, nargs="+", default=[1e-8], help="relative tolerances of AMICI")
    parser.add_argument("--away", type=float, default=0.05, help="how far beside the nominal values, as a part of them")
    parser.add_argument("--most", type=int, default=50, help="parameters up to which the gradient is told by differences too")
    parser.add_argument("--only", nargs="+", default=PROBLEMS)
    options = parser.parse_args()
    # AMICI tells every step of its import, and a line for every number that is not finite
    logging.disable(logging.WARNING)
    Path(options.work).mkdir(parents=True, exist_ok=True)
    for name in options.only:
        told(name, options)
    return 0


if __name__ == "__main__":
    sys.exit(main())
