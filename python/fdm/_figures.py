"""Figures on matplotlib axes, which a user can change, and what notebooks show."""

from __future__ import annotations

import html
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from . import _fdm

if TYPE_CHECKING:
    from ._fit import Fit, History
    from ._model import Model
    from ._results import Spectra
    from ._run import RunLike

# Half the width of a 95 % band, in standard deviations
_WIDE = 1.96
# Pictures that a notebook shows at once
_SHOWN = 2


def _axes(axes: Any, rows: int, columns: int, **options: Any) -> Any:
    if axes is not None:
        given = np.asarray(axes, dtype=object)
        if given.size != rows * columns:
            raise ValueError(f"{given.size} axes, expected {rows} by {columns}")
        return given.reshape(rows, columns)
    import matplotlib.pyplot as plt

    size = options.pop("size", (4.5, 2.0))
    figure, made = plt.subplots(
        rows, columns, squeeze=False, figsize=(max(1, columns) * size[0], max(1, rows) * size[1]), layout="constrained", **options
    )
    return made


def _label(name: str, unit: str | None) -> str:
    return f"{name} [{unit}]" if unit else name


def histories(
    model: Model,
    found: Sequence[History],
    bands: Sequence[Any] | None,
    *,
    runs: Sequence[str] | None = None,
    outputs: Sequence[str] | None = None,
    axes: Any = None,
) -> Any:
    """Measurement, response with band, and residual below: axes (2 q by runs)."""
    places = [k for k, h in enumerate(found) if runs is None or h.run in runs]
    shown = [k for k, o in enumerate(model.outputs) if outputs is None or o.name in outputs]
    if not places or not shown:
        raise ValueError("there is no such history: a fit without simulation has none")
    made = _axes(axes, 2 * len(shown), len(places), sharex="col", height_ratios=[3, 1] * len(shown), size=(6.0, 1.8))
    for column, k in enumerate(places):
        history = found[k]
        for row, o in enumerate(shown):
            output, time = model.outputs[o], history.time
            above, below = made[2 * row, column], made[2 * row + 1, column]
            above.plot(time, history.measured[:, o], ".", ms=2, color="0.45", label="measured")
            [line] = above.plot(time, history.response[:, o], lw=1.2, label="model")
            if bands is not None and len(bands):
                wide = _WIDE * bands[k][:, o]
                low, high = history.response[:, o] - wide, history.response[:, o] + wide
                above.fill_between(time, low, high, color=line.get_color(), alpha=0.25, lw=0, label="95 %")
            below.plot(time, history.residuals[:, o], lw=0.8, color="0.3")
            below.axhline(0, lw=0.5, color="0.7")
            above.set_ylabel(_label(output.name, output.unit))
            below.set_ylabel("residual")
        made[0, column].set_title(history.run)
        made[0, column].legend(loc="best", fontsize="small")
        made[-1, column].set_xlabel(_label("t", model.time_unit))
    return made


def residuals(outputs: Sequence[Any], *, axes: Any = None) -> Any:
    """Autocorrelation, spectrum and distribution of each residual: axes (outputs by 3)."""
    tested = [o for o in outputs if o.get("whiteness") or o.get("distribution")]
    if not tested:
        raise ValueError("there is no residual that was tested")
    made = _axes(axes, len(tested), 3, size=(4.0, 2.4))
    for row, output in zip(made, tested):
        name = f"{output.name} in {output.run}"
        white, spectrum, spread = output.get("whiteness"), output.get("spectrum"), output.get("distribution")
        row[0].set_title(f"{name}: autocorrelation", fontsize="small")
        if white:
            lags = np.arange(1, len(white["autocorrelation"]) + 1) * (white.get("interval") or 1)
            row[0].vlines(lags, 0, white["autocorrelation"])
            bounds = np.array(white["bounds"], dtype=float)
            row[0].fill_between(lags, -bounds, bounds, alpha=0.25, lw=0)
            row[0].set_xlabel("lag")
        row[1].set_title("spectrum", fontsize="small")
        if spectrum:
            row[1].loglog(spectrum["frequency"], spectrum["density"], lw=1)
            row[1].fill_between(spectrum["frequency"], spectrum["low"], spectrum["high"], alpha=0.25, lw=0)
            row[1].set_xlabel("cycles per unit of time")
        row[2].set_title("distribution", fontsize="small")
        if spread:
            edges = np.array(spread["edges"], dtype=float)
            row[2].stairs(spread["counts"], edges, fill=True, alpha=0.5)
            row[2].plot(0.5 * (edges[1:] + edges[:-1]), spread["expected"], lw=1, color="0.2")
            row[2].set_xlabel("standard deviations")
    return made


def _decibels(response: Any) -> Any:
    with np.errstate(divide="ignore"):
        return 20 * np.log10(np.abs(response))


def _degrees(response: Any) -> Any:
    angle = np.angle(response)
    good = np.isfinite(angle)
    angle[good] = np.unwrap(angle[good])
    return np.degrees(angle)


def bode(fit: Fit, runs: Sequence[RunLike], *, axes: Any = None, **options: Any) -> Any:
    """Magnitude and phase of the linear model, and those of the runs: axes (2 by pairs)."""
    measured: dict[tuple[str, str], tuple[Any, Any]] = {}
    if runs:
        found = fit.model.spectra(list(runs), **options)
        measured = {(o, i): (found.frequency, found.response(o, i)) for o, i in found.pairs}
    elif fit.document.get("frequency_responses"):
        for pair in fit.document.frequency_responses.pairs:
            magnitude, phase = (np.array(pair[key], dtype=float) for key in ("decibels", "degrees"))
            measured[pair.output, pair.input] = (
                np.array(pair["frequency"], dtype=float),
                10 ** (magnitude / 20) * np.exp(1j * np.radians(phase)),
            )
    linear = fit.linear()
    declared = [i.name for i in fit.model.inputs]
    pairs = list(measured) or [(o, i) for o in linear.outputs for i in declared]
    if not pairs:
        raise ValueError("the model has no input, so that there is no frequency response")
    made = _axes(axes, 2, len(pairs), sharex="col", size=(4.0, 2.4))
    natural = np.abs(linear.poles[np.abs(linear.poles) > 0]) / (2 * np.pi)
    low, high = (float(natural.min()) / 10, float(natural.max()) * 10) if natural.size else (0.01, 10.0)
    for column, (output, input) in enumerate(pairs):
        above, below = made[0, column], made[1, column]
        frequency = np.geomspace(low, high, 300)
        if (output, input) in measured:
            at, response = measured[output, input]
            above.semilogx(at, _decibels(response), ".", ms=3, color="0.45", label="measured")
            below.semilogx(at, _degrees(response), ".", ms=3, color="0.45")
            frequency = np.geomspace(at[at > 0].min(), at.max(), 300)
        model = linear.response(frequency)[:, linear.outputs.index(output), linear.inputs.index(input)]
        above.semilogx(frequency, _decibels(model), lw=1.2, label="model")
        below.semilogx(frequency, _degrees(model), lw=1.2)
        above.set_title(f"{output} / {input}", fontsize="small")
        below.set_xlabel(f"cycles per {fit.model.time_unit}")
    made[0, 0].set_ylabel("magnitude [dB]")
    made[1, 0].set_ylabel("phase [deg]")
    made[0, 0].legend(loc="best", fontsize="small")
    return made


def overlays(model: Model, found: Sequence[dict[str, Any]], *, axes: Any = None) -> Any:
    """Measurement, and responses before and after: axes (q by runs)."""
    made = _axes(axes, len(model.outputs), len(found), sharex="col", size=(6.0, 2.2))
    for column, overlay in enumerate(found):
        for o, output in enumerate(model.outputs):
            place = made[o, column]
            place.plot(overlay["time"], overlay["measured"][:, o], ".", ms=2, color="0.45", label="measured")
            place.plot(overlay["time"], overlay["before"][:, o], lw=1, ls="--", label="before")
            place.plot(overlay["time"], overlay["after"][:, o], lw=1.2, label="after")
            place.set_ylabel(_label(output.name, output.unit))
        made[0, column].set_title(overlay["run"])
        made[0, column].legend(loc="best", fontsize="small")
        made[-1, column].set_xlabel(_label("t", model.time_unit))
    return made


def draws(found: Mapping[str, Any], *, axes: Any = None) -> Any:
    """Trace of every chain beside the histogram of all draws: axes (parameters by 2)."""
    made = _axes(axes, len(found), 2, size=(4.5, 1.6))
    for (trace, spread), (name, values) in zip(made, found.items()):
        trace.plot(values.T, lw=0.6)
        spread.hist(values.ravel(), bins=40, density=True, color="0.6")
        trace.set_ylabel(name)
        spread.set_yticks([])
    made[-1, 0].set_xlabel("draw")
    return made


def profiles(found: Sequence[Any], *, axes: Any = None) -> Any:
    """Rise of the cost over each parameter: axes (1 by parameters)."""
    made = _axes(axes, 1, len(found), size=(3.5, 2.6))[0]
    for place, profile in zip(made, found):
        points = sorted((p.value, p.rise) for p in profile.points)
        place.plot(*zip(*points), ".-", ms=4, lw=1)
        # where the cost is by so much above its minimum, chance explains it in 95 of 100 records
        place.axhline(0.5 * _WIDE**2 * profile.factor**2, lw=0.7, ls="--", color="0.5")
        for end in profile.ends:
            if end.get("at") is not None:
                place.axvline(end["at"], lw=0.7, color="0.5")
        place.set_xlabel(profile.name)
    made[0].set_ylabel("rise of the cost")
    return made


def spectra(found: Spectra, *, axes: Any = None) -> Any:
    """Magnitude, phase and coherence: axes (3 by pairs)."""
    made = _axes(axes, 3, len(found.pairs), sharex="col", size=(4.0, 2.0))
    for column, (output, input) in enumerate(found.pairs):
        response = found.response(output, input)
        made[0, column].semilogx(found.frequency, _decibels(response), ".-", ms=3, lw=1)
        made[1, column].semilogx(found.frequency, _degrees(response), ".-", ms=3, lw=1)
        made[2, column].semilogx(found.frequency, found.coherence(output, input), ".-", ms=3, lw=1)
        made[2, column].set_ylim(0, 1)
        made[0, column].set_title(f"{output} / {input}", fontsize="small")
        made[2, column].set_xlabel("cycles per unit of time")
    for row, label in zip(made, ("magnitude [dB]", "phase [deg]", "coherence")):
        row[0].set_ylabel(label)
    return made


# Notebooks


def table(title: str, heads: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table as HTML."""

    def cells(tag: str, row: Sequence[str]) -> str:
        return "".join(f"<{tag}>{html.escape(str(c))}</{tag}>" for c in row)

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    return f"<table><caption>{html.escape(title)}</caption><thead><tr>{cells('th', heads)}</tr></thead><tbody>{body}</tbody></table>"


def _pictures(files: Sequence[tuple[str, bytes]]) -> str:
    drawn = _fdm.figures_of(list(files), False)

    def part(drawing: tuple[str, str, str]) -> str:
        return f"<figure>{drawing[2]}<figcaption>{html.escape(drawing[1])}</figcaption></figure>"

    shown, rest = drawn[:_SHOWN], drawn[_SHOWN:]
    more = f"<details><summary>{len(rest)} more figures</summary>{''.join(map(part, rest))}</details>" if rest else ""
    return "".join(map(part, shown)) + more


def result(fit: Fit) -> str:
    """A fit: its table, remarks, and the page's own figures."""

    def error(p: Any) -> str:
        return "" if p.error is None else f"{p.error:.2g}"

    rows = [
        [p.name, p.run or "", f"{p.value:.6g}", error(p), p.unit or "", "" if p.status == "estimated" else p.status.replace("_", " ")]
        for p in fit.params.values()
    ]
    remarks = "".join(f"<li>{html.escape(r)}</li>" for r in fit.remarks)
    title = f"{fit.model.name}: {fit.message}" if fit.message else f"{fit.model.name}: equation error"
    return table(title, ["parameter", "run", "value", "error", "unit", ""], rows) + f"<ul>{remarks}</ul>" + _pictures(fit.files)


def with_figures(text: str, files: Sequence[tuple[str, bytes]]) -> str:
    """What is printed, and the page's own figures."""
    return f"<pre>{html.escape(text)}</pre>{_pictures(files)}"
