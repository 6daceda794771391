"""An unscented filter on the displacement-driven state: sigma points instead of slopes."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals.ensemble import EnsembleFilter, states_of
from distal.estimators.adaptive.drive_tracking import MEMORY
from distal.rig import Rig

Floats = NDArray[np.float64]


class UnscentedFilter(EnsembleFilter):
    """A cubature filter (Arasaratnam and Haykin, 2009): 2n points at ±sqrt(n) standard deviations,
    equal weights.

    Args:
        rig: the description.
        name: of the estimator.
    """

    def __init__(self, rig: Rig, name: str = "unscented") -> None:
        super().__init__(name, rig, 2 * len(states_of(rig, name)))

    def _points(self, mean: Floats, covariance: Floats) -> Floats:
        """Return the sigma points, (n, 2n); directions without variance have none."""
        n = len(mean)
        scale = np.maximum(self._states.stds, 1e-12)
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        root: Floats = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        points: Floats = mean[:, None] + np.sqrt(n) * np.hstack([root, -root])
        return points

    def _advance(
        self, kernel_state: Floats, row: Floats, key: tuple[int, int]
    ) -> tuple[Floats, Floats, Floats]:
        n, nd = len(self._states), self._states.context.n_drives
        start = n + n * n
        mean, covariance = kernel_state[:n], kernel_state[n:start].reshape(n, n)
        memory, kept = (
            kernel_state[start : start + nd * MEMORY],
            kernel_state[start + nd * MEMORY : start + nd * (MEMORY + 1)],
        )
        dt, before = row[0], memory[::MEMORY]
        tracks = np.array(self._track(kernel_state[:n], memory, row, self._p)).ravel()
        points = self._lowest(self._points(mean, covariance))
        still = np.zeros((nd, self._size))
        moved = np.array(self._move(points, still, before, tracks, dt, self._p))
        mean = moved.mean(axis=1)
        covariance = (moved - mean[:, None]) @ (moved - mean[:, None]).T / self._size + np.diag(
            self._process_stds(dt) ** 2
        )
        covariance += self._from_positions(mean, before, tracks, dt)
        points = self._lowest(self._points(mean, covariance))
        remembered = np.tile(kept[:, None], self._size)
        compared = self._compare(points, remembered, tracks, before, row, self._p)
        residuals, variances, masks, after = (np.array(part) for part in compared)
        prior = mean
        expected = residuals.mean(axis=1)
        spreads = np.mean((residuals - expected[:, None]) ** 2, axis=1) + variances.mean(axis=1)
        crosses = (points - prior[:, None]) @ (residuals - expected[:, None]).T / self._size
        there = np.flatnonzero(masks[:, 0] > 0)
        if len(there):
            together = (
                (residuals - expected[:, None]) @ (residuals - expected[:, None]).T / self._size
            )
            wild = expected**2 / (self._states.context.robustness.wild_force * spreads)
            robust = variances.mean(axis=1) * np.maximum(1.0, wild)
            together = together[np.ix_(there, there)] + np.diag(robust[there])
            gain = np.linalg.solve(together, crosses[:, there].T).T
            mean = prior - gain @ expected[there]
            covariance = covariance - gain @ together @ gain.T
        covariance = (covariance + covariance.T) / 2
        following = np.concatenate(
            [mean, covariance.ravel(), tracks[: nd * MEMORY], after.mean(axis=1)]
        )
        measured = len(self.measured)
        return following, np.where(masks[:, 0] > 0, expected, np.nan)[:measured], spreads[:measured]

    def _from_positions(self, mean: Floats, before: Floats, tracks: Floats, dt: float) -> Floats:
        """Return the covariance of (θ, ω) that comes from the noise of the places, by
        differences.
        """
        nd = len(before)
        noise = tracks[-nd:]
        shifts = np.zeros((nd, self._size))
        for i in range(nd):
            shifts[i, 2 * i], shifts[i, 2 * i + 1] = np.sqrt(noise[i]), -np.sqrt(noise[i])
        same = np.tile(mean[:, None], self._size)
        moved = np.array(self._move(same, shifts, before, tracks, dt, self._p))
        total = np.zeros((len(mean), len(mean)))
        for i in range(nd):
            half = (moved[:, 2 * i] - moved[:, 2 * i + 1]) / 2
            total += np.outer(half, half)
        return total
