"""JAX."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from .._model import Residuals


def jax_residuals(residuals: Residuals) -> Callable[[Any], Any]:
    """A JAX function: unknowns (U) to residuals (R), with a custom reverse derivative from the exact Jacobian.

    It can be jitted and differentiated once. Needs ``jax.config.update("jax_enable_x64", True)``.
    """
    import jax
    import jax.numpy as jnp

    rows, width = len(residuals), len(residuals.start)
    vector, matrix = jax.ShapeDtypeStruct((rows,), jnp.float64), jax.ShapeDtypeStruct((rows, width), jnp.float64)

    @jax.custom_vjp
    def value(theta: Any) -> Any:
        return jax.pure_callback(lambda t: residuals.r(np.asarray(t)), vector, theta, vmap_method="sequential")

    def forward(theta: Any) -> Any:
        both = jax.pure_callback(lambda t: residuals(np.asarray(t)), (vector, matrix), theta, vmap_method="sequential")
        return both

    def backward(J: Any, sensitivity: Any) -> Any:
        return (sensitivity @ J,)

    value.defvjp(forward, backward)
    return value
