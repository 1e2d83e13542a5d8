"""python-control."""

from __future__ import annotations

from typing import Any

from .._fit import Fit
from .._model import Model


def control_ss(subject: Model | Fit, **options: Any) -> Any:
    """A `control.StateSpace` of a model at its start values, or of a fit at its estimates, with the names of states, inputs and outputs.

    options: those of `Model.linear` or `Fit.linear`.
    """
    return subject.linear(**options).to_control()
