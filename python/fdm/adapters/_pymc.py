"""PyMC and PyTensor."""

from __future__ import annotations

from typing import Any

import numpy as np

from .._errors import NumericalError
from .._model import Residuals


def pymc_op(residuals: Residuals) -> Any:
    """A PyTensor operation: unknowns (U) and factors (q) to the logarithm of the likelihood, with its exact gradient, for NUTS.

    The factors multiply the deviations with which the residuals were prepared; prepared without any, they are the deviations of the
    outputs, which then may be sampled too.

    ::

        with pymc.Model():
            k = pymc.Normal("k", 0.5, 0.1)
            sigma = pymc.HalfNormal("sigma", 0.1)
            pymc.Potential("data", pymc_op(residuals)(pt.stack([k]), pt.stack([sigma])))
    """
    import pytensor.tensor as pt
    from pytensor.graph.basic import Apply
    from pytensor.graph.op import Op

    def evaluated(theta: Any, factors: Any) -> tuple[float, Any, Any]:
        try:
            r, J = residuals(theta)
        except NumericalError:
            return -np.inf, np.zeros(len(theta)), np.zeros(len(factors))
        squares = residuals.squares(r)
        value = -0.5 * (squares / factors**2).sum() - residuals.counts @ np.log(factors) - residuals.log_constant
        weights = 1.0 / factors[residuals.outputs] ** 2
        return value, -(r * weights) @ J, squares / factors**3 - residuals.counts / factors

    class Gradient(Op):
        def make_node(self, theta: Any, factors: Any) -> Any:
            return Apply(self, [theta, factors], [pt.dvector(), pt.dvector()])

        def perform(self, node: Any, inputs: Any, outputs: Any) -> None:
            _, outputs[0][0], outputs[1][0] = evaluated(*inputs)

    class LogLikelihood(Op):
        def make_node(self, theta: Any, factors: Any = None) -> Any:
            factors = np.ones(len(residuals.deviations)) if factors is None else factors
            return Apply(self, [pt.as_tensor(theta, dtype="float64"), pt.as_tensor(factors, dtype="float64")], [pt.dscalar()])

        def perform(self, node: Any, inputs: Any, outputs: Any) -> None:
            outputs[0][0] = np.array(evaluated(*inputs)[0])

        def grad(self, inputs: Any, gradients: Any) -> Any:
            return [gradients[0] * g for g in Gradient()(*inputs)]

    return LogLikelihood()
