"""Joints that carry one another: their dynamics on the frames of their links, as CasADi
expressions.

Dynamics are recursive Newton–Euler. A joint's frame has its origin at `offset` in the frame of its
parent and is turned about `axis` by θ; at θ = 0 both are parallel. The centre of mass and the
inertia of a link are given in the frame of its joint. The method is that of Featherstone, Rigid
Body Dynamics Algorithms, 2008, chapter 5, written in three dimensions instead of six.
"""

from __future__ import annotations

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

    def gravity(self) -> Vector:
        """Return the acceleration of free fall in the base's frame, (3,) [m/s²]."""
        turned = ca.SX.eye(3)
        for k, axis in enumerate(np.eye(3).tolist()):
            # each turn is about an axis of the world, after those before it
            turned = ca.mtimes(rotation(axis, self._p[f"base.orientation.{k}"]), turned)
        return ca.mtimes(turned.T, self.vector("base.gravity"))

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
        n = len(self.parents)
        # of each joint's frame in the frame of its parent
        turned = [rotation(joint.axis, q[i]) for i, joint in enumerate(self.rig.joints)]
        resting = (ca.SX(3, 1), ca.SX(3, 1), -self.gravity())
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
            spin = ca.mtimes(back, spin)
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
