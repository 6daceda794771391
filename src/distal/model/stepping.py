"""The time step: kick–drift–kick leapfrog with exact damping, exact friction, and stops. An
interval between samples is repeated calls of one function for a sub-step, whose code is there
once.

Joints that carry one another get all of their velocities at once. In impulses over a kick of
length h the equations are A v⁺ + h f = r with A = M(q) + h (D̃ + D) and r = (M + h D̃ − h C) v + h
(F − c − g), f being friction. The Coriolis torques c are those in the middle of the kick. C holds
the joints' viscous dampings. D̃_j = (M_jj/h)(φ(x) − 1) with φ(x) = x/(1 − e^{−x}) and x = C_j
h/M_jj makes the response of a joint alone the exact one of `free_response`. D is damping that is
taken implicitly. Where a kick is long compared with the joints' own oscillation, the tendons'
stiffness K is taken implicitly too, A += h² K, and the joints come to rest within the kick
(linearly implicit Euler; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996,
section IV.7).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import ceil

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.expressions import Matrix, Scalar, Vector, symbols
from distal.model.chain import Slip, slipping, solver
from distal.model.friction import (
    Flight,
    Limit,
    Push,
    Stop,
    bounce,
    free_response,
    kick_at_stops,
    met,
    restitution,
    velocity_in_stops,
)
from distal.model.mechanism import Mechanism

SHORTEST_KICK = 1e-15
"""Least length of a kick, by which changes of velocities are divided [s]. Source: rounding (a
division by zero).
"""


@dataclass(frozen=True)
class Loads:
    """The forces on the joints of a chain in one kick, (n_joints,) each if no other shape is said.

    Args:
        force: F, all torques but inertia, damping, friction and stops [N m].
        implicit: D, damping that is taken implicitly [N m s/rad].
        up: friction limits against + motion [N m].
        down: friction limits against − motion [N m].
        stiffness: K of the taut tendons and springs, taken implicitly, (n_joints, n_joints) [N
            m/rad]; None for none.
    """

    force: Vector
    implicit: Vector
    up: Vector
    down: Vector
    stiffness: Matrix | None = None


@dataclass(frozen=True)
class Contacts:
    """The contacts of free joints with stops: each joint gets the impulse −κ (q − position) − δ v⁺.

    Args:
        stiffness: κ, (n_free,), 0 without contact.
        damping: δ, (n_free,), 0 without contact.
        position: of the stop, (n_free,) [rad].
    """

    stiffness: Vector
    damping: Vector
    position: Vector


@dataclass(frozen=True)
class Kicked:
    """A chain after a kick and the drift that follows.

    Args:
        q: angles of all joints, (n_joints,) [rad].
        v: their speeds, (n_joints,) [rad/s].
        slip: which free joints slip.
        contacts: which free joints press against a stop.
        matrix: A with the stops in it, (n_free, n_free).
        load: r with the stops in it, (n_free,).
        up: friction impulses against + motion, (n_free,).
        down: friction impulses against − motion, (n_free,).
        damped: `damped_inertias`, (n_joints,).
    """

    q: Vector
    v: Vector
    slip: Slip
    contacts: Contacts
    matrix: Matrix
    load: Vector
    up: Vector
    down: Vector
    damped: Vector


def _growth(damping: Scalar, inertia: Scalar, length: Scalar) -> Scalar:
    """Return φ(x) = x/(1 − e^{−x}) with x = C h/M: 1 without damping."""
    if ca.SX(damping).is_zero():
        return ca.SX(1)
    x = damping * length / inertia
    small = x < 1e-5
    return ca.if_else(small, 1 + x / 2 + x * x / 12, -x / ca.if_else(small, 1, ca.expm1(-x)))


def damped_inertias(mechanism: Mechanism, inertias: Vector, length: Scalar) -> Vector:
    """Return M_jj (φ − 1), what viscous damping adds to the `inertias` M_jj of the joints over a
    kick of a `length` [s], (n_joints,) [kg m²].
    """
    pairs = zip(ca.vertsplit(mechanism.dampings()[: mechanism.n_joints]), ca.vertsplit(inertias))
    return ca.vertcat(
        *(inertia * (_growth(damping, inertia, length) - 1) for damping, inertia in pairs)
    )


def residual(
    mechanism: Mechanism,
    q: Vector,
    v: Vector,
    after: Vector,
    loads: Loads,
    *,
    slip: Slip,
    contacts: Contacts,
    damped: Vector,
    h: Scalar,
) -> Vector:
    """Return A v⁺ + h f − r of the free joints, (n_free,). It is zero for joints that slip, so that
    its slopes give those of the kick.

    Args:
        q: angles before the kick, (n_joints,).
        v: speeds before the kick, (n_joints,).
        after: speeds of the free joints after the kick, (n_free,).
        damped: `damped_inertias`, (n_joints,).
        h: length of the kick [s].
    """
    nj = mechanism.n_joints
    spread = mechanism.spread
    speeds = ca.mtimes(spread, after)
    change = speeds - v
    # where no time passes inertia alone is left
    passed = ca.fmax(h, SHORTEST_KICK)
    needed = mechanism.inertias()[:nj] * change
    if mechanism.chain is not None:
        needed = passed * mechanism.chain.torques(q, v, change / passed) + needed
    needed += damped * change + h * mechanism.dampings()[:nj] * v
    needed += h * (loads.implicit * speeds - loads.force)
    if loads.stiffness is not None:
        needed += h * h * ca.mtimes(loads.stiffness, speeds)
    share = ca.fabs(spread).T
    free = mechanism.free
    needed = ca.mtimes(spread.T, needed)
    needed += h * slip.friction(ca.mtimes(share, loads.up), ca.mtimes(share, loads.down))
    return needed + contacts.stiffness * (q[free] - contacts.position) + contacts.damping * after


def _middle(matrix: Matrix, load: Vector, v: Vector, up: Vector, down: Vector) -> Vector:
    """Return the speeds in the middle of a kick, (n_free,). With Coriolis torques taken there the
    step is of second order.

    Joints that move go on in their direction; those that stand still stay. The `load` is r with the
    Coriolis torques at the start.
    """
    ahead = Slip(v > 0, v < 0)
    after = solver(matrix, ahead.moving)(load - ahead.friction(up, down))
    return (v + after) / 2


def _contacts(
    mechanism: Mechanism, kick: Kick, v: Vector, inertias: Vector, last: bool
) -> Contacts:
    """Return which free joints press against a stop, judged by their velocities v without it; see
    `kick_at_stops` and `kicked_chain`.
    """
    length = kick.length
    drift = kick.drift
    table = ca.SX.zeros(len(mechanism.free), 3)
    for k, j in enumerate(mechanism.free):
        if not mechanism.bodies[j].has_stops:
            continue
        stiffness, damping, low, high = mechanism.stop(j)
        end = kick.q[j] if last else kick.q[j] + drift * v[k]
        at_high, at_low = (end > high, end < low) if last else met(end, v[k], *mechanism.stop(j))
        touching = ca.logic_or(at_high, at_low)
        share = ca.if_else(stiffness * drift * drift / inertias[k] <= 1, 0.5, 1)
        implicit = touching * length * (share * stiffness * drift + damping)
        position = ca.if_else(at_high, high, low)
        table[k, :] = ca.horzcat(touching * length * stiffness, implicit, position)
    return Contacts(*ca.horzsplit(table))


def _bounced(
    mechanism: Mechanism,
    kick: Kick,
    before: Vector,
    alone: Vector,
    inertias: Vector,
    pressed: Kicked,
) -> Kicked:
    """Return the free joints after some have bounced off their stops; the speeds of the other
    joints answer to these blows.

    Args:
        before: speeds before the kick.
        alone: speeds after it without stops.
        pressed: the free joints where none bounces.
    """
    drift = kick.drift
    contacts = pressed.contacts
    table = ca.SX.zeros(len(mechanism.free), 3)
    for k, j in enumerate(mechanism.free):
        if not mechanism.bodies[j].has_stops:
            continue
        stiffness, damping, _, high = mechanism.stop(j)
        unresolved = stiffness * drift * drift / inertias[k] > 1
        rebound = ca.if_else(unresolved, restitution(stiffness, damping, inertias[k]), 0)
        end = contacts.position[k]
        flight = Flight(alone[k], kick.q[j], before[k], kick.length, drift)
        flies, after, position = bounce(rebound, end == high, end, flight)
        table[k, :] = ca.horzcat(ca.logic_and(contacts.damping[k] > 0, flies), after, position)
    bouncing, speeds, positions = ca.horzsplit(table)
    imposed = bouncing * speeds
    impulse = pressed.load - pressed.slip.friction(pressed.up, pressed.down)
    moving = solver(pressed.matrix, pressed.slip.moving * (1 - bouncing))
    answered = imposed + moving(impulse - ca.mtimes(pressed.matrix, imposed))
    v = ca.if_else(ca.sum1(bouncing) > 0, answered, pressed.v)
    flown = kick.q[mechanism.free] + drift * v
    return replace(pressed, q=ca.if_else(bouncing, positions, flown), v=v)


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
            if rebounds:
                rebound = ca.if_else(resolved, 0, restitution(k_s, b_s, inertia))
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
    acting = [pulled + passive, up, down, ca.densify(stiffness)]
    force, up, down, stiffness = ca.substitute(acting, [at], [q])
    return Loads(force + effort, ca.SX(nj, 1), up, down, stiffness)


def kicked_chain(
    mechanism: Mechanism,
    kick: Kick,
    rebounds: bool = True,
    last: bool = False,
    settles: bool = False,
) -> Kicked:
    """Return the joints of a chain after a kick and the drift that follows.

    Args:
        rebounds: whether joints bounce off stops whose contact the step does not resolve.
        last: whether no drift follows, the `drift` of the kick being that before it; a joint then
            presses against a stop where it is inside it.
        settles: see `loads_of`; joints that settle begin at rest.
    """
    nj = mechanism.n_joints
    spread = mechanism.spread
    free = mechanism.free
    length = kick.length
    q = kick.q[:nj]
    v = ca.SX.zeros(nj) if settles else kick.v[:nj]
    loads = loads_of(mechanism, kick, settles)
    matrix = mechanism.mass_matrix(q)
    inertias = ca.diag(matrix)
    dampings = mechanism.dampings()[:nj]
    added = damped_inertias(mechanism, inertias, length) if kick.damped is None else kick.damped
    matrix += ca.diag(added)
    load = ca.mtimes(matrix, v) + length * (loads.force - dampings * v)
    matrix += ca.diag(length * loads.implicit)
    if loads.stiffness is not None:
        matrix += length * length * loads.stiffness
    share = ca.fabs(spread).T
    up = length * ca.mtimes(share, loads.up)
    down = length * ca.mtimes(share, loads.down)
    matrix = ca.mtimes([spread.T, matrix, spread])
    load = ca.mtimes(spread.T, load)
    if mechanism.chain is not None:
        torques = mechanism.chain.torques
        bias = ca.mtimes(spread.T, torques(q, v, ca.SX(nj, 1)))
        middle = _middle(matrix, load - length * bias, v[free], up, down)
        bias = ca.mtimes(spread.T, torques(q, ca.mtimes(spread, middle), ca.SX(nj, 1)))
        load -= length * bias
    inertias = inertias[free]

    slip = slipping(matrix, load, up, down)
    alone = solver(matrix, slip.moving)(load - slip.friction(up, down))
    at = q[free]

    def pressed(contacts: Contacts) -> Kicked:
        """Return the free joints with the stops in A and r."""
        held = matrix + ca.diag(contacts.damping)
        pressing = load - contacts.stiffness * (at - contacts.position)
        slip = slipping(held, pressing, up, down, start=alone, events=len(free))
        speeds = solver(held, slip.moving)(pressing - slip.friction(up, down))
        return Kicked(
            at + kick.drift * speeds, speeds, slip, contacts, held, pressing, up, down, added
        )

    if any(mechanism.bodies[j].has_stops for j in free):
        contacts = _contacts(mechanism, kick, alone, inertias, last)
        if last:
            # a stop only pushes: one that would pull lets go
            inside = at - contacts.position
            impulse = contacts.stiffness * inside + contacts.damping * pressed(contacts).v
            pushes = impulse * inside > 0
            contacts = Contacts(
                contacts.stiffness * pushes, contacts.damping * pushes, contacts.position
            )
        kicked = pressed(contacts)
        if rebounds and not last:
            kicked = _bounced(mechanism, kick, v[free], alone, inertias, kicked)
    else:
        none = Contacts(*(ca.SX(len(free), 1) for _ in range(3)))
        moved = at + kick.drift * alone
        kicked = Kicked(moved, alone, slip, none, matrix, load, up, down, added)
    angles = ca.mtimes(spread, kicked.q) + mechanism.offsets
    return replace(kicked, q=angles, v=ca.mtimes(spread, kicked.v))


def kick_and_drift(
    mechanism: Mechanism,
    kick: Kick,
    rebounds: bool = True,
    bodies: Sequence[int] | None = None,
    last: bool = False,
) -> tuple[Vector, Vector]:
    """Return (q⁺, v⁺) after one kick and the drift that follows: v⁺ = soft(a v + b F, b · limit),
    q⁺ = q + h v⁺.

    Args:
        rebounds: whether bodies bounce off stops whose contact the step does not resolve. A filter
            that linearises takes them as pressed instead, since the slope of a bounce is of no use
            to it.
        bodies: which bodies the kick moves; default all. The others drift with the velocity they
            have.
        last: whether it is the half kick that ends an interval, of which v⁺ counts alone. Its
            `drift` is the one before it.
    """
    z, limits, damping = impulses(mechanism, kick)
    free = range(mechanism.n_bodies) if bodies is None else bodies
    q = list[Scalar]()
    v = list[Scalar]()
    if mechanism.chain is not None:
        chain = kicked_chain(mechanism, kick, rebounds, last)
        q = ca.vertsplit(chain.q)
        v = ca.vertsplit(chain.v)
    for i in range(len(q), mechanism.n_bodies):
        push = Push(z[i], limits[i], kick.response[i, 1], damping[i])
        velocity = push.free if i in free else kick.v[i]
        position = kick.q[i] + kick.drift * velocity
        if i in free and mechanism.bodies[i].has_stops:
            k_s, b_s, low, high = mechanism.stop(i)
            rebound = kick.response[i, 2] if rebounds else 0.0
            stop = Stop(low, high, k_s, b_s, rebound, kick.response[i, 3])
            if last:
                velocity = velocity_in_stops(stop, push, kick.q[i], kick.drift)
            else:
                velocity, position = kick_at_stops(
                    stop, push, kick.q[i], kick.v[i], kick.length, kick.drift
                )
        q.append(position)
        v.append(velocity)
    return ca.vertcat(*q), ca.vertcat(*v)


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


def interval_step(
    mechanism: Mechanism, count: int, rebounds: bool = True, with_servo: bool = False
) -> ca.Function:
    """Return the function (q, v, effort, added_inertia, servo, dt, p) → (q⁺, v⁺) over an interval
    of `count` sub-steps.

    The scheme is kick–drift–kick leapfrog: half a kick and a drift, then `count` − 1 times a kick
    and a drift, then half a kick. What acts is constant over the interval and given for each body:
    `effort` is a force or torque, (n_bodies,); `added_inertia` is that of hung weights, which move
    with the bodies, (n_bodies,); `servo` is (stiffness, target, damping) of a spring and damper to
    a target, such as a hand or a position loop, (n_bodies, 3), and is taken implicitly.

    Args:
        rebounds: whether bodies bounce off stops (simulation) or are pressed against them
            (filters).
        with_servo: whether a spring and damper to a target may act on the bodies.
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.symbols
    of_kick = symbols(ca.SX, q=n, v=n, effort=n, response=(n, 4), length=1, drift=1)
    kick = Kick(*of_kick)
    servo, added = symbols(ca.SX, servo=(n, 3), added_inertia=n)
    if with_servo:
        stiffness, target, damping = ca.horzsplit(servo)
        implicit = ca.horzcat(stiffness * (target - kick.q), stiffness * kick.drift + damping)
        kick = replace(kick, implicit=implicit)
    arguments = [*of_kick, servo, p]
    moving = ca.Function(
        "substep", arguments, ca.cse(list(kick_and_drift(mechanism, kick, rebounds)))
    )
    closing = ca.Function(
        "last_kick", arguments, ca.cse([kick_and_drift(mechanism, kick, last=True)[1]])
    )
    step = kick.length, kick.drift, added
    prepared = ca.Function("responses", [*step, p], [responses(mechanism, *step)])

    inputs = symbols(ca.MX, q=n, v=n, effort=n, added_inertia=n, servo=(n, 3), dt=1, p=p.numel())
    q, v, effort, added, servo, dt, p = inputs
    h = dt / count
    half = prepared(h / 2, h, added, p), h / 2
    full = prepared(h, h, added, p), h
    for response, length in [half] + [full] * (count - 1):
        q, v = moving(q, v, effort, response, length, h, servo, p)
    v = closing(q, v, effort, *half, h, servo, p)
    return ca.Function("interval", inputs, [q, v])
