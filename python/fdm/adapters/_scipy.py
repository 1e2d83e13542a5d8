"""SciPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._errors import NumericalError
from .._model import Residuals


def scipy_least_squares(residuals: Residuals, strict: bool = False, **options: Any) -> Any:
    """`scipy.optimize.least_squares` of prepared residuals, with their exact Jacobian and the bounds of the model.

    strict: a trial point that cannot be simulated ends the search with `fdm.NumericalError`. Otherwise its residuals are so large that
        SciPy steps back to where the model can be simulated; the start values must be such a point.
    options: those of SciPy; ``x0`` is the start values unless it is given. The result has ``names`` beside ``x``.
    """
    from scipy.optimize import least_squares

    greatest = 0.0

    def r(theta: Any) -> Any:
        nonlocal greatest
        try:
            found = residuals.r(theta)
        except NumericalError:
            # no point was seen yet: there is none to step back to
            if strict or not greatest:
                raise
            # the cost is a thousand times that of any point that was seen, and no step to it is taken
            return np.full(len(residuals), np.sqrt(1e3 * greatest / len(residuals)))
        greatest = max(greatest, float(found @ found), np.finfo(float).tiny)
        return found

    given = {"x0": residuals.start, "bounds": residuals.bounds, "x_scale": "jac", **options}
    found = least_squares(r, jac=residuals.J, **given)
    found.names = residuals.names
    return found
