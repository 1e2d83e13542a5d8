"""Results as the command prints them with ``--json``: keys are attributes too."""

from __future__ import annotations

import csv
import io
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray


class Document(Mapping[str, Any]):
    """A part of a result: ``part["key"]`` and ``part.key`` are the same. Keys are those of ``--json``."""

    __slots__ = ("_keys",)

    def __init__(self, keys: Mapping[str, Any]):
        self._keys = keys

    def __getitem__(self, key: str) -> Any:
        return wrapped(self._keys[key])

    def __getattr__(self, key: str) -> Any:
        if key.startswith("_") or key not in self._keys:
            raise AttributeError(f"there is no `{key}`; there are {', '.join(self._keys)}")
        return self[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._keys)

    def __len__(self) -> int:
        return len(self._keys)

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._keys]

    def __repr__(self) -> str:
        return f"Document({', '.join(self._keys)})"

    def __reduce__(self) -> Any:
        return Document, (dict(self._keys),)


def wrapped(value: Any) -> Any:
    """Dictionaries as documents, in lists too."""
    if isinstance(value, dict):
        return Document(value)
    if isinstance(value, list) and value and isinstance(value[0], dict):
        return [wrapped(v) for v in value]
    return value


def columns(content: bytes) -> list[tuple[str, NDArray[np.float64]]]:
    """Titles and numbers of a table that fdm wrote; empty cells are NaN."""
    lines = io.StringIO(content.decode())
    titles = next(csv.reader(lines))
    numbers = np.genfromtxt(lines, delimiter=",", ndmin=2)
    return [(title, np.ascontiguousarray(numbers[:, k])) for k, title in enumerate(titles)]


def frame(columns: Mapping[str, Any], kind: str) -> Any:
    """Columns as ``"pandas"`` or ``"polars"`` frame, or as ``"dict"``."""
    if kind == "pandas":
        import pandas

        return pandas.DataFrame(dict(columns))
    if kind == "polars":
        import polars

        return polars.DataFrame(dict(columns))
    if kind == "dict":
        return dict(columns)
    raise ValueError(f"a table is made as 'pandas', 'polars', 'dict' or 'text', not {kind!r}")
