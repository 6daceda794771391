"""A particle filter on the displacement-driven state: a slow reference for what is attainable."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from benchmarks.rivals.ensemble import EnsembleFilter, torque_fadings
from distal.estimators.adaptive.drive_tracking import MEMORY
from distal.rig import Rig

Floats = NDArray[np.float64]

PARTICLES = 800
SHRINK = 0.9
"""Shrinkage of Liu and West's kernel when particles are drawn again: keeps mean and covariance of
the parameters.
"""


class ParticleFilter(EnsembleFilter):
    """A bootstrap particle filter with exact friction in every particle.

    Its random numbers depend on its seed and the number of the sample only, so that the same log
    gives the same estimate, step by step or at once.

    Args:
        rig: the description.
        particles: how many.
        seed: of its random numbers.
        name: of the estimator.
    """

    def __init__(
        self, rig: Rig, particles: int = PARTICLES, seed: int = 0, name: str = "particle"
    ) -> None:
        super().__init__(name, rig, particles)
        self._seed = seed

    def _own_memory(self) -> Floats:
        n, nd = len(self._states), self._states.context.n_drives
        rng = np.random.default_rng([self._seed, 0])
        states = self._states.means[:, None] + self._states.stds[:, None] * rng.normal(
            size=(n, self._size)
        )
        kept, weights = np.zeros((nd, self._size)), np.full(self._size, -np.log(self._size))
        return np.concatenate([self._lowest(states).ravel(), kept.ravel(), weights])

    def _advance(
        self, kernel_state: Floats, row: Floats, key: tuple[int, int]
    ) -> tuple[Floats, Floats, Floats]:
        n, nd, size = len(self._states), self._states.context.n_drives, self._size
        rng = np.random.default_rng([self._seed, 1 + key[0], key[1]])
        start = n + n * n
        memory, rest = (
            kernel_state[start : start + nd * MEMORY],
            kernel_state[start + nd * (MEMORY + 1) :],
        )
        states = rest[: n * size].reshape(n, size)
        kept = rest[n * size : (n + nd) * size].reshape(nd, size)
        logs = rest[(n + nd) * size :].copy()
        dt, before = row[0], memory[::MEMORY]
        tracks = np.array(self._track(kernel_state[:n], memory, row, self._p)).ravel()
        shift = np.sqrt(tracks[-nd:])[:, None] * rng.normal(size=(nd, size))
        states = np.array(self._move(states, shift, before, tracks, dt, self._p))
        states += self._process_stds(dt)[:, None] * rng.normal(size=(n, size))
        states = self._lowest(states)
        # the particles are spread as the places err: their forces err by the sensor alone
        tracks[-nd:] = 0.0
        compared = self._compare(states, kept, tracks, before, row, self._p)
        residuals, variances, masks, kept = (np.array(part) for part in compared)
        prior = np.exp(logs - logs.max())
        prior /= prior.sum()
        # a wild force counts no more than a far one
        squares = np.minimum(residuals**2 / variances, self._states.context.robustness.wild_force)
        logs = logs - 0.5 * (masks * (squares + np.log(variances))).sum(axis=0)
        expected = (prior * residuals).sum(axis=1)
        spread = (prior * (residuals - expected[:, None]) ** 2).sum(axis=1) + (
            prior * variances
        ).sum(axis=1)
        weights = np.exp(logs - logs.max())
        weights /= weights.sum()
        mean = states @ weights
        covariance = (weights * (states - mean[:, None])) @ (states - mean[:, None]).T
        covariance = (covariance + covariance.T) / 2
        if 1.0 / np.sum(weights**2) < 0.5 * size:
            states, kept = self._again(states, kept, weights, mean, covariance, rng)
            logs = np.full(size, -np.log(size))
        else:
            logs = np.log(np.maximum(weights, 1e-300))
        following = np.concatenate(
            [
                mean,
                covariance.ravel(),
                tracks[: nd * MEMORY],
                np.zeros(nd),
                states.ravel(),
                kept.ravel(),
                logs,
            ]
        )
        measured = len(self.measured)
        return following, np.where(masks[:, 0] > 0, expected, np.nan)[:measured], spread[:measured]

    def _again(
        self,
        states: Floats,
        kept: Floats,
        weights: Floats,
        mean: Floats,
        covariance: Floats,
        rng: np.random.Generator,
    ) -> tuple[Floats, Floats]:
        """Draw the particles again (systematic resampling), the static states with Liu and West's
        kernel.
        """
        size = self._size
        chosen = np.searchsorted(np.cumsum(weights), (rng.random() + np.arange(size)) / size).clip(
            0, size - 1
        )
        states, kept = states[:, chosen], kept[:, chosen]
        static = slice(
            2 * self._states.context.n_joints + len(torque_fadings(self._states, 0.0)), None
        )
        spread = np.sqrt(np.maximum(np.diag(covariance)[static], 0.0))
        jitter = np.sqrt(1 - SHRINK**2) * spread[:, None] * rng.normal(size=states[static].shape)
        states[static] = SHRINK * states[static] + (1 - SHRINK) * mean[static, None] + jitter
        return self._lowest(states), kept
