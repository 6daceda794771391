"""The time step: kick–drift–kick leapfrog with exact damping, exact friction, and stops. An
interval between samples is repeated calls of one function for a sub-step, whose code is there
once.

Joints that carry one another get all of their velocities at once; those of other bodies follow from
the same equations. In impulses over a kick of length h these are A v⁺ + h f = r with A = M(q) + h
(D̃ + D) and r = (M + h D̃ − h C) v + h (F − c − g), f being friction. It is the set-valued force of
Coulomb: a body in stick does not creep, whatever the step. The Coriolis torques c are those in the
middle of the kick. C holds the viscous dampings. D̃_j = (M_jj/h)(φ(x) − 1) with φ(x) = x/(1 −
e^{−x}) and x = C_j h/M_jj makes the response of a body alone to a constant force the exact one. D
is damping that is taken implicitly. Where a kick is long compared with the joints' own oscillation,
the tendons' stiffness K is taken implicitly too, A += h² K, and the joints come to rest within the
kick (linearly implicit Euler; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996,
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
from distal.model.friction import Flight, Limit, Slip, bounce, restitution, slipping, solver
from distal.model.mechanism import Mechanism

SHORTEST_KICK = 1e-15
"""Least length of a kick, by which changes of velocities are divided [s]. Source: rounding (a
division by zero).
"""


@dataclass(frozen=True)
class Loads:
    """The forces on some bodies in one kick, (n,) each if no other shape is said.

    Args:
        force: F, all forces but inertia, damping, friction and stops [N m, N].
        implicit: D, damping that is taken implicitly [N m s/rad, kg/s].
        up: friction limits against + motion [N m, N].
        down: friction limits against − motion [N m, N].
        stiffness: K of the taut tendons and springs, taken implicitly, (n, n) [N m/rad]; None for
            none.
    """

    force: Vector
    implicit: Vector
    up: Vector
    down: Vector
    stiffness: Matrix | None = None


@dataclass(frozen=True)
class Contacts:
    """The contacts of free bodies with stops: each gets the impulse −κ (q − position) − δ v⁺.

    Args:
        stiffness: κ, (n_free,), 0 without contact.
        damping: δ, (n_free,), 0 without contact.
        position: of the stop, (n_free,) [rad, m].
    """

    stiffness: Vector
    damping: Vector
    position: Vector


@dataclass(frozen=True)
class Kicked:
    """All joints, or all drives, after a kick and the drift that follows.

    Args:
        q: their coordinates, (n,) [rad, m].
        v: their velocities, (n,).
        slip: which free ones slip.
        contacts: which free ones press against a stop.
        matrix: A with the stops in it, (n_free, n_free).
        load: r with the stops in it, (n_free,).
        up: friction impulses against + motion, (n_free,).
        down: friction impulses against − motion, (n_free,).
        damped: `damped_inertias`, (n,).
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


def _growth(damping: Vector, inertia: Vector, length: Scalar) -> Scalar:
    """Return φ(x) = x/(1 − e^{−x}) with x = C h/M: 1 without damping."""
    if damping.is_zero():
        return ca.SX(1)
    x = damping * length / inertia
    small = x < 1e-5
    return ca.if_else(small, 1 + x / 2 + x * x / 12, -x / ca.if_else(small, 1, ca.expm1(-x)))


def damped_inertias(dampings: Vector, inertias: Vector, length: Scalar) -> Vector:
    """Return M_jj (φ − 1), what the viscous `dampings` C_j, (n,), add to the `inertias` M_jj, (n,),
    over a kick of a `length` [s], (n,) [kg m², kg].
    """
    pairs = zip(ca.vertsplit(dampings), ca.vertsplit(inertias))
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
    friction: Vector,
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
        friction: impulses h f, (n_free,).
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
    needed += h * (loads.implicit[:nj] * speeds - loads.force[:nj])
    if loads.stiffness is not None:
        needed += h * h * ca.mtimes(loads.stiffness, speeds)
    needed = ca.mtimes(spread.T, needed) + friction + contacts.damping * after
    return needed + contacts.stiffness * (q[mechanism.free] - contacts.position)


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
    mechanism: Mechanism, kick: Kick, free: Sequence[int], v: Vector, inertias: Vector, last: bool
) -> Contacts:
    """Return which `free` bodies press against a stop, judged by their velocities v without it.

    That are those which drift into a stop and would be pushed back there, or, in the `last` kick,
    those which are inside one. A contact that the step resolves (k_s h²/m ≤ 1) is a spring taken at
    the middle of the drift, without numerical damping. One that it does not resolve is fully
    implicit.
    """
    drift = kick.drift
    table = ca.SX.zeros(len(free), 3)
    for k, j in enumerate(free):
        if not mechanism.bodies[j].has_stops:
            continue
        stiffness, damping, low, high = mechanism.stop(j)
        end = kick.q[j] if last else kick.q[j] + drift * v[k]
        at_high = end > high
        at_low = end < low
        if not last:
            at_high = ca.logic_and(at_high, stiffness * (end - high) + damping * v[k] > 0)
            at_low = ca.logic_and(at_low, stiffness * (end - low) + damping * v[k] < 0)
        touching = ca.logic_or(at_high, at_low) * kick.length
        share = ca.if_else(stiffness * drift * drift / inertias[k] <= 1, 0.5, 1)
        implicit = touching * (share * stiffness * drift + damping)
        table[k, :] = ca.horzcat(touching * stiffness, implicit, ca.if_else(at_high, high, low))
    return Contacts(*ca.horzsplit(table))


def _pressed(kick: Kick, free: Sequence[int], alone: Kicked, contacts: Contacts) -> Kicked:
    """Return the `free` bodies, which were kicked `alone`, with the stops in A and r."""
    at = kick.q[free]
    matrix = alone.matrix + ca.diag(contacts.damping)
    load = alone.load - contacts.stiffness * (at - contacts.position)
    slip = slipping(matrix, load, alone.up, alone.down, start=alone.v, events=len(free))
    v = solver(matrix, slip.moving)(load - slip.friction(alone.up, alone.down))
    after = replace(alone, q=at + kick.drift * v, v=v, slip=slip, contacts=contacts)
    return replace(after, matrix=matrix, load=load)


def restitutions(mechanism: Mechanism, inertias: Vector, drift: Scalar) -> Vector:
    """Return the coefficients of restitution of the first n bodies, (n,): zero without stops, and
    where a step with this `drift` [s] resolves the contact, which then needs no rebound. The
    `inertias` are (n,).
    """
    rebounds = []
    for i, inertia in enumerate(ca.vertsplit(inertias)):
        rebound = ca.SX(0)
        if mechanism.bodies[i].has_stops:
            stiffness, damping, _, _ = mechanism.stop(i)
            unresolved = stiffness * drift * drift / inertia > 1
            rebound = ca.if_else(unresolved, restitution(stiffness, damping, inertia), 0)
        rebounds.append(rebound)
    return ca.vertcat(*rebounds)


def _bounced(
    mechanism: Mechanism,
    kick: Kick,
    free: Sequence[int],
    rebound: Vector,
    alone: Vector,
    pressed: Kicked,
) -> Kicked:
    """Return the `free` bodies after some have bounced off their stops; the velocities of the other
    ones answer to these blows.

    Args:
        rebound: coefficients of restitution, (n_free,).
        alone: velocities after the kick without stops.
        pressed: the free bodies where none bounces.
    """
    contacts = pressed.contacts
    table = ca.SX.zeros(len(free), 3)
    for k, j in enumerate(free):
        if not mechanism.bodies[j].has_stops:
            continue
        end = contacts.position[k]
        flight = Flight(alone[k], kick.q[j], kick.v[j], kick.length, kick.drift)
        flies, after, position = bounce(rebound[k], end == mechanism.stop(j)[3], end, flight)
        table[k, :] = ca.horzcat(ca.logic_and(contacts.damping[k] > 0, flies), after, position)
    bouncing, speeds, positions = ca.horzsplit(table)
    imposed = bouncing * speeds
    impulse = pressed.load - pressed.slip.friction(pressed.up, pressed.down)
    moving = solver(pressed.matrix, pressed.slip.moving * (1 - bouncing))
    answered = imposed + moving(impulse - ca.mtimes(pressed.matrix, imposed))
    v = ca.if_else(ca.sum1(bouncing) > 0, answered, pressed.v)
    flown = kick.q[free] + kick.drift * v
    return replace(pressed, q=ca.if_else(bouncing, positions, flown), v=v)


RESOLUTION = 0.6
"""Largest product of a sub-step and the rig's highest natural frequency [1]. Source: benchmark
(docs/results/numerics.md).
"""

MOST_SUBSTEPS = 1000
"""Largest number of sub-steps in an interval; a rig that needs more has a wrong unit or size.
Source: judgement.
"""


@dataclass(frozen=True)
class Kick:
    """The symbols of one kick, all SX.

    Args:
        q: coordinates, (n_bodies,) [rad, m].
        v: their velocities, (n_bodies,).
        effort: force or torque on each body, (n_bodies,).
        length: of the kick [s].
        drift: length of the drift that follows, or, in the last kick, of the drift before it [s].
        implicit: (force F, damping D) of each body, (n_bodies, 2): F − D v⁺ is taken implicitly;
            None for none.
        damped: `damped_inertias` of the joints, or of all bodies, where they are the same in all
            kicks; those of a chain follow from q.
        rebound: `restitutions` of all bodies, (n_bodies,); None where none bounces off a stop whose
            contact the step does not resolve. A filter that linearises takes bodies as pressed
            instead, since the slope of a bounce is of no use to it.
        added_inertia: of hung weights, which move with the bodies, (n_bodies,); None for none.
    """

    q: Vector
    v: Vector
    effort: Vector
    length: Scalar
    drift: Scalar
    implicit: Matrix | None = None
    damped: Vector | None = None
    rebound: Vector | None = None
    added_inertia: Vector | None = None


def loads_of(mechanism: Mechanism, kick: Kick, settles: bool = False) -> Loads:
    """Return the forces on all bodies in a kick.

    The damping that tendons give to a body's own velocity is taken implicitly, so that stiff
    damping needs no small step. Where it `settles`, the joints come to rest within the kick: the
    drives are taken where they are at its end, stiffness is implicit, and only the forces on joints
    are returned.
    """
    if settles:
        nj = mechanism.n_joints
        ahead = ca.vertcat(kick.q[:nj], kick.q[nj:] + kick.drift * kick.v[nj:])
        return _settling(mechanism, ahead, kick.effort[:nj])
    pulls = mechanism.pulls(kick.q, kick.v)
    damping = mechanism.tendon_damping(kick.q, pulls.joint)
    force = pulls.forces + mechanism.passive_forces(kick.q) + kick.effort + damping * kick.v
    if kick.implicit is not None:
        force = force + kick.implicit[:, 0]
        damping = damping + kick.implicit[:, 1]
    limits = mechanism.friction_limits(kick.q, kick.v, pulls.joint, pulls.drive)
    return Loads(force, damping, *_sides(limits))


def _sides(limits: Sequence[Limit]) -> tuple[Vector, Vector]:
    """Return friction limits against + and against − motion, (n,) each."""
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


def kicked(
    mechanism: Mechanism,
    kick: Kick,
    loads: Loads,
    *,
    drives: bool = False,
    last: bool = False,
    settles: bool = False,
) -> Kicked:
    """Return the joints, or the `drives`, after a kick and the drift that follows.

    Args:
        loads: `loads_of` the kick.
        last: whether no drift follows, the `drift` of the kick being that before it; a body then
            presses against a stop where it is inside it.
        settles: see `loads_of`; joints that settle begin at rest.
    """
    nj = mechanism.n_joints
    first, end = (nj, mechanism.n_bodies) if drives else (0, nj)
    bodies = slice(first, end)
    free = [*range(first, end)] if drives else mechanism.free
    spread = ca.DM.eye(mechanism.n_drives) if drives else mechanism.spread
    chain = None if drives else mechanism.chain
    length = kick.length
    q = kick.q[bodies]
    v = ca.SX.zeros(nj) if settles else kick.v[bodies]
    matrix = ca.diag(mechanism.inertias()[bodies]) if drives else mechanism.mass_matrix(q)
    if kick.added_inertia is not None:
        matrix += ca.diag(kick.added_inertia[bodies])
    inertias = ca.diag(matrix)
    dampings = mechanism.dampings()[bodies]
    if kick.damped is None or chain is not None:
        added = damped_inertias(dampings, inertias, length)
    else:
        added = kick.damped[bodies]
    matrix += ca.diag(added)
    load = ca.mtimes(matrix, v) + length * (loads.force[bodies] - dampings * v)
    matrix += ca.diag(length * loads.implicit[bodies])
    if loads.stiffness is not None:
        matrix += length * length * loads.stiffness
    share = ca.fabs(spread).T
    up = length * ca.mtimes(share, loads.up[bodies])
    down = length * ca.mtimes(share, loads.down[bodies])
    matrix = ca.mtimes([spread.T, matrix, spread])
    load = ca.mtimes(spread.T, load)
    rebound = kick.rebound
    if chain is not None:
        bias = ca.mtimes(spread.T, chain.torques(q, v, ca.SX(nj, 1)))
        middle = _middle(matrix, load - length * bias, v[free], up, down)
        bias = ca.mtimes(spread.T, chain.torques(q, ca.mtimes(spread, middle), ca.SX(nj, 1)))
        load -= length * bias
        if rebound is not None:
            rebound = restitutions(mechanism, inertias, kick.drift)
    slip = slipping(matrix, load, up, down)
    alone = solver(matrix, slip.moving)(load - slip.friction(up, down))
    after = Kicked(
        kick.q[free] + kick.drift * alone,
        alone,
        slip,
        Contacts(*ca.horzsplit(ca.SX(len(free), 3))),
        matrix,
        load,
        up,
        down,
        added,
    )
    if any(mechanism.bodies[j].has_stops for j in free):
        contacts = _contacts(
            mechanism, kick, free, alone, inertias[[j - first for j in free]], last
        )
        if last:
            # a stop only pushes: one that would pull lets go
            inside = kick.q[free] - contacts.position
            speeds = _pressed(kick, free, after, contacts).v
            pushes = (contacts.stiffness * inside + contacts.damping * speeds) * inside > 0
            contacts = Contacts(
                contacts.stiffness * pushes, contacts.damping * pushes, contacts.position
            )
        after = _pressed(kick, free, after, contacts)
        if rebound is not None and not last:
            after = _bounced(mechanism, kick, free, rebound[free], alone, after)
    if drives:
        return after
    return replace(
        after, q=ca.mtimes(spread, after.q) + mechanism.offsets, v=ca.mtimes(spread, after.v)
    )


def kick_and_drift(mechanism: Mechanism, kick: Kick, last: bool = False) -> tuple[Vector, Vector]:
    """Return (q⁺, v⁺) of all bodies after one kick and the drift that follows; the `last` half kick
    ends an interval, of which v⁺ counts alone.
    """
    loads = loads_of(mechanism, kick)
    parts = [kicked(mechanism, kick, loads, drives=drives, last=last) for drives in (False, True)]
    return ca.vertcat(*(part.q for part in parts)), ca.vertcat(*(part.v for part in parts))


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


def interval_step(mechanism: Mechanism, count: int, rebounds: bool = True) -> ca.Function:
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
    """
    n = mechanism.n_bodies
    p = mechanism.parameters.symbols
    q, v, effort, length, drift = symbols(ca.SX, q=n, v=n, effort=n, length=1, drift=1)
    servo, damped, rebound, added = symbols(
        ca.SX, servo=(n, 3), damped=n, rebound=n, added_inertia=n
    )
    stiffness, target, damping = ca.horzsplit(servo)
    kick = Kick(
        q,
        v,
        effort,
        length,
        drift,
        implicit=ca.horzcat(stiffness * (target - q), stiffness * drift + damping),
        damped=damped,
        rebound=rebound if rebounds else None,
        added_inertia=added,
    )
    arguments = [q, v, effort, length, drift, damped, rebound, servo, added, p]
    moving = ca.Function("substep", arguments, ca.cse([*kick_and_drift(mechanism, kick)]))
    closing = ca.Function(
        "last_kick", arguments, ca.cse([kick_and_drift(mechanism, kick, last=True)[1]])
    )
    inertias = mechanism.inertias() + added
    constants = [
        damped_inertias(mechanism.dampings(), inertias, length),
        restitutions(mechanism, inertias, drift),
    ]
    prepared = ca.Function("constants", [length, drift, added, p], constants)

    inputs = symbols(ca.MX, q=n, v=n, effort=n, added_inertia=n, servo=(n, 3), dt=1, p=p.numel())
    q, v, effort, added, servo, dt, p = inputs
    h = dt / count
    half = h / 2, h, *prepared(h / 2, h, added, p)
    full = h, h, *prepared(h, h, added, p)
    for step in [half] + [full] * (count - 1):
        q, v = moving(q, v, effort, *step, servo, added, p)
    v = closing(q, v, effort, *half, servo, added, p)
    return ca.Function("interval", inputs, [q, v])
