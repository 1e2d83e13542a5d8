"""Jobs over many machines: the shards of a plan, started by Dask, Ray, or any executor of `concurrent.futures`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import tempfile
import warnings
from collections.abc import Callable, Mapping
from concurrent.futures import Executor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

from ._documents import wrapped
from ._errors import InputError, NumericalError

_PATIENCE = 30
"""Seconds that Dask may be silent before its workers are counted."""


class Mapped:
    """What came of a job: `document` as with ``--json``, where it has one result; `good` where the command ends with 0."""

    document: Any
    good: bool
    out: Path
    """The folder with the results of all tasks."""

    def __init__(self, document: Any, good: bool, out: Path):
        self.document, self.good, self.out = document, good, out

    @property
    def text(self) -> str:
        """What the command prints."""
        return _command(["job", "merge", str(self.out), "--quiet"])[1]

    def __str__(self) -> str:
        return self.text

    def __repr__(self) -> str:
        return f"{type(self).__name__}({str(self.out)!r}, good={self.good})"


def _command(words: list[str], cwd: str | None = None) -> tuple[int, str, str]:
    """What the command does in a process of its own: a worker that is lost takes no state with it."""
    # a sentence a line
    environment = {**os.environ, "COLUMNS": "100000"}
    done = subprocess.run([sys.executable, "-m", "fdm", *words], capture_output=True, text=True, cwd=cwd, env=environment, check=False)
    return done.returncode, done.stdout, done.stderr


def _plan(job: str | os.PathLike[str] | Mapping[str, Any], untimed: bool) -> Path:
    if isinstance(job, Mapping):
        # in the working directory, since paths in a job are relative to its folder
        with tempfile.NamedTemporaryFile("w", prefix="job-", suffix=".toml", dir=".", delete=False) as file:
            file.write("".join(f"{json.dumps(str(k))} = {_toml(v)}\n" for k, v in job.items()))
        try:
            return _plan(file.name, untimed)
        finally:
            os.unlink(file.name)
    path = Path(os.fspath(job)).absolute()
    if path.suffix != ".toml":
        return path
    code, _, said = _command(["job", "plan", str(path), "--quiet", *(["--untimed"] if untimed else [])])
    if code:
        raise _refused(said) if code == 2 else NumericalError(said.strip())
    return path.with_suffix(".plan")


def _refused(said: str) -> InputError:
    """What the command told, a sentence a line."""
    return InputError([line.removeprefix("error: ") for line in said.strip().splitlines() if line])


def _toml(value: Any) -> str:
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{json.dumps(str(k))} = {_toml(v)}" for k, v in value.items()) + "}"
    if isinstance(value, (list, tuple)):
        return "[" + ", ".join(_toml(v) for v in value) + "]"
    if isinstance(value, os.PathLike):
        return json.dumps(os.fspath(value))
    # strings, numbers and truths are written as in JSON
    return json.dumps(value)


def _starter(client: Any) -> tuple[Callable[[list[str]], Any], Callable[[Any], tuple[int, str, str]]]:
    """How a client starts the command with these words, and how it waits for the end."""
    if hasattr(client, "remote") and hasattr(client, "get"):
        started = client.remote(_command).options(num_cpus=1, max_retries=-1)
        return started.remote, client.get
    if hasattr(client, "scheduler_info") or hasattr(client, "ncores"):
        # Dask takes equal calls for the same call, unless it is told otherwise
        return (lambda words: client.submit(_command, words, pure=False, retries=3)), (lambda future: _awaited(client, future))
    if hasattr(client, "submit"):
        return (lambda words: client.submit(_command, words)), (lambda future: future.result())
    raise TypeError(f"{client!r} is no client of Dask, not Ray, and no executor of concurrent.futures")


def _awaited(client: Any, future: Any) -> tuple[int, str, str]:
    """The end of a shard. Dask waits in silence for workers that may never come: that is said, once a wait."""
    import asyncio  # its error is Python's own from 3.11 on

    said = False
    while True:
        try:
            return future.result(timeout=_PATIENCE)
        except (TimeoutError, asyncio.TimeoutError):
            if client.ncores():
                said = False
            elif not said:
                said = True
                warnings.warn(
                    f"Dask has no workers: {client!r} waits for new ones. What is done is kept, and is not done again.",
                    RuntimeWarning,
                    stacklevel=5,
                )


def map(
    job: str | os.PathLike[str] | Mapping[str, Any],
    client: Any = None,
    *,
    shards: int | None = None,
    out: str | os.PathLike[str] | None = None,
    threads: int = 1,
    retries: int = 100,
) -> Mapped:
    """Does a job on the machines of a client, and merges it: the result is that of the one command, to the bit.

    ::

        with dask.distributed.Client() as client:
            fdm.map("study.toml", client, shards=200)
        fdm.map("study.toml", ray)
        with ProcessPoolExecutor() as pool:
            fdm.map("study.toml", pool)
        fdm.map({"command": "study", "model": "wing.fdm", "data": "run.csv", "repeats": 10000})

    job: a job file (``.toml``), a plan that ``fdm job plan`` made, or the keys of a job file. client: a client of Dask, the module ``ray``, an
    executor, or nothing for the cores of this machine. shards: parts that are started one by one; more of them are evener, and lose less
    with a worker [default: 4 for each core of this machine]. out: folder of the results, which all machines see and which stays;
    what is in it already is not done again [default: beside the plan, with the ending ``.tasks``]. threads: of each shard. retries: how
    often a shard that was lost is started again.

    Raises `InputError` where the job cannot be done, and `NumericalError` where tasks were lost for good.
    """
    plan = _plan(job, untimed=True)
    folder = Path(out).absolute() if out is not None else plan.with_suffix(".tasks")
    count = shards or 4 * (os.cpu_count() or 1)
    own: Executor | None = None
    if client is None:
        client = own = ThreadPoolExecutor(os.cpu_count() or 1)
    try:
        _shards(client, plan, folder, (count, threads, retries))
    finally:
        if own is not None:
            own.shutdown()
    return _merged(plan, folder)


def _shards(client: Any, plan: Path, folder: Path, how: tuple[int, int, int]) -> None:
    count, threads, retries = how
    begin, end = _starter(client)

    def words(shard: int) -> list[str]:
        place = ["--shard", f"{shard}/{count}", "--out", str(folder), "--threads", str(threads)]
        return ["job", "run", str(plan), *place, "--quiet"]

    left, said = list(range(1, count + 1)), ""
    for _ in range(retries + 1):
        begun, lost = [], []
        for shard in left:
            begun.append((shard, begin(words(shard))))
        for shard, future in begun:
            try:
                code, _, said = end(future)
            except Exception as e:  # whatever the engine raises where a worker is lost
                code, said = 1, str(e)
            if code == 2:
                raise _refused(said)
            if code:
                lost.append(shard)
        left = lost
        if not left:
            return
    raise NumericalError(f"{len(left)} of {count} shards did not end: {said.strip()}")


def _merged(plan: Path, folder: Path) -> Mapped:
    # several results have a folder each, and no common document
    one = len(json.loads(plan.read_text(encoding="utf-8"))["commands"]) == 1
    code, text, said = _command(["job", "merge", str(folder), "--quiet", *(["--json"] if one else [])])
    if code == 2:
        raise _refused(said)
    if code and not text:
        raise NumericalError(said.strip())
    return Mapped(wrapped(json.loads(text)) if one else None, code == 0, folder)
