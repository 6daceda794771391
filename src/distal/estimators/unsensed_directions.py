"""Directions of joint space that the sensors miss: only springs hold them, or nothing does."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.linalg import null_space

from distal.arrays import Floats
from distal.model import Mechanism
from distal.rig import Rig

SMALLEST = 1e-3
"""A direction along which tendons move by less than this share of the strongest one's motion counts
as missed [1]. Source: judgement.
"""


@dataclass(frozen=True)
class Directions:
    """Directions of joint space at a posture that the sensors miss.

    Args:
        missed: orthonormal directions, (m, n), along which no measured tendon moves.
        sprung: whether springs hold all missed directions.
    """

    missed: Floats
    sprung: bool

    @property
    def text(self) -> str:
        """A sentence on what is not seen."""
        held = (
            "springs hold them, as long as nothing touches the joints"
            if self.sprung
            else "the bands say how far"
        )
        return f"the sensors miss {len(self.missed)} of the joints' directions: {held}"


def directions(rig: Rig) -> Directions:
    """Return which directions of joint space the sensors of a rig miss at the joints' `initial`
    angles.

    A tendon tells ∂ℓ/∂θ · δθ if its drive has a position sensor or its own tension is measured.
    Directions orthogonal to all these rows are missed (singular values below `SMALLEST` of the
    largest). A coupled joint moves with the joint that it is coupled to.
    """
    mechanism = Mechanism(rig)
    q = ca.SX.sym("q", mechanism.n_bodies)
    p = mechanism.parameters
    look = ca.Function(
        "arms", [q, p.symbols], [mechanism.length_jacobian(q), mechanism.passive_springs(q)[:, 1]]
    )
    at = [*(joint.initial.value for joint in rig.joints), *np.zeros(mechanism.n_drives)]
    jacobian, springs = (np.array(part) for part in look(at, p.values))
    placed = {sensor.of for sensor in rig.sensors_of("position")}
    measured = {sensor.of for sensor in rig.sensors_of("tension")}
    rows = [
        i
        for i, tendon in enumerate(rig.tendons)
        if tendon.drive in placed or tendon.name in measured
    ]
    spread = mechanism.spread.full()
    across = null_space(-jacobian[rows, : mechanism.n_joints] @ spread, rcond=SMALLEST)
    missed = (spread @ across).T
    missed = missed / np.maximum(np.linalg.norm(missed, axis=1, keepdims=True), 1e-300)
    stiffness = spread.T @ np.diag(springs.ravel()) @ spread
    held = np.linalg.eigvalsh(across.T @ stiffness @ across)
    return Directions(missed, bool(np.all(held > 0.0)))
