"""Recorded runs: from files, arrays, dictionaries and frames."""

from __future__ import annotations

import os
import re
import weakref
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Union

import numpy as np
from numpy.typing import ArrayLike, NDArray

from . import _fdm
from ._errors import InputError, SampleError, UnknownOption
from ._options import listed, words

if TYPE_CHECKING:
    from ._model import Model

# Names of the times, unless a model has such a channel
TIMES = ("t", "time")
_TITLE = re.compile(r"^\s*(?P<name>.*?)\s*\[(?P<unit>[^\[\]]*)\]\s*$")


@dataclass(frozen=True)
class Signal:
    """Samples with what belongs to them.

    values: samples (N); NaN where one is missing.
    unit: unit of the samples, such as ``"deg"``; the model's own when not given.
    t: times of these samples (N), where they have a rate of their own.
    """

    values: ArrayLike
    unit: str | None = None
    t: ArrayLike | None = None


RunLike = Union["Run", "RunTable", str, "os.PathLike[str]", Mapping[str, Any], Any]


class Run:
    """A recorded run: times, inputs and measured outputs.

    ::

        Run("f.csv")                                        # a file, as Run.read
        Run(frame)                                          # a pandas or polars frame
        Run({"t": t, "u [deg]": u, "y": y})                 # a dictionary of arrays
        Run(t=t, inputs={"u": (u, "deg")}, outputs={"y": y})
        Run(t=t, inputs={"u": u}, outputs={"y": Signal(y, "deg", t=slow)})  # several rates

    data: a file, a mapping of names to samples, or a frame. A name may hold a unit, as in ``"roll [deg]"``. Columns that a model
        does not know are left alone.
    t: times (N), rising, in the model's unit of time unless `units` says another. A frame without a column ``t`` or ``time``
        has its index for them.
    inputs, outputs: samples (N) by channel: an array, a pair ``(samples, "unit")``, a `Signal`, or a pandas series with its own
        index. A channel that the model does not have is refused.
    units: units by name, where they are not said otherwise; ``"t"`` is the time.
    map: columns by channel, ``{"roll": "attitude_phi"}``.
    name: what tables call the run.
    zoh: inputs that keep their value until the next sample (zero-order hold). Others are linear between samples, unless they move only
        at samples, all at once.
    linear: inputs that go in straight lines between samples, whatever they look like.
    without_output: outputs that are not compared.
    known: values that the run brings (``known T0 per run;``): a number in the model's unit, ``(20, "degC")`` or ``"20 degC"``.
    groups: the group that the run belongs to, by grouping (``param k per group aircraft;``): ``{"aircraft": "A"}``.
    begin: where the run begins: the instant that is the model's time 0, in the times of the samples, at the first of them or before it.
    mask: only samples where it is not 0 are compared: samples (N) or the name of a column, for all outputs or by output.

    NaN marks a sample that is missing: outputs are not compared there, inputs are bridged linearly. Channels with other rates are
    put on the union of all times.
    """

    notes: Sequence[str] = ()
    """What a careful reader would mention about the file: known when it has been read."""

    def __init__(
        self,
        data: Any = None,
        /,
        *,
        t: ArrayLike | None = None,
        inputs: Mapping[str, Any] | None = None,
        outputs: Mapping[str, Any] | None = None,
        units: Mapping[str, str] | None = None,
        map: Mapping[str, str] | None = None,
        name: str | None = None,
        zoh: str | Iterable[str] = (),
        linear: str | Iterable[str] = (),
        without_output: str | Iterable[str] = (),
        known: Mapping[str, Any] | None = None,
        groups: Mapping[str, str] | None = None,
        begin: float | None = None,
        mask: ArrayLike | str | Mapping[str, ArrayLike | str] | None = None,
    ):
        self._begin((zoh, linear), without_output, groups)
        if isinstance(data, (str, os.PathLike)):
            if t is not None or inputs or outputs or units:
                raise TypeError("a file has its own times, channels and units: leave out t, inputs, outputs and units")
            self._of_file(data, name, {"map": map, "known": known, "begin": begin, "mask": mask})
            return
        self.name = name or "run"
        self._start = begin
        # whether a channel that the model does not have is a mistake
        self._exact = data is None
        self._channels: dict[str, Signal] = {}
        if data is not None:
            for title, samples in _columns(data, t is None).items():
                self._add(title, samples)
        for given in (inputs, outputs):
            for channel, samples in (given or {}).items():
                self._add(channel, samples)
        if t is not None:
            self._channels = {"t": _signal("t", t, None), **self._channels}
        for channel, column in (map or {}).items():
            if column not in self._channels:
                raise KeyError(f"there is no column `{column}`; the columns are {', '.join(self._channels)}")
            self._channels[channel] = self._channels.pop(column)
        for channel, unit in (units or {}).items():
            key = channel if channel in self._channels else next((n for n in TIMES if n in self._channels), channel)
            if channel not in self._channels and channel not in TIMES:
                raise KeyError(f"units are given for `{channel}`, which has no samples")
            if key in self._channels:
                self._channels[key] = Signal(self._channels[key].values, unit, self._channels[key].t)
        self._merge_rates()
        self._known = {value: _amount(value, amount) for value, amount in (known or {}).items()}
        self._masks: dict[str | None, NDArray[np.bool_]] = {}
        for output, samples in (mask.items() if isinstance(mask, Mapping) else [(None, mask)] if mask is not None else []):
            self._masks[output] = self._compared(samples)

    def _begin(self, between: tuple[Any, Any], without_output: Any, groups: Mapping[str, str] | None) -> None:
        self.file: Path | None = None
        self._words: list[str] = []
        self._start = None
        self._source: _fdm.Source | None = None
        self._bound: weakref.WeakKeyDictionary[Any, dict[Any, _fdm.Record]] = weakref.WeakKeyDictionary()
        self.zoh, self.linear = listed(between[0]), listed(between[1])
        self.without_output = listed(without_output)
        self.groups: dict[str, str] = dict(groups or {})
        """The group that the run belongs to, by grouping."""

    @classmethod
    def read(
        cls,
        file: str | os.PathLike[str],
        *,
        map: Mapping[str, str] | str | os.PathLike[str] | None = None,
        from_: float | None = None,
        to: float | None = None,
        every: int | None = None,
        zoh: str | Iterable[str] = (),
        linear: str | Iterable[str] = (),
        without_output: str | Iterable[str] = (),
        known: Mapping[str, Any] | None = None,
        groups: Mapping[str, str] | None = None,
        begin: float | None = None,
        mask: str | Mapping[str, str] | None = None,
        name: str | None = None,
        **options: Any,
    ) -> Run:
        """A run of a file, with the options of the command: ``fdm fit --data FILE --map ... --from ... --to ... --begin ... --every ...``.

        map: columns by channel, or the file of a map (``--map-file``), or ``"px4"``, ``"ardupilot"``, ``"fti"``. known, groups and mask are
        those of `Run`. The file is read when a model is there that says what its channels are.
        """
        run = cls.__new__(cls)
        run._begin((zoh, linear), without_output, groups)
        reading = {"map": map, "from": from_, "to": to, "every": every, "known": known, "begin": begin, "mask": mask, **options}
        run._of_file(file, name, reading)
        return run

    @classmethod
    def _of_source(cls, source: _fdm.Source) -> Run:
        run = cls.__new__(cls)
        run._begin(((), ()), (), source.groups)
        run._of_file(source.path, source.name, {})
        run._source = source
        return run

    def _of_file(self, file: str | os.PathLike[str], name: str | None, reading: Mapping[str, Any]) -> None:
        self.file = Path(file)
        self.name = name or self.file.stem
        self._exact, self._channels, self._known, self._masks = False, {}, {}, {}
        self._words = _reading({**reading, "groups": self.groups, "zoh": self.zoh, "linear": self.linear, "without_output": self.without_output})

    def _add(self, title: str, samples: Any) -> None:
        match = _TITLE.match(title)
        channel, unit = (match["name"], match["unit"] or None) if match else (title, None)
        if channel in self._channels:
            raise ValueError(f"samples of `{channel}` are given more than once")
        self._channels[channel] = _signal(channel, samples, unit)

    def _merge_rates(self) -> None:
        """Channels with times of their own are put on the union of all times."""
        own = {name: s for name, s in self._channels.items() if s.t is not None}
        if not own:
            return
        base = next((name for name in TIMES if name in self._channels), None)
        common = np.asarray(self._channels[base].values) if base else np.empty(0)
        times = np.unique(np.concatenate([common, *(np.asarray(s.t) for s in own.values())]))
        merged: dict[str, Signal] = {}
        for name, signal in self._channels.items():
            if name == base:
                continue
            at = common if signal.t is None else np.asarray(signal.t)
            values = np.asarray(signal.values)
            if len(at) != len(values):
                raise ValueError(f"`{name}` has {len(values)} samples and {len(at)} times")
            spread = np.full(len(times), np.nan)
            spread[np.searchsorted(times, at)] = values
            merged[name] = Signal(spread, signal.unit)
        unit = self._channels[base].unit if base else None
        self._channels = {base or "t": Signal(times, unit), **merged}

    @property
    def channels(self) -> list[str]:
        """Names of the channels in memory, the time among them; none of a file, which is read with a model."""
        return list(self._channels)

    def __getitem__(self, channel: str) -> NDArray[np.float64]:
        """Samples (N) of a channel in memory."""
        return np.asarray(self._channels[channel].values)

    def __len__(self) -> int:
        return max((np.size(s.values) for s in self._channels.values()), default=0)

    def __bool__(self) -> bool:
        return True

    def __repr__(self) -> str:
        if self.file is not None:
            return f"Run({str(self.file)!r})"
        return f"Run(name={self.name!r}, {len(self)} samples of {', '.join(self._channels)})"

    def __getstate__(self) -> dict[str, Any]:
        if self._source is not None:
            raise TypeError("a run of a table or pattern belongs to this process: make it anew by its file")
        return {k: v for k, v in self.__dict__.items() if k != "_bound"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__dict__.update(state)
        self._bound = weakref.WeakKeyDictionary()

    def _compared(self, samples: Any) -> NDArray[np.bool_]:
        """A mask (N) from its samples or the name of its column."""
        if isinstance(samples, str):
            if samples not in self._channels:
                raise KeyError(f"there is no column `{samples}` for the mask; the columns are {', '.join(self._channels)}")
            samples = self._channels[samples].values
        values, _ = _numbers("mask", samples)
        if len(values) != len(self):
            raise ValueError(f"the mask has {len(values)} samples, and the run {len(self)}")
        return ~(np.isnan(values) | (values == 0))

    def _samples(self, name: str, signal: Signal, outputs: Sequence[str]) -> NDArray[np.float64]:
        """Samples (N) of a channel, NaN where an output is not to be compared."""
        values = np.asarray(signal.values)
        masks = [m for output, m in self._masks.items() if output in (None, name)] if name in outputs else []
        return np.where(np.all(masks, axis=0), values, np.nan) if masks else values

    def _record(self, model: Model, others: set[str], to_simulate: bool) -> _fdm.Record:
        """Samples in memory in the channels of a model; outputs that `others` measure may be missing."""
        channels = model._names
        self._belongs(model)
        wrong = [output for output in self._masks if output not in (None, *(o.name for o in model.outputs))]
        if wrong:
            raise KeyError(f"a mask is given for `{wrong[0]}`, which is no output; there are {', '.join(o.name for o in model.outputs)}")
        outputs = [o.name for o in model.outputs]
        absent = [o for o in outputs if o not in self._channels]
        waived = to_simulate or bool(absent) and all(o in others or o in self.without_output for o in absent)
        known = {*channels, *(() if any(t in channels for t in TIMES) else TIMES)}
        taken = [
            (name, signal.unit, self._samples(name, signal, outputs))
            for name, signal in self._channels.items()
            if (self._exact or name in known) and name not in self.without_output
        ]
        taken += [(name, unit, np.full(len(self), value)) for name, (value, unit) in self._known.items()]
        return model._m.run(self.name, taken, self.groups, (self.zoh, self.linear, self._start), waived or bool(self.without_output))

    def _belongs(self, model: Model) -> None:
        """Refuses a run that does not say to which group of the model it belongs."""
        for grouping, groups in model._m.groups().items():
            said = f"give groups={{{grouping!r}: {groups[0]!r}}}" if len(groups) == 1 else f"its groups are {', '.join(groups)}"
            if grouping not in self.groups:
                raise InputError([f"run `{self.name}` does not say its `{grouping}`: {said}"])
            if self.groups[grouping] not in groups:
                raise InputError([f"run `{self.name}`: no fitted run has the {grouping} `{self.groups[grouping]}`: {said}"])


class RunTable:
    """A table of runs, as ``--runs`` reads it: a row for each run with its `file`, and where wanted `run` (its name), `role` (``fit`` or
    ``validation``), `map`, `from`, `to`, values that the runs bring, and groups.

    ::

        fit = m.fit(fdm.RunTable("runs.csv"))

    Runs of the role ``validation`` are predicted, not fitted. options: those of `Run.read`, for all files.
    """

    def __init__(self, file: str | os.PathLike[str], **options: Any):
        self.file = Path(file)
        self._words = _reading({"runs": self.file, **options})

    def __repr__(self) -> str:
        return f"RunTable({str(self.file)!r})"


def _amount(name: str, amount: Any) -> tuple[float, str | None]:
    """Value and unit of what a run brings."""
    unit = None
    if isinstance(amount, tuple) and len(amount) == 2:
        amount, unit = amount
    elif isinstance(amount, str):
        amount, _, rest = amount.strip().partition(" ")
        unit = rest.strip() or None
    try:
        return float(amount), unit
    except (TypeError, ValueError):
        raise TypeError(f"the value of `{name}` is {amount!r}, expected a number, (number, unit) or 'number unit'") from None


def _said(name: str, amount: Any) -> str:
    value, unit = _amount(name, amount)
    return f"{value!r} {unit}" if unit else repr(value)


def _signal(channel: str, samples: Any, unit: str | None) -> Signal:
    times = None
    if isinstance(samples, Signal):
        samples, unit, times = samples.values, samples.unit or unit, samples.t
    elif isinstance(samples, tuple) and len(samples) == 2 and isinstance(samples[1], str):
        samples, unit = samples
    elif channel not in TIMES and _is_series(samples) and _has_times(samples.index):
        times = samples.index
    values, seconds = _numbers(channel, samples)
    if seconds:
        unit = unit or "s"
    if times is not None:
        times, _ = _numbers("t", times)
    return Signal(values, unit, times)


def _is_series(samples: Any) -> bool:
    return type(samples).__module__.startswith("pandas") and hasattr(samples, "index")


def _has_times(index: Any) -> bool:
    """Whether an index says more than the number of the row."""
    return type(index).__name__ != "RangeIndex"


def _numbers(channel: str, samples: Any) -> tuple[NDArray[np.float64], bool]:
    """Samples (N) as numbers, and whether they were times that became seconds."""
    if type(samples).__module__.startswith("polars"):
        samples = samples.to_numpy()
    elif hasattr(samples, "to_numpy"):
        kind = getattr(samples, "dtype", None)
        # numbers that may be missing
        samples = samples.to_numpy(dtype=float, na_value=np.nan) if _is_extension(kind) else samples.to_numpy()
    # what is masked was not measured
    hidden = np.ma.getmaskarray(samples) if isinstance(samples, np.ma.MaskedArray) else None
    values = np.asarray(samples)
    if hidden is not None and hidden.any() and values.dtype.kind in "mM":
        raise InputError([f"the samples of `{channel}` are times, some of which are masked: leave these rows out"])
    if values.dtype.kind in "mM":
        first = values[:1] if values.dtype.kind == "M" else np.zeros(1, values.dtype)
        return ((values - first) / np.timedelta64(1, "ns")).astype(float) * 1e-9, True
    try:
        values = np.asarray(values, dtype=np.float64)
    except (TypeError, ValueError) as e:
        raise SampleError(f"the samples of `{channel}` are no numbers: {e}") from None
    if hidden is not None:
        values = np.where(hidden, np.nan, values)
    if values.ndim != 1:
        raise ValueError(f"the samples of `{channel}` have the shape {values.shape}, expected one number for each time")
    return values, False


def _is_extension(kind: Any) -> bool:
    return kind is not None and not isinstance(kind, np.dtype) and getattr(kind, "_is_numeric", False)


def _columns(data: Any, with_index: bool) -> dict[str, Any]:
    if isinstance(data, Mapping):
        return dict(data)
    if not hasattr(data, "columns"):
        raise TypeError(f"a run is a file, a mapping of names to samples, or a frame, not {type(data).__name__}")
    columns = {str(c): data[c] for c in data.columns}
    index = getattr(data, "index", None)
    if with_index and index is not None and not any(_named(c) in TIMES for c in columns) and _has_times(index):
        columns = {"t": index, **columns}
    if index is not None:
        # the times are the frame's own
        columns = {n: c.to_numpy() if isinstance(getattr(c, "dtype", None), np.dtype) else c.array for n, c in columns.items()}
    units = getattr(data, "attrs", {}).get("units", {})
    return {n: (c, units[n]) if n in units else c for n, c in columns.items()}


def _named(title: str) -> str:
    match = _TITLE.match(title)
    return match["name"] if match else title


def as_runs(runs: RunLike | Sequence[RunLike]) -> list[Run | RunTable]:
    """One run or several; files, frames and dictionaries become runs."""
    given: Iterable[Any] = runs if isinstance(runs, Iterable) else [runs]
    if isinstance(runs, (Run, RunTable, str, os.PathLike, Mapping)) or hasattr(runs, "columns"):
        given = [runs]
    return [r if isinstance(r, (Run, RunTable)) else Run(r) for r in given]


# Options of reading, which belong to the files
_READING = {"map", "map_file", "salvage", "from", "to", "begin", "every", "zoh", "linear", "without_output", "known", "group", "groups", "mask"}


def _reading(options: Mapping[str, Any]) -> list[str]:
    """The words of reading for these options."""
    given = {name.rstrip("_"): value for name, value in options.items()}
    if "groups" in given:
        given["group"] = given.pop("groups")
    if given.get("known"):
        given["known"] = {n: _said(n, amount) for n, amount in given["known"].items()}
    if isinstance(given.get("map"), (str, os.PathLike)):
        given["map_file"] = given.pop("map")
    mask = given.get("mask")
    columns = list(mask.values()) if isinstance(mask, Mapping) else [mask] if mask is not None else []
    if not all(isinstance(c, str) for c in columns):
        raise TypeError("the mask of a file is the name of its column")
    return words(given)


def _of_files(options: dict[str, Any], runs: Sequence[Run | RunTable]) -> list[str]:
    """Takes the options of reading out of those of a call, as words for its files."""
    given = {name: options.pop(name) for name in list(options) if name.rstrip("_") in _READING}
    in_memory = [r.name for r in runs if isinstance(r, Run) and r.file is None]
    if given and in_memory:
        name = next(iter(given))
        raise UnknownOption(f"`{name}` is for files; give it to fdm.Run, as `{in_memory[0]}` is in memory", name)
    return _reading(given)


@dataclass(frozen=True)
class Campaign:
    """Runs in the channels, order and units of a model."""

    model: Model
    """The model for the groups of the runs."""
    runs: list[Run]
    records: list[_fdm.Record]
    validation: list[Run]
    predicted: list[_fdm.Record]
    """The records of the validation runs."""

    @classmethod
    def of(
        cls,
        model: Model,
        runs: RunLike | Sequence[RunLike],
        validation: RunLike | Sequence[RunLike] = (),
        *,
        options: dict[str, Any] | None = None,
        to_simulate: bool = False,
        elsewhere: Iterable[str] = (),
        several: bool = True,
        optional: bool = False,
    ) -> Campaign:
        """Reads what must be read. `options` loses those of reading. Runs to be simulated need no outputs; those that are measured
        `elsewhere` may be missing in all of them. Without `several` the roles of a table are of no account."""
        fitted, predicted = as_runs(runs), as_runs(validation)
        said = _of_files(options, [*fitted, *predicted]) if options else []
        taken: list[Run] = []
        left: list[Run] = []
        for given in fitted:
            for run in _expanded(given, model, said, to_simulate):
                apart = several and run._source is not None and run._source.validation
                (left if apart else taken).append(run)
        left += [run for given in predicted for run in _expanded(given, model, said, to_simulate)]
        if not taken and not optional:
            raise InputError(["no run was given"])
        if not model._m.groups():
            groups = {g: list(dict.fromkeys(r.groups[g] for r in taken or left if g in r.groups)) for g in model._m.groupings()}
            model = model._grouped({g: names for g, names in groups.items() if names})
        records = _bound(taken, model, said, to_simulate, elsewhere)
        measured = np.any([r.measures() for r in records], axis=0) if records else np.zeros(len(model.outputs), bool)
        known = [o.name for o, m in zip(model.outputs, measured) if m]
        return cls(model, taken, records, left, _bound(left, model, said, to_simulate, [*elsewhere, *known]))


def _expanded(given: Run | RunTable, model: Model, said: list[str], to_simulate: bool) -> list[Run]:
    """The runs of a table, and of a pattern such as ``flights/*.csv``."""
    if isinstance(given, RunTable):
        return [Run._of_source(s) for s in model._m.sources([], [*said, *given._words], to_simulate)]
    if given.file is None or not any(c in str(given.file) for c in "*?[") or given.file.exists():
        return [given]
    return [Run._of_source(s) for s in model._m.sources([given.file], [*said, *given._words], to_simulate)]


def _bound(runs: Sequence[Run], model: Model, said: list[str], to_simulate: bool, elsewhere: Iterable[str]) -> list[_fdm.Record]:
    """Runs in the channels of a model. Outputs that are measured `elsewhere` may be missing in all of them."""
    outputs = [o.name for o in model.outputs]
    measured = {name for run in runs for name in run._channels} | set(elsewhere)
    found: dict[int, _fdm.Record] = {}
    sources: list[_fdm.Source] = []
    places = [k for k, run in enumerate(runs) if run.file is not None]
    for k, run in enumerate(runs):
        if run.file is not None:
            source = run._source or model._m.sources([run.file], [*said, *run._words], to_simulate)[0]
            own = run._source is None and run.name != run.file.stem
            sources.append(source.named(run.name) if own else source)
            continue
        key = (to_simulate, *(o in measured for o in outputs))
        kept = run._bound.setdefault(model, {})
        if key not in kept:
            kept[key] = run._record(model, measured, to_simulate)
        found[k] = kept[key]
    if sources:
        for k, (record, notes) in zip(places, model._m.read(sources, [o in measured for o in outputs])):
            found[k], runs[k].notes = record, notes
    return [found[k] for k in range(len(runs))]
