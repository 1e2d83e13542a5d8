"""Models and records that the tests share."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import pytest

import fdm

matplotlib.use("Agg")
ROOT = Path(__file__).resolve().parents[2]
MODELS = ROOT / "models"

DECAY = "model decay { state x [1] = 1; param k = 0.2 in [0, 5] [1/s]; der(x) = -k*x; output y [1] = x; }"
ROLL = """model roll "a roll axis" {
  input aileron [deg];
  state p [rad/s], phi [rad];
  param d = 0.5 in [0, 5] [1/s], k = 1.5 in [0, 50] [1/s^2], b = 1.0 [1/s^2];
  der(p) = -d*p - k*phi + b*deg2rad(aileron);
  der(phi) = p;
  output p_m [deg/s] = rad2deg(p);
  output phi_m [rad] = phi;
}"""


@pytest.fixture(scope="session")
def tanker() -> fdm.Model:
    return fdm.Model(MODELS / "ship_roll_decay/model.fdm")


@pytest.fixture(scope="session")
def tanker_run() -> Path:
    return MODELS / "ship_roll_decay/run.csv"


@pytest.fixture(scope="session")
def tanker_fit(tanker: fdm.Model, tanker_run: Path) -> fdm.Fit:
    return tanker.fit(tanker_run)


@pytest.fixture(scope="session")
def decay() -> fdm.Model:
    return fdm.Model.from_text(DECAY)


@pytest.fixture(scope="session")
def roll() -> fdm.Model:
    return fdm.Model.from_text(ROLL)


def decaying(k: float = 0.5, n: int = 200, seed: int = 1, name: str = "decay") -> fdm.Run:
    """A noisy record of the model `decay`."""
    t = np.linspace(0, 8, n)
    y = np.exp(-k * t) + 0.01 * np.random.default_rng(seed).standard_normal(n)
    return fdm.Run(t=t, outputs={"y": y}, name=name)


def rolling(roll: fdm.Model, seed: int = 0, n: int = 800, name: str = "roll") -> fdm.Run:
    """A record of the model `roll`, excited by steps, with noise."""
    rng = np.random.default_rng(seed)
    t = 0.025 * np.arange(n)
    aileron = np.repeat(rng.choice([-5.0, 0.0, 5.0], n // 40 + 1), 40)[:n]
    run = fdm.Run(t=t, inputs={"aileron": aileron})
    y = roll.simulate(run, {"d": 0.8, "k": 2.0, "b": 3.0}).outputs
    noisy = y + rng.standard_normal(y.shape) * [0.3, 0.005]
    return fdm.Run(t=t, inputs={"aileron": aileron}, outputs={"p_m": noisy[:, 0], "phi_m": noisy[:, 1]}, name=name)


def command(*words: str | os.PathLike[str], cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    """The command of the same package."""
    return subprocess.run(
        [sys.executable, "-m", "fdm", *map(str, words)], cwd=cwd, capture_output=True, text=True, check=False, timeout=600
    )


def plain(value: Any) -> Any:
    """A document as JSON's reader would give it."""
    if isinstance(value, fdm._documents.Document):
        return {k: plain(v) for k, v in value.items()}
    return [plain(v) for v in value] if isinstance(value, list) else value
