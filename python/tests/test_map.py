"""Jobs over several programs: whatever starts the shards, the result is that of the one command."""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from concurrent.futures import Future, ProcessPoolExecutor, ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import fdm

from conftest import DECAY, plain


@pytest.fixture
def desk(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "decay.fdm").write_text(DECAY)
    t = np.linspace(0, 8, 50)
    y = np.exp(-0.5 * t) + 0.01 * np.random.default_rng(1).standard_normal(50)
    rows = "".join(f"{a},{b}\n" for a, b in zip(t, y, strict=True))
    (tmp_path / "run.csv").write_text("t [s],y\n" + rows)
    monkeypatch.chdir(tmp_path)
    return tmp_path


JOB: dict[str, Any] = {"command": "study", "model": "decay.fdm", "data": ["run.csv"], "repeats": 20, "seed": 3}


def whole() -> Any:
    words = ["study", "decay.fdm", "--data", "run.csv", "--repeats", "20", "--seed", "3", "--json", "-q"]
    done = subprocess.run([sys.executable, "-m", "fdm", *words], capture_output=True, text=True, check=True)
    return json.loads(done.stdout)


def test_an_executor_or_nothing_gives_what_the_command_gives(desk: Path) -> None:
    expected = whole()
    assert plain(fdm.map(JOB, shards=3, out="a").document) == expected
    with ThreadPoolExecutor(2) as pool:
        found = fdm.map(JOB, pool, shards=2, out="b")
    assert plain(found.document) == expected and found.good
    assert "20 repeats" in found.text
    with ProcessPoolExecutor(1) as pool:
        assert fdm.map(JOB, pool, shards=2, out="c").good


class Losing:
    """An executor that loses every second call."""

    def __init__(self) -> None:
        self.calls, self.lock = 0, threading.Lock()

    def submit(self, function: Any, *arguments: Any) -> Future[Any]:
        future: Future[Any] = Future()
        with self.lock:
            self.calls += 1
        if self.calls % 2:
            future.set_exception(RuntimeError("the worker is gone"))
        else:
            future.set_result(function(*arguments))
        return future


def test_lost_shards_are_started_again(desk: Path) -> None:
    client = Losing()
    assert plain(fdm.map(JOB, client, shards=3, out="a").document) == whole()
    assert client.calls > 3


class Deserted(ThreadPoolExecutor):
    """Dask's client, whose workers come late."""

    def __init__(self) -> None:
        super().__init__(1)
        self.asked = 0

    def ncores(self) -> dict[str, int]:
        self.asked += 1
        return {} if self.asked < 3 else {"tcp://here": 1}

    def submit(self, function: Any, *arguments: Any, **how: Any) -> Future[Any]:  # type: ignore[override]
        def late() -> Any:
            while self.asked < 3:
                time.sleep(0.01)
            return function(*arguments)

        return super().submit(late)


def test_that_dask_has_no_workers_is_said_once(desk: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("fdm._map._PATIENCE", 0.05)
    with Deserted() as client, pytest.warns(RuntimeWarning, match="no workers") as said:
        assert fdm.map(JOB, client, shards=1, out="a").good
    assert len(said) == 1


def test_what_cannot_be_done_is_told(desk: Path) -> None:
    with pytest.raises(fdm.InputError, match="did you mean `repeats`"):
        fdm.map({**JOB, "repeatz": 3})
    with pytest.raises(TypeError, match="no client"):
        fdm.map(JOB, 3)
    with pytest.raises(fdm.NumericalError, match="shards did not end"):
        fdm.map(JOB, Losing(), shards=1, retries=0, out="a")
    assert not list(desk.glob("job-*.toml"))
