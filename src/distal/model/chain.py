"""Dynamics of joints that carry one another, on the frames of their links: recursive
Newton–Euler, as CasADi expressions.

A joint's frame has its origin at `offset` in the frame of its parent and is turned about `axis` by
θ; at θ = 0 both are parallel. The centre of mass and the inertia of a link are given in the frame
of its joint. The method is that of Featherstone, Rigid Body Dynamics Algorithms, 2008, chapter 5,
written in three dimensions instead of six.
"""

from __future__ import annotations

from collections.abc import Sequence

import casadi as ca
import numpy as np

from distal.expressions import Matrix, Vector, rotation
from distal.model.parameters import Parameters
from distal.rig import Rig


class Chain:
    """The links of a rig as a tree of rigid bodies. Joint angles q [rad] and their speeds v [rad/s]
    are (n_joints,).
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

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return the links' inertia matrix at q, (n_joints, n_joints) [kg m²]: the derivative of
        `torques` by the acceleration, in which these are linear.
        """
        n = len(self.parents)
        a = ca.SX.sym("a", n)
        slopes = ca.jacobian(self.torques(q, ca.SX(n, 1), a), a)
        return ca.tril2symm(ca.tril(slopes))

    def torques(self, q: Vector, v: Vector, acceleration: Vector) -> Vector:
        """Return the joint torques M(q) q̈ + c(q, v) + g(q) that a motion of the links needs,
        (n_joints,) [N m], by recursive Newton–Euler. The `acceleration` is q̈, (n_joints,)
        [rad/s²].
        """
        n = len(self.rig.joints)
        turned = self.rotations(q)
        resting = (ca.SX(3, 1), ca.SX(3, 1), -self.gravity())
        spins = self.carried(turned, v)
        moving = list[tuple[Vector, Vector, Vector]]()
        loads = list[tuple[Vector, Vector]]()
        for i in range(n):
            parent = self.parents[i]
            axis = self._axis(i)
            spin, twist, linear = resting if parent is None else moving[parent]
            offset = self.vector(f"joints.{i}.offset")
            back = turned[i].T
            linear = ca.mtimes(
                back, linear + ca.cross(twist, offset) + ca.cross(spin, ca.cross(spin, offset))
            )
            spin = spins[i]
            twist = ca.mtimes(back, twist) + axis * acceleration[i] + ca.cross(spin, axis * v[i])
            spin = spin + axis * v[i]
            moving.append((spin, twist, linear))
            if self.rig.joints[i].link is None:
                loads.append((ca.SX(3, 1), ca.SX(3, 1)))
                continue
            mass = self._p[f"joints.{i}.link.mass"]
            centre, inertia = (self.vector(f"joints.{i}.link.{x}") for x in ("centre", "inertia"))
            force = mass * (
                linear + ca.cross(twist, centre) + ca.cross(spin, ca.cross(spin, centre))
            )
            loads.append(
                (force, inertia * twist + ca.cross(spin, inertia * spin) + ca.cross(centre, force))
            )
        needed = [ca.SX(0)] * n
        for i in reversed(range(n)):
            force, torque = loads[i]
            needed[i] = ca.dot(self._axis(i), torque)
            parent = self.parents[i]
            if parent is not None:
                force = ca.mtimes(turned[i], force)
                torque = ca.mtimes(turned[i], torque) + ca.cross(
                    self.vector(f"joints.{i}.offset"), force
                )
                loads[parent] = (loads[parent][0] + force, loads[parent][1] + torque)
        return ca.vertcat(*needed)
