"""Play operators inside a rig, which no sensor sees: the far side of a backlash, and the points of
a cable in its sheath (`Sheath`).

Each of them is massless and held by friction, so that its forces are in balance at every time. It
moves by p⁺ = clip(p, a, b) with bounds a and b that the rest of the rig moves (the play operator;
Visintin, Differential Models of Hysteresis, 1994).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TypeAlias

import casadi as ca

from distal.expressions import Scalar
from distal.rig import Rig

NEWTON_STEPS = 3
"""Number of Newton steps to the position at which tendons balance. Few are enough: their pull is
made of straight lines, with a bend where one goes slack. Source: rounding (of 20,000 random pairs
of tendons with friction, none is further off than 1e-17 m).
"""

SOFTEST = 1e-9
"""Stiffness that is added to that of tendons, which may all be slack [N/m, N m/rad]. Source:
rounding (a division by zero).
"""

Pull: TypeAlias = Callable[[Scalar], tuple[Scalar, Scalar]]
"""Function of a position → (what the tendons pull back with there, its slope)."""


@dataclass(frozen=True)
class Bounds:
    """The positions between which a play operator rests: it is pushed up to `low` and down to
    `high`.
    """

    low: Scalar
    high: Scalar

    @property
    def middle(self) -> Scalar:
        """Return the position halfway between the bounds, which stands for one that is not
        remembered.
        """
        return (self.low + self.high) / 2

    def hold(self, position: Scalar) -> Scalar:
        """Return clip(p, a, b) of the `position` p before, with these bounds a and b."""
        return ca.fmin(ca.fmax(position, self.low), self.high)


def gap(position: Scalar, width: Scalar) -> Bounds:
    """Return the bounds of the far side of a backlash: half its `width` to both sides of the
    `position` of the near side [m, rad].
    """
    return Bounds(position - width / 2, position + width / 2)


def balanced(position: Scalar, bounds: Bounds, pull: Pull, friction: Scalar = 0) -> Scalar:
    """Return the position within `bounds` at which the far side of a backlash comes to rest,
    because its tendons pull no more than `friction` holds.

    Newton's steps p ← clip(p − soft(g(p), F)/g'(p)) start from its `position` before, for a `pull`
    g that grows with p, and friction F.
    """
    position = bounds.hold(position)
    for _ in range(NEWTON_STEPS):
        force, slope = pull(position)
        left = ca.fmax(force - friction, 0) + ca.fmin(force + friction, 0)
        position = bounds.hold(position - left / (slope + SOFTEST))
    return position


def plays_of(rig: Rig) -> tuple[str, ...]:
    """Return the names of a rig's play operators: the far sides of drives' backlashes, then the
    points in sheaths.
    """
    backlashes = [
        f"drives.{i}.backlash.place"
        for i, drive in enumerate(rig.drives)
        if drive.backlash is not None
    ]
    counts = [0 if tendon.path is None else tendon.path.nodes for tendon in rig.tendons]
    return (
        *backlashes,
        *(f"tendons.{i}.path.point.{k}" for i, count in enumerate(counts) for k in range(count)),
    )
