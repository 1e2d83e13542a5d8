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


class _Task:
    """Drives a display of rich: `add_task`, `update`, `start`, `stop`."""

    def __init__(self, shown: Any, what: str):
        self.shown, self.what = shown, what
        # a display that runs already is its owner's
        self.own = not shown.live.is_started
        if self.own:
            shown.start()
        self.task = shown.add_task(what, total=None)
        self.last: dict[str, Any] | None = None

    def __call__(self, seen: dict[str, Any]) -> None:
        self.last = seen
        doing = " ".join(seen["doing"].split())
        done = seen["done"] if seen["total"] else seen["iteration"] or 0
        self.shown.update(self.task, description=f"{self.what}: {doing}" if doing else self.what, total=seen["total"], completed=done)

    def close(self) -> None:
        total = self.last["total"] if self.last else None
        self.shown.update(self.task, total=total or 1, completed=total or 1)
        if self.own:
            self.shown.stop()


@contextlib.contextmanager
def telling(progress: Any, what: str) -> Iterator[Callable[[dict[str, Any]], None] | None]:
    """What the extension is to call while it works.

    progress: ``None`` for a bar of tqdm where that is installed and somebody looks; ``False`` for nothing; tqdm's class or a bar of it;
        a `rich.progress.Progress`; or a function of a dictionary with the keys ``doing``, ``iteration``, ``cost``, ``step``, ``values``, ``done``, ``total``,
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
    elif hasattr(progress, "add_task") and hasattr(progress, "live"):
        task = _Task(progress, what)
        try:
            yield task
        finally:
            task.close()
    elif callable(progress):
        yield progress
    else:
        raise TypeError(f"progress is None, False, tqdm, a display of rich or a function, not {type(progress).__name__}")
