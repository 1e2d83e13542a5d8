"""Checks of the second blind set itself: what integration, noise and the fits of truth are good for.

    python3 studies/world/check.py [--families NAMES]

Integration: the naive model beside DOP853 of scipy, and every effect beside steps of a quarter, as the nats by which a
judge who knows the noise could tell both apart. Noise: drawn covariance beside the one it is whitened with. All limits
are asserted.
"""

import argparse

import numpy as np
from scipy.integrate import solve_ivp

from cases import Bench
from families import FAMILIES
from motion import Motion
from noises import COLOURS, Noise, covariance, numbers

# largest difference of two integrations, nats over all runs of a case
MOST = 0.5


def nats(bench, a, b):
    records = bench.records(b, list(range(bench.runs)))
    d = records.whiten((a - b)[..., None])
    return 0.5 * float(np.sum(d**2))


def reference(bench):
    """Outputs of the naive model by DOP853, from sample to sample, as inputs have a kink at each."""
    family, out = bench.family, []
    for r in range(bench.runs):
        x, rows = bench.begin[:, r], []
        for k in range(len(bench.time)):
            u = bench.inputs[k, :, r]
            rows.append([float(v) for v in family.measured(x, u, bench.values)])
            if k + 1 < len(bench.time):
                slope = (bench.inputs[k + 1, :, r] - u) / family.step
                x = solve_ivp(
                    lambda t, x: family.rates(x, u + slope * t, bench.values, {}, {}), (0, family.step), x,
                    method="DOP853", rtol=1e-10, atol=1e-12).y[:, -1]
        out.append(rows)
    return np.moveaxis(np.array(out), 0, 2)


def integration(name):
    family = FAMILIES[name]
    rng = np.random.default_rng(11)
    bench = Bench(family, rng, 1, 0, "white")
    worst = nats(bench, bench.clean, reference(bench))
    print(f"{name}: {worst:.1e} nats from DOP853", flush=True)
    assert worst < 1e-3, name
    for effect in [*family.effects, *family.outside]:
        effect, largest = bench.prepare(effect)
        sizes = np.array([0.03 * largest])
        y, start = bench.simulate([(effect, sizes)])
        finer = Motion(family, bench.inputs, bench.motion.gust[:: 2 * bench.motion.sub], refine=4)
        z, _ = finer.outputs({k: np.array([v]) for k, v in bench.values.items()}, [(effect, sizes)], start, scales=bench.scales)
        off, does = nats(bench, y[..., 0], z[..., 0]), nats(bench, y[..., 0], bench.clean)
        print(f"  {effect.key}: {off:.1e} of {does:.3g} nats", flush=True)
        assert off < MOST and off < 1e-3 * does + 1e-3, effect.key


def colours():
    """Covariances of drawn noise, at lags 0, 1, 5, over 4000 records."""
    for colour in COLOURS:
        rng = np.random.default_rng(5)
        n, drawn = 120, numbers(colour, rng)
        noise = Noise(colour, n, 1.0, drawn)
        signal = np.sin(np.arange(n) / 7)
        many = np.array([noise.draw(signal, rng) / noise.deviations(signal) for _ in range(4000)])
        told = covariance(colour, n, drawn)
        for lag in (0, 1, 5):
            got = np.mean(many[:, : n - lag] * many[:, lag:])
            assert abs(got - told[lag]) < 0.03, (colour, lag, got, told[lag])
        white = noise.whiten(many[0][:, None] * noise.deviations(signal)[:, None], noise.deviations(signal))
        assert abs(np.mean(white**2) - 1) < 0.45, colour
        print(f"{colour}: covariance as told")


def main():
    ask = argparse.ArgumentParser()
    ask.add_argument("--families", default=",".join(FAMILIES))
    given = ask.parse_args()
    colours()
    for name in given.families.split(","):
        integration(name)


if __name__ == "__main__":
    main()
