"""What the records hold: fits of naive and true structure at known noise, by finite differences and Levenberg and Marquardt."""

from dataclasses import dataclass

import numpy as np

# relative step of a difference
STEP = 1e-5


@dataclass
class Records:
    """Measured outputs (samples, outputs, runs), their noise, and the deviation of each sample."""

    measured: np.ndarray
    deviations: np.ndarray
    noises: list

    def whiten(self, residual):
        """Residuals (samples, outputs, runs, columns) in units of independent noise."""
        out = np.empty_like(residual)
        for o, noise in enumerate(self.noises):
            for r in range(residual.shape[2]):
                out[:, o, r] = noise.whiten(residual[:, o, r], self.deviations[:, o, r])
        return out

    def part(self, runs):
        return Records(self.measured[:, :, runs], self.deviations[:, :, runs], self.noises)


@dataclass
class Point:
    """Parameters by name, sizes of effects, initial states (states, runs)."""

    values: dict
    sizes: list
    start: np.ndarray


class Oracle:
    """Fits a structure: the naive model's parameters, sizes of effects, and initial states where the text frees them."""

    def __init__(self, motion, known, effects, scales, free_start, spread):
        self.motion, self.known, self.effects, self.scales = motion, known, effects, scales
        self.free_start, self.spread = free_start, spread

    def columns(self, point, parameters=True):
        """Simulated outputs at the point and moved in every direction: (samples, outputs, runs, 1 + directions)."""
        names = list(point.values) if parameters else []
        sizes = point.sizes if parameters else []
        states = len(point.start) if self.free_start else 0
        count = 1 + len(names) + len(sizes) + states
        values = {k: np.full(count, v) for k, v in {**self.known, **point.values}.items()}
        amounts = [np.full(count, s) for s in point.sizes]
        start = np.repeat(point.start[:, :, None], count, axis=2)
        steps = []
        for j, name in enumerate(names):
            steps.append(STEP * max(abs(point.values[name]), 1e-9))
            values[name][1 + j] += steps[-1]
        for j, size in enumerate(sizes):
            steps.append(STEP * max(abs(size), 1e-4))
            amounts[j][1 + len(names) + j] += steps[-1]
        for j in range(states):
            steps.append(STEP * self.spread[j])
            start[j, :, 1 + len(names) + len(sizes) + j] += steps[-1]
        acting = list(zip(self.effects, amounts))
        y, _ = self.motion.outputs(values, acting, start, scales=self.scales)
        return y, np.array(steps), states

    def linear(self, point, records, parameters=True):
        """Whitened residual (flat) and Jacobian (flat, directions): initial states of each run are directions of their own."""
        y, steps, states = self.columns(point, parameters)
        residual = records.whiten(records.measured[..., None] - y[..., :1])[..., 0]
        J = records.whiten(y[..., 1:] - y[..., :1]) / steps
        shared = len(steps) - states
        runs = residual.shape[2]
        blocks = [J[..., :shared].reshape(residual.size, shared)]
        for r in range(runs):
            own = np.zeros((*residual.shape, states))
            own[:, :, r] = J[:, :, r, shared:]
            blocks.append(own.reshape(residual.size, states))
        return residual.ravel(), np.concatenate(blocks, axis=1)

    def moved(self, point, step, parameters):
        values, sizes, at = dict(point.values), list(point.sizes), 0
        if parameters:
            for name in values:
                values[name] += step[at]
                at += 1
            for j in range(len(sizes)):
                sizes[j] += step[at]
                at += 1
        start = point.start.copy()
        if self.free_start:
            for r in range(start.shape[1]):
                start[:, r] += step[at:at + len(start)]
                at += len(start)
        return Point(values, sizes, start)

    def fit(self, point, records, parameters=True, iterations=25):
        """The best point from here, and its half sum of squares."""
        if not parameters and not self.free_start:
            y, _, _ = self.columns(point, False)
            residual = records.whiten(records.measured[..., None] - y[..., :1])
            return point, 0.5 * np.sum(residual**2)
        r, J = self.linear(point, records, parameters)
        cost, damping = 0.5 * r @ r, 1e-6
        for _ in range(iterations):
            size = np.sqrt(np.sum(J**2, axis=0)) + 1e-30
            U, s, V = np.linalg.svd(J / size, full_matrices=False)
            step = -(V.T @ ((s / (s**2 + damping)) * (U.T @ -r))) / size
            predicted = 0.5 * np.sum((U.T @ r) ** 2)
            if predicted < 2e-3:
                break
            new = self.moved(point, step, parameters)
            r2, J2 = self.linear(new, records, parameters)
            new_cost = 0.5 * r2 @ r2
            if np.isfinite(new_cost) and new_cost < cost:
                small = cost - new_cost < 1e-3
                point, r, J, cost, damping = new, r2, J2, new_cost, max(damping / 30, 1e-9)
                if small:
                    break
            else:
                damping = max(damping * 30, 1e-4)
                if damping > 1e4:
                    break
        return point, cost


def complement(J):
    """A projector off the columns of J."""
    U, s, _ = np.linalg.svd(J / (np.sqrt(np.sum(J**2, axis=0)) + 1e-30), full_matrices=False)
    U = U[:, s > 1e-9 * s[0]]
    return lambda d: d - U @ (U.T @ d)
