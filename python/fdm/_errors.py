"""What is refused, and what is warned of. Every exception says what is wrong, where, and what would mend it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class Finding:
    """One finding about the text of a model."""

    code: str
    """Stable code, such as ``E0201``; ``fdm explain CODE`` says more."""
    title: str
    """What the code stands for."""
    error: bool
    """An error, or else a warning."""
    message: str
    """What is wrong, in one sentence."""
    hint: str | None
    """What would mend it: the nearest name or form."""
    file: str
    """The text that it is in."""
    line: int
    """From 1."""
    column: int
    """From 1, in characters."""
    end_line: int
    end_column: int
    excerpt: str
    """The part of the text that is meant."""
    labels: tuple[tuple[int, int, str], ...] = ()
    """Further places: line, column, and what they are."""

    def __str__(self) -> str:
        kind = "error" if self.error else "warning"
        hint = f"; {self.hint}" if self.hint else ""
        return f"{self.file}:{self.line}:{self.column}: {kind}[{self.code}]: {self.message}{hint}"


@dataclass(frozen=True)
class Problem:
    """One problem of a recorded file."""

    file: str
    line: int | None
    """Line as an editor counts them, from 1; none where the problem is not in one line."""
    column: str | None
    """Title of the column."""
    message: str
    hint: str | None
    """What would mend it."""


def findings(dictionaries: Sequence[dict[str, Any]]) -> list[Finding]:
    """Findings as the extension hands them over."""
    return [Finding(**{**d, "labels": tuple(d["labels"])}) for d in dictionaries]


class Error(Exception):
    """Anything that fdm refuses. Every one says what it is, where, and where it can what would mend it."""

    code: str = "error"
    """Of a model's text a stable code, such as ``E0201`` (``fdm explain CODE`` says more); else ``unreadable``, ``record``, ``run``,
    ``input``, ``option``, ``unknown_option`` or ``numbers``."""
    place: str | None = None
    """File with line and column, run, or option."""
    hint: str | None = None
    """What would mend it: the nearest name or form."""


class UnreadableError(Error, OSError):
    """A model's file that cannot be read."""

    code = "unreadable"

    def __init__(self, file: str, reason: str):
        super().__init__(f"{file}: {reason}")
        self.file, self.reason, self.place, self.hint = file, reason, file, _hint(reason)


class ModelError(Error, ValueError):
    """A text that is no model. All mistakes come at once, in `diagnostics`.

    `code`, `place`, `file`, `line`, `column`, `message` and `hint` are those of the first error.
    """

    def __init__(self, text: str, diagnostics: Sequence[dict[str, Any]]):
        super().__init__(text.rstrip())
        self.diagnostics: list[Finding] = findings(diagnostics)
        first = next((d for d in self.diagnostics if d.error), self.diagnostics[0])
        self.code, self.file, self.line, self.column = first.code, first.file, first.line, first.column
        self.message, self.hint = first.message, first.hint or _hint(first.message)
        self.place = f"{first.file}:{first.line}:{first.column}"

    def __str__(self) -> str:
        return "\n" + str(self.args[0])


class RecordError(Error, ValueError):
    """Files that cannot be used as runs. All problems come at once, in `problems`.

    `place`, `file`, `line`, `column` and `hint` are those of the first one.
    """

    code = "record"

    def __init__(self, text: str, problems: Sequence[dict[str, Any]]):
        super().__init__(text)
        self.problems: list[Problem] = [Problem(**p) for p in problems]
        first = self.problems[0]
        self.file, self.line, self.column, self.hint = first.file, first.line, first.column, first.hint or _hint(first.message)
        line = "" if self.line is None else f":{self.line}"
        self.place = f"{self.file}{line}" + ("" if self.column is None else f": {self.column}")


class RunError(Error, ValueError):
    """Samples in memory that cannot be used as a run. All faults come at once, in `faults`."""

    code = "run"

    def __init__(self, text: str, run: str, faults: Sequence[str]):
        super().__init__(text)
        self.run: str = run
        self.faults: list[str] = list(faults)
        self.place, self.hint = f"run `{run}`", _hint(text)


class InputError(Error, ValueError):
    """Anything else that is wrong with the input; `reasons` has one sentence for each."""

    code = "input"

    def __init__(self, reasons: Sequence[str]):
        self.reasons: list[str] = [in_python(r) for r in reasons]
        super().__init__("\n".join(self.reasons))
        self.place, self.hint = _quoted(self.reasons[0]) if self.reasons else None, _hint(str(self))


class SampleError(InputError, TypeError):
    """Samples in memory that are no numbers, such as a column of text."""

    def __init__(self, said: str):
        super().__init__([said])


class OptionError(Error, ValueError):
    """A value that an option does not take."""

    code = "option"

    def __init__(self, said: str):
        super().__init__(in_python(said))
        self.place, self.hint = _quoted(str(self)), _hint(str(self))


class UnknownOption(OptionError, TypeError):
    """An option that does not exist, or that only the command has; `option` is its name."""

    code = "unknown_option"

    def __init__(self, said: str, option: str):
        super().__init__(said)
        self.option: str = option.replace("-", "_")
        self.place = self.option


class NumericalError(Error, ArithmeticError):
    """The input may be good, but numbers went wrong."""

    code = "numbers"


class ModelWarning(UserWarning):
    """A finding about a model that does not stop its use."""


class ResultWarning(UserWarning):
    """Something about a result that should not be overlooked."""


class InterruptedWarning(ResultWarning):
    """Work was stopped; the result is the best so far."""


def _hint(said: str) -> str | None:
    """What a sentence proposes: the nearest name, what there is, or what is taken."""
    found = _PROPOSED.search(said)
    return found[0].strip(" ;,.()[]") if found else None


_PROPOSED = re.compile(
    r"did you mean [^;\n]*|is it what was given as [^;\n]*|possible values: [^\]\n]*|(there (is|are)|its channels are|its groups are|give|use|or use|expected) .*"
)


def _quoted(said: str) -> str | None:
    """The first name in a sentence."""
    found = re.search(r"`([^`]+)`|'([^']+)'", said)
    return (found[1] or found[2]) if found else None


def in_python(said: str) -> str:
    """A sentence about options of the command, in the words of a call: ``--start-values`` is ``start_values``."""
    words = said.split("--")
    for k, word in enumerate(words[1:], start=1):
        length = next((i for i, c in enumerate(word) if not (c.isalnum() or c == "-")), len(word))
        if length and word[0].isalpha():
            name = word[:length].rstrip("-")
            words[k] = f"`{name.replace('-', '_')}`{word[len(name) :]}"
        else:
            words[k] = "--" + word
    return "".join(words)
