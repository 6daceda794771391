"""Logs of rigs that only these tests know: tendons that stretch, friction along them, noise.

No code of `distal.model` is used: the plant is quasi-static, each drive follows
s = A θ + T/k + f sign(ds/dt), and tensions are what springs and co-contraction ask for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.from_logs import RigFromLogs, rig_from_logs

RATE = 100.0
SECONDS = 20.0


def motion(seed: int, joints: int, wide: float = 0.6) -> tuple[Floats, Floats]:
    """Return time and angles of joints that move between random targets, (n,) and (n, joints)."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, SECONDS, 1.0 / RATE)
    angles = []
    for _ in range(joints):
        knots = np.concatenate([[0.0], np.cumsum(rng.uniform(0.5, 1.5, 40))])
        targets = np.concatenate([[0.0], rng.uniform(-wide, wide, 40)])
        angles.append(np.interp(time, knots, targets))
    return time, np.column_stack(angles)


def finger(
    seed: int,
    arms: Sequence[Sequence[float]] = ((8e-3, 6e-3), (8e-3, -5e-3), (-9e-3, -4e-3)),
    noise: float = 5e-6,
) -> dict[str, Floats]:
    """Return a log of sliders [mm] with load cells [N] and joints' references [deg]."""
    rng = np.random.default_rng(seed + 1000)
    time, angles = motion(seed, len(arms[0]))
    matrix = np.array(arms)
    level = 8.0 + 3.0 * np.sin(0.7 * time + seed)
    tensions = level[:, None] + 2.0 * np.sin(np.arange(len(arms)) + time[:, None])
    tensions += rng.normal(0.0, 0.05, tensions.shape)
    pulled = angles @ matrix.T + tensions / 9e3
    pulled += 2e-5 * np.sign(np.gradient(pulled, axis=0))
    pulled += rng.normal(0.0, noise, pulled.shape)
    columns = {"t_ms": 1e3 * time}
    columns |= {f"x_{name}_mm": 1e3 * column for name, column in zip("abc", pulled.T)}
    columns |= {f"F_{name}": column for name, column in zip("abc", tensions.T)}
    references = np.rad2deg(angles) + rng.normal(0.0, 0.05, angles.shape)
    columns |= {f"{name}_deg": column for name, column in zip(("mcp", "pip"), references.T)}
    return columns


def fingers() -> list[dict[str, Floats]]:
    """Return three logs of the finger."""
    return [finger(seed) for seed in range(3)]


def write(columns: Mapping[str, Floats], path: Path) -> Path:
    """Write a log as CSV, and return its path."""
    table = np.column_stack(list(columns.values()))
    np.savetxt(path, table, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")
    return path


def written(logs: Sequence[Mapping[str, Floats]], folder: Path) -> list[Path]:
    """Write several logs to a folder, and return their paths."""
    return [write(columns, folder / f"run_{k}.csv") for k, columns in enumerate(logs)]


def drafted(logs: Sequence[Mapping[str, Floats]], folder: Path) -> RigFromLogs:
    """Return the rig that is drafted from logs, which are written to a folder."""
    return rig_from_logs(written(logs, folder))
