"""The true angles and external torques of a log's joints, where they are known."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.logs.log import Log, frozen
from distal.rig import angle_names, torque_names


def true_angles(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the joints' true angles [rad], read-only, (n, n_joints), or None where none is known.

    Angles that are not known are NaN.

    Args:
        joints: names of the joints.
    """
    return _columns(log, angle_names(joints))


def true_torques(log: Log, joints: Sequence[str]) -> Floats | None:
    """Return the true external torques on the joints [N m], (n, n_joints), in the form of
    `true_angles`.
    """
    return _columns(log, torque_names(joints))


def _columns(log: Log, names: Sequence[str]) -> Floats | None:
    if not any(name in log.truth for name in names):
        return None
    if len(names) == 1:
        return log.truth[names[0]][:, None]
    unknown = np.full(len(log), np.nan)
    return frozen(np.column_stack([log.truth.get(name, unknown) for name in names]))
