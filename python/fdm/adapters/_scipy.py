"""SciPy."""

from __future__ import annotations

from typing import Any

from .._model import Residuals


def scipy_least_squares(residuals: Residuals, **options: Any) -> Any:
    """`scipy.optimize.least_squares` of prepared residuals, with their exact Jacobian and the bounds of the model.

    options: those of SciPy; ``x0`` is the start values unless it is given. The result has ``names`` beside ``x``.
    """
    from scipy.optimize import least_squares

    given = {"x0": residuals.start, "bounds": residuals.bounds, "x_scale": "jac", **options}
    found = least_squares(residuals.r, jac=residuals.J, **given)
    found.names = residuals.names
    return found
