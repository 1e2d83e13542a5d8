"""Models: what they declare, and everything that can be asked of one."""

from __future__ import annotations

import os
import warnings
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _fdm
from ._errors import ModelWarning, NumericalError, ResultWarning, findings
from ._options import listed, words
from ._progress import telling
from ._run import Campaign, Run, RunLike, as_runs

if TYPE_CHECKING:
    from ._errors import Finding
    from ._fit import Fit
    from ._results import Calibration, Check, Design, Diagnosis, Doctor, Effects, Linear, Modes, Profiles, Spectra, Study


@dataclass(frozen=True)
class Channel:
    """An input, a state or an output."""

    name: str
    doc: str
    unit: str | None


@dataclass(frozen=True)
class Param:
    """A parameter as the model declares it."""

    name: str
    doc: str
    unit: str | None
    value: float
    """Start value of an estimation."""
    lower: float
    upper: float
    """Bounds; infinite where there are none."""
    fixed: bool
    """Known: not estimated."""
    per_run: bool
    """With a value of its own in every run."""
    log: bool
    """Searched by its logarithm."""
    prior: tuple[float, float] | None
    """Mean and standard deviation of what was known before."""


@dataclass(frozen=True)
class Response:
    """Simulated outputs of a run."""

    time: NDArray[np.float64]
    """Times (N), from 0, in the model's unit."""
    outputs: NDArray[np.float64]
    """Outputs (N by q), in the model's units and order; NaN behind a divergence."""
    names: tuple[str, ...]
    """Names of the outputs (q)."""
    units: tuple[str | None, ...]
    integration: str
    """Scheme, steps and integration error, in words."""
    faults: tuple[str, ...]
    """What makes the numbers wrong; empty when nothing does."""

    def __getitem__(self, output: str) -> NDArray[np.float64]:
        """Samples (N) of an output."""
        if output not in self.names:
            raise KeyError(f"there is no output `{output}`; there are {', '.join(self.names)}")
        return self.outputs[:, self.names.index(output)]

    def table(self, kind: str = "pandas") -> Any:
        """Time and outputs as ``"pandas"`` or ``"polars"`` frame, or as ``"dict"``."""
        from ._documents import frame

        return frame({"t": self.time, **{n: self[n] for n in self.names}}, kind)


class Model:
    """A checked and compiled model.

    ::

        m = fdm.Model("wing.fdm")
        m = fdm.Model.from_text("model decay { state x = 1; param k = 0.5 [1/s]; der(x) = -k*x; output y = x; }")

    file: a ``.fdm`` file; it and the files that it uses are read and checked.

    Raises `ModelError` with every mistake of the text: code, line, column, hint. Warnings of the text are warned of.

    Methods that work on runs take one run or several: `Run`, files, frames or dictionaries of arrays. Their options are those of the
    command of the same name, with underscores: ``fdm fit --start-values model`` is ``fit(runs, start_values="model")``. Results are
    equal to the bit to those of the command.
    """

    def __init__(self, file: str | os.PathLike[str]):
        self._begin(_fdm.Model.from_file(os.fspath(file)))
        self._warn()

    @classmethod
    def from_text(cls, text: str, name: str = "model.fdm") -> Model:
        """The model of a text that uses no files. `name` is what messages call it."""
        model = cls._of(_fdm.Model.from_text(name, text))
        model._warn()
        return model

    @classmethod
    def _of(cls, made: _fdm.Model) -> Model:
        model = cls.__new__(cls)
        model._begin(made)
        return model

    def _begin(self, made: _fdm.Model) -> None:
        self._m = made
        inputs, known, states, outputs = made.channels()
        self.inputs: list[Channel] = [Channel(*c) for c in inputs]
        """Inputs (m)."""
        self.known: list[Channel] = [Channel(*c) for c in known]
        """Values that each run brings (``known T0 per run;``)."""
        self.states: list[Channel] = [Channel(*c) for c in states]
        """States (n)."""
        self.outputs: list[Channel] = [Channel(*c) for c in outputs]
        """Outputs (q)."""
        self._names = [c.name for c in [*self.inputs, *self.known, *self.outputs]]
        self._kept: tuple[Any, Residuals] | None = None
        self._by_groups: dict[str, Model] = {}

    def _warn(self) -> None:
        found, text = self._m.warnings()
        if found:
            warnings.warn("\n" + text.rstrip(), ModelWarning, stacklevel=3)

    @property
    def name(self) -> str:
        """Its own name."""
        return self._m.name

    @property
    def doc(self) -> str:
        """Its doc string."""
        return self._m.doc

    @property
    def text(self) -> str:
        """The text that it was made from."""
        return self._m.text

    @property
    def file(self) -> str:
        """What messages call the text."""
        return self._m.file

    @property
    def time_unit(self) -> str:
        """Unit of time."""
        return self._m.time_unit

    @property
    def parameters(self) -> dict[str, Param]:
        """Parameters by name, in the model's order; free initial values are called ``x(0)``."""
        return {p["name"]: Param(**p) for p in self._m.parameters()}

    @property
    def groupings(self) -> list[str]:
        """Groupings that parameters are shared within (``param k per group aircraft;``); runs say their group by ``groups``."""
        return self._m.groupings()

    @property
    def warnings(self) -> list[Finding]:
        """Findings that did not stop the compilation."""
        return findings(self._m.warnings()[0])

    def changed(
        self,
        *,
        set: Mapping[str, float] | None = None,
        fix: str | Iterable[str] = (),
        free: str | Iterable[str] = (),
        untie: str | Iterable[str] = (),
    ) -> Model:
        """The same model with other start values, with parameters fixed and freed, and with ties switched off."""
        made = self._m.untied(listed(untie)) if listed(untie) else self._m
        values = [(name, float(value)) for name, value in (set or {}).items()]
        return Model._of(made.changed(values, listed(fix), listed(free)))

    # Work on runs

    def fit(
        self,
        runs: RunLike | Sequence[RunLike],
        *,
        validation: RunLike | Sequence[RunLike] = (),
        method: str | None = None,
        domain: str | None = None,
        optimizer: str | None = None,
        set: Mapping[str, float] | None = None,
        fix: str | Iterable[str] = (),
        free: str | Iterable[str] = (),
        untie: str | Iterable[str] = (),
        noise: str | Mapping[str, float] | None = None,
        loss: str | None = None,
        start_values: str | None = None,
        iterations: int | None = None,
        tolerance: float | None = None,
        gain: float | None = None,
        starts: int | None = None,
        seed: int | None = None,
        steps: int | None = None,
        integrator: str | None = None,
        band: tuple[float, float] | None = None,
        time_limit: float | str | None = None,
        progress: Any = None,
        **options: Any,
    ) -> Fit:
        """Estimates the parameters from one run or several, as ``fdm fit`` does.

        validation: runs that are not fitted but predicted.
        method: ``"output-error"`` (default), ``"filter-error"``, ``"equation-error"``, ``"frequency-response"``.
        domain: ``"time"`` or ``"frequency"``; optimizer: ``"gauss-newton"``, ``"nelder-mead"``, ``"lbfgs"``.
        set, fix, free, untie: other start values; parameters that are kept, freed, or estimated without their tie.
        noise: ``"diagonal"``, ``"full"``, or known standard deviations ``{"y": 0.1}`` in the outputs' units.
        loss: ``"squares"``, ``"huber"``, ``"student"``; starts, seed: multi-start.
        steps, integrator: equal integration steps between samples; ``"auto"``, ``"runge-kutta"``, ``"radau"``.
        band: ``(low, high)`` in cycles per unit of time, in the frequency domain.
        time_limit: seconds, or ``"5m"``. Then, and at Ctrl-C, the best so far is returned and warned of.
        progress: see `fdm.progress`.
        options: all others of ``fdm fit --help``; those of reading (``every=2``) are for the files among the runs: ``shooting=8``, ``substitute="all"``, ``continuation=[1, 2]``, ``confidence=True``,
            ``weights=True``, ``checkpoint="DIR"``, ``input_noise={"p": 0.002}``, ``segments=[20, 10]``, ``pair=("y", "u")``,
            ``coherence=0.6``, ``end_points="free"``, ``nonlinear="auto"``, ``df=0.01``, ``integration_accuracy=1e-8`` ...

        Raises `UnknownOption`, `OptionError` and `InputError` where the command would refuse, `RecordError` or `RunError` where runs
        cannot be used.
        """
        from ._fit import Fit

        given = dict(
            method=method, domain=domain, optimizer=optimizer, set=set, fix=fix, free=free, untie=untie, noise=noise, loss=loss,
            start_values=start_values, iterations=iterations, tolerance=tolerance, gain=gain, starts=starts, seed=seed, steps=steps,
            integrator=integrator, band=band, time_limit=time_limit,
        )  # fmt: skip
        of = Campaign.of(self, runs, validation, options=options)
        with telling(progress, f"fitting {self.name}") as tell:
            made = _fdm.fit(of.model._m, of.records, of.predicted, words({**given, **options}), tell)
        return Fit._of(made, of)

    def _grouped(self, groups: dict[str, list[str]]) -> Model:
        """The same for groups by grouping, with a parameter of each."""
        if not groups:
            return self
        key = repr(groups)
        if key not in self._by_groups:
            self._by_groups[key] = Model._of(self._m.grouped(groups))
        return self._by_groups[key]

    def simulate(
        self,
        run: RunLike,
        parameters: Mapping[str, float] | None = None,
        *,
        steps: int | None = None,
        integrator: str | None = None,
        **options: Any,
    ) -> Response:
        """Outputs (N by q) over the inputs of a run, as ``fdm simulate`` computes them.

        parameters: other values by name; the rest as the model declares it, free initial values as the run suggests.
        """
        of = Campaign.of(self, run, options=options, to_simulate=True, several=False)
        if len(of.records) != 1:
            raise ValueError(f"one run is simulated at a time, not {len(of.records)}")
        given = dict(set=parameters, steps=steps, integrator=integrator)
        [record] = of.records
        outputs, integration, faults = _fdm.simulate(of.model._m, record, words({**given, **options}))
        for fault in faults:
            warnings.warn(fault, ResultWarning, stacklevel=2)
        names, units = tuple(o.name for o in self.outputs), tuple(o.unit for o in self.outputs)
        return Response(record.time(), outputs, names, units, integration, tuple(faults))

    def prepare(
        self,
        runs: RunLike | Sequence[RunLike],
        *,
        set: Mapping[str, float] | None = None,
        fix: str | Iterable[str] = (),
        free: str | Iterable[str] = (),
        noise: Mapping[str, float] | None = None,
        steps: int | None = None,
        integrator: str | None = None,
    ) -> Residuals:
        """Residuals as a function of the parameters, ready to be evaluated many times.

        noise: standard deviation of each output in its unit, by which residuals are divided; as the model declares it, else 1.
        steps, integrator: as in `fit`; chosen at the start values when not given. A stiff model that is evaluated far from these wants
            ``integrator="radau"``.
        """
        of = Campaign.of(self, runs, several=False)
        model = of.model.changed(set=set, fix=fix, free=free) if set or listed(fix) or listed(free) else of.model
        unknown = [name for name in noise or {} if name not in [o.name for o in self.outputs]]
        if unknown:
            raise KeyError(f"there is no output `{unknown[0]}`; there are {', '.join(o.name for o in self.outputs)}")
        declared = zip(self.outputs, self._m.noise())
        deviations = [float((noise or {}).get(o.name, d if d is not None else 1.0)) for o, d in declared]
        bad = [f"the deviation of `{o.name}` is {d}, expected a number above 0" for o, d in zip(self.outputs, deviations) if not d > 0]
        if bad:
            raise ValueError("; ".join(bad))
        made = _fdm.Residuals(model._m, of.records, deviations, steps, integrator)
        return Residuals(made, model, deviations)

    def residuals(
        self, runs: RunLike | Sequence[RunLike], theta: ArrayLike | Mapping[Any, float] | None = None, **options: Any
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Residuals r (R), measured minus simulated over the noise's deviation, and their exact Jacobian J (R by U).

        theta: values of the U unknowns, or by name; the start values when not given. Unknowns are the shared parameters that are
            estimated, in the model's order, then those of every run (`Residuals.names`).
        options: those of `prepare`. What was prepared is kept for the next call with the same runs and options.
        """
        given = as_runs(runs)
        key = (tuple(id(r) for r in given), repr(sorted(options.items())))
        if self._kept is None or self._kept[0] != key:
            # the runs are kept too, so that no other one gets their numbers
            prepared = self.prepare(given, **options)
            prepared._runs = given
            self._kept = (key, prepared)
        return self._kept[1](theta)

    def diagnose(
        self,
        runs: RunLike | Sequence[RunLike],
        *,
        validation: RunLike | Sequence[RunLike] = (),
        only: str | Iterable[str] = (),
        without: str | Iterable[str] = (),
        effects: str | os.PathLike[str] | Iterable[str] = (),
        alpha: float | None = None,
        max_effects: int | None = None,
        domain: str | None = None,
        set: Mapping[str, float] | None = None,
        fix: str | Iterable[str] = (),
        free: str | Iterable[str] = (),
        time_limit: float | str | None = None,
        progress: Any = None,
        **options: Any,
    ) -> Diagnosis:
        """What the model gets wrong: lack of fit, its cause, the extended model and the gain, as ``fdm diagnose`` finds them.

        validation: runs that are not fitted; an effect must improve their prediction too.
        only, without: effects of the catalogue that are searched, or not; effects: files with effects of your own.
        alpha: family-wise probability of a false alarm (0.03); max_effects: most effects that are added (4).
        """
        from ._results import Diagnosis

        given = dict(
            only=only, without=without, effects=effects, alpha=alpha, max_effects=max_effects, domain=domain, set=set, fix=fix,
            free=free, time_limit=time_limit,
        )  # fmt: skip
        of = Campaign.of(self, runs, validation, options=options)
        with telling(progress, f"diagnosing {self.name}") as tell:
            made = _fdm.diagnose(of.model._m, of.records, of.predicted, words({**given, **options}), tell)
        return Diagnosis._of(of.model, *made)

    def doctor(
        self,
        runs: RunLike | Sequence[RunLike],
        *,
        alpha: float | None = None,
        odds: float | None = None,
        estimated: bool = True,
        **options: Any,
    ) -> Doctor:
        """Runs judged before they are believed, by themselves and beside this model, as ``fdm doctor``: faults with odds, biases and
        repairs.

        alpha: probability of a finding in a record without a fault (0.01). odds: those that a fault must have beside the model (20).
        estimated: whether delays, offsets, scale factors and drifts of clocks are estimated beside the model.
        """
        from ._results import Doctor

        of = Campaign.of(self, runs, options=options, to_simulate=True, several=False)
        given = dict(alpha=alpha, odds=odds, no_estimated=not estimated)
        return Doctor._of(_fdm.doctor(of.model._m, of.records, words({**given, **options})))

    def study(
        self, runs: RunLike | Sequence[RunLike], *, repeats: int | None = None, seed: int | None = None, progress: Any = None, **options: Any
    ) -> Study:
        """Monte Carlo study of the fit, as ``fdm study``: bias and scatter of the estimates, coverage of their intervals.

        repeats: how many (1000); noise_colour: ``"white"``, ``"fitted"``, ``"ar1"``, ``"pink"``.
        """
        from ._results import Study

        of = Campaign.of(self, runs, options=options)
        with telling(progress, f"study of {self.name}") as tell:
            asked = words({"repeats": repeats, "seed": seed, **options})
            made, columns = _fdm.study(of.model._m, of.records, asked, tell)
        return Study._of(made, columns)

    def calibrate(
        self, runs: RunLike | Sequence[RunLike], *, repeats: int | None = None, seed: int | None = None, progress: Any = None, **options: Any
    ) -> Calibration:
        """Simulation-based calibration of `Fit.sample` conditional on the runs, as ``fdm study --calibration``.

        repeats: how many (1000); warmup: transitions before the draws of each (300).
        """
        from ._results import Calibration

        of = Campaign.of(self, runs, options=options)
        with telling(progress, f"calibration of {self.name}") as tell:
            asked = words({"calibration": True, "repeats": repeats, "seed": seed, **options})
            return Calibration._of(_fdm.ask("study", of.model._m, of.records, asked, tell))

    def profile(
        self,
        runs: RunLike | Sequence[RunLike],
        parameter: str | Iterable[str] = (),
        *,
        progress: Any = None,
        **options: Any,
    ) -> Profiles:
        """Profile-likelihood intervals, as ``fdm profile``: of these parameters, or of all that are estimated and shared."""
        from ._results import Profiles

        of = Campaign.of(self, runs, options=options)
        with telling(progress, f"profiling {self.name}") as tell:
            asked = words({"parameter": parameter, **options})
            made = _fdm.ask("profile", of.model._m, of.records, asked, tell)
        return Profiles._of(made)

    def design(
        self,
        runs: RunLike | Sequence[RunLike] = (),
        *,
        amplitude: Mapping[str, float | str] | None = None,
        rest: Mapping[str, float | str] | None = None,
        duration: float | None = None,
        dt: float | None = None,
        noise: Mapping[str, float] | None = None,
        next_runs: int | None = None,
        progress: Any = None,
        **options: Any,
    ) -> Design:
        """Optimal input design, as ``fdm design``: the manoeuvres of the next runs that reduce the standard errors most.

        runs: earlier runs. amplitude, rest: largest amplitude of an input and its value at rest, in its unit or as ``"2 deg"``.
        duration, dt: length and sampling interval of the next run. next_runs: how many are planned (2).
        """
        given = dict(amplitude=amplitude, rest=rest, duration=duration, dt=dt, noise=noise, runs=next_runs)
        return self._design(runs, None, {**given, **options}, progress)

    def _design(self, runs: Any, result: Any, options: Mapping[str, Any], progress: Any) -> Design:
        from ._results import Design

        of = Campaign.of(self, runs, to_simulate=True, several=False, optional=True)
        with telling(progress, f"planning runs of {self.name}") as tell:
            made = _fdm.design(of.model._m, of.records, result, words(options), tell)
        return Design._of(made)

    def spectra(
        self,
        runs: RunLike | Sequence[RunLike],
        *,
        inputs: str | Iterable[str] = (),
        outputs: str | Iterable[str] = (),
        band: tuple[float, float] | None = None,
        segment: float | Iterable[float] = (),
        **options: Any,
    ) -> Spectra:
        """Frequency responses of the runs with coherence and random error, as ``fdm spectra`` estimates them.

        band: ``(low, high)`` in cycles per unit of time; segment: lengths of the averaged segments; overlap, df: as the command.
        """
        from ._results import Spectra

        given = dict(inputs=inputs, outputs=outputs, band=band, segment=segment)
        of = Campaign.of(self, runs, options=options, to_simulate=True, several=False)
        return Spectra._of(_fdm.spectra(of.model._m, of.records, words({**given, **options})))

    # Without runs

    def modes(self, parameters: Mapping[str, float] | None = None) -> Modes:
        """Eigenvalues, linear or linearised at the trim, with damping, frequency and dominant states, as ``fdm modes``."""
        from ._results import Modes

        return Modes._of(self.changed(set=parameters)._m.modes())

    def linear(self, parameters: Mapping[str, float] | None = None) -> Linear:
        """The linear model at its trim: matrices A (n by n), B (n by m), C (q by n), D (q by m)."""
        from ._results import Linear

        return Linear._of(self.changed(set=parameters))

    def check(self) -> Check:
        """Every derivative against a complex step, as ``fdm check``."""
        from ._results import Check

        return Check._of(self._m.check())

    def effects(self, **options: Any) -> Effects:
        """Candidate effects and where each fits, as ``fdm effects``; ``only=``, ``without=``, ``effects=FILE``."""
        from ._results import Effects

        return Effects._of(self._m.effects(words(options)))

    def extend(self, effect: str | Iterable[str], **options: Any) -> Model:
        """The model with effects written into its text, such as ``"input_delay(stick)"``, as ``fdm extend``.

        step, duration: sampling interval and length of the records, from which start values and bounds of lags and delays follow.
        """
        text, _ = self._m.extend(words({"effect": effect, **options}))
        return Model.from_text(text, self.file)

    # As any object

    def __repr__(self) -> str:
        sizes = f"{len(self.inputs)} inputs, {len(self.states)} states, {len(self.outputs)} outputs"
        return f"Model({self.name!r}, {sizes}, {len(self.parameters)} parameters)"

    def _repr_html_(self) -> str:
        from ._figures import table

        rows = [
            [p.name, f"{p.value:g}", p.unit or "", "fixed" if p.fixed else "per run" if p.per_run else "", p.doc]
            for p in self.parameters.values()
        ]
        return table(f"{self.name}: {self.doc}" if self.doc else self.name, ["parameter", "start", "unit", "", "meaning"], rows)

    def __reduce__(self) -> Any:
        return _again, (self._m.state(),)


def _again(state: Any) -> Model:
    return Model._of(_fdm.Model.from_state(state))


class Residuals:
    """Residuals as a function of the parameters.

    ::

        residuals = m.prepare([run])
        r, J = residuals(residuals.start)
        scipy.optimize.least_squares(residuals.r, residuals.start, jac=residuals.J, bounds=residuals.bounds)

    r (R) is measured minus simulated over the standard deviation of the output's noise, of every number that was measured: runs, in
    these samples, in these outputs. J (R by U) is its exact derivative. Integration steps are chosen at the start values and kept.
    Safe to be called from several threads.
    """

    def __init__(self, made: _fdm.Residuals, model: Model, deviations: Sequence[float]):
        self._made, self.model = made, model
        self.names: list[str | tuple[str, str]] = [name if run is None else (name, run) for name, run, _ in made.names]
        """Unknowns (U): names of shared parameters, and pairs of name and run."""
        self.units: list[str | None] = [unit for _, _, unit in made.names]
        self.start: NDArray[np.float64] = made.start
        """Start values (U)."""
        self.bounds: tuple[NDArray[np.float64], NDArray[np.float64]] = tuple(made.bounds)  # type: ignore[assignment]
        """Least and greatest values (U each), infinite where there are none."""
        self.priors: list[tuple[float, float] | None] = made.priors
        """Mean and deviation of what is known of each unknown (U) beforehand."""
        self.deviations = np.asarray(deviations)
        """Standard deviation of each output (q) by which residuals were divided."""
        self.outputs: NDArray[np.uintp] = made.outputs
        """The output that each residual (R) belongs to, by its number."""
        self.counts = np.bincount(made.outputs.astype(int), minlength=len(self.deviations))
        """Measured numbers of each output (q)."""
        self._runs: Any = None

    def __len__(self) -> int:
        return len(self._made)

    def values(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> NDArray[np.float64]:
        """Unknowns (U) from an array, from names, or the start values. Names that are missing keep their start value."""
        if theta is None:
            return self.start
        if isinstance(theta, Mapping):
            unknown = [name for name in theta if name not in self.names]
            if unknown:
                raise KeyError(f"`{unknown[0]}` is not estimated; unknowns are {', '.join(map(str, self.names))}")
            return np.array([theta.get(n, s) for n, s in zip(self.names, self.start)], dtype=float)
        return np.ascontiguousarray(theta, dtype=np.float64)

    def __call__(
        self, theta: ArrayLike | Mapping[Any, float] | None = None, out: tuple[Any, Any] | None = None
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """r (R) and J (R by U), written into the arrays `out` where these are given.

        Raises `NumericalError` where the simulation is not finite.
        """
        return self._made.jacobian(self.values(theta), out)

    def r(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> NDArray[np.float64]:
        """Residuals (R) alone."""
        return self._made.residuals(self.values(theta))

    def J(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> NDArray[np.float64]:
        """Jacobian (R by U) alone."""
        return self(theta)[1]

    def log_likelihood(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> float:
        """Logarithm of the likelihood for noise of these deviations, with its constant, without priors."""
        r = self.r(theta)
        return float(-0.5 * (r @ r) - self.log_constant)

    def log_prior(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> float:
        """Logarithm of the priors that the model declares; minus infinity outside the bounds."""
        values = self.values(theta)
        if np.any(values < self.bounds[0]) or np.any(values > self.bounds[1]):
            return -np.inf
        known = [((v - p[0]) / p[1], p[1]) for v, p in zip(values, self.priors) if p is not None]
        return float(sum(-0.5 * z * z - np.log(d) - 0.5 * np.log(2 * np.pi) for z, d in known))

    @property
    def log_constant(self) -> float:
        """What of minus the log-likelihood does not depend on the parameters."""
        return float(self.counts @ np.log(self.deviations) + 0.5 * len(self) * np.log(2 * np.pi))

    def gradient(self, theta: ArrayLike | Mapping[Any, float] | None = None) -> tuple[float, NDArray[np.float64]]:
        """Log-likelihood and its gradient (U)."""
        r, J = self(theta)
        return float(-0.5 * (r @ r) - self.log_constant), -(r @ J)

    def squares(self, r: NDArray[np.float64]) -> NDArray[np.float64]:
        """Sums of squares of the residuals of each output (q)."""
        sums = np.bincount(self.outputs.astype(int), weights=r * r, minlength=len(self.deviations))
        return np.asarray(sums, dtype=np.float64)

    def __reduce__(self) -> Any:
        raise TypeError("residuals hold compiled code: prepare them anew in the other process")


__all__ = ["Channel", "Model", "NumericalError", "Param", "Residuals", "Response", "Run"]
