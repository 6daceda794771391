"""A line of a hand's table: a joint, and what moves it."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Literal

from distal.errors import RigError

MOST_COUNTS = 1e9
"""Largest number of counts of an encoder in one turn [1]. Source: judgement."""


@dataclass(frozen=True, kw_only=True)
class Row:
    """A joint that a motor's tendon moves, or that follows another; None stands for what is not
    known.

    Args:
        joint: its name.
        motor: name or number of the motor; None for a joint that only `follows` another.
        low: end of the joint's range [rad].
        high: the other end [rad].
        spool_radius: of the motor [m].
        joint_radius: of the pulley at the joint [m].
        direction: +1 where the joint's angle grows as the motor's reading grows.
        back: whether a second "tendon" on the same spool or a "spring" brings the joint back.
        zero: what the motor reads while the joint is at zero [rad].
        zero_std: std of that reading [rad].
        ratio_std: std of the ratio of both radii, as a share.
        unit: of what the motor reads, "rad" or "deg", where it does not log counts.
        counts: of the encoder in one turn; None for a log in `unit`.
        torque_constant: of the motor [N m/A].
        follows: a joint to which it is coupled rigidly.
        ratio: turns of this joint for one turn of the joint that it follows.
        range_std: std of each end of its range [rad].
        position_column: what the motor's reading is called in logs.
        current_column: what its current is called.
        time_column: what the time is called; one for all.
    """

    joint: str
    low: float
    high: float
    motor: str | None = None
    spool_radius: float | None = None
    joint_radius: float | None = None
    direction: int = 1
    back: Literal["tendon", "spring"] = "tendon"
    zero: float | None = None
    zero_std: float | None = None
    ratio_std: float | None = None
    unit: Literal["rad", "deg"] = "rad"
    counts: float | None = None
    torque_constant: float | None = None
    follows: str | None = None
    ratio: float = 1.0
    range_std: float | None = None
    position_column: str | None = None
    current_column: str | None = None
    time_column: str | None = None

    def __post_init__(self) -> None:
        if not -2 * pi <= self.low < self.high <= 2 * pi:
            raise RigError(
                f"the range of '{self.joint}' must be from a lower to a higher angle within ±360°, "
                f"{self.low:.4g} to {self.high:.4g} rad came; is the unit right?"
            )
        if self.counts is not None and not 2 <= self.counts <= MOST_COUNTS:
            raise RigError(
                f"counts of '{self.joint}' are those of the encoder in one turn, 2 to "
                f"{MOST_COUNTS:.0e}; {self.counts:g} came"
            )
        for name in ("spool_radius", "joint_radius"):
            radius = getattr(self, name)
            if radius is not None and not 1e-4 < radius < 0.5:
                raise RigError(
                    f"{name} of '{self.joint}' must be 0.1 to 500 mm, {1e3 * radius:.4g} mm came"
                )
        if (self.motor is None) == (self.follows is None):
            raise RigError(
                f"'{self.joint}' needs a motor, or the joint that it follows, one of both"
            )
