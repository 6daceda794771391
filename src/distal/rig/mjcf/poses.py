"""Lengths and moment arms of tendons, as MuJoCo computes them, at poses over the joints' ranges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.rig.mjcf.loading import mujoco_module

if TYPE_CHECKING:
    import mujoco


UNLIMITED = (-np.pi / 2, np.pi / 2)
"""Range of a joint to which the model gives none [rad]. Source: judgement."""

CROSSED = 1e-3
"""A tendon crosses a joint where its moment arm is larger than this share of its largest one [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Poses:
    """Lengths and moment arms of tendons at k poses, in the model's units.

    Args:
        angles: of the joints [rad], (k, n_joints).
        lengths: of the tendons, (k, n_tendons).
        arms: ∂length/∂angle, (k, n_tendons, n_joints).
        wraps: number of points of each tendon's path, (k, n_tendons); it changes where the tendon
            touches a surface or leaves it.
    """

    angles: Floats
    lengths: Floats
    arms: Floats
    wraps: NDArray[np.int64]


def range_of(model: mujoco.MjModel, joint: int) -> tuple[float, float]:
    """Return the range of a joint [rad], `UNLIMITED` where the model has none."""
    if not model.jnt_limited[joint]:
        return UNLIMITED
    low, high = model.jnt_range[joint]
    return float(low), float(high)


def tendon_slopes(model: mujoco.MjModel, data: mujoco.MjData) -> Floats:
    """Return ∂length/∂q of all tendons from `data` in which their lengths are computed, (n_tendons,
    n_v); MuJoCo keeps it dense or sparse.
    """
    flat = np.asarray(data.ten_J).ravel()
    owner = model if hasattr(model, "ten_J_rownnz") else data
    if owner is data and not mujoco_module().mj_isSparse(model):
        return flat.reshape(model.ntendon, model.nv).copy()
    slopes = np.zeros((model.ntendon, model.nv))
    columns = np.ravel(owner.ten_J_colind)
    for i in range(model.ntendon):
        first = int(owner.ten_J_rowadr[i])
        count = int(owner.ten_J_rownnz[i])
        slopes[i, columns[first : first + count]] = flat[first : first + count]
    return slopes


def at_poses(model: mujoco.MjModel, joints: Sequence[int], angles: Floats) -> Poses:
    """Return lengths and moment arms of all tendons at `angles` of some joints [rad], (k,
    n_joints); other joints stay where the model has them.
    """
    mujoco = mujoco_module()
    data = mujoco.MjData(model)
    positions = [int(model.jnt_qposadr[j]) for j in joints]
    speeds = [int(model.jnt_dofadr[j]) for j in joints]
    lengths = []
    arms = []
    wraps = []
    for row in angles:
        data.qpos[positions] = row
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mj_tendon(model, data)
        lengths.append(data.ten_length.copy())
        arms.append(tendon_slopes(model, data)[:, speeds])
        wraps.append(data.ten_wrapnum.copy())
    return Poses(angles, np.array(lengths), np.array(arms), np.array(wraps))


def rest_lengths(model: mujoco.MjModel, joints: Sequence[int]) -> Floats:
    """Return the lengths of all tendons with some joints at zero, (n_tendons,); displacements of
    drives count from these.
    """
    lengths: Floats = at_poses(model, joints, np.zeros((1, len(joints)))).lengths[0]
    return lengths


def over_ranges(model: mujoco.MjModel, joints: Sequence[int], count: int, seed: int = 0) -> Poses:
    """Return lengths and moment arms at a `count` of random poses within the joints' ranges."""
    ends = np.array([range_of(model, j) for j in joints])
    drawn = np.random.default_rng(seed).uniform(size=(count, len(joints)))
    return at_poses(model, joints, ends[:, 0] + drawn * (ends[:, 1] - ends[:, 0]))


def turned_by(poses: Poses, tendon: int) -> list[int]:
    """Return which of the joints of some poses a tendon turns, by their positions in `poses`."""
    size = np.abs(poses.arms[:, tendon]).max(axis=0)
    return [k for k, arm in enumerate(size) if arm > CROSSED * max(float(size.max()), 1e-12)]
