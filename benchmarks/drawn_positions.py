"""Joints of which nothing is measured but positions: motors wind tendons with play, which couple
and stretch; no inertia. The plant shares nothing with `distal.model`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Positions:
    """A drawn rig of motors without any force.

    Args:
        ratios: turns of the motors per turn of the joints, (n_joints, n_joints), below the diagonal
            the tendons that pass over joints before.
        plays: half of the play of each motor [rad].
        sags: by which gravity turns each joint at the most [rad].
        seconds: a motor for each side of a joint, which goes the other way by this ratio, or 0.
        noises: of each joint's reference [rad].
        rate: of the logs [Hz].
    """

    ratios: Floats
    plays: Floats
    sags: Floats
    seconds: Floats
    noises: Floats
    rate: float

    @classmethod
    def drawn(cls, seed: int, joints: int | None = None) -> Positions:
        """Return the rig of a seed."""
        rng = np.random.default_rng([seed, 77])
        n = int(rng.integers(1, 4)) if joints is None else joints
        ratios = np.diag(rng.uniform(0.8, 1.6, n))
        ratios += np.tril(rng.uniform(-0.25, 0.25, (n, n)), -1)
        antagonists = rng.integers(0, 2) * np.ones(n)
        return cls(
            ratios,
            np.deg2rad(rng.uniform(0.2, 1.5, n)),
            np.deg2rad(rng.uniform(0.0, 1.0, n)),
            antagonists * rng.uniform(0.8, 1.2, n),
            np.deg2rad(rng.uniform(0.1, 0.6, n)),
            float(rng.choice([10.0, 25.0, 50.0])),
        )

    def log(self, seed: int, duration: float) -> tuple[dict[str, Floats], Floats]:
        """Return the columns of a log [deg], and the joints' exact angles [rad], (k, n_joints)."""
        rng = np.random.default_rng([seed, 78])
        n = len(self.plays)
        time = np.arange(0.0, duration, 1.0 / self.rate)
        wanted = np.zeros((len(time), n))
        for _ in range(2):
            sizes = np.deg2rad(rng.uniform(10.0, 25.0, n))
            phases = 2 * np.pi * rng.uniform(0.05, 0.25, n) * time[:, None] + rng.uniform(0, 6, n)
            wanted += sizes * np.sin(phases)
        motors = wanted @ self.ratios.T
        held = motors.copy()  # behind their play
        for k in range(1, len(time)):
            held[k] = np.clip(held[k - 1], motors[k] - self.plays, motors[k] + self.plays)
        angles = held @ np.linalg.inv(self.ratios).T
        angles = angles - self.sags * np.cos(angles)
        columns = {"t [s]": time}
        for j in range(n):
            columns[f"motor_{j + 1} [deg]"] = np.rad2deg(motors[:, j])
            if self.seconds[j]:
                slack = 0.02 * np.sin(0.4 * time + j)
                other = -self.seconds[j] * motors[:, j] + slack
                columns[f"motor_{j + 1}b [deg]"] = np.rad2deg(other)
        read = angles + self.noises * rng.standard_normal(angles.shape)
        for j in range(n):
            columns[f"joint_{j + 1} [deg]"] = np.rad2deg(read[:, j])
        return columns, angles


def write(columns: dict[str, Floats], path: Path, without: Sequence[str] = ()) -> None:
    """Write columns as CSV, but those that begin with one of some words."""
    kept = {name: c for name, c in columns.items() if not name.startswith(tuple(without) or "\0")}
    table = np.column_stack(list(kept.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(kept), comments="", fmt="%.5f")
