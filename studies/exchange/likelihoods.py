#!/usr/bin/env python3
"""Log-likelihoods of PEtab's benchmark problems at their nominal values by an integrator that is not ours: CVODE as libRoadRunner reads the
SBML, with tables and formulas as PEtab's own library reads them. Beside them what fdm finds, where a program is named.

    python3 -m venv target/petab && target/petab/bin/pip install petab libroadrunner
    target/petab/bin/python studies/exchange/likelihoods.py COLLECTION Boehm_JProteomeRes2014 --fdm target/release/fdm

COLLECTION is the folder Benchmark-Models. `--fdm` wants a build with `--features petab`; `--reader` names another one for that part.
Problems that are at rest before the experiment are integrated for a long time (`--rest` lengths of the longest experiment), as fdm does.
The second figure is that of ten times coarser tolerances: what it differs by tells how far the first is integrated. PEtab's own library
refuses noise whose formula names states: the density of a measured number is written out here.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import resource
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import libsbml
import pandas as pd
import petab.v1 as petab
import roadrunner
import sympy as sp


class Simulator:
    """A model with the tables of its problem."""

    def __init__(self, yaml: Path, rest: float):
        self.problem = petab.Problem.from_yaml(str(yaml))
        self.document = self.problem.model.sbml_document
        species = list(self.document.getModel().getListOfSpecies())
        self.compartment = {s.getId(): s.getCompartment() for s in species}
        model = self.document.getModel()
        rules = [r for r in model.getListOfRules() if r.isRate()]
        self.moving = {s.getId() for s in species if not s.getBoundaryCondition()} | {r.getVariable() for r in rules}
        self.amounts = {s.getId() for s in species if s.getHasOnlySubstanceUnits()}
        times = self.problem.measurement_df["time"]
        self.long = rest * max(times[times < math.inf].max(), 1e-9)
        self.formulas: dict[str, sp.Expr] = {}
        self.runner: Any = None

    def value(self, name: str) -> float:
        """A quantity of the model, as formulas of PEtab mean it."""
        if name == "time":
            return float(self.runner.getCurrentTime())
        if name in self.compartment and name not in self.amounts:
            return float(self.runner.getValue(f"[{name}]"))
        return float(self.runner.getValue(name))

    def begin(self, values: dict[str, float], relative: float) -> None:
        """The model anew, with these values written into its text, so that initial values follow from them."""
        document = self.document.clone()
        model = document.getModel()
        for name, value in values.items():
            if math.isnan(value):
                continue
            element = model.getElementBySId(name)
            if element is None or model.getAssignmentRule(name) is not None:
                continue
            model.removeInitialAssignment(name)
            if isinstance(element, libsbml.Parameter):
                element.setValue(value)
            elif isinstance(element, libsbml.Compartment):
                element.setSize(value)
            elif name in self.amounts:
                element.unsetInitialConcentration()
                element.setInitialAmount(value)
            else:
                element.unsetInitialAmount()
                element.setInitialConcentration(value)
        self.runner = roadrunner.RoadRunner(libsbml.writeSBMLToString(document))
        self.runner.integrator.relative_tolerance = relative
        self.runner.integrator.absolute_tolerance = relative * 1e-3
        self.runner.integrator.maximum_num_steps = 10_000_000

    def to(self, end: float) -> None:
        now = float(self.runner.getCurrentTime())
        if end > now:
            self.runner.simulate(now, end, 2)

    def formula(self, text: str) -> sp.Expr:
        if text not in self.formulas:
            self.formulas[text] = petab.math.sympify_petab(text)
        return self.formulas[text]

    def log_likelihood(self, relative: float) -> float:
        problem = self.problem
        conditions = problem.get_simulation_conditions_from_measurement_df()
        nominal = {str(k): float(v) for k, v in zip(problem.x_ids, problem.x_nominal)}
        found = 0.0
        for _, condition in conditions.iterrows():
            before, during = (self.row(condition.get(f"{kind}ConditionId"), nominal) for kind in ("preequilibration", "simulation"))
            if before is None:
                self.begin({**nominal, **(during or {})}, relative)
            else:
                self.begin({**nominal, **before}, relative)
                self.to(self.long)
                held = {name: self.value(name) for name in self.moving}
                self.begin({**nominal, **held, **{k: v for k, v in (during or {}).items() if not math.isnan(v)}}, relative)
            chosen = problem.measurement_df
            for key, value in condition.items():
                chosen = chosen[chosen[key] == value]
            for time, rows in chosen.sort_values("time").groupby("time"):
                self.to(self.long if math.isinf(time) else float(time))
                found += sum(self.density(row, nominal) for _, row in rows.iterrows())
        return found

    def row(self, condition: Any, nominal: dict[str, float]) -> dict[str, float] | None:
        """A row of the table of conditions, in numbers."""
        if not isinstance(condition, str) or not condition:
            return None
        row = self.problem.condition_df.loc[condition].drop("conditionName", errors="ignore")
        return {str(k): float(nominal.get(v, v)) for k, v in row.items() if not pd.isna(v)}

    def density(self, row: Any, nominal: dict[str, float]) -> float:
        """Logarithm of the density of a measured number."""
        observable = self.problem.observable_df.loc[row["observableId"]]
        law, scale = (observable.get(key, math.nan) for key in ("noiseDistribution", "observableTransformation"))
        if law not in ("normal", "") and not pd.isna(law):
            raise NotImplementedError(f"noise of the distribution {law}")
        known = {**nominal, **self.placeholders(row, "observable", nominal), **self.placeholders(row, "noise", nominal)}
        value, deviation = (self.evaluated(str(observable[key]), known) for key in ("observableFormula", "noiseFormula"))
        measured = float(row["measurement"])
        slope = {"log": measured, "log10": measured * math.log(10.0)}.get(str(scale), 1.0)
        law_of = {"log": math.log, "log10": math.log10}.get(str(scale), float)
        residual = (law_of(measured) - law_of(value)) / deviation
        return -0.5 * (residual**2 + math.log(2 * math.pi)) - math.log(deviation) - math.log(slope)

    def placeholders(self, row: Any, kind: str, nominal: dict[str, float]) -> dict[str, float]:
        given = petab.split_parameter_replacement_list(row.get(f"{kind}Parameters", math.nan))
        return {f"{kind}Parameter{k + 1}_{row['observableId']}": float(nominal.get(v, v)) for k, v in enumerate(given)}

    def evaluated(self, text: str, known: dict[str, float]) -> float:
        formula = self.formula(text)
        return float(formula.subs({s: known[str(s)] if str(s) in known else self.value(str(s)) for s in formula.free_symbols}))


def by_fdm(options: argparse.Namespace, yaml: Path) -> str:
    """The log-likelihood that the command finds, and its processor seconds."""
    folder = Path(options.work).absolute() / yaml.stem
    shutil.rmtree(folder, ignore_errors=True)
    words = [options.reader or options.fdm, "import", str(yaml), "-o", str(folder)]
    read = subprocess.run(words, capture_output=True, text=True, check=False)
    if read.returncode:
        return f"refused: {read.stderr.strip().splitlines()[-1][:200]}"
    found = re.search(r"Add (\S+) ", (folder / "IMPORT.md").read_text())
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    command = [options.fdm, "fit", "--iterations", "0", "--threads", "1", "--json", "--quiet", f"--integration-accuracy={options.accuracy}"]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    if not done.stdout:
        return f"failed: {done.stderr.strip().splitlines()[-1][:200]}"
    log_likelihood = json.loads(done.stdout)["log_likelihood"] + (float(found[1]) if found else 0.0)
    return f"{log_likelihood:.6f} ({after.ru_utime - before.ru_utime:.1f} s)"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("collection", type=Path)
    parser.add_argument("problems", nargs="+")
    parser.add_argument("--fdm")
    parser.add_argument("--reader")
    parser.add_argument("--work", default="target/likelihoods")
    parser.add_argument("--rest", type=float, default=1e4)
    parser.add_argument("--relative", type=float, default=1e-12, help="tolerance of CVODE")
    parser.add_argument("--accuracy", type=float, default=1e-8, help="--integration-accuracy of fdm")
    options = parser.parse_args()
    options.fdm, options.reader = (p and str(Path(p).absolute()) for p in (options.fdm, options.reader))
    for name in options.problems:
        yaml = (options.collection / name / f"{name}.yaml").absolute()
        try:
            simulator = Simulator(yaml, options.rest)
            fine, coarse = simulator.log_likelihood(options.relative), simulator.log_likelihood(10 * options.relative)
            said = f"{fine:.6f}, coarser {coarse:.6f}"
        except Exception as e:  # one problem that cannot be read here must not end the others
            said = f"{type(e).__name__}: {str(e)[:200]}"
        print(f"{name}: libRoadRunner {said}" + (f"; fdm {by_fdm(options, yaml)}" if options.fdm else ""), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
