"""Noise with a known covariance: drawn and whitened by one Cholesky factor, so that gains in log-likelihood are exact."""

import numpy as np
from scipy.linalg import cholesky, solve_triangular, toeplitz

COLOURS = ["white", "AR(1)", "1/f", "resonant", "growing"]
# lowest line of 1/f noise, in records
OCTAVES = 3


def numbers(colour, rng):
    """What a colour is drawn with: correlation of neighbours; period in samples and damping."""
    if colour == "AR(1)":
        return [float(rng.uniform(0.7, 0.95))]
    if colour == "resonant":
        return [float(rng.uniform(5, 25)), float(rng.uniform(0.03, 0.1))]
    return []


def covariance(colour, n, drawn):
    """Autocovariance of noise of variance 1. That of 1/f noise begins at a third of the record's first line; a tenth is white."""
    if colour == "AR(1)":
        return drawn[0] ** np.arange(n)
    if colour == "1/f":
        lines = np.arange(1, OCTAVES * n // 2) / (OCTAVES * n)
        found = np.array([np.sum(np.cos(2 * np.pi * lines * k) / lines) for k in range(n)])
        found *= 0.9 / found[0]
        found[0] += 0.1
        return found
    if colour == "resonant":
        period, zeta = drawn
        radius, angle = np.exp(-zeta * 2 * np.pi / period), 2 * np.pi / period
        a1, a2 = 2 * radius * np.cos(angle), -(radius**2)
        found = np.empty(n)
        found[0], found[1] = 1, a1 / (1 - a2)
        for k in range(2, n):
            found[k] = a1 * found[k - 1] + a2 * found[k - 2]
        return found
    return np.eye(1, n).ravel()


class Noise:
    """Noise of one output in records of n samples, of deviation `size`."""

    def __init__(self, colour, n, size, drawn):
        self.colour, self.size, self.numbers = colour, float(size), drawn
        self.factor = cholesky(toeplitz(covariance(colour, n, drawn)) + 1e-12 * np.eye(n), lower=True)

    def deviations(self, signal):
        """Deviation of every sample: where it grows with the signal, 0.3 to 2.5 times its mean size."""
        if self.colour != "growing":
            return np.full(len(signal), self.size)
        away = np.abs(signal - np.mean(signal))
        return self.size * np.clip(0.3 + 0.8 * away / np.sqrt(np.mean(away**2)), 0.3, 2.5)

    def draw(self, signal, rng):
        return self.deviations(signal) * (self.factor @ rng.standard_normal(len(signal)))

    def whiten(self, residual, deviations):
        """Residuals (samples, ...) in units of independent noise of deviation 1."""
        flat = residual.reshape(len(residual), -1) / deviations[:, None]
        return solve_triangular(self.factor, flat, lower=True).reshape(residual.shape)
