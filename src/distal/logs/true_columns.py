"""The true angles and torques of a log's joints, where they are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.logs.log import Log, frozen
from distal.rig import angle_names, torque_names


def true_angles(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the joints' true angles [rad], read-only, (k, n_joints); NaN where one is not known,
    None where none is.
    """
    return _columns(log, angle_names(joints))


def true_torques(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the true torques on the joints from outside [N m], as `true_angles` does."""
    return _columns(log, torque_names(joints))


def _columns(log: Log, names: Sequence[str]) -> Floats | None:
    if not any(name in log.truth for name in names):
        return None
    if len(names) == 1:
        return log.truth[names[0]][:, None]
    unknown = np.full(len(log), np.nan)
    return frozen(np.column_stack([log.truth.get(name, unknown) for name in names]))
