"""One kick of joints that carry one another: all of their velocities at once, with exact friction
and their stops.

In impulses over a kick of length h the equations are A v⁺ + h f = r with A = M(q) + h (D̃ + D) and
r = (M + h D̃ − h C) v + h (F − c − g), f being friction. The Coriolis torques c are those in the
middle of the kick. C holds the joints' viscous dampings. D̃_j = (M_jj/h)(φ(x) − 1) with φ(x) = x/(1
− e^{−x}) and x = C_j h/M_jj makes the response of a joint alone the exact one of `free_response`. D
is damping that is taken implicitly. Where a kick is long compared with the joints' own oscillation,
the tendons' stiffness K is taken implicitly too, A += h² K, and the joints come to rest within the
kick (linearly implicit Euler; Hairer and Wanner, Solving Ordinary Differential Equations II, 1996,
section IV.7).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.expressions import Matrix, Scalar, Vector
from distal.model.chain import Slip, slipping, solver
from distal.model.mechanism import Mechanism
from distal.model.stops import Flight, bounce, met, restitution

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


def chain_kick(
    mechanism: Mechanism,
    q: Vector,
    v: Vector,
    loads: Loads,
    length: Scalar,
    drift: Scalar,
    *,
    last: bool,
    rebounds: bool,
    damped: Vector | None = None,
) -> Kicked:
    """Return the joints of a chain after a kick and the drift that follows.

    Args:
        q: angles before the kick, (n_joints,).
        v: speeds before the kick, (n_joints,).
        length: of the kick [s].
        drift: length of the drift that follows; in the last kick, of the drift before it [s].
        last: whether no drift follows; a joint then presses against a stop where it is inside it.
        rebounds: whether joints bounce off stops whose contact the step does not resolve.
        damped: `damped_inertias`, where they are the same in all kicks; default those at q.
    """
    nj = mechanism.n_joints
    spread = mechanism.spread
    free = mechanism.free
    matrix = mechanism.mass_matrix(q)
    assembled = mechanism.chain
    inertias = ca.diag(matrix)
    dampings = mechanism.dampings()[:nj]
    added = damped_inertias(mechanism, inertias, length) if damped is None else damped
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
    if assembled is not None:
        bias = ca.mtimes(spread.T, assembled.torques(q, v, ca.SX(nj, 1)))
        middle = _middle(matrix, load - length * bias, v[free], up, down)
        bias = ca.mtimes(spread.T, assembled.torques(q, ca.mtimes(spread, middle), ca.SX(nj, 1)))
        load -= length * bias
    inertias = inertias[free]

    slip = slipping(matrix, load, up, down)
    alone = solver(matrix, slip.moving)(load - slip.friction(up, down))
    contacts = Contacts(*(ca.SX(len(free), 1) for _ in range(3)))
    at = q[free]
    kicked = alone
    stopped = any(mechanism.bodies[j].has_stops for j in free)
    if stopped:
        contacts = _contacts(mechanism, at, alone, inertias, length, drift, last=last)
        if last:
            # a stop only pushes: one that would pull lets go
            *_, kicked = _pressed(contacts, at, alone, matrix, load, up=up, down=down)
            inside = at - contacts.position
            pushes = (contacts.stiffness * inside + contacts.damping * kicked) * inside > 0
            contacts = Contacts(
                contacts.stiffness * pushes, contacts.damping * pushes, contacts.position
            )
        matrix, load, slip, kicked = _pressed(contacts, at, alone, matrix, load, up=up, down=down)
    moved = at + drift * kicked
    if stopped and rebounds and not last:
        motion = (at, v[free], alone, kicked)
        system = (matrix, load, slip, up, down)
        kicked, moved = _bounced(
            mechanism, motion, system, contacts, inertias=inertias, length=length, drift=drift
        )
    angles = ca.mtimes(spread, moved) + mechanism.offsets
    return Kicked(angles, ca.mtimes(spread, kicked), slip, contacts, matrix, load, up, down, added)


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
    mechanism: Mechanism,
    q: Vector,
    v: Vector,
    inertias: Vector,
    length: Scalar,
    drift: Scalar,
    *,
    last: bool,
) -> Contacts:
    """Return which free joints press against a stop, judged by their velocities without it; see
    `kick_at_stops`.
    """
    rows = list[tuple[Scalar, Scalar, Scalar]]()
    for k, j in enumerate(mechanism.free):
        if not mechanism.bodies[j].has_stops:
            rows.append((0, 0, 0))
            continue
        stiffness, damping, low, high = mechanism.stop(j)
        end = q[k] if last else q[k] + drift * v[k]
        at_high, at_low = (end > high, end < low) if last else met(end, v[k], *mechanism.stop(j))
        touching = ca.logic_or(at_high, at_low)
        share = ca.if_else(stiffness * drift * drift / inertias[k] <= 1, 0.5, 1)
        implicit = touching * length * (share * stiffness * drift + damping)
        rows.append((touching * length * stiffness, implicit, ca.if_else(at_high, high, low)))
    return Contacts(*(ca.vertcat(*column) for column in zip(*rows)))


def _pressed(
    contacts: Contacts,
    at: Vector,
    alone: Vector,
    matrix: Matrix,
    load: Vector,
    *,
    up: Vector,
    down: Vector,
) -> tuple[Matrix, Vector, Slip, Vector]:
    """Return A and r with the stops in them, which free joints slip then, and their speeds."""
    pressed = matrix + ca.diag(contacts.damping)
    pressing = load - contacts.stiffness * (at - contacts.position)
    slip = slipping(pressed, pressing, up, down, start=alone, events=matrix.size1())
    return pressed, pressing, slip, solver(pressed, slip.moving)(pressing - slip.friction(up, down))


def _bounced(
    mechanism: Mechanism,
    motion: tuple[Vector, Vector, Vector, Vector],
    system: tuple[Matrix, Vector, Slip, Vector, Vector],
    contacts: Contacts,
    *,
    inertias: Vector,
    length: Scalar,
    drift: Scalar,
) -> tuple[Vector, Vector]:
    """Return speeds and angles after joints have bounced off their stops; the speeds of the other
    joints answer to these blows.
    """
    at, before, alone, kicked = motion
    matrix, load, slip, up, down = system
    rows = list[tuple[Scalar, Scalar, Scalar]]()
    for k, j in enumerate(mechanism.free):
        if not mechanism.bodies[j].has_stops:
            rows.append((ca.SX(0), ca.SX(0), ca.SX(0)))
            continue
        stiffness, damping, _, high = mechanism.stop(j)
        unresolved = stiffness * drift * drift / inertias[k] > 1
        rebound = ca.if_else(unresolved, restitution(stiffness, damping, inertias[k]), 0)
        touching = contacts.damping[k] > 0
        at_high = contacts.position[k] == high
        flight = Flight(alone[k], at[k], before[k], length, drift)
        flies, after, position = bounce(rebound, at_high, contacts.position[k], flight)
        rows.append((ca.logic_and(touching, flies), after, position))
    bounces, speeds, positions = zip(*rows)
    bouncing = ca.vertcat(*bounces)
    imposed = bouncing * ca.vertcat(*speeds)
    moving = slip.moving * (1 - bouncing)
    impulse = load - slip.friction(up, down) - ca.mtimes(matrix, imposed)
    answered = imposed + solver(matrix, moving)(impulse)
    velocities = [
        ca.if_else(ca.sum1(bouncing) > 0, answered[k], kicked[k]) for k in range(len(bounces))
    ]
    angles = [
        ca.if_else(bounces[k], positions[k], at[k] + drift * velocities[k])
        for k in range(len(bounces))
    ]
    return ca.vertcat(*velocities), ca.vertcat(*angles)
