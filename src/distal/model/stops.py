"""End stops: springs and dampers that only push. A contact is taken implicitly where a body presses
against a stop, and as a rebound where it hits one.

F_stop = max(k_s (x − x_H) + b_s ẋ, 0) above x_H, min(k_s (x − x_L) + b_s ẋ, 0) below x_L, else 0:
equation (14), reconstructed. Its max and min are a correction: a stop only pushes, and as written
it would pull on release.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.expressions import Scalar
from distal.model.friction import Limit, slip, slipped, soft


def restitution(stiffness: Scalar, damping: Scalar, inertia: Scalar) -> Scalar:
    """Return the coefficient of restitution of a body that hits a stop which only pushes.

    e = exp(−(β/ω)(π − arctan(2βω/(ω² − β²)))) with β = b_s/2m, ω² = k_s/m − β²; contact ends where
    the force, not the penetration, is zero (Schwager & Pöschel, Granular Matter 9, 2007). It is
    zero where the contact is overdamped. The stop has the `stiffness` k_s and the `damping` b_s,
    the body the `inertia` m.
    """
    beta = damping / (2 * inertia)
    square = stiffness / inertia - beta * beta
    oscillates = square > 0
    omega = ca.sqrt(ca.if_else(oscillates, square, 1))
    phase = ca.pi - ca.atan2(2 * beta * omega, omega * omega - beta * beta)
    return ca.if_else(oscillates, ca.exp(-beta / omega * phase), 0)


@dataclass(frozen=True)
class Push:
    """The effect of a kick on a body, before friction and stops.

    Args:
        z: velocity after the other forces.
        limit: friction limit as a velocity, l = b · μN.
        b: response of the velocity to a constant force over the kick.
        implicit: damping coefficient D that is taken implicitly.
    """

    z: Scalar
    limit: Limit
    b: Scalar
    implicit: Scalar

    @property
    def free(self) -> Scalar:
        """The velocity of the body without stops, soft(z, l)/(1 + b D)."""
        return soft(self.z, self.limit) / (1 + self.b * self.implicit)


@dataclass(frozen=True)
class Flight:
    """A kick of a body and the drift that follows, without stops.

    Args:
        free: velocity after the kick.
        position: at the start of the drift.
        before: velocity before the kick.
        length: of the kick [s].
        drift: length of the drift, h [s].
    """

    free: Scalar
    position: Scalar
    before: Scalar
    length: Scalar
    drift: Scalar


@dataclass(frozen=True)
class Stop:
    """The stops of one body, and how a time step takes a contact with them.

    A contact that the step resolves (k_s h²/m ≤ 1) is a spring taken at the middle of the drift
    (implicitness ½, no numerical damping) and needs no rebound. One that it does not resolve is a
    rigid rebound with the coefficient of restitution when hit, and fully implicit when pressed.

    Args:
        low: lower end, x_L.
        high: upper end, x_H.
        stiffness: k_s.
        damping: b_s.
        rebound: coefficient of restitution e, 0 for none.
        implicitness: share α of the coming drift at which the spring is taken.
    """

    low: Scalar
    high: Scalar
    stiffness: Scalar
    damping: Scalar
    rebound: Scalar
    implicitness: Scalar

    def pressed(
        self,
        push: Push,
        position: Scalar,
        stop_position: Scalar,
        drift: Scalar,
        contact: Scalar = True,
    ) -> Scalar:
        """Return the velocity of a body that presses against a stop, exact with friction, implicit
        in the spring.

        It is the solution v of (1 + b (D + α k_s h + b_s)) v + l ∂|v| ∋ z − b k_s (x − x_stop). It
        grows with z, so that a stop that was found by looking at the velocity without it can only
        push. Without contact it is v = soft(z, l)/(1 + b D). Both have the form of `slipped` less c
        (x − x_stop). The choice is made between their factors, so that derivatives need no choice
        of their own.

        Args:
            push: the kick, before friction and stops.
            position: x at the start of the drift.
            stop_position: the stop, x_L or x_H.
            drift: length h of the drift [s].
            contact: whether the body is pressed against the stop.
        """
        z = push.z
        limit = push.limit
        b = push.b
        implicit = push.implicit
        inside = position - stop_position
        held = 1 / (1 + b * (implicit + self.implicitness * self.stiffness * drift + self.damping))
        forward, back = slip(z - b * self.stiffness * inside, limit, held)
        spring = (forward + back) * (b * self.stiffness)
        if contact is not True:
            loose = slip(z, limit, 1 / (1 + b * implicit))
            forward = ca.if_else(contact, forward, loose[0])
            back = ca.if_else(contact, back, loose[1])
            spring = ca.if_else(contact, spring, 0)
        return slipped(forward, back, z, limit) - spring * inside


def kick_at_stops(
    stop: Stop, push: Push, position: Scalar, before: Scalar, length: Scalar, drift: Scalar
) -> tuple[Scalar, Scalar]:
    """Return (v⁺, x⁺) of a body with stops after a kick and a drift.

    Without contact v⁺ = soft(z, l)/(1 + b D), x⁺ = x + h v⁺. If that drifts into a stop, the body
    is pressed against it (`Stop.pressed`). Where it flies in and the rebound leads it away again,
    it bounces instead (`bounce`).

    Args:
        push: the kick, before friction and stops.
        position: x at the start of the drift.
        before: velocity before the kick.
        length: of the kick [s].
        drift: length of the drift, h [s].
    """
    free = push.free
    end = position + drift * free
    at_high, at_low = met(end, free, stop.stiffness, stop.damping, stop.low, stop.high)
    contact = ca.logic_or(at_high, at_low)
    stop_position = ca.if_else(at_high, stop.high, stop.low)
    velocity = stop.pressed(push, position, stop_position, drift, contact)
    final = position + drift * velocity
    if isinstance(stop.rebound, (int, float)):
        return velocity, final
    bounces, after, bounced = bounce(
        stop.rebound, at_high, stop_position, Flight(free, position, before, length, drift)
    )
    bounces = ca.logic_and(bounces, contact)
    return ca.if_else(bounces, after, velocity), ca.if_else(bounces, bounced, final)


def met(
    end: Scalar, velocity: Scalar, stiffness: Scalar, damping: Scalar, low: Scalar, high: Scalar
) -> tuple[Scalar, Scalar]:
    """Return whether the high and the low stop of a body push on it.

    Args:
        end: where it drifts to [rad, m].
        velocity: of the drift.
        stiffness: of the stops, as `Mechanism.stop` gives this and the rest.
        damping: of the stops.
        low: lower end of its range.
        high: upper end.
    """
    return (
        ca.logic_and(end > high, stiffness * (end - high) + damping * velocity > 0),
        ca.logic_and(end < low, stiffness * (end - low) + damping * velocity < 0),
    )


def bounce(
    rebound: Scalar, at_high: Scalar, stop_position: Scalar, flight: Flight
) -> tuple[Scalar, Scalar, Scalar]:
    """Return whether a body that meets a stop flies off again within the drift, and its velocity
    and position after it.

    The body meets the stop at `stop_position` (the upper one where `at_high`) at the time at which
    the parabola of its `flight` reaches it. It leaves with −e times its speed there, e being
    `rebound`, and flies on for the rest of the drift.
    """
    free = flight.free
    length = flight.length
    drift = flight.drift
    # motion towards the stop, s > 0: gap = u τ + ½ A τ², u the speed at the start of the drift
    towards = ca.if_else(at_high, 1, -1)
    acceleration = towards * (free - flight.before) / ca.if_else(length > 0, length, 1)
    start = towards * free - acceleration * drift / 2
    gap = towards * (stop_position - flight.position)
    speed = ca.sqrt(ca.fmax(start * start + 2 * acceleration * gap, 0))
    closing = start + speed
    time = ca.fmin(2 * gap / ca.if_else(closing > 0, closing, 1), drift)
    left = drift - time
    # it bounces if the flight after the hit outlasts the drift; otherwise it would come to rest
    # within the drift and counts as pressed
    flies = ca.logic_and(
        ca.logic_and(gap > 0, 2 * rebound * speed > acceleration * left), rebound > 0
    )
    away = -rebound * speed
    bounced = stop_position + towards * (away * left + acceleration * left * left / 2)
    return flies, towards * (away + acceleration * (left - drift / 2)), bounced


def velocity_in_stops(stop: Stop, push: Push, position: Scalar, drift: Scalar) -> Scalar:
    """Return v⁺ of the last half kick, after which no drift follows, of a body at a `position`.
    Where this is inside a stop, the stop's spring is taken over the `drift` before the kick [s].
    """
    free = push.free
    inside = ca.if_else(position > stop.high, stop.high, stop.low)
    pressed = stop.pressed(push, position, inside, drift)
    pushes = ca.if_else(position > stop.high, pressed < free, pressed > free)
    contact = ca.logic_and(ca.logic_or(position > stop.high, position < stop.low), pushes)
    return stop.pressed(push, position, inside, drift, contact)
