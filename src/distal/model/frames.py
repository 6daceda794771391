"""Frames of the joints' links: their rotations, their angular velocities, and the acceleration of
free fall in them.

A joint's frame has its origin at `offset` in the frame of its parent and is turned about `axis` by
θ; at θ = 0 both are parallel.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from distal.expressions import Matrix, Scalar, Vector
from distal.model.parameters import Parameters
from distal.rig import Rig


def rotation(axis: Sequence[float], angle: Scalar) -> Matrix:
    """Return the rotation matrix R = a aᵀ + cos θ (1 − a aᵀ) + sin θ [a×] about a unit `axis` a by
    an `angle` θ [rad], (3, 3).
    """
    a = np.asarray(axis)
    along = np.outer(a, a)
    cross = np.array([[0, -a[2], a[1]], [a[2], 0, -a[0]], [-a[1], a[0], 0]])
    return (
        ca.SX(ca.DM(along))
        + ca.cos(angle) * ca.DM(np.eye(3) - along)
        + ca.sin(angle) * ca.DM(cross)
    )


class Frames:
    """The frames of a rig's links as a tree. Joint angles q [rad] and their speeds v [rad/s] are
    (n_joints,).
    """

    def __init__(self, rig: Rig, parameters: Parameters) -> None:
        self.rig = rig
        self._p = parameters
        self.parents = [rig.parent_of(i) for i in range(len(rig.joints))]

    def vector(self, path: str) -> Vector:
        """Return the vector at a path of the description, (3,)."""
        return ca.vertcat(*(self._p[f"{path}.{k}"] for k in range(3)))

    def rotations(self, q: Vector) -> list[Matrix]:
        """Return the rotation matrix of each joint's frame in the frame of its parent at q, (3, 3)
        each.
        """
        return [rotation(joint.axis, q[i]) for i, joint in enumerate(self.rig.joints)]

    def carried(self, turned: Sequence[Matrix], v: Vector) -> list[Vector]:
        """Return the angular velocity that each link has from the joints before its own, in its own
        frame, (3,) each [rad/s].

        The frames are `turned` by the matrices of `rotations`; the joints' speeds are v.
        """
        spins = list[Vector]()
        for i, parent in enumerate(self.parents):
            before = (
                ca.SX(3, 1) if parent is None else spins[parent] + self._axis(parent) * v[parent]
            )
            spins.append(ca.mtimes(turned[i].T, before))
        return spins

    def turning(self, q: Vector, v: Vector) -> list[Vector]:
        """Return the angular velocity of each link at q and v in its own frame, (3,) each
        [rad/s].
        """
        spins = self.carried(self.rotations(q), v)
        return [spin + self._axis(i) * v[i] for i, spin in enumerate(spins)]

    def falling(self, q: Vector) -> list[Vector]:
        """Return the acceleration of free fall in the frame of each link at q, (3,) each [m/s²]."""
        turned = self.rotations(q)
        falls = list[Vector]()
        for i, parent in enumerate(self.parents):
            falls.append(
                ca.mtimes(turned[i].T, self.gravity() if parent is None else falls[parent])
            )
        return falls

    def gravity(self) -> Vector:
        """Return the acceleration of free fall in the base's frame, (3,) [m/s²]."""
        base = self.rig.base
        turned = ca.SX.eye(3)
        # only a chain has the numbers of its base among the model's
        has = self.rig.is_chain
        for k, axis in enumerate(np.eye(3).tolist()):
            # each turn is about an axis of the world, after those before it
            angle = self._p[f"base.orientation.{k}"] if has else ca.SX(base.orientation[k])
            turned = ca.mtimes(rotation(axis, angle), turned)
        return ca.mtimes(
            turned.T, self.vector("base.gravity") if has else ca.SX(ca.DM(list(base.gravity)))
        )

    def _axis(self, joint: int) -> Vector:
        return ca.DM(self.rig.joints[joint].axis)
