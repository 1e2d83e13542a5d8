"""How far long work is: a bar, or a function of the user."""

from __future__ import annotations

import contextlib
import sys
import time
from collections.abc import Callable, Iterator
from typing import Any

# Work that ends sooner shows nothing
_DELAY = 0.7


def _interactive() -> bool:
    kernel = "ipykernel" in sys.modules and "IPython" in sys.modules
    return kernel or bool(getattr(sys.stderr, "isatty", lambda: False)())


class _Bar:
    """Drives anything with tqdm's protocol: `total`, `n`, `refresh`, `set_description_str`, `close`."""

    def __init__(self, made: Any, what: str):
        self.made, self.what, self.bar, self.begun = made, what, None, time.monotonic()
        if not isinstance(made, type):
            self.bar = made

    def __call__(self, seen: dict[str, Any]) -> None:
        if self.bar is None:
            if time.monotonic() - self.begun < _DELAY:
                return
            self.bar = self.made(total=seen["total"], desc=self.what, leave=False)
        if seen["total"]:
            self.bar.total, self.bar.n = seen["total"], seen["done"]
        elif seen["iteration"] is not None:
            self.bar.n = seen["iteration"]
        doing = " ".join(seen["doing"].split())
        self.bar.set_description_str(f"{self.what}: {doing}" if doing else self.what, refresh=False)
        self.bar.refresh()

    def close(self) -> None:
        if self.bar is not None and isinstance(self.made, type):
            self.bar.close()


@contextlib.contextmanager
def telling(progress: Any, what: str) -> Iterator[Callable[[dict[str, Any]], None] | None]:
    """What the extension is to call while it works.

    progress: ``None`` for a bar of tqdm where that is installed and somebody looks; ``False`` for nothing; tqdm's class or a bar of it;
        or a function of a dictionary with the keys ``doing``, ``iteration``, ``cost``, ``step``, ``values``, ``done``, ``total``,
        which is called some times a second on the thread of the caller. What it raises ends the work; ``StopIteration`` does so
        with the best so far.
    """
    if progress is None or progress is True:
        try:
            from tqdm.auto import tqdm as bar
        except ImportError:
            bar = None
        progress = bar if bar is not None and (progress is True or _interactive()) else False
    if progress is False:
        yield None
    elif hasattr(progress, "set_description_str") and hasattr(progress, "refresh"):
        driven = _Bar(progress, what)
        try:
            yield driven
        finally:
            driven.close()
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress is None, False, tqdm or a function, not {type(progress).__name__}")
