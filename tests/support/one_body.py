"""A kick of each body alone, as it stands in textbooks: the exact response of a body with viscous
damping to a constant force, friction as a projection of the velocity, and a stop as a spring.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.model import Kick, Mechanism
from distal.model.stepping import Loads, loads_of


def soft(z: ca.SX, up: ca.SX, down: ca.SX) -> ca.SX:
    """Return the one v with z − v in [−l₋, l₊] · sgn(v)."""
    return ca.fmax(z - up, 0) + ca.fmin(z + down, 0)


@dataclass(frozen=True)
class OneBody:
    """A body's response b to a force, its velocity z = a v + b F before friction and stops, its
    friction limits as velocities, and its velocity after all.
    """

    b: ca.SX
    z: ca.SX
    up: ca.SX
    down: ca.SX
    damping: ca.SX
    velocity: ca.SX


def one_body(
    mechanism: Mechanism, kick: Kick, body: int, last: bool = False, loads: Loads | None = None
) -> OneBody:
    """Return a body after a kick; it is pressed against its stops, and bounces off none."""
    loads = loads or loads_of(mechanism, kick)
    c, m, h = mechanism.dampings()[body], mechanism.inertias()[body], kick.drift
    x = ca.fmax(c * kick.length / m, 1e-9)
    b = kick.length / m * -ca.expm1(-x) / x
    z = ca.exp(-c * kick.length / m) * kick.v[body] + b * loads.force[body]
    up, down, drag = b * loads.up[body], b * loads.down[body], loads.implicit[body]
    velocity = free = soft(z, up, down) / (1 + b * drag)
    if mechanism.bodies[body].has_stops:
        k, c_stop, low, high = mechanism.stop(body)
        at, end = kick.q[body], kick.q[body] + (0 if last else h * free)
        stop = ca.if_else(end > high, high, low)
        share = ca.if_else(k * h * h / m <= 1, 0.5, 1)
        held = 1 + b * (drag + share * k * h + c_stop)
        pressed = soft(z - b * k * (at - stop), up, down) / held
        is_beyond = ca.logic_or(end > high, end < low)
        side = ca.if_else(end > high, 1, -1)
        pushes = pressed < free if last else k * (end - stop) + c_stop * free > 0
        pulls = pressed > free if last else k * (end - stop) + c_stop * free < 0
        velocity = ca.if_else(
            ca.logic_and(is_beyond, ca.if_else(side > 0, pushes, pulls)), pressed, free
        )
    return OneBody(b, z, up, down, drag, velocity)
