"""An unscented filter on the displacement-driven state: sigma points instead of slopes."""

from __future__ import annotations

import numpy as np
from distal.estimators.ensemble import EnsembleFilter
from distal.estimators.force_update import WILD_FORCE
from distal.estimators.motion import MEMORY
from numpy.typing import NDArray

from distal.rig import Rig

Floats = NDArray[np.float64]


class UnscentedFilter(EnsembleFilter):
    """A cubature filter (Arasaratnam and Haykin, 2009): 2n points at ±sqrt(n) standard deviations, equal weights.

    Args:
        rig: the description.
        name: of the estimator.
    """

    def __init__(self, rig: Rig, name: str = "unscented") -> None:
        from distal.estimators.augmented import AugmentedState

        from distal.estimators.channels import channels_of
        from distal.model import Mechanism

        n = len(AugmentedState(Mechanism(rig), channels_of(rig, name)))
        super().__init__(name, rig, 2 * n)

    def _points(self, mean: Floats, covariance: Floats) -> Floats:
        """Return the sigma points, (n, 2n); directions without variance have none."""
        n = len(mean)
        scale = np.maximum(self._augmented.stds, 1e-12)
        values, vectors = np.linalg.eigh(covariance / np.outer(scale, scale))
        root: Floats = scale[:, None] * vectors * np.sqrt(np.maximum(values, 0.0))
        points: Floats = mean[:, None] + np.sqrt(n) * np.hstack([root, -root])
        return points

    def _advance(self, carry: Floats, row: Floats, key: tuple[int, int]) -> tuple[Floats, Floats, Floats]:
        n, nd = len(self._augmented), self._augmented.mechanism.n_drives
        start = n + n * n
        mean, covariance = carry[:n], carry[n:start].reshape(n, n)
        memory, kept = carry[start : start + nd * MEMORY], carry[start + nd * MEMORY : start + nd * (MEMORY + 1)]
        dt, before = row[0], memory[::MEMORY]
        motions, noise = (np.array(part).ravel() for part in self._follow(memory, row))
        points = self._lowest(self._points(mean, covariance))
        still = np.zeros((nd, self._size))
        moved = np.array(self._move(points, still, before, motions, dt, self._p))
        mean = moved.mean(axis=1)
        covariance = (moved - mean[:, None]) @ (moved - mean[:, None]).T / self._size + np.diag(
            self._process_stds(dt) ** 2
        )
        covariance += self._from_places(mean, before, motions, dt, noise)
        points = self._lowest(self._points(mean, covariance))
        remembered = np.tile(kept[:, None], self._size)
        compared = self._compare(points, remembered, motions, before, noise, row, self._p)
        residuals, variances, masks, after = (np.array(part) for part in compared)
        prior = mean
        expected = residuals.mean(axis=1)
        spreads = np.mean((residuals - expected[:, None]) ** 2, axis=1) + variances.mean(axis=1)
        crosses = (points - prior[:, None]) @ (residuals - expected[:, None]).T / self._size
        there = np.flatnonzero(masks[:, 0] > 0)
        if len(there):
            together = (residuals - expected[:, None]) @ (residuals - expected[:, None]).T / self._size
            robust = variances.mean(axis=1) * np.maximum(1.0, expected**2 / (WILD_FORCE * spreads))
            together = together[np.ix_(there, there)] + np.diag(robust[there])
            gain = np.linalg.solve(together, crosses[:, there].T).T
            mean = prior - gain @ expected[there]
            covariance = covariance - gain @ together @ gain.T
        covariance = (covariance + covariance.T) / 2
        following = np.concatenate([mean, covariance.ravel(), motions[: nd * MEMORY], after.mean(axis=1)])
        measured = len(self.measured)
        return following, np.where(masks[:, 0] > 0, expected, np.nan)[:measured], spreads[:measured]

    def _from_places(self, mean: Floats, before: Floats, motions: Floats, dt: float, noise: Floats) -> Floats:
        """Return the covariance of (θ, ω) that comes from the noise of the places, by differences."""
        nd = len(noise)
        shifts = np.zeros((nd, self._size))
        for i in range(nd):
            shifts[i, 2 * i], shifts[i, 2 * i + 1] = np.sqrt(noise[i]), -np.sqrt(noise[i])
        same = np.tile(mean[:, None], self._size)
        moved = np.array(self._move(same, shifts, before, motions, dt, self._p))
        total = np.zeros((len(mean), len(mean)))
        for i in range(nd):
            half = (moved[:, 2 * i] - moved[:, 2 * i + 1]) / 2
            total += np.outer(half, half)
        return total
