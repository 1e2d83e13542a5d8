"""pyPESTO."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._errors import NumericalError
from .._model import Residuals


def pypesto_objective(residuals: Residuals, log10: bool | list[bool] = False, estimate_noise: bool = False) -> Any:
    """A `pypesto.Objective`: minus the log-likelihood, its gradient and Fisher matrix, residuals and their sensitivities.

    log10: whether the unknowns are logarithms, of all or one by one. Bounds are ``residuals.bounds``; names are set.
    estimate_noise: the deviation of each output has its likeliest value at every point (concentrated likelihood); there are then no
        residuals, whose squares are the objective.
    """
    import pypesto

    logs = np.broadcast_to(log10, len(residuals.start))

    def residual(x: Any) -> tuple[Any, Any]:
        theta = np.where(logs, 10.0 ** np.where(logs, x, 0), x)
        try:
            r, J = residuals(theta)
        except NumericalError:
            return np.full(len(residuals), np.inf), np.full((len(residuals), len(theta)), np.nan)
        return r, J * np.where(logs, np.log(10) * theta, 1.0)

    def objective(x: Any) -> tuple[float, Any, Any]:
        r, J = residual(x)
        if not np.isfinite(r).all():
            return np.inf, np.full(len(x), np.nan), np.full((len(x), len(x)), np.nan)
        factors, counts = np.ones(len(residuals.deviations)), residuals.counts
        if estimate_noise:
            factors = np.sqrt(residuals.squares(r) / np.maximum(counts, 1))
        weighted = r / factors[residuals.outputs]
        J = J / factors[residuals.outputs, None]
        value = 0.5 * (weighted @ weighted) + counts[counts > 0] @ np.log(factors[counts > 0]) + residuals.log_constant
        return float(value), weighted @ J, J.T @ J

    names = [n if isinstance(n, str) else "/".join(n) for n in residuals.names]
    squares = not estimate_noise
    return pypesto.Objective(fun=objective, grad=True, hess=True, res=residual if squares else None, sres=squares, x_names=names)
