"""emcee, and any sampler that wants a log-density."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._errors import NumericalError
from .._model import Residuals


def emcee_log_density(residuals: Residuals, log_prior: Callable[[Any], float] | None = None) -> Callable[[Any], float]:
    """Logarithm of the posterior density of the unknowns (U), up to a constant.

    log_prior: of the unknowns (U), beside the priors and bounds of the model. Where the simulation is not finite the density is zero.

    ::

        sampler = emcee.EnsembleSampler(32, len(residuals.start), emcee_log_density(residuals))
    """

    def density(theta: Any) -> float:
        prior = residuals.log_prior(theta) + (log_prior(theta) if log_prior else 0.0)
        if not np.isfinite(prior):
            return -np.inf
        try:
            value = prior + residuals.log_likelihood(theta)
        except NumericalError:
            return -np.inf
        return value if np.isfinite(value) else -np.inf

    return density
