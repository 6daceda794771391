"""Comparison of the lengths of tendons that a vendor gives with those of a rig."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from distal.errors import RigError
from distal.rig.rig import Rig
from distal.rig.tendons import Tendon

DIFFERS = 0.05
"""Moment arms that differ by more than this share of the larger one count as different [1]. Source:
judgement.
"""

MOST_ANGLE = 7.0
"""Largest angle in a table [rad], just above a whole turn; larger ones are degrees. Source:
judgement.
"""


@dataclass(frozen=True)
class Disagreement:
    """How the moment arm of a tendon at a joint differs between a rig and a table.

    Args:
        rms: std of the difference of the tendon's length between both [m].
        arm: moment arm of the rig, mean over the table's angles, positive where it pulls to +θ [m].
        other: moment arm of the table by least squares, with the same sign [m].
    """

    tendon: str
    joint: str
    rms: float
    arm: float
    other: float

    @property
    def differs(self) -> bool:
        """Whether the arms of rig and table differ by more than `DIFFERS` of the larger one."""
        return abs(self.arm - self.other) > DIFFERS * max(abs(self.arm), abs(self.other))


def compare_lengths(rig: Rig, table: Mapping[str, ArrayLike]) -> tuple[Disagreement, ...]:
    """Return how the lengths in a table differ from the rig's, by tendon and joint; lengths may be
    counted from any zero.

    Args:
        table: name of a joint → its angles [rad], (k,), and name of a tendon → its lengths [m],
            (k,). Joints without a column are at zero; at least one joint and one tendon are needed.

    Raises:
        RigError: the table lacks these, its columns differ in length, or its angles are no radians.
    """
    columns = {name: np.asarray(values, dtype=float) for name, values in table.items()}
    joints = [joint.name for joint in rig.joints if joint.name in columns]
    tendons = [tendon for tendon in rig.tendons if tendon.name in columns]
    for kind, parts, matches in (("joint", rig.joints, joints), ("tendon", rig.tendons, tendons)):
        if not matches:
            names = ", ".join(part.name for part in parts)
            raise RigError(f"the table has no column of a {kind}; the rig has {names}")
    if len({values.shape for values in columns.values()}) > 1:
        raise RigError("the table's columns differ in length")
    angles = np.column_stack([columns[name] for name in joints])
    if np.abs(angles).max() > MOST_ANGLE:
        raise RigError(
            f"an angle of {np.abs(angles).max():.4g} came; the table's angles are radians, its "
            "lengths metres"
        )
    poses = [dict(zip(joints, row)) for row in angles]
    disagreements = list[Disagreement]()
    for tendon in tendons:
        arms = np.array(
            [[tendon.arms(pose).get(name, 0.0) for name in joints] for pose in poses]
        ).mean(axis=0)
        sloped = np.column_stack([np.ones(len(angles)), angles])
        length = columns[tendon.name]
        slopes = np.linalg.lstsq(sloped, length, rcond=None)[0][1:]
        rms = float(np.std(length + np.array([_drawn(tendon, pose) for pose in poses])))
        for name, arm, slope in zip(joints, arms, slopes):
            if name in tendon.joints or abs(slope) > 1e-6:
                disagreements.append(
                    Disagreement(tendon.name, name, rms, float(arm), float(-slope))
                )
    return tuple(disagreements)


def _drawn(tendon: Tendon, angles: dict[str, float]) -> float:
    """Return how far a tendon is drawn in from zero to given angles [m]: ∫ Σ arm_j(s θ) θ_j ds over
    s from 0 to 1, exact for polynomials up to degree 11.
    """
    positions, weights = np.polynomial.legendre.leggauss(6)
    total = 0.0
    for position, weight in zip((positions + 1) / 2, weights / 2):
        arms = tendon.arms({name: position * angle for name, angle in angles.items()})
        total += float(weight) * sum(arms.get(name, 0.0) * angle for name, angle in angles.items())
    return total
