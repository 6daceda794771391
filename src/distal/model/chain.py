"""Dynamics of joints that carry one another, on the frames of their links: composite rigid bodies
and recursive Newton–Euler, as CasADi expressions.

A joint's frame has its origin at `offset` in the frame of its parent and is turned about `axis` by
θ; at θ = 0 both are parallel. The centre of mass and the inertia of a link are given in the frame
of its joint. The methods are those of Featherstone, Rigid Body Dynamics Algorithms, 2008, chapters
5 and 6, written in three dimensions instead of six.
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


def cross(a: Vector, b: Vector) -> Vector:
    """Return a × b, (3,)."""
    return ca.vertcat(
        a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    )


class Chain:
    """The links of a rig as a tree of rigid bodies. Joint angles q [rad] and their speeds v [rad/s]
    are (n_joints,).
    """

    def __init__(self, rig: Rig, parameters: Parameters) -> None:
        self._rig = rig
        self._p = parameters
        self._frames = Frames(rig, parameters)

    def _link(self, joint: int) -> tuple[Scalar, Vector, Vector] | None:
        """Return mass, centre and moments of inertia about the centre of a joint's link, None where
        it has none.
        """
        if self._rig.joints[joint].link is None:
            return None
        path = f"joints.{joint}.link"
        return (
            self._p[f"{path}.mass"],
            self._frames.vector(f"{path}.centre"),
            self._frames.vector(f"{path}.inertia"),
        )

    def mass_matrix(self, q: Vector) -> Matrix:
        """Return the links' inertia matrix at q, (n_joints, n_joints) [kg m²], by composite rigid
        bodies.

        A composite body is a link with all links that it carries: mass m, first moment h = m c, and
        inertia J about the origin of its joint's frame. A unit angular acceleration about the
        joint's axis a needs the force a × h and the moment J a. Both are passed on from joint to
        joint towards the base; the moment's components along the axes on the way are the entries of
        the matrix.
        """
        n = len(self._rig.joints)
        turned = self._frames.rotations(q)
        bodies = list[tuple[Scalar, Vector, Matrix]]()
        for i in range(n):
            link = self._link(i)
            zero = ca.SX(3, 1)
            if link is None:
                bodies.append((ca.SX(0), zero, ca.SX(3, 3)))
            else:
                mass, centre, moments = link
                inertia = ca.diag(moments) + _shifted(mass, mass * centre, centre)
                bodies.append((mass, mass * centre, inertia))
        matrix = ca.SX(n, n)
        for i in reversed(range(n)):
            mass, moment, inertia = bodies[i]
            axis = ca.DM(self._rig.joints[i].axis)
            force = cross(axis, moment)
            torque = ca.mtimes(inertia, axis)
            at = i
            matrix[i, i] = ca.dot(axis, torque)
            while (parent := self._frames.parents[at]) is not None:
                offset = self._frames.vector(f"joints.{at}.offset")
                force = ca.mtimes(turned[at], force)
                torque = ca.mtimes(turned[at], torque) + cross(offset, force)
                matrix[i, parent] = matrix[parent, i] = ca.dot(
                    ca.DM(self._rig.joints[parent].axis), torque
                )
                at = parent
            above = self._frames.parents[i]
            if above is not None:
                offset = self._frames.vector(f"joints.{i}.offset")
                r = turned[i]
                moment = ca.mtimes(r, moment)
                inertia = ca.mtimes([r, inertia, r.T]) + _shifted(
                    mass, 2 * moment + mass * offset, offset
                )
                before = bodies[above]
                bodies[above] = (
                    before[0] + mass,
                    before[1] + moment + mass * offset,
                    before[2] + inertia,
                )
        return matrix

    def torques(self, q: Vector, v: Vector, acceleration: Vector) -> Vector:
        """Return the joint torques M(q) q̈ + c(q, v) + g(q) that a motion of the links needs,
        (n_joints,) [N m], by recursive Newton–Euler. The `acceleration` is q̈, (n_joints,)
        [rad/s²].
        """
        n = len(self._rig.joints)
        turned = self._frames.rotations(q)
        resting = (ca.SX(3, 1), ca.SX(3, 1), -self._frames.gravity())
        spins = self._frames.carried(turned, v)
        moving = list[tuple[Vector, Vector, Vector]]()
        loads = list[tuple[Vector, Vector]]()
        for i in range(n):
            parent = self._frames.parents[i]
            axis = ca.DM(self._rig.joints[i].axis)
            spin, twist, linear = resting if parent is None else moving[parent]
            offset = self._frames.vector(f"joints.{i}.offset")
            back = turned[i].T
            linear = ca.mtimes(
                back, linear + cross(twist, offset) + cross(spin, cross(spin, offset))
            )
            spin = spins[i]
            twist = ca.mtimes(back, twist) + axis * acceleration[i] + cross(spin, axis * v[i])
            spin = spin + axis * v[i]
            moving.append((spin, twist, linear))
            link = self._link(i)
            if link is None:
                loads.append((ca.SX(3, 1), ca.SX(3, 1)))
                continue
            mass, centre, inertia = link
            force = mass * (linear + cross(twist, centre) + cross(spin, cross(spin, centre)))
            loads.append(
                (force, inertia * twist + cross(spin, inertia * spin) + cross(centre, force))
            )
        needed = [ca.SX(0)] * n
        for i in reversed(range(n)):
            force, torque = loads[i]
            needed[i] = ca.dot(ca.DM(self._rig.joints[i].axis), torque)
            parent = self._frames.parents[i]
            if parent is not None:
                force = ca.mtimes(turned[i], force)
                torque = ca.mtimes(turned[i], torque) + cross(
                    self._frames.vector(f"joints.{i}.offset"), force
                )
                loads[parent] = (loads[parent][0] + force, loads[parent][1] + torque)
        return ca.vertcat(*needed)


def _shifted(mass: Scalar, moment: Vector, offset: Vector) -> Matrix:
    """Return (h·o) 1 − (h oᵀ + o hᵀ)/2, (3, 3): what a shift by `offset` o adds to an inertia.

    With `moment` h = m o it is the parallel-axis theorem m (o·o 1 − o oᵀ). With h = 2 m c + m o it
    is the same for a body with its centre at c.
    """
    if ca.SX(mass).is_zero():
        return ca.SX(3, 3)
    outer = ca.mtimes(moment, offset.T)
    return ca.dot(moment, offset) * ca.SX.eye(3) - (outer + outer.T) / 2
