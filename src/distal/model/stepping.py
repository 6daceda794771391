"""The time step: kick–drift–kick leapfrog with exact damping, exact friction, and stops."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import ceil

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.expressions import Matrix, Scalar, Vector
from distal.model.chain_kick import Kicked, Loads, chain_kick
from distal.model.friction import Limit, free_response
from distal.model.mechanism import Mechanism
from distal.model.stops import Push, Stop, kick_at_stops, restitution, velocity_in_stops

RESOLUTION = 0.6
"""Largest product of a sub-step and the rig's highest natural frequency [1]. Source: benchmark
(docs/results/numerics.md).
"""

MOST_SUBSTEPS = 1000
"""Largest number of sub-steps in an interval; a rig that needs more has a wrong unit or size.
Source: judgement.
"""


def responses(
    mechanism: Mechanism,
    length: Scalar,
    drift: Scalar,
    added_inertia: Vector | None = None,
    rebounds: bool = True,
) -> Matrix:
    """Return the numbers of each body's kick that depend on the step alone, (n_bodies, 4): a and b
    (see `free_response`), coefficient of restitution, implicitness (see `Stop`).

    The kick has a `length`, the drift that follows is `drift` long [s]. Hung weights, which move
    with the bodies, have an `added_inertia`, (n_bodies,). Where no body `rebounds`, the third
    column is zero.
    """
    inertias = mechanism.inertias()
    dampings = mechanism.dampings()
    rows = []
    for i, body in enumerate(mechanism.bodies):
        inertia = inertias[i] if added_inertia is None else inertias[i] + added_inertia[i]
        a, b = free_response(dampings[i], inertia, length)
        rebound = ca.SX(0)
        implicitness = ca.SX(0)
        if body.has_stops:
            k_s, b_s, _, _ = mechanism.stop(i)
            resolved = k_s * drift * drift / inertia <= 1
            rebound = (
                ca.if_else(resolved, 0, restitution(k_s, b_s, inertia)) if rebounds else ca.SX(0)
            )
            implicitness = ca.if_else(resolved, 0.5, 1)
        rows.append(ca.horzcat(a, b, rebound, implicitness))
    return ca.vertcat(*rows)


@dataclass(frozen=True)
class Kick:
    """The symbols of one kick, all SX.

    Args:
        q: coordinates, (n_bodies,) [rad, m].
        v: their velocities, (n_bodies,).
        effort: force or torque on each body, (n_bodies,).
        response: see `responses`, (n_bodies, 4).
        length: of the kick [s].
        drift: length of the drift that follows, or, in the last kick, of the drift before it [s].
        implicit: (force F, damping D) of each body, (n_bodies, 2): F − D v⁺ is taken implicitly;
            None for none.
        damped: `damped_inertias` of the joints where they are the same in all kicks, (n_joints,);
            None where they follow from q.
    """

    q: Vector
    v: Vector
    effort: Vector
    response: Matrix
    length: Scalar
    drift: Scalar
    implicit: Matrix | None = None
    damped: Vector | None = None


def _forces(mechanism: Mechanism, kick: Kick) -> tuple[Vector, Vector, list[Limit]]:
    """Return force, implicit damping and friction limits of all bodies.

    The damping that tendons give to a body's own velocity is taken implicitly, so that stiff
    damping needs no small step.
    """
    pulls = mechanism.pulls(kick.q, kick.v)
    damping = mechanism.tendon_damping(kick.q, pulls.joint)
    force = pulls.forces + mechanism.passive_forces(kick.q) + kick.effort + damping * kick.v
    if kick.implicit is not None:
        force = force + kick.implicit[:, 0]
        damping = damping + kick.implicit[:, 1]
    return force, damping, mechanism.friction_limits(kick.q, kick.v, pulls.joint, pulls.drive)


def impulses(mechanism: Mechanism, kick: Kick) -> tuple[Vector, list[Limit], Vector]:
    """Return (z, friction limits, implicit damping) of all bodies in a kick. The velocity before
    friction and stops is z = a v + b F; the limits are multiplied by b, as velocities.
    """
    force, damping, limits = _forces(mechanism, kick)
    a = kick.response[:, 0]
    b = kick.response[:, 1]
    return a * kick.v + b * force, [limit.times(b[i]) for i, limit in enumerate(limits)], damping


def loads_of(mechanism: Mechanism, kick: Kick, settles: bool = False) -> Loads:
    """Return the forces on the joints of a chain in a kick.

    Where it `settles`, the joints come to rest within the kick: the drives are taken where they are
    at its end, and stiffness is implicit.
    """
    nj = mechanism.n_joints
    if settles:
        return _settling(
            mechanism,
            ca.vertcat(kick.q[:nj], kick.q[nj:] + kick.drift * kick.v[nj:]),
            kick.effort[:nj],
        )
    force, damping, limits = _forces(mechanism, kick)
    return Loads(force[:nj], damping[:nj], *_sides(limits[:nj]))


def _sides(limits: Sequence[Limit]) -> tuple[Vector, Vector]:
    """Return friction limits against + and against − motion, (n_joints,) each."""
    return ca.vertcat(*(limit.up for limit in limits)), ca.vertcat(
        *(limit.down for limit in limits)
    )


def _settling(mechanism: Mechanism, q: Vector, effort: Vector) -> Loads:
    """Return the forces on joints that come to rest within a kick, with their stiffness and without
    the tendons' damping.
    """
    nj = mechanism.n_joints
    at = ca.SX.sym("q", mechanism.n_bodies)
    still = ca.SX.zeros(mechanism.n_bodies)
    pulls = mechanism.pulls(at, still)
    pulled = pulls.forces[:nj]
    passive = mechanism.passive_forces(at)[:nj]
    stiffness = -ca.jacobian(pulled, at)[:, :nj]
    # a weight above its axle has a negative stiffness and would turn over; it stays explicit
    stiffness += ca.diag(ca.fmax(-ca.diag(ca.jacobian(passive, at)[:, :nj]), 0))
    up, down = _sides(mechanism.friction_limits(at, still, pulls.joint, pulls.drive)[:nj])
    p = mechanism.parameters.symbols
    acting = ca.Function("settling", [at, p], [pulled + passive, up, down, ca.densify(stiffness)])
    force, up, down, stiffness = acting(q, p)
    return Loads(force + effort, ca.SX(nj, 1), up, down, stiffness)


def kicked_chain(
    mechanism: Mechanism,
    kick: Kick,
    rebounds: bool = True,
    last: bool = False,
    settles: bool = False,
) -> Kicked:
    """Return the joints of a chain after a kick and the drift that follows; see `chain_kick` and
    `loads_of`.
    """
    nj = mechanism.n_joints
    loads = loads_of(mechanism, kick, settles)
    before = ca.SX.zeros(nj) if settles else kick.v[:nj]  # joints that settle begin at rest
    return chain_kick(
        mechanism,
        kick.q[:nj],
        before,
        loads,
        kick.length,
        kick.drift,
        last=last,
        rebounds=rebounds,
        damped=kick.damped,
    )


def _stop(mechanism: Mechanism, body: int, response: Matrix, rebounds: bool) -> Stop:
    k_s, b_s, low, high = mechanism.stop(body)
    return Stop(low, high, k_s, b_s, response[body, 2] if rebounds else 0.0, response[body, 3])


def kick_and_drift(
    mechanism: Mechanism, kick: Kick, rebounds: bool = True, bodies: Sequence[int] | None = None
) -> tuple[Vector, Vector]:
    """Return (q⁺, v⁺) after one kick and the drift that follows: v⁺ = soft(a v + b F, b · limit),
    q⁺ = q + h v⁺.

    Args:
        rebounds: whether bodies bounce off stops whose contact the step does not resolve. A filter
            that linearises takes them as pressed instead, since the slope of a bounce is of no use
            to it.
        bodies: which bodies the kick moves; default all. The others drift with the velocity they
            have.
    """
    z, limits, damping = impulses(mechanism, kick)
    free = range(mechanism.n_bodies) if bodies is None else bodies
    q = list[Scalar]()
    v = list[Scalar]()
    if mechanism.chain is not None:
        chain = kicked_chain(mechanism, kick, rebounds)
        q = ca.vertsplit(chain.q)
        v = ca.vertsplit(chain.v)
    for i in range(len(q), mechanism.n_bodies):
        push = Push(z[i], limits[i], kick.response[i, 1], damping[i])
        if i in free and mechanism.bodies[i].has_stops:
            stop = _stop(mechanism, i, kick.response, rebounds)
            velocity, position = kick_at_stops(
                stop, push, kick.q[i], kick.v[i], kick.length, kick.drift
            )
        else:
            velocity = push.free if i in free else kick.v[i]
            position = kick.q[i] + kick.drift * velocity
        q.append(position)
        v.append(velocity)
    return ca.vertcat(*q), ca.vertcat(*v)


def last_kick(mechanism: Mechanism, kick: Kick) -> Vector:
    """Return v⁺ after the half kick that ends an interval. The `drift` of this kick is the one
    before it.
    """
    z, limits, damping = impulses(mechanism, kick)
    velocities = list[Scalar]()
    if mechanism.chain is not None:
        velocities = ca.vertsplit(kicked_chain(mechanism, kick, last=True).v)
    for i in range(len(velocities), mechanism.n_bodies):
        push = Push(z[i], limits[i], kick.response[i, 1], damping[i])
        if mechanism.bodies[i].has_stops:
            stop = _stop(mechanism, i, kick.response, False)
            velocities.append(velocity_in_stops(stop, push, kick.q[i], kick.drift))
        else:
            velocities.append(push.free)
    return ca.vertcat(*velocities)


def stiffest_frequency(mechanism: Mechanism) -> float:
    """Return the highest natural frequency [rad/s] of the rig with all tendons taut, from M⁻¹K.

    Raises:
        RigError: it is not finite.
    """
    frequencies = _frequencies(mechanism, range(mechanism.n_bodies))
    if not np.all(np.isfinite(frequencies)):
        raise RigError(
            f"{mechanism.rig.name}: stiffness over inertia is not finite; check the sizes of the "
            "rig's values"
        )
    return max(frequencies)


def _frequencies(mechanism: Mechanism, bodies: range) -> list[float]:
    """Return the highest natural frequency of some bodies at each of `_postures`, the other bodies
    held [rad/s].
    """
    p = mechanism.parameters
    q = ca.SX.sym("q", mechanism.n_bodies)
    stiffness = ca.vertcat(*(mechanism.stiffest(i) for i in range(mechanism.n_tendons)))
    jacobian = mechanism.length_jacobian(q)
    nj = mechanism.n_joints
    spring = ca.mtimes([jacobian.T, ca.diag(stiffness), jacobian])
    for i, joint in enumerate(mechanism.rig.joints):
        if joint.spring is not None:
            spring[i, i] += p[f"joints.{i}.spring.stiffness"]
        if joint.extension_spring is not None:
            path = f"joints.{i}.extension_spring"
            spring[i, i] += (
                p[f"{path}.stiffness"] * p[f"{path}.radius"] ** 2
            )  # it lengthens by r per radian at most
    inertia = ca.diag(mechanism.inertias())
    inertia[:nj, :nj] = mechanism.mass_matrix(q)
    system = ca.Function("system", [q, p.symbols], [spring, inertia])
    free = [i for i in mechanism.free if i in bodies] + [i for i in bodies if i >= nj]
    spread = np.eye(mechanism.n_bodies)
    spread[:nj, mechanism.free] = mechanism.spread.full()
    spread = spread[np.ix_(bodies, free)]

    def largest(at: Floats) -> float:
        matrix, masses = (
            spread.T @ np.array(part.full())[np.ix_(bodies, bodies)] @ spread
            for part in system(at, p.values)
        )
        if not np.all(np.isfinite(matrix)) or not np.all(np.isfinite(masses)):
            return float("nan")
        root = np.linalg.inv(np.linalg.cholesky(masses))
        return float(np.sqrt(max(np.linalg.eigvalsh(root @ matrix @ root.T).max(), 0.0)))

    return [largest(at) for at in _postures(mechanism)]


def _postures(mechanism: Mechanism) -> list[Floats]:
    """Return the coordinates at which frequencies are computed: zero; for a chain also where it
    starts, and its stops.
    """
    at = [np.zeros(mechanism.n_bodies)]
    if mechanism.chain is not None:
        angles = [
            (joint.initial.value, *(joint.stops or (-1.0, 1.0))) for joint in mechanism.rig.joints
        ]
        at += [np.concatenate([posture, np.zeros(mechanism.n_drives)]) for posture in zip(*angles)]
    return at


def joint_frequency(mechanism: Mechanism) -> float:
    """Return the highest natural frequency [rad/s] of the joints on their taut tendons, with the
    drives held.
    """
    return max(_frequencies(mechanism, range(mechanism.n_joints)))


def substeps(mechanism: Mechanism, interval: float) -> int:
    """Return the number of sub-steps that an `interval` [s] needs: each is at most the rig's
    `largest_step`, or RESOLUTION/ω of its stiffest mode where none is given.

    Raises:
        RigError: it needs more than `MOST_SUBSTEPS`.
    """
    largest = mechanism.rig.stepping.largest_step or RESOLUTION / max(
        stiffest_frequency(mechanism), 1e-12
    )
    needed = interval / largest * (1 - 1e-9)
    if needed > MOST_SUBSTEPS:
        raise RigError(
            f"{mechanism.rig.name}: an interval of {interval:g} s needs {needed:.3g} sub-steps of "
            f"{largest:.3g} s "
            f"(at most {MOST_SUBSTEPS} are allowed); a tendon is too stiff for its lightest body: "
            "check the units of stiffness and mass, or set stepping.largest_step"
        )
    return max(1, ceil(needed))
