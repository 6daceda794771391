"""Directions of joint space: those that the sensors see, and those that only springs hold or
nothing does.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.model import Mechanism
from distal.rig import Rig

SMALLEST = 1e-3
"""A direction along which tendons move by less than this share of the strongest one's motion counts
as missed [1]. Source: judgement.
"""


@dataclass(frozen=True)
class Directions:
    """Directions of joint space at a posture: those that the sensors see, and those that they miss.

    Args:
        joints: names of the n joints.
        seen: sums of the angles that the sensors tell, (r, n) [m]: one row of moment arms for each
            of r independent tendons.
        missed: orthonormal directions, (m, n), along which no measured tendon moves.
        sprung: whether springs hold all missed directions.
    """

    joints: tuple[str, ...]
    seen: Floats
    missed: Floats
    sprung: bool

    @property
    def text(self) -> str:
        """A sentence on what is seen and what is not, such as ``seen is 9·mcp + 7·pip + 5·dip; two
        directions are not: …``.
        """
        if len(self.missed) == 0:
            return f"all directions of {', '.join(self.joints)} are seen"
        sums = " and ".join(_sum(row, self.joints) for row in self.seen) or "nothing"
        words = {1: "one direction is", 2: "two directions are", 3: "three directions are"}
        missed = words.get(len(self.missed), f"{len(self.missed)} directions are")
        held = (
            "springs hold them, as long as nothing touches the joints"
            if self.sprung
            else "the bands say how far"
        )
        return f"seen is {sums}; {missed} not: {held}"


def _sum(row: Floats, joints: tuple[str, ...]) -> str:
    """Return a sum of angles in words, in millimetres of tendon per radian."""
    parts = []
    for arm, joint in zip(1e3 * row * np.sign(row[np.argmax(np.abs(row))]), joints):
        if abs(arm) > 1e3 * SMALLEST * np.abs(row).max():
            parts.append(f"{'-' if arm < 0 else '+'} {abs(arm):.3g}·{joint}")
    text = " ".join(parts)
    return text[2:] if text[0] == "+" else f"-{text[2:]}"


def directions(rig: Rig) -> Directions:
    """Return which directions of joint space the sensors of a rig see at the joints' `initial`
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
    arms = -jacobian[rows, : mechanism.n_joints]
    free = arms @ spread
    _, values, across = np.linalg.svd(free)
    rank = int(np.sum(values > SMALLEST * max(values.max(initial=0.0), 1e-300)))
    missed = (spread @ across[rank:].T).T
    missed = missed / np.maximum(np.linalg.norm(missed, axis=1, keepdims=True), 1e-300)
    stiffness = spread.T @ np.diag(springs.ravel()) @ spread
    held: Floats = np.zeros(0)
    if rank < free.shape[1]:
        held = np.linalg.eigvalsh(across[rank:] @ stiffness @ across[rank:].T)
    names = tuple(rig.joint_names)
    return Directions(names, _independent(arms, rank), missed, bool(np.all(held > 0.0)))


def _independent(arms: Floats, rank: int) -> Floats:
    """Return the first rows that are independent, as a person would choose them, (rank, n)."""
    rows: list[Floats] = []
    for row in arms:
        if len(rows) < rank:
            count = np.linalg.matrix_rank(np.array([*rows, row]), tol=SMALLEST * np.abs(arms).max())
            rows += [row] if count > len(rows) else []
    return np.array(rows).reshape(len(rows), arms.shape[1])
