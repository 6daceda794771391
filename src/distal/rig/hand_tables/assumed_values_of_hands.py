"""Guesses, with wide stds, for what a table of a hand does not say; they suit small hands with
braided lines.
"""

from __future__ import annotations

from math import degrees, radians

from distal.rig.files import Guess

USUAL_RADIUS = 8e-3
"""Radius at which a tendon passes a joint [m]. Source: judgement."""

JOINT_RADIUS = Guess(USUAL_RADIUS, "radii of joints (only their ratio to the spools counts)")
SPOOL_RADIUS = Guess(8e-3, "radii of spools")
RATIO_STD = 0.03
"""Std of a ratio of radii that a drawing or a table gives, each of them to 2 %, as a share [1].
Source: judgement.
"""

UNKNOWN_RATIO_STD = 0.25
"""Std of a ratio of radii that nothing gives, as a share [1]. Source: judgement."""

INERTIA = Guess("1e-5 kg m^2", "inertia of joints")
DAMPING = Guess("1e-3 N m s", "damping of joints")
JOINT_FRICTION = Guess(
    {"coefficient": {"value": 0.1, "std": 0.05}, "radius": "3 mm", "preload": "30 N"},
    "friction of joints",
)
RANGE_STD = Guess("1 deg", "how well ranges are known")
MOTOR_INERTIA = Guess("2e-4 kg m^2", "inertia of motors")
MOTOR_DAMPING = Guess("1e-3 N m s", "damping of motors")
MOTOR_FRICTION = Guess(
    {"constant": {"value": "0.035 N m", "std": "0.015 N m"}, "load": {"value": 0.06, "std": 0.03}},
    "friction of motors",
)
SERVO = Guess({"bandwidth": "5 Hz", "delay": "10 ms"}, "how motors follow")
STIFFNESS = Guess("20 N/mm", "stiffness of tendons")
STIFFNESS_STD = 0.4
"""Std of the stiffness of a tendon, as a share [1]. Source: judgement."""

TENDON_DAMPING = Guess("2 N s/m", "damping of tendons")
SLACK = Guess({"value": "0.3 mm", "std": "0.25 mm"}, "slack of tendons")
"""Slack of each of the two tendons that pull a joint to both sides."""

LOOSE = Guess({"value": "0.5 mm", "std": "1 mm"}, "slack of tendons")
"""Slack of a tendon whose joints springs bring back."""

PATH = Guess(
    {"friction": {"value": 0.1, "std": 0.05}, "wrap": "80 deg"}, "friction along the paths"
)
TORQUE_CONSTANT = Guess("0.5 N m/A", "torque constants")
CURRENT_NOISE = Guess("6 mA", "noise of currents")
POSITION_NOISE = Guess("0.05 deg", "noise of encoders")
RATE = Guess(100.0, "rate of the sensors")
ZERO_STD = "where encoders have their zero (a power-on routine finds it)"
IDENTIFIED_ZERO_STD = radians(5.0)
"""Std of the motor's angle at a joint's zero that a table gives [rad]. Source: judgement."""

UNKNOWN_ZERO_STD = radians(60.0)
"""Std of the motor's angle at a joint's zero that nothing gives [rad]. Source: judgement."""

COUNTS = Guess(4096, "counts of encoders")
"""Counts of an encoder in one turn; where a log is not in counts, they give its resolution."""


def spring(radius: float) -> Guess:
    """Return the stiffness of the return spring at a joint whose tendon passes at some `radius`
    [m]. It is proportional to the radius, so that the joints of one tendon close together.
    """
    return Guess(
        {"value": f"{0.05 * radius / USUAL_RADIUS:.3g} N m/rad", "std": "60 %"},
        "stiffness of springs",
    )


def rest_angle(low: float) -> Guess:
    """Return the rest angle of a spring that holds its joint open: 18° below the lower end `low` of
    the joint's range [rad].
    """
    return Guess({"value": f"{degrees(low) - 18:.4g} deg", "std": "7 deg"}, "where springs rest")


def initial_angle(low: float, high: float) -> Guess:
    """Return the angle of a joint at the first sample: anywhere from `low` to `high` [rad]."""
    middle = degrees(low + high) / 2
    spread = degrees(high - low) / 4
    return Guess({"value": f"{middle:.4g} deg", "std": f"{spread:.4g} deg"}, "angles at the start")
