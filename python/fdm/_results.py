"""Diagnoses, studies, profiles, designs, spectra, modes and linear models."""

from __future__ import annotations

import json
import os
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _fdm, _figures
from ._documents import Document, columns, frame, wrapped
from ._errors import InputError, InterruptedWarning
from ._model import Model
from ._options import words
from ._run import TIMES, Run, RunLike, RunTable, as_runs

A = TypeVar("A", bound="Answer")


class Answer:
    """What a command prints: `text` for people, `document` for programs (``--json``), `good` where it would end with 0."""

    text: str
    document: Any
    good: bool
    interrupted: bool

    @classmethod
    def _of(cls: type[A], made: _fdm.Answer) -> A:
        answer = cls.__new__(cls)
        answer.text, answer.document, answer.good = made.text, wrapped(json.loads(made.json)), made.good
        answer.interrupted, answer._files = made.interrupted, made.files
        if made.interrupted:
            warnings.warn("stopped: the result is the best so far", InterruptedWarning, stacklevel=4)
        return answer

    _files: list[tuple[str, bytes]]

    def __getattr__(self, key: str) -> Any:
        if key.startswith("_") or not isinstance(self.__dict__.get("document"), Document):
            raise AttributeError(key)
        return getattr(self.document, key)

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"{type(self).__name__}:\n{self.text}"


class Diagnosis(Answer):
    """What a model gets wrong. Keys of ``fdm diagnose --json`` are attributes: `causes`, `lack_of_fit`, `verdict`, `outputs` ..."""

    model: Model
    extended: Model | None
    """The model with the accepted effects in its text; none where no effect was accepted."""
    overlays: list[dict[str, Any]]
    """Of every run ``run``, ``time`` (N), and ``measured``, ``before``, ``after`` (N by q)."""

    @classmethod
    def _of(cls, model: Model, made: _fdm.Answer, extended: str | None, overlays: list[dict[str, Any]]) -> Diagnosis:  # type: ignore[override]
        found = super()._of(made)
        found.model, found.overlays = model, overlays
        found.extended = None if extended is None else Model.from_text(extended, model.file)
        return found

    @property
    def causes(self) -> list[Document]:
        """Accepted effects: ``effect``, ``targets``, ``parameters``, ``loss`` (nats), ``probability``, ``group``."""
        return self.document.causes

    def plot(self, *, axes: Any = None) -> Any:
        """Measurement, and the responses before and after, of every output (q by runs), as matplotlib axes."""
        return _figures.overlays(self.model, self.overlays, axes=axes)

    def figures(self, *, dark: bool = False) -> dict[str, str]:
        """The page's own figures as SVG, by name."""
        return {name: svg for name, _, svg in _fdm.figures_of(self._files, dark)}

    def report(self, file: str | os.PathLike[str] | None = None) -> str:
        """The page of the diagnosis; written to a file where one is given."""
        page = _fdm.page_of(self._files)
        if file is not None:
            Path(file).write_text(page, encoding="utf-8")
        return page

    def save(self, folder: str | os.PathLike[str], *, force: bool = False) -> None:
        """Writes the folder that ``fdm diagnose --out`` writes."""
        _fdm.write(os.fspath(folder), self._files, force)

    def _repr_html_(self) -> str:
        return _figures.with_figures(self.text, self._files)


class Study(Answer):
    """A Monte Carlo study. Keys of its document are attributes: `parameters` and `requirements` (bias, scatter, coverage), `converged`,
    `pooled` ...
    """

    repeats: dict[str, NDArray[np.float64]]
    """Estimates and errors of every repeat, by column."""

    @classmethod
    def _of(cls, made: _fdm.Answer, columns: Sequence[tuple[str, NDArray[np.float64]]]) -> Study:  # type: ignore[override]
        found = super()._of(made)
        found.repeats = dict(columns)
        return found

    def table(self, kind: str = "pandas") -> Any:
        """The repeats as ``"pandas"`` or ``"polars"`` frame, or as ``"dict"``."""
        return frame(self.repeats, kind)


class Draws(Answer):
    """Draws from a posterior. Keys of ``fdm sample --json`` are attributes: `parameters` (mean, deviation, interval, R-hat, effective
    sizes), `chains`, `bands`, `remarks`. ``draws["k"]`` are those of a parameter (chains by draws); of a single run ``draws["k", "run"]``."""

    arviz: dict[str, dict[str, Any]]
    """Groups as ArviZ names them, of variables (chains by draws): ``az.from_dict(draws.arviz)``, or with ArviZ before 1.0
    ``az.from_dict(**draws.arviz)``."""

    @classmethod
    def _of(cls, made: _fdm.Answer) -> Draws:
        found = super()._of(made)
        groups = json.loads(dict(made.files)["draws.json"])
        found.arviz = {group: {name: np.array(v, dtype=float) for name, v in variables.items()} for group, variables in groups.items()}
        found.arviz["sample_stats"]["diverging"] = found.arviz["sample_stats"]["diverging"] > 0
        return found

    def __getitem__(self, name: str | tuple[str, str]) -> NDArray[np.float64]:
        key = name if isinstance(name, str) else f"{name[0]}[{name[1]}]"
        if key not in self.arviz["posterior"]:
            raise KeyError(f"there is no `{key}`; there are {', '.join(self.arviz['posterior'])}")
        return self.arviz["posterior"][key]

    def table(self, kind: str = "pandas") -> Any:
        """One row for each draw, with ``chain`` and ``draw``."""
        posterior = self.arviz["posterior"]
        chains, draws = next(iter(posterior.values())).shape
        numbers = {"chain": np.repeat(np.arange(chains), draws), "draw": np.tile(np.arange(draws), chains)}
        return frame({**numbers, **{name: v.ravel() for name, v in posterior.items()}}, kind)

    def save(self, file: str | os.PathLike[str]) -> None:
        """Writes the draws as ``--arviz`` does, for ``az.from_json``."""
        Path(file).write_bytes(dict(self._files)["draws.json"])

    def report(self, file: str | os.PathLike[str]) -> None:
        """Writes one page for a browser, as ``--report``: parameters, traces, ranks, predictive bands where `bands` was given."""
        Path(file).write_bytes(dict(self._files)["page.html"])

    def plot(self, *, axes: Any = None) -> Any:
        """Traces and histograms of every parameter, as matplotlib axes (parameters by 2)."""
        return _figures.draws(self.arviz["posterior"], axes=axes)


class Calibration(Answer):
    """Ranks of the truth among draws. Keys of its document are attributes: `parameters` (``counts``, ``shift``, ``spread``, ``p``), `p`."""

    def report(self, file: str | os.PathLike[str]) -> None:
        """Writes one page for a browser, as ``--report``."""
        Path(file).write_bytes(dict(self._files)["page.html"])


class Profiles(Answer):
    """Profile-likelihood intervals; ``profiles["k"]`` is that of a parameter."""

    def __getitem__(self, name: str) -> Document:
        """Of a parameter: ``by_error`` (interval by its standard error), ``ends``, ``points`` (value, rise of the cost)."""
        found = [p for p in self.document if p.name == name]
        if not found:
            raise KeyError(f"`{name}` was not profiled; these were: {', '.join(p.name for p in self.document)}")
        return found[0]

    @property
    def intervals(self) -> dict[str, tuple[float | None, float | None]]:
        """95 % intervals by parameter; none where the profile has no end on that side."""
        return {p.name: (p.ends[0].get("at"), p.ends[1].get("at")) for p in self.document}

    def plot(self, *, axes: Any = None) -> Any:
        """Rise of the cost over each parameter, as matplotlib axes."""
        return _figures.profiles(self.document, axes=axes)


class Design(Answer):
    """The manoeuvres of the next runs; keys of ``fdm design --json`` are attributes: `steps` ..."""

    @property
    def runs(self) -> list[Run]:
        """The planned runs: their times and inputs, ready for `Model.simulate`."""
        tables = ((name, columns(content)) for name, content in self._files)
        return [Run(dict(table), name=Path(name).stem) for name, table in tables]

    def save(self, folder: str | os.PathLike[str]) -> None:
        """Writes the inputs of the planned runs as CSV."""
        Path(folder).mkdir(parents=True, exist_ok=True)
        for name, content in self._files:
            (Path(folder) / name).write_bytes(content)


class Spectra(Answer):
    """Frequency responses of runs. `frequency` (M) is in cycles per unit of time."""

    @property
    def frequency(self) -> NDArray[np.float64]:
        """Frequencies (M), in cycles per unit of time."""
        return np.array(self.document["frequency"], dtype=float)

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Output and input of each response."""
        return [(r.output, r.input) for r in self.document.responses]

    def _pair(self, output: str, input: str) -> Document:
        found = [r for r in self.document.responses if (r.output, r.input) == (output, input)]
        if not found:
            raise KeyError(f"there is no response of `{output}` to `{input}`; pairs are {self.pairs}")
        return found[0]

    def response(self, output: str, input: str) -> NDArray[np.complex128]:
        """Complex response (M) of an output to an input."""
        pair = self._pair(output, input)
        return _numbers(pair["re"]) + 1j * _numbers(pair["im"])

    def coherence(self, output: str, input: str) -> NDArray[np.float64]:
        """Partial coherence (M), from 0 to 1."""
        return _numbers(self._pair(output, input)["coherence"])

    def random_error(self, output: str, input: str) -> NDArray[np.float64]:
        """Normalised random error of the magnitude (M)."""
        return _numbers(self._pair(output, input)["random_error"])

    def plot(self, *, axes: Any = None) -> Any:
        """Magnitude, phase and coherence of every pair, as matplotlib axes (3 by pairs)."""
        return _figures.spectra(self, axes=axes)


def _numbers(values: Sequence[float | None]) -> NDArray[np.float64]:
    return np.array([np.nan if v is None else v for v in values], dtype=float)


class Modes(Answer):
    """Eigenvalues with damping, frequency and dominant states; keys of ``fdm modes --json`` are attributes."""

    @property
    def poles(self) -> NDArray[np.complex128]:
        """Every eigenvalue, both of a pair, in 1 over the unit of time."""
        return np.array([complex(m.re, m.im) for m in self.document.modes])

    def table(self, kind: str = "pandas") -> Any:
        """One row for each eigenvalue."""
        fields = ["re", "im", "damping", "frequency", "time_to_half", "time_to_double"]
        columns: dict[str, list[Any]] = {f: [m[f] for m in self.document.modes] for f in fields}
        columns["states"] = [", ".join(m.states) for m in self.document.modes]
        return frame(columns, kind)


class Margins(Answer):
    """What a result is used for: modes and requirements with intervals. Keys of ``fdm margins --json`` are attributes:
    `requirements`, each with ``value``, ``interval``, ``probability``; `modes`. ``margins["name"]`` is a requirement."""

    def __getitem__(self, name: str) -> Document:
        for requirement in self.document.requirements:
            if requirement.name == name:
                return requirement
        raise KeyError(f"there is no requirement `{name}`")

    def table(self, kind: str = "pandas") -> Any:
        """One row for each requirement."""
        fields = ["name", "unit", "value", "error", "lower", "upper", "probability", "by"]
        columns: dict[str, list[Any]] = {f: [r[f] for r in self.document.requirements] for f in fields}
        ends = [r["interval"] or (None, None) for r in self.document.requirements]
        columns["low"], columns["high"] = [e[0] for e in ends], [e[1] for e in ends]
        return frame(columns, kind)


class Doctor(Answer):
    """Records judged before they are believed: `good` where nothing but remarks was found. Keys of ``fdm doctor --json`` are attributes:
    `findings`, each with ``run``, ``channels``, ``fault``, ``place``, ``what``, ``log_odds``, ``biases``, ``repair``; `records`, `notes`."""

    _made: _fdm.Doctor

    @classmethod
    def _of(cls, made: _fdm.Doctor) -> Doctor:  # type: ignore[override]
        found = super()._of(made.answer())
        found._made = made
        return found

    @property
    def findings(self) -> list[Document]:
        """Findings first, then remarks; the surest first."""
        return self.document.findings

    @property
    def map(self) -> str:
        """A map with all repairs that a map can hold, as ``fdm doctor --fix`` writes it; the records are not touched."""
        return self._made.map()

    def save_map(self, file: str | os.PathLike[str]) -> None:
        """Writes the map, ready for ``Run.read(record, map=file)``. A file that fdm did not write is left alone."""
        path, begins = Path(file), self.map.split(";")[0]
        if path.exists() and not path.read_text(encoding="utf-8").startswith(begins):
            raise InputError([f"{path} exists already, and is no map that fdm wrote"])
        path.write_text(self.map, encoding="utf-8")

    def report(self, file: str | os.PathLike[str] | None = None) -> str:
        """The page: each finding with its channel drawn; written to a file where one is given."""
        page = self._made.page()
        if file is not None:
            Path(file).write_text(page, encoding="utf-8")
        return page

    def table(self, kind: str = "pandas") -> Any:
        """One row for each finding."""
        fields = ["run", "severity", "fault", "what", "log_odds"]
        columns: dict[str, list[Any]] = {f: [finding[f] for finding in self.findings] for f in fields}
        columns["channels"] = [", ".join(finding["channels"]) for finding in self.findings]
        return frame(columns, kind)

    def _repr_html_(self) -> str:
        rows = [[f["run"], ", ".join(f["channels"]), f["fault"], f["what"]] for f in self.findings]
        title = "nothing was found" if self.good else "findings"
        return _figures.table(title, ["run", "channels", "fault", "what"], rows)


def doctor(runs: RunLike | Sequence[RunLike], *, alpha: float | None = None, **options: Any) -> Doctor:
    """Records judged by themselves, without a model, as ``fdm doctor --data FILE``: every table of every file, frames and arrays.

    alpha: probability of a finding in a record without a fault (0.01). `Model.doctor` judges runs beside a model.
    """
    files: list[Path] = []
    tables: list[Any] = []
    for run in as_runs(runs):
        if isinstance(run, RunTable):
            raise TypeError("a table of runs is judged beside a model: Model.doctor")
        if run.file is not None:
            files.append(run.file)
        else:
            fields = [(name, s.unit, np.asarray(s.values)) for name, s in run._channels.items()]
            time = next((k for k, (name, _, _) in enumerate(fields) if name in TIMES), None)
            tables.append((run.name, time, fields))
    if not files and not tables:
        raise InputError(["no run was given"])
    return Doctor._of(_fdm.doctor_alone(files, tables, words({"alpha": alpha, **options})))


class Check(Answer):
    """Declarations, and whether every derivative was confirmed (`good`)."""


class Effects(Answer):
    """Candidate effects and their places."""


@dataclass(frozen=True)
class Linear:
    """A model, linear or linearised at its trim: ``der(x) = A x + B u``, ``y = C x + D u``, for deviations from the trim."""

    A: NDArray[np.float64]
    """n by n."""
    B: NDArray[np.float64]
    """n by m."""
    C: NDArray[np.float64]
    """q by n."""
    D: NDArray[np.float64]
    """q by m."""
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    outputs: tuple[str, ...]
    poles: NDArray[np.complex128]
    """Eigenvalues, both of a pair; of a model with delays the rightmost."""
    trim_states: NDArray[np.float64]
    """States (n) at which it was linearised."""
    trim_inputs: NDArray[np.float64]
    """Inputs (m) at which it was linearised."""
    delayed: tuple[str, ...]
    """States and inputs that act later."""
    delays: NDArray[np.float64]
    """Their delays, in the unit of time."""
    by_delayed: NDArray[np.float64]
    """Coefficients of the delayed signals in rates and outputs (n + q by delayed)."""

    @classmethod
    def _of(cls, model: Model) -> Linear:
        found = model._m.linear()
        n, m, _ = found["sizes"]
        whole = found["matrix"]
        inputs = tuple(found["inputs"])
        return cls(
            A=whole[:n, :n], B=whole[:n, n : n + m], C=whole[n:, :n], D=whole[n:, n : n + m],
            states=tuple(s.name for s in model.states), inputs=inputs, outputs=tuple(o.name for o in model.outputs),
            poles=np.array([complex(*p) for p in found["poles"]]), trim_states=found["trim_states"], trim_inputs=found["trim_inputs"],
            delayed=tuple(found["delayed"]), delays=found["delays"], by_delayed=whole[:, n + m :],
        )  # fmt: skip

    def response(self, frequency: ArrayLike) -> NDArray[np.complex128]:
        """Frequency response (M by q by m) at M frequencies, in cycles per unit of time; delays are exact."""
        n, m = len(self.states), len(self.inputs)
        found = []
        for f in np.atleast_1d(np.asarray(frequency, dtype=float)):
            s = 2j * np.pi * f
            A, B, C, D = (M.astype(complex) for M in (self.A, self.B, self.C, self.D))
            for k, (name, delay) in enumerate(zip(self.delayed, self.delays)):
                lag, column = np.exp(-s * delay), self.by_delayed[:, k]
                if name in self.states:
                    at = self.states.index(name)
                    A[:, at] += lag * column[:n]
                    C[:, at] += lag * column[n:]
                else:
                    at = self.inputs.index(name)
                    B[:, at] += lag * column[:n]
                    D[:, at] += lag * column[n:]
            found.append(C @ np.linalg.solve(s * np.eye(n) - A, B) + D if n else D)
        return np.array(found).reshape(-1, len(self.outputs), m)

    def to_control(self) -> Any:
        """A ``StateSpace`` of python-control. Refused where the model has delays, which it cannot hold."""
        import control

        if self.delayed:
            raise ValueError(
                f"{', '.join(self.delayed)} act later, which a state space cannot hold: use `response`, or a Pade approximation of your own"
            )
        names = dict(states=list(self.states), inputs=list(self.inputs), outputs=list(self.outputs))
        return control.ss(self.A, self.B, self.C, self.D, **names)
