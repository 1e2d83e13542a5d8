"""fdm for other packages: each adapter is some lines around `fdm.Model.prepare`, and needs its package only when it is called.

================== ==========================================================================
`pypesto_objective` pyPESTO: value, gradient, Fisher matrix, residuals and their sensitivities
`pymc_op`           PyMC and PyTensor: log-likelihood with its gradient, for NUTS
`emcee_log_density` emcee and other samplers without gradients: log-posterior
`sklearn_estimator` scikit-learn: fit, predict, score; cross-validation over runs
`control_ss`        python-control: state space
`scipy_least_squares` SciPy: residuals and Jacobian
`jax_residuals`     JAX: residuals with a custom derivative
================== ==========================================================================
"""

from ._control import control_ss
from ._emcee import emcee_log_density
from ._jax import jax_residuals
from ._pymc import pymc_op
from ._pypesto import pypesto_objective
from ._scipy import scipy_least_squares
from ._sklearn import sklearn_estimator

__all__ = [
    "control_ss",
    "emcee_log_density",
    "jax_residuals",
    "pymc_op",
    "pypesto_objective",
    "scipy_least_squares",
    "sklearn_estimator",
]
