"""Noise of deviation 1 with known colours and laws; nothing of it is the tool's."""

import numpy as np
from scipy.signal import lfilter

# samples that are left out until a filter is in its stationary state
WARM = 2000
# a 1/f spectrum ends at so many times the length of the record
OCTAVES = 4


def white(chance, n, plant):
    return chance.standard_normal(n)


def first_order(chance, n, plant):
    """AR(1), neighbours correlate by 0.9."""
    return lfilter([np.sqrt(1 - 0.81)], [1, -0.9], chance.standard_normal(n + WARM))[WARM:]


def pink(chance, n, plant):
    """Density as 1/f, from a line at one over four records on; the deviation is that of the process."""
    whole = 2 ** int(np.ceil(np.log2(max(OCTAVES * n, 64))))
    bins = np.arange(1, whole // 2)
    drawn = (chance.standard_normal(len(bins)) + 1j * chance.standard_normal(len(bins))) / np.sqrt(2 * bins)
    spectrum = np.zeros(whole // 2 + 1, dtype=complex)
    spectrum[1:-1] = drawn
    series = np.fft.irfft(spectrum, whole)
    power = np.sqrt(2 * np.sum(1.0 / bins)) / whole
    begin = chance.integers(0, whole - n + 1)
    return series[begin:begin + n] / power


def resonant(chance, n, plant):
    """AR(2) with a period of so many samples and a damping of 0.05 (radius 0.9 or more)."""
    radius, angle = max(0.9, 1 - 0.6 / plant.period), 2 * np.pi / plant.period
    a1, a2 = 2 * radius * np.cos(angle), -(radius**2)
    series = lfilter([1], [1, -a1, -a2], chance.standard_normal(n + WARM))[WARM:]
    variance = (1 - a2) / ((1 + a2) * ((1 - a2) ** 2 - a1**2))
    return series / np.sqrt(variance)


def heavy(chance, n, plant):
    """Student's law with three degrees of freedom."""
    return chance.standard_t(3, n) / np.sqrt(3)


NOISES = {
    "white": white,
    "AR(1) 0.9": first_order,
    "1/f": pink,
    "resonance": resonant,
    "10 % of the value": None,
    "Student-t 3": heavy,
}


def record(plant, noise, chance):
    """Outputs with noise. In proportion to the value: a tenth of it, and a twentieth of that deviation besides."""
    response = plant.response()
    n, q = response.shape
    noisy = response.copy()
    for o in range(q):
        size = plant.noise * np.std(response[:, o])
        if NOISES[noise] is None:
            noisy[:, o] += 0.1 * response[:, o] * chance.standard_normal(n) + 0.05 * size * chance.standard_normal(n)
        else:
            noisy[:, o] += size * NOISES[noise](chance, n, plant)
    return noisy
