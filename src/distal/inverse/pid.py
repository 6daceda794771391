"""The one PID law that every controller has: torques of joints that feedback of an estimated angle
asks for.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from math import isfinite, radians
from typing import NamedTuple

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.errors import CommandError
from distal.expressions import Scalar, Vector

LEAVES = 2.0
"""Error at which a joint that rests within its dead band is corrected again, in dead bands [1].
Source: judgement.
"""


@dataclass(frozen=True)
class Feedback:
    """Feedback of a joint's estimated angle.

    Args:
        follow: rate at which the commanded angle corrects an error of the angle [1/s]; 0 for none.
        deadband: error that is not corrected [rad], so that a loop with friction and backlash does
            not hunt.
        proportional: gain for drives that follow forces [N m/rad].
        integral: gain for drives that follow forces [N m/(rad s)].
        derivative: gain for drives that follow forces [N m s/rad].
        torque_limit: of the sum of the three torques [N m].
        correction_limit: of the correction of the commanded angle [rad].

    Raises:
        CommandError: a gain is negative or not finite, or a limit is not above zero.
    """

    follow: float = 1.0
    deadband: float = radians(0.5)
    proportional: float = 0.0
    integral: float = 0.0
    derivative: float = 0.0
    torque_limit: float = 1e300
    correction_limit: float = radians(20.0)

    def __post_init__(self) -> None:
        for name, number in vars(self).items():
            if name.endswith("limit"):
                if not number > 0.0:
                    raise CommandError(f"feedback.{name}: a number above 0, {number} came")
            elif not (isfinite(number) and number >= 0.0):
                raise CommandError(f"feedback.{name}: 0 or a finite number above, {number} came")

    @staticmethod
    def gains(joints: Sequence[Feedback]) -> dict[str, Floats]:
        """Return name of a gain → its value for each of some joints, (n,)."""
        return {
            one.name: np.array([vars(joint)[one.name] for joint in joints])
            for one in fields(Feedback)
        }


REMEMBERED = ("effort", "rests")
"""What the law remembers of each joint from sample to sample: the integral of its error [rad s],
and whether it rests.
"""


class Corrected(NamedTuple):
    """What feedback does in a sample: errors beyond the dead band [rad], its torques [N m], and
    name of what is `REMEMBERED` → its value afterwards, (n,) each.
    """

    errors: Vector
    torques: Vector
    after: dict[str, Vector]


def feedback_torques(
    gains: Mapping[str, Vector],
    *,
    before: Mapping[str, Vector],
    error: Vector,
    lag: Vector,
    dt: Scalar,
    trusted: Scalar = 1.0,
    free: Scalar = 1.0,
) -> Corrected:
    """Return what the PID law  τ = K_p e + K_i ∫ e dt + K_d de/dt  does in a sample, as an
    expression.

    In the dead band e = 0, which ends stick-slip (Armstrong-Hélouvry, Dupont and Canudas de Wit,
    Automatica 30, 1994). The torque is cut at its limit; while it is cut, the integral stands.

    Args:
        gains: by the names of `Feedback`.
        before: what is `REMEMBERED`, by name, (n,) each.
        error: desired minus estimated angles [rad], (n,).
        lag: desired minus estimated speeds [rad/s], (n,).
        dt: length of the sample [s].
        trusted: whether the estimate is known; e and its derivative are zero where it is not.
        free: whether the integral may grow.
    """
    band = gains["deadband"]
    rests = ca.fabs(error) < band * ca.if_else(before["rests"] > 0, LEAVES, 1)
    errors = trusted * ca.if_else(rests, 0, error - limited(error, band))
    effort = before["effort"]
    asked = gains["proportional"] * errors + gains["integral"] * effort
    asked += gains["derivative"] * trusted * lag
    torques = limited(asked, gains["torque_limit"])
    grown = effort + free * ca.if_else(torques == asked, errors * dt, 0)
    return Corrected(errors, torques, {"effort": grown, "rests": rests})


def limited(value: Vector, most: Scalar) -> Vector:
    """Return a value within ± `most`."""
    return ca.fmin(ca.fmax(value, -most), most)
