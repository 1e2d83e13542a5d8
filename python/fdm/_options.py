"""Options of a call become the words of the command, so that names, defaults and refusals are the same."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from typing import Any

# One value that is a list, not an option that is given several times
_LISTS = {"continuation"}
# What stands between the two parts of a pair
_PAIRS = {"band": ":", "pair": "/"}


def _value(value: Any) -> str:
    if isinstance(value, bool) or value is None:
        raise TypeError(f"{value!r} is no value of an option")
    if isinstance(value, (int, str, os.PathLike)):
        return os.fspath(value) if isinstance(value, os.PathLike) else str(value)
    # all digits, so that the bits are the same
    return repr(float(value)) if hasattr(value, "__float__") else str(value)


def _values(name: str, value: Any) -> list[str]:
    if isinstance(value, Mapping):
        return [f"{key}={_value(v)}" for key, v in value.items()]
    if name in _PAIRS and isinstance(value, (tuple, list)) and len(value) == 2 and not isinstance(value[0], (tuple, list)):
        return [_PAIRS[name].join(_value(v) for v in value)]
    if isinstance(value, (str, os.PathLike)) or not isinstance(value, Iterable):
        return [_value(value)]
    values = [_values(name, v)[0] for v in value]
    return [",".join(values)] if name in _LISTS else values


def words(options: Mapping[str, Any]) -> list[str]:
    """The words of the command for these options; ``None`` and ``False`` stand for options that are not given."""
    found: list[str] = []
    for key, value in options.items():
        name = key.rstrip("_")
        option = "--" + name.replace("_", "-")
        if value is None or value is False:
            continue
        if value is True:
            found.append(option)
            continue
        found.extend(f"{option}={v}" for v in _values(name, value))
    return found


def listed(names: str | Iterable[str] | None) -> list[str]:
    """One name or several, as a list."""
    if names is None:
        return []
    return [names] if isinstance(names, str) else list(names)
