"""The tendons of a rig beyond their lengths: the internal state along each (backlash, points in a
sheath, creep), tensions and forces.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca

from distal.expressions import Scalar, Vector
from distal.model.parameters import NOTHING_DERIVED, Derived, Parameters
from distal.model.plays import Bounds, Pull, balanced, gap, plays_of
from distal.model.sheath import Sheath
from distal.model.springs import stretched
from distal.model.tendon_lengths import Lengths
from distal.rig import Rig


@dataclass(frozen=True)
class InternalState:
    """The internal state of the transmissions, and the coordinates that the tendons see.

    Args:
        q: coordinates with the far sides of backlashes in place of the near ones, (n_bodies,) [rad,
            m].
        inside: positions of the far sides of drives' backlashes, then of the points in sheaths,
            (n_inside,) [rad, m].
    """

    q: Vector
    inside: tuple[Scalar, ...]


@dataclass(frozen=True)
class Pulls:
    """Tensions of the tendons and the forces that they exert on the bodies.

    Args:
        joint: tensions at the joints' ends, (n_tendons,) [N].
        drive: tensions at the drives' ends, (n_tendons,) [N]; they are those at the joints unless a
            tendon runs in a sheath.
        forces: on the bodies, −(∂ℓ/∂q)ᵀ T, (n_bodies,) [N m, N].
    """

    joint: Vector
    drive: Vector
    forces: Vector


class Tendons(Lengths):
    """The tendons of a rig: lengths, internal state, tensions [N] and forces; `Mechanism` adds the
    other forces. Velocities v, (n_bodies,), are those of the coordinates q.

    Args:
        inputs: numbers of the description that stay inputs whatever their values; see `Parameters`.
        remembers: whether the internal state (backlash, points in a sheath, creep) is remembered,
            as `inside` among the parameters. Otherwise positions are taken to be in the middle of
            their bounds, and creep to be as settled as at the start.
        derived: values that are computed from the description; see `Parameters`.
    """

    def __init__(
        self,
        rig: Rig,
        inputs: Sequence[str] = (),
        remembers: bool = False,
        derived: Derived = NOTHING_DERIVED,
    ) -> None:
        self.remembers = remembers
        self.plays = plays_of(rig)
        self.strains = tuple(
            f"tendons.{i}.creep.strain"
            for i, tendon in enumerate(rig.tendons)
            if tendon.creep is not None
        )
        # points in sheaths come last
        self._first_point = sum(drive.backlash is not None for drive in rig.drives)
        inside = (*self.plays, *self.strains) if remembers else ()
        super().__init__(rig, Parameters(rig, inputs, inside, derived))

    def internal_state(self, q: Vector, settled: bool = False) -> InternalState:
        """Return the internal state after the bodies have moved to q from where it is remembered.
        Where `settled`, what is remembered belongs to q already and is kept.
        """
        remembered = [self.parameters[name] for name in self.plays] if self.remembers else None
        points = None if remembered is None else remembered[self._first_point :]
        tied, far_sides = self._tied(q, remembered, points, settled)
        elongated = self.elongations(tied)
        inside = list[Scalar]()
        for i in range(self.n_tendons):
            if (sheath := self.sheath(i)) is None:
                continue
            ends = self._ends(i, tied, elongated)
            if points is None:
                inside += sheath.middle(*ends)
            else:
                along = points[len(inside) : len(inside) + sheath.count]
                inside += along if settled else sheath.settled(along, *ends)
        if (
            points and not settled
        ):  # the points have moved: the far sides of backlashes find their balance with them
            tied, far_sides = self._tied(q, far_sides, inside, settled)
        return InternalState(tied, (*far_sides, *inside))

    def _tied(
        self,
        q: Vector,
        remembered: Sequence[Scalar] | None,
        points: Sequence[Scalar] | None,
        settled: bool,
    ) -> tuple[Vector, list[Scalar]]:
        """Return q with the far sides of backlashes in place of the near ones, and the far sides of
        the drives' backlashes alone.
        """
        tied = [q[i] for i in range(self.n_bodies)]
        far_sides = list[Scalar]()
        for i in range(self.n_drives):
            if self.rig.drives[i].backlash is not None:
                held = None if remembered is None else remembered[len(far_sides)]
                far_sides.append(self._far_side(i, ca.vertcat(*tied), held, points, settled))
                tied[self.n_joints + i] = far_sides[-1]
        for j, joint in enumerate(self.rig.joints):
            if joint.backlash is not None:
                # the tendons turn the pulley until it meets the link
                near = gap(q[j], self.parameters[f"joints.{j}.backlash.width"])
                at = ca.vertcat(*tied)
                tied[j] = balanced(at[j], near, self._pull_along(j, at, points))
        return ca.vertcat(*tied), far_sides

    def bounds(self, which: int, q: Vector) -> Bounds:
        """Return the bounds of a play operator at q, the other ones being where they are remembered
        to be. `which` is its index in `plays`.
        """
        keys = self.plays[which].split(".")
        index = int(keys[1])
        if keys[0] == "drives":
            near = gap(q[self.n_joints + index], self.parameters[f"drives.{index}.backlash.width"])
            if self.rig.drives[index].backlash.held:  # type: ignore[union-attr]
                return near
            points = [self.parameters[name] for name in self.plays if name.startswith("tendons.")]
            rests = self._far_side(index, q, self.parameters[self.plays[which]], points, False)
            return Bounds(rests, rests)
        state = self.internal_state(q, settled=True)
        sheath = self.sheath(index)
        point = int(keys[-1])
        assert sheath is not None
        drive, joint = self._ends(index, state.q, self.elongations(state.q))
        first = which - point
        line = [drive, *state.inside[first : first + sheath.count], joint]
        return sheath.bounds(point, line[point], line[point + 2])

    def _far_side(
        self,
        drive: int,
        q: Vector,
        before: Scalar | None,
        points: Sequence[Scalar] | None,
        settled: bool,
    ) -> Scalar:
        """Return where the far side of a drive's backlash is."""
        part = self.rig.drives[drive].backlash
        body = self.n_joints + drive
        p = self.parameters
        assert part is not None  # it is asked for drives with backlash
        if settled:
            return before
        path = f"drives.{drive}.backlash"
        near = gap(q[body], p[f"{path}.width"])
        start = near.middle if before is None else before
        if part.held:
            return near.hold(start)
        return balanced(start, near, self._pull_along(body, q, points), p[f"{path}.friction"])

    def _pull_along(self, body: int, q: Vector, points: Sequence[Scalar] | None) -> Pull:
        """Return the function position → (Σ T ∂ℓ/∂q, its slope) of the tendons along the coordinate
        of one body, with the others at q.

        The points of sheaths stay at `points` meanwhile; without these a cable is a spring.
        """
        at = ca.SX.sym("q", self.n_bodies)
        held = ca.SX.sym("points", len(points or ()))
        forces = self.elastic_forces(at)
        if points:
            joint, drive = self._end_forces(at, ca.vertsplit(held))
            forces = ca.vertcat(*(joint if body < self.n_joints else drive))
        pull = ca.dot(self.length_jacobian(at)[:, body], self._taut(forces))
        symbols = [at, self.parameters.symbols, held]
        function = ca.Function("pull", symbols, [pull, ca.jacobian(pull, at)[body]])

        def along(position: Scalar) -> tuple[Scalar, Scalar]:
            moved = [position if i == body else q[i] for i in range(self.n_bodies)]
            force, slope = function(
                ca.vertcat(*moved), self.parameters.symbols, ca.vertcat(*(points or ()))
            )
            return force, slope

        return along

    def sheath(self, tendon: int) -> Sheath | None:
        """Return the cable of a tendon as springs and points of friction; None where it has no
        points, since all friction of its path acts at its drive.
        """
        path = self.rig.tendons[tendon].path
        if path is None or path.nodes == 0:
            return None
        p = self.parameters
        name = f"tendons.{tendon}"
        exponent = self.wrapped(tendon) / path.nodes
        out = ca.exp(exponent * p[f"{name}.path.let_out"])
        stiffening = p[f"{name}.stiffening"] if p.has(f"{name}.stiffening") else None
        cable = p[f"{name}.stiffness"], ca.exp(exponent), out, path.nodes
        return Sheath(*cable, stiffening, p[f"{name}.pretension"])

    def stiffest(self, tendon: int) -> Scalar:
        """Return the stiffness of a tendon against a fast motion of one end [N/m]. In a sheath with
        N points this is 2 N k, the stiffness of the stretch next to that end.
        """
        path = self.rig.tendons[tendon].path
        k = self.parameters[f"tendons.{tendon}.stiffness"]
        return k if path is None or path.nodes == 0 else 2 * path.nodes * k

    def _ends(self, tendon: int, q: Vector, elongated: Vector) -> tuple[Scalar, Scalar]:
        """Return the displacements of a cable's ends at the drive and at the joint [m], whose
        difference is its stretch from the length without tension.
        """
        drive = self.displacement(tendon, q)
        stretch = self._beyond(tendon, elongated[tendon])
        p = self.parameters
        name = f"tendons.{tendon}"
        return drive, drive - stretch - p[f"{name}.pretension"] / p[f"{name}.stiffness"]

    def pulls(self, q: Vector, v: Vector, settled: bool = False) -> Pulls:
        """Return the tensions at both ends of the tendons, T_i = max(k δ + T_pre + c δ̇, 0), zero
        where slack, and their forces on the bodies.

        These are equations (8) and (9) at q and v, in the general form with damping and
        pre-tension. The max(·, 0) corrects them, since a tendon cannot push. For `settled` see
        `internal_state`.
        """
        p = self.parameters
        state = self.internal_state(q, settled)
        nj = self.n_joints
        jacobian = self.length_jacobian(state.q)
        rates = ca.mtimes(jacobian, v)
        taut: list[list[Scalar]] = []
        for elastic in self._end_forces(state.q, state.inside[self._first_point :]):
            taut.append([self._taut(force) for force in elastic])
            for i in range(self.n_tendons):
                if p.has(f"tendons.{i}.damping"):
                    damped = elastic[i] + p[f"tendons.{i}.damping"] * rates[i]
                    taut[-1][i] = ca.if_else(ca.logic_and(elastic[i] > 0, damped > 0), damped, 0)
        joint, drive = (ca.vertcat(*tensions) for tensions in taut)
        if all(self.sheath(i) is None for i in range(self.n_tendons)):
            return Pulls(joint, joint, -ca.mtimes(jacobian.T, joint))
        forces = -ca.vertcat(
            ca.mtimes(jacobian[:, :nj].T, joint), ca.mtimes(jacobian[:, nj:].T, drive)
        )
        return Pulls(joint, drive, forces)

    def _end_forces(self, q: Vector, points: Sequence[Scalar]) -> tuple[list[Scalar], list[Scalar]]:
        """Return `elastic_forces` at the joints' and at the drives' ends [N], with the points of
        sheaths at `points`.
        """
        elongated = self.elongations(q)
        left = list(points)
        joint = ca.vertsplit(self.elastic_forces(q))
        drive = list(joint)
        for i in range(self.n_tendons):
            if (sheath := self.sheath(i)) is not None:
                drive[i], joint[i] = sheath.tensions(
                    left[: sheath.count], *self._ends(i, q, elongated)
                )
                del left[: sheath.count]
        return joint, drive

    def tensions(self, q: Vector, v: Vector) -> Vector:
        """Return the tensions of all tendons at their drives at q and v, (n_tendons,) [N]; see
        `pulls`.
        """
        return self.pulls(q, v).drive

    @staticmethod
    def _taut(elastic: Vector) -> Vector:
        return ca.if_else(elastic > 0, elastic, 0)

    def elastic_forces(self, q: Vector) -> Vector:
        """Return T_pre + k δ of all tendons at q, (n_tendons,) [N], negative where slack. The δ of
        a tendon that stiffens is that of `stretched`.
        """
        p = self.parameters
        elongated = self.elongations(q)
        forces = []
        for i in range(self.n_tendons):
            path = f"tendons.{i}"
            stretch = self._beyond(i, elongated[i])
            if p.has(f"{path}.stiffening"):
                stretch = stretched(stretch, p[f"{path}.stiffening"])
            forces.append(p[f"{path}.stiffness"] * stretch + p[f"{path}.pretension"])
        return ca.vertcat(*forces)

    def _beyond(self, tendon: int, elongated: Scalar) -> Scalar:
        """Return the part of an elongation that is left after slack and creep [m]."""
        p = self.parameters
        path = f"tendons.{tendon}"
        if p.has(f"{path}.slack"):
            elongated = elongated - p[f"{path}.slack"]
        creep = self.rig.tendons[tendon].creep
        if creep is not None:
            # a creep that is not remembered is taken as settled as it is at the start
            if self.remembers:
                elongated = elongated - p[f"{path}.creep.strain"]
            else:
                elongated = elongated / (1 + p[f"{path}.creep.share"] * creep.settled.value)
        return elongated

    def crept(self, q: Vector, dt: Scalar) -> list[Scalar]:
        """Return all creep `strains` [m] after an interval dt [s] with the bodies at q: c⁺ = λ c +
        (1 − λ) γ/(1 + γ) (T/k + c), λ = e^{−(1 + γ) dt/τ}.

        This is the exact response of τ ċ = γ T/k − c while the tendon's whole stretch, T/k + c,
        stays constant, and so it is stable for every dt.
        """
        p = self.parameters
        pulls = self.pulls(q, ca.SX.zeros(self.n_bodies), settled=True)
        after = []
        for i, tendon in enumerate(self.rig.tendons):
            if tendon.creep is not None:
                path = f"tendons.{i}"
                stretch = (pulls.joint[i] + pulls.drive[i]) / 2 / p[f"{path}.stiffness"]
                share = p[f"{path}.creep.share"]
                strain = p[f"{path}.creep.strain"]
                left = ca.exp(-(1 + share) * dt / p[f"{path}.creep.time"])
                after.append(left * strain + (1 - left) * share / (1 + share) * (stretch + strain))
        return after

    def tendon_damping(self, q: Vector, tensions: Vector) -> Vector:
        """Return the damping Σ c (∂ℓ/∂q_j)² that the taut tendons, those with `tensions` > 0, give
        to each body's own coordinate at q, (n_bodies,).
        """
        jacobian = self.length_jacobian(self.internal_state(q).q)
        total = ca.SX(self.n_bodies, 1)
        for i in range(self.n_tendons):
            if self.parameters.has(f"tendons.{i}.damping"):
                taut = ca.if_else(tensions[i] > 0, self.parameters[f"tendons.{i}.damping"], 0)
                total += taut * (jacobian[i, :] ** 2).T
        return total
