"""Numbers that a model does not have: what is written instead, with a wide std, and what it is in
words.
"""

from __future__ import annotations

from math import hypot

from distal.rig.imported import Guess

DRIVE_MASS = Guess(0.02, "the drive's mass")
"""[kg]; a filter follows the position that is measured."""

PATH_FRICTION = Guess({"value": 0.05, "std": 0.1}, "friction along the path")
NOMINAL_FORCE = Guess({"value": "5 N", "std": "5 N"}, "usual force")
PRETENSION = Guess({"value": "1 N", "std": "1 N"}, "tension at zero angle and zero displacement")

RATE = Guess(100.0, "rate of the sensors")
FORCE_NOISE = Guess("0.2 N", "noise of a force")
ENCODER_STEP = Guess("0.1 deg", "encoders, which are for learning and comparing only")

FRICTION_COEFFICIENT = 1e-3
"""Friction of a joint whose model has `frictionloss`: only its product with a radius counts [1]."""

JOINT_FRICTION = Guess({"value": FRICTION_COEFFICIENT, "std": "30 %"}, "how well friction is known")


POSITION_NOISE = 2e-5
"""Of a position [m]."""

LASTING = 6.0
"""√ of the samples in which what a polynomial leaves of a length stays the same: 0.36 s; noise is
new in each [1].
"""


def position_noise(left: float) -> Guess:
    """Return the noise of a tendon's position, of whose length a polynomial leaves so much [m,
    RMS].
    """
    return Guess(float(f"{hypot(POSITION_NOISE, LASTING * left):.2g}"), "noise of a position")


def series_stiffness(drives: int, joints: int) -> Guess:
    """Return the series stiffness of tendons, for so many drives and joints that turn by
    themselves.

    Any from a third of the value to no stretch at all is likely. Where drives pull against each
    other, their forces say where the joints are, and are not to be explained by stiffness:
    docs/results/hands.md.
    """
    return Guess(
        {"value": "20 N/mm", "std": "60 %" if drives > joints else "100 %"}, "series stiffness"
    )


def initial_angle_of_model(angle: float) -> Guess:
    """Return where a joint starts whose model says its `angle` [rad]."""
    return Guess({"value": angle, "std": "5 deg"}, "angle at the start")
