"""What a table of a hand does not say: numbers of small hands with braided lines, with wide
stds.
"""

from __future__ import annotations

from math import degrees, radians

from distal.rig.imported import Guess

USUAL_RADIUS = 8e-3
"""Of a joint [m]."""

JOINT_RADIUS = Guess(USUAL_RADIUS, "radii of joints (only their ratio to the spools counts)")
SPOOL_RADIUS = Guess(8e-3, "radii of spools")
RATIO_STD = 0.03
"""Of a ratio of radii that a drawing or a table says, each to 2 %, as a share."""

UNKNOWN_RATIO_STD = 0.25
"""Of one that nobody says."""

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
TENDON_DAMPING = Guess("2 N s/m", "damping of tendons")
SLACK = Guess({"value": "0.3 mm", "std": "0.25 mm"}, "slack of tendons")
LOOSE = Guess({"value": "0.5 mm", "std": "1 mm"}, "slack of tendons")
PATH = Guess(
    {"friction": {"value": 0.1, "std": 0.05}, "wrap": "80 deg"}, "friction along the paths"
)
TORQUE_CONSTANT = Guess("0.5 N m/A", "torque constants")
CURRENT_NOISE = Guess("6 mA", "noise of currents")
POSITION_NOISE = Guess("0.05 deg", "noise of encoders")
RATE = Guess(100.0, "rate of the sensors")
ZERO_STD = "where encoders have their zero (a power-on routine finds it)"
IDENTIFIED_ZERO_STD = radians(5.0)
UNKNOWN_ZERO_STD = radians(60.0)
"""At the motor, where a table says it and where nobody does [rad]."""

COUNTS = Guess(4096, "counts of encoders")
"""In one turn; of a log in radians it is the resolution."""


def spring(radius: float) -> Guess:
    """Return the stiffness of a spring at a joint of some radius [m]: of one tendon's joints all
    close together.
    """
    return Guess(
        {"value": f"{0.05 * radius / USUAL_RADIUS:.3g} N m/rad", "std": "60 %"},
        "stiffness of springs",
    )


def rest_angle(low: float) -> Guess:
    """Return where a spring rests that holds its joint open: some way beyond the lower end of its
    range [rad].
    """
    return Guess({"value": f"{degrees(low) - 18:.4g} deg", "std": "7 deg"}, "where springs rest")


def initial_angle(low: float, high: float) -> Guess:
    """Return where a joint may be at the first sample: anywhere from `low` to `high` [rad]."""
    middle = degrees(low + high) / 2
    spread = degrees(high - low) / 4
    return Guess({"value": f"{middle:.4g} deg", "std": f"{spread:.4g} deg"}, "angles at the start")
