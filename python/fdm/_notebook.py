"""Models written in Python files and notebooks: mistakes are told at their own line."""

from __future__ import annotations

import linecache
import sys
import warnings
from typing import Any

from . import _fdm
from ._errors import ModelError, ModelWarning
from ._model import Model


def model(text: str, name: str | None = None) -> Model:
    """The model of a text that stands in this Python file or cell.

    ::

        m = fdm.model(\"\"\"
        model decay { state x = 1; param k = 0.5 [1/s]; der(x) = -k*x; output y = x; }
        \"\"\")

    Mistakes and warnings are told with file, line and column where the text stands, when it is found there as it is.
    """
    frame = sys._getframe(1)
    file, line = frame.f_code.co_filename, frame.f_lineno
    place = _place("".join(linecache.getlines(file, frame.f_globals)), text, line)
    if name is not None or place is None:
        return Model.from_text(text, name or "model.fdm")
    row, column = place
    return placed(text, file, row, column)


def _place(source: str, text: str, line: int) -> tuple[int, int] | None:
    """Line and column, from 0, where the text stands in a source; the place that is nearest to the line where there are several."""
    places, at = [], source.find(text)
    while at >= 0 and text.strip():
        places.append(at)
        at = source.find(text, at + 1)
    rows = [(source.count("\n", 0, at), at - (source.rfind("\n", 0, at) + 1)) for at in places]
    return min(rows, key=lambda r: abs(r[0] + 1 - line), default=None)


def placed(text: str, file: str, row: int, column: int = 0) -> Model:
    """The model of a text; findings are told in a file, behind so many lines and columns."""
    before = "\n" * row + " " * column
    try:
        made = _fdm.Model.from_text("model.fdm", text)
    except ModelError:
        made = None
    # the same mistakes, where the reader sees the text
    made = made or _fdm.Model.from_text(file, before + text)
    found = Model._of(made)
    if made.warnings()[0]:
        _, said = _fdm.Model.from_text(file, before + text).warnings()
        warnings.warn("\n" + said.rstrip(), ModelWarning, stacklevel=3)
    return found


def load_ipython_extension(shell: Any) -> None:
    """``%load_ext fdm``: the cell magic ``%%fdm NAME`` makes the model of the cell's text, under that name.

    A mistake is told at its line in the cell; the first line, ``%%fdm``, is line 1.
    """

    def cell(line: str, text: str) -> Any:
        name = line.strip()
        if name and not name.isidentifier():
            raise ModelError(f"%%fdm takes the name of a variable, not `{name}`", [_misnamed(name)])
        try:
            made = placed(text, "<cell>", 1)
        except ModelError as error:
            # the traceback says nothing that the message does not
            print(error, file=sys.stderr)
            shell.user_ns["_fdm_error"] = error
            return None
        if name:
            shell.user_ns[name] = made
            return None
        return made

    shell.register_magic_function(cell, magic_kind="cell", magic_name="fdm")


def _misnamed(name: str) -> dict[str, Any]:
    return {
        "code": "", "title": "", "error": True, "message": f"`{name}` is no name of a variable", "hint": "write %%fdm m", "file": "<cell>",
        "line": 1, "column": 7, "end_line": 1, "end_column": 7 + len(name), "excerpt": name, "labels": [],
    }  # fmt: skip
