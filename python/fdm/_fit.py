"""Fits: estimates with their errors, histories, predictions, tables, pages and folders."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from . import _fdm, _figures
from ._documents import Document, columns, frame
from ._errors import InputError, InterruptedWarning, ResultWarning
from ._model import Model, Residuals, Response
from ._options import listed, words
from ._progress import telling
from ._run import Campaign, Run, RunLike, as_runs

if TYPE_CHECKING:
    from ._results import Design, Draws, Linear, Margins, Modes


@dataclass(frozen=True)
class Parameter:
    """A parameter as it was found."""

    name: str
    run: str | None
    """The run that it belongs to; none where all runs share it."""
    value: float
    unit: str | None
    std_error: float | None
    """Standard error by Cramer and Rao, in its unit; none where it has none."""
    corrected: float | None
    """Standard error corrected for the colour of the residuals."""
    status: str
    """``"estimated"``, ``"fixed"``, ``"at_bound"``, ``"not_determined"``, ``"derived"`` ..."""
    interval: tuple[float, float] | None
    """95 % interval, also where residuals are coloured."""
    start: float | None
    lower: float | None
    upper: float | None

    @property
    def error(self) -> float | None:
        """The standard error to be trusted: the corrected one where there is one."""
        return self.corrected if self.corrected is not None else self.std_error

    @property
    def key(self) -> str | tuple[str, str]:
        """Its key in `Params`: the name, and the run where runs have their own."""
        return self.name if self.run is None else (self.name, self.run)

    def __float__(self) -> float:
        return self.value


class Params(Mapping[Any, Parameter]):
    """Parameters by name; those of single runs by ``(name, run)``, or by name alone where there is one run."""

    def __init__(self, parameters: Sequence[Parameter]):
        self._by_key = {p.key: p for p in parameters}

    def __getitem__(self, key: str | tuple[str, str]) -> Parameter:
        if key in self._by_key:
            return self._by_key[key]
        own = [p for p in self._by_key.values() if p.name == key]
        if len(own) == 1:
            return own[0]
        if own:
            raise KeyError(f"every run has its own `{key}`: give a pair, such as {own[0].key}")
        raise KeyError(f"there is no parameter `{key}`; there are {', '.join(map(str, self._by_key))}")

    def __iter__(self) -> Iterator[Any]:
        return iter(self._by_key)

    def __len__(self) -> int:
        return len(self._by_key)

    def __repr__(self) -> str:
        def one(p: Parameter) -> str:
            error = "" if p.error is None else f" +- {p.error:.2g}"
            return f"{p.key}: {p.value:.6g}{error}{f' {p.unit}' if p.unit else ''}"

        return "\n".join(one(p) for p in self.values())


@dataclass(frozen=True)
class History:
    """Measurement and response of a run, in the model's units. N samples, q outputs."""

    run: str
    time: NDArray[np.float64]
    """Times (N), from 0."""
    measured: NDArray[np.float64]
    """Measured outputs (N by q); NaN where nothing is compared."""
    response: NDArray[np.float64]
    """The model's outputs (N by q)."""
    residuals: NDArray[np.float64]
    """Measured minus model (N by q)."""


@dataclass(frozen=True)
class Prediction:
    """Runs that were not fitted: shared parameters are held, biases and initial states estimated anew, as `fdm validate` does."""

    document: Document
    """As ``fdm validate --json`` prints it."""
    text: str
    histories: list[History]
    bands: list[NDArray[np.float64]]
    """Standard deviation of the response by the errors of the shared parameters (N by q), run by run."""
    noise: NDArray[np.float64]
    """Standard deviation of the measurement noise of the fit (q); NaN where the fit estimated none."""
    model: Model

    @property
    def measurement_bands(self) -> list[NDArray[np.float64]]:
        """Standard deviation of a new measurement (N by q), run by run: by the errors of the shared parameters and by the noise."""
        return [np.hypot(band, self.noise) for band in self.bands]

    @property
    def outputs(self) -> list[Document]:
        """Quality of each output of each run: ``rms``, ``r2``, ``tic``, ``whiteness`` ..."""
        return self.document.outputs

    def plot(self, *, noise: bool = False, **options: Any) -> Any:
        """Time histories with bands and residuals, as matplotlib axes (2 q by runs). With `noise` the bands are those of measurements."""
        bands = self.measurement_bands if noise else self.bands
        return _figures.histories(self.model, self.histories, bands, **options)

    def __str__(self) -> str:
        return self.text


class Fit:
    """A fit, or equation-error estimates: everything that the command prints and writes of it.

    `Model.fit` makes one, `Fit.load` reads one that was saved by `save` or by ``fdm fit --out``.
    """

    model: Model
    """The model with the changes that were asked for."""
    document: Document
    """As ``fdm fit --json`` prints it, and as it stands in ``result.json``."""
    params: Params
    """The estimates: ``fit.params["Mq"].value``, ``.std_error``, ``.corrected``, ``.interval``, ``.unit``."""
    interrupted: bool
    """Stopped by Ctrl-C or by the progress function: the values are the best so far."""
    validation: Prediction | None
    """The prediction of the validation runs; none where none were given, and in the frequency domain: `document.validation_runs` has its quality."""

    # the fit of this process, or none of one that was read
    _made: _fdm.Fit | None
    _files: list[tuple[str, bytes]] | None
    _runs: list[Run]
    _text: str
    _remarks: list[str]

    def __init__(self, *_: Any) -> None:
        raise TypeError("fits are made by Model.fit and by fdm.load")

    @classmethod
    def _of(cls, made: _fdm.Fit, of: Campaign) -> Fit:
        fit = cls.__new__(cls)
        fit._made, fit._files = made, None
        fit.model, fit.interrupted, fit._runs = Model._of(made.model), made.interrupted, of.runs
        text, remarks = made.text()
        fit._text, fit._remarks = text, remarks
        fit._begin()
        if fit.interrupted:
            warnings.warn("stopped: the result is the best so far", InterruptedWarning, stacklevel=3)
        for remark in remarks:
            if not remark.startswith("note:") and not fit.interrupted:
                warnings.warn(remark, ResultWarning, stacklevel=3)
        fit.validation = None
        in_frequency = "frequency_domain" in fit.document or "frequency_responses" in fit.document
        if of.validation and not in_frequency and not fit.interrupted and fit.converged:
            fit.validation = fit.predict(of.validation, progress=False)
        return fit

    @classmethod
    def load(cls, folder: str | os.PathLike[str]) -> Fit:
        """The result of a folder that `save` or ``fdm fit --out`` wrote; every file is checked against its fingerprint."""
        return cls._loaded(_fdm.open(os.fspath(folder)))

    @classmethod
    def _loaded(cls, files: list[tuple[str, bytes]]) -> Fit:
        fit = cls.__new__(cls)
        fit._made, fit._files = None, files
        texts = dict(files)
        if "result.json" not in texts:
            raise InputError(["this is no result of a fit"])
        fit._text, fit._remarks = texts.get("result.txt", b"").decode(), []
        fit.interrupted, fit.validation, fit._runs = False, None, []
        declared = Model._of(_fdm.Model.from_files(files))
        fit.model = declared
        fit._begin()
        kept = {p.name for p in fit.params.values() if p.status == "fixed"}
        free = {p.name for p in fit.params.values() if p.status in ("estimated", "at_bound", "not_determined")}
        own = declared.parameters
        fix = [n for n in own if n in kept and not own[n].fixed]
        fit.model = declared.changed(fix=fix, free=[n for n in own if n in free and own[n].fixed])
        return fit

    def _begin(self) -> None:
        files = dict(self.files)
        keys = json.loads(files["result.json"])
        self.document = Document(keys)
        intervals = _fdm.intervals(self.files)
        self.params = Params([_parameter(p, i) for p, i in zip(keys["parameters"], intervals)])

    @property
    def files(self) -> list[tuple[str, bytes]]:
        """Names and contents of the files that ``fdm fit --out`` writes: ``result.json``, ``manifest.json``, tables, pictures."""
        if self._files is None:
            self._files = self._made.files() if self._made is not None else []
        return self._files

    # What was found

    @property
    def good(self) -> bool:
        """Converged, every parameter determined, and no integration error that falsifies that: exit code 0 of the command."""
        if self._made is not None:
            return self._made.good
        return self.converged and not self.document.get("undetermined")

    @property
    def converged(self) -> bool:
        """Whether the iteration ended at a minimum; equation error has none, and is always there."""
        return self.document.get("termination", "converged") == "converged"

    @property
    def message(self) -> str:
        """How the iteration ended, in a sentence."""
        return self.document.get("message", "")

    @property
    def cost(self) -> float | None:
        """Minus the logarithm of the likelihood, without its constant."""
        return self.document.get("cost")

    @property
    def log_likelihood(self) -> float | None:
        """Logarithm of the likelihood with its constant, without priors."""
        return self.document.get("log_likelihood")

    @property
    def iterations(self) -> int:
        """Gauss-Newton iterations."""
        return self.document.get("iterations", 0)

    @property
    def remarks(self) -> list[str]:
        """What should not be overlooked, one sentence each."""
        return [r.sentence for r in self.document.get("remarks", [])] + [r for r in self._remarks]

    @property
    def names(self) -> list[Any]:
        """Keys of the parameters (U) that `cov` and `correlations` are about."""
        keys = list(self.params)
        return [keys[k] for k in self._matrix("covariance")["parameters"]]

    def _matrix(self, name: str) -> dict[str, Any]:
        return self.document._keys.get(name) or {"parameters": [], "values": []}

    @property
    def cov(self) -> NDArray[np.float64]:
        """Covariance of the estimates (U by U), corrected for the colour of the residuals where that was done."""
        corrected = self.cov_corrected
        return corrected if corrected.size else self.cov_cramer_rao

    @property
    def cov_cramer_rao(self) -> NDArray[np.float64]:
        """Covariance of the estimates (U by U): the bound of Cramer and Rao."""
        return _square(self._matrix("covariance")["values"])

    @property
    def cov_corrected(self) -> NDArray[np.float64]:
        """Covariance corrected for the colour of the residuals (U by U); 0 by 0 where that was not done."""
        return _square(self._matrix("corrected_covariance")["values"])

    @property
    def correlations(self) -> NDArray[np.float64]:
        """Correlations of the estimates (U by U)."""
        return _square(self._matrix("correlations")["values"])

    @property
    def noise_cov(self) -> NDArray[np.float64] | None:
        """Covariance of the measurement noise (q by q), as given or estimated."""
        values = self.document.get("noise_covariance")
        return None if values is None else _square(values)

    @property
    def outputs(self) -> list[Document]:
        """Quality of each output of each run: ``rms``, ``r2``, ``tic``, ``whiteness`` ..."""
        return self.document.get("outputs", [])

    @property
    def histories(self) -> list[History]:
        """Measurement, response and residuals of every run (N by q each); empty without simulation."""
        if self._made is not None:
            return [History(**h) for h in self._made.histories()]
        return _from_tables(self.files, [o.name for o in self.model.outputs])

    @property
    def residuals(self) -> dict[str, NDArray[np.float64]]:
        """Measured minus model (N by q), by run."""
        return {h.run: h.residuals for h in self.histories}

    @property
    def runs(self) -> list[str]:
        """Names of the runs that were fitted."""
        return [d["run"] for d in json.loads(dict(self.files)["manifest.json"])["data"]]

    @property
    def modes(self) -> Document | None:
        """Modes of the model as it was found, with standard errors; none where it has no states."""
        return self.document.get("modes")

    # What follows from it

    def values(self, run: str | None = None) -> dict[str, float]:
        """Values of all parameters of the model by name; those of single runs are of `run`, or of the first."""
        run = run if run is not None else next(iter(self.runs), None)
        if run is not None and run not in self.runs:
            raise KeyError(f"there is no run `{run}`; there are {', '.join(self.runs)}")
        own = self.model.parameters
        return {p.name: p.value for p in self.params.values() if p.name in own and p.run in (None, run)}

    def found(self, run: str | None = None) -> Model:
        """The model with the estimates as its start values."""
        return self.model.changed(set=self.values(run))

    def linear(self, run: str | None = None) -> Linear:
        """The linear model at the estimates: matrices A, B, C, D; ``.to_control()``."""
        return self.found(run).linear()

    def simulate(self, run: RunLike, like: str | None = None, **options: Any) -> Response:
        """Outputs (N by q) over the inputs of a run at the estimates; those of single runs are of the run `like`, or of the first."""
        return self.model.simulate(run, self.values(like), **options)

    def margins(self, requirement: str | Sequence[str] | None = None, **options: Any) -> Margins:
        """Modes and requirements with intervals and probabilities, as ``fdm margins``; `requirement` adds to those of the model's text:
        ``"settled = at(y, 10, step(u, 1)) in [0.9, 1.1]"``."""
        from ._results import Margins

        return Margins._of(_fdm.margins(self.files, words({"requirement": listed(requirement), **options})))

    def sample(self, *, chains: int | None = None, draws: int | None = None, seed: int | None = None, progress: Any = None, **options: Any) -> Draws:
        """Draws from the posterior by the No-U-Turn sampler, as ``fdm sample``: of parameters, noise and derived quantities.

        chains: how many (4); draws: of each chain (1000); warmup, target, max_depth: of the sampler; bands: predictive bands of every run; white:
        residuals taken for white, where they are coloured and draws are as wide as the corrected errors otherwise.
        """
        from ._results import Draws

        # a result that was read knows its files; one of runs in memory needs them
        if self._made is not None:
            records = self._made.records()
        else:
            records = Campaign.of(self.model, self._runs).records if self._runs else []
        asked = words({"chains": chains, "draws": draws, "seed": seed, **options})
        with telling(progress, f"sampling {self.model.name}") as tell:
            return Draws._of(_fdm.sample(self.files, records, asked, tell))

    def predict(self, runs: RunLike | Sequence[RunLike], *, progress: Any = None) -> Prediction:
        """What the result predicts of runs that it was not fitted to, as ``fdm validate``: shared parameters are held, biases and initial
        states estimated anew. Bands are by the errors of the shared parameters."""
        every = [o.name for o in self.model.outputs]
        of = Campaign.of(self.model, runs, elsewhere=every, optional=True)
        # a table says which runs are predicted
        records = of.predicted or of.records
        if not records:
            raise InputError(["no run was given"])
        with telling(progress, f"predicting {self.model.name}") as tell:
            text, printed, histories = _fdm.validate(self.files, self.model._m, records, tell)
        keys = json.loads(text)
        found = Params([_parameter(p, None) for p in keys["parameters"]])
        bands = [self._band(r, h["run"], found) for r, h in zip(records, histories)]
        return Prediction(Document(keys), printed, [History(**h) for h in histories], bands, self.noise, self.model)

    @property
    def noise(self) -> NDArray[np.float64]:
        """Standard deviation of the measurement noise of each output (q), as given or estimated; NaN where there is none."""
        cov = self.noise_cov
        return np.full(len(self.model.outputs), np.nan) if cov is None else np.sqrt(np.diag(cov))

    def bands(self, *, noise: bool = False) -> list[NDArray[np.float64]]:
        """Standard deviation of the response by the errors of the estimates (N by q), run by run; empty without histories. With `noise`
        that of a new measurement."""
        found = self._bands()
        return [np.hypot(band, self.noise) for band in found] if noise else found

    def _bands(self) -> list[NDArray[np.float64]]:
        if self._made is None:
            records = Campaign.of(self.model, self._runs).records if self._runs else []
        else:
            records = self._made.records()
        return [self._band(r, r.name, self.params) for r in records] if self.histories else []

    def _band(self, record: _fdm.Record, run: str, params: Params) -> NDArray[np.float64]:
        """Deviation of the response at the estimates, of every sample."""
        q = len(self.model.outputs)
        names, cov = self.names, self.cov
        if not cov.size:
            return np.zeros((len(record), q))
        own = self.model.parameters
        # where a run has its own values, they are those that were found for it
        at = {p.name: p.value for p in params.values() if p.name in own and p.run in (None, run)}
        model = self.model.changed(set={**at, **{n: p.value for n, p in self.params.items() if n in own}})
        residuals = Residuals(_fdm.Residuals(model._m, [record.compared()], [1.0] * q), model, [1.0] * q)
        _, J = residuals()
        both = [(k, names.index(n)) for k, n in enumerate(residuals.names) if n in names]
        if not both:
            return np.zeros((len(record), q))
        mine, theirs = (list(c) for c in zip(*both))
        J, cov = J[:, mine], cov[np.ix_(theirs, theirs)]
        return np.sqrt(np.maximum(np.einsum("ij,ij->i", J @ cov, J), 0.0)).reshape(-1, q)

    def design(self, runs: RunLike | Sequence[RunLike] = (), *, next_runs: int | None = None, progress: Any = None, **options: Any) -> Design:
        """Optimal input design from this result, as ``fdm design --from-result``; see `Model.design`."""
        return self.model._design(runs, self.files, {"runs": next_runs, **options}, progress)

    def extend(self, effect: str | Sequence[str], **options: Any) -> Model:
        """The model's text with effects in it; see `Model.extend`."""
        return self.model.extend(effect, **options)

    # What is shown and kept

    def table(self, kind: str = "text") -> Any:
        """The estimates as ``"text"``, as ``"pandas"`` or ``"polars"`` frame, or as ``"dict"`` of columns."""
        if kind == "text":
            return self._text
        fields = ["name", "run", "value", "std_error", "corrected", "unit", "status"]
        rows = list(self.params.values())
        cells: dict[str, list[Any]] = {f: [getattr(p, f) for p in rows] for f in fields}
        cells["low"] = [p.interval[0] if p.interval else None for p in rows]
        cells["high"] = [p.interval[1] if p.interval else None for p in rows]
        return frame(cells, kind)

    def report(self, file: str | os.PathLike[str] | None = None) -> str:
        """The page with equations, tables and figures, as ``fdm report`` makes it; written to a file where one is given."""
        page = _fdm.page_of(self.files)
        if file is not None:
            Path(file).write_text(page, encoding="utf-8")
        return page

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Writes the folder that ``fdm fit --out`` writes: all of it or nothing. `force` replaces files that fdm did not write."""
        _fdm.write(os.fspath(folder), self.files, force)

    def plot(self, *, runs: Sequence[str] | None = None, outputs: Sequence[str] | None = None, bands: bool = True, axes: Any = None) -> Any:
        """Time histories: measurement and response with its 95 % band, and the residual below.

        Returns matplotlib axes (2 q by runs), rows of response and residual for each output.
        """
        return _figures.histories(self.model, self.histories, self.bands() if bands else None, runs=runs, outputs=outputs, axes=axes)

    def plot_residuals(self, *, axes: Any = None) -> Any:
        """Autocorrelation, spectrum and distribution of the residual of each output of each run, as matplotlib axes (outputs by 3)."""
        return _figures.residuals(self.outputs, axes=axes)

    def plot_bode(self, runs: RunLike | Sequence[RunLike] = (), *, axes: Any = None, **options: Any) -> Any:
        """Magnitude and phase of the linear model at the estimates, and those of the runs where some are given, or of the fit where it
        was one of frequency responses, as matplotlib axes (2 by pairs). Options are those of `Model.spectra`."""
        return _figures.bode(self, as_runs(runs), axes=axes, **options)

    def figures(self, *, dark: bool = False) -> dict[str, str]:
        """The page's own figures as SVG, by name."""
        return {name: svg for name, _, svg in _fdm.figures_of(self.files, dark)}

    def __str__(self) -> str:
        return "\n".join([self._text, *self._remarks])

    def __repr__(self) -> str:
        return f"Fit({self.model.name!r}, {self.message or 'equation error'})\n{self.params!r}"

    def _repr_html_(self) -> str:
        return _figures.result(self)

    def __reduce__(self) -> Any:
        return Fit._loaded, (self.files,)


def _square(values: Sequence[Sequence[float]]) -> NDArray[np.float64]:
    matrix = np.array(values, dtype=float)
    return matrix if matrix.size else np.empty((0, 0))


def _parameter(p: Mapping[str, Any], interval: tuple[float, float] | None) -> Parameter:
    return Parameter(
        name=p["name"], run=p["run"], value=float("nan") if p["value"] is None else p["value"], unit=p.get("unit"),
        std_error=p.get("standard_error"), corrected=p.get("corrected_error"), status=p["status"],
        interval=None if interval is None else (interval[0], interval[1]), start=p.get("start"), lower=p.get("lower"),
        upper=p.get("upper"),
    )  # fmt: skip


def _from_tables(files: Sequence[tuple[str, bytes]], outputs: Sequence[str]) -> list[History]:
    """Histories of a folder, from its tables."""
    manifest = json.loads(dict(files)["manifest.json"])
    names = [d["run"] for d in manifest["data"]]
    tables = {int(n.split("_")[1]): content for n, content in files if n.startswith("run_") and n.endswith(".csv")}
    found = []
    for k, content in sorted(tables.items()):
        by = {name.rsplit(" [", 1)[0]: values for name, values in columns(content)}
        stack = [np.column_stack([by[o + suffix] for o in outputs]) for suffix in ("", "_model", "_residual")]
        found.append(History(names[k - 1], by["t"], *stack))
    return found


load = Fit.load
