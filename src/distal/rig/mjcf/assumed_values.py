"""Guesses for what a model does not have: what is written instead, with a wide std, and what it is
in words.
"""

from __future__ import annotations

from math import hypot

from distal.rig.imported import Guess

DRIVE_MASS = Guess(0.02, "the drive's mass")
"""Mass of a drive [kg]; it matters little, since a filter follows the measured position."""

PATH_FRICTION = Guess({"value": 0.05, "std": 0.1}, "friction along the path")
NOMINAL_FORCE = Guess({"value": "5 N", "std": "5 N"}, "usual force")
PRETENSION = Guess({"value": "1 N", "std": "1 N"}, "tension at zero angle and zero displacement")

RATE = Guess(100.0, "rate of the sensors")
FORCE_NOISE = Guess("0.2 N", "noise of a force")
ENCODER_STEP = Guess("0.1 deg", "encoders, which are for learning and comparing only")

FRICTION_COEFFICIENT = 1e-3
"""Friction coefficient of a joint whose model has `frictionloss` [1]; only its product with a
radius counts. Source: judgement.
"""

JOINT_FRICTION = Guess({"value": FRICTION_COEFFICIENT, "std": "30 %"}, "how well friction is known")


POSITION_NOISE = 2e-5
"""Noise std of a position [m]. Source: judgement."""

LASTING = 6.0
"""Factor that turns the RMS of what a polynomial leaves of a length into noise [1]. What is left
stays the same for about 36 samples (0.36 s), while noise is new in each sample; the factor is the
square root of their number. Source: judgement.
"""


def position_noise(left: float) -> Guess:
    """Return the noise of a tendon's position, √(σ² + (6 e)²) with σ = `POSITION_NOISE`; e is what
    a polynomial has `left` of the tendon's length [m, RMS].
    """
    return Guess(float(f"{hypot(POSITION_NOISE, LASTING * left):.2g}"), "noise of a position")


def series_stiffness(drives: int, joints: int) -> Guess:
    """Return the series stiffness of tendons, for the number of drives and of joints that turn by
    themselves.

    Any stiffness from a third of the value to infinite is likely. With more drives than joints,
    drives pull against each other and their forces say where the joints are; a wide std would let
    the stiffness explain these forces instead, so that it is narrower: docs/results/hands.md.
    """
    return Guess(
        {"value": "20 N/mm", "std": "60 %" if drives > joints else "100 %"}, "series stiffness"
    )


def initial_angle_of_model(angle: float) -> Guess:
    """Return the angle at the start of a joint that has this `angle` in its model [rad]."""
    return Guess({"value": angle, "std": "5 deg"}, "angle at the start")
