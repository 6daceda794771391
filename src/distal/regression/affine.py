"""The baseline map: the joints' angles as a linear function of the readings, with directions of motion."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.regression.learn import Kind, Terms
from distal.rig import CONSTANT, Affine, Discrepancy, JointMap, LearnedMap

DEAD_BAND = 6.0
"""Half-width of the play that finds a direction, in standard deviations of the position sensor."""

PLAYS = (0.1, 0.3, 0.8)
"""Half-widths of plays that are tried, in standard deviations of the reading."""

DIRECTIONS_HELP = 0.95
"""Directions are used if the RMS error on left-out logs with them is below this share of that without them."""


def affine_kind(channels: Sequence[str], positions: Sequence[str], joints: Sequence[str], noise: Floats) -> Kind:
    """Return the kind of map that gives joints' angles from readings alone.

    Args:
        noise: standard deviation of each sensor's random error [SI], (m,).
    """
    linear = (CONSTANT, *channels)
    turns = tuple(f"slip({name})" for name in positions)
    plays = tuple(f"play({name})" for name in positions)
    line, directions = "a straight line of what the sensors read", "a straight line, with directions of motion"
    sets = (
        Terms(line, linear, DEAD_BAND, of_noise=True),
        Terms(f"{line}, all logs as one", linear, DEAD_BAND, of_noise=True, pooled=True),
        Terms(directions, (*linear, *turns), DEAD_BAND, of_noise=True),
        Terms(f"{directions}, all logs as one", (*linear, *turns), DEAD_BAND, of_noise=True, pooled=True),
        *(
            Terms(
                f"a straight line, with a play of {width:g} std, all logs as one", (*linear, *plays), width, pooled=True
            )
            for width in PLAYS
        ),
    )
    return Kind(
        Affine,
        "affine",
        tuple(channels),
        tuple(joints),
        noise,
        sets,
        DIRECTIONS_HELP,
        by_motion=True,
        unknown_outside=False,
    )


def as_discrepancy(affine: LearnedMap, frame: LearnedMap, follows: bool = False) -> Discrepancy:
    """Return the discrepancy δ = φᵀ b − θ with which a filter reports the angle of `affine`, within the learned range.

    Within the learned range the map replaces the filter's own angle and its error. Beyond it the terms stay constant, and
    the reported angle follows the filter's motion; or the straight line goes on.

    Args:
        frame: a discrepancy of the same logs, for the range of the filter's own angles.
        follows: whether the line goes on beyond the range.
    """
    m, nj = len(affine.channels), len(affine.joints)

    def both(name: str) -> tuple[float, ...]:
        return (*getattr(affine, name), *getattr(frame, name)[m:])

    joints = []
    for j, joint in enumerate(affine.joints):
        coefficients = np.concatenate([joint.coefficients, np.zeros(nj)])
        coefficients[affine.terms.index(CONSTANT)] -= frame.centre[m + j]
        coefficients[len(affine.terms) + j] = -frame.scale[m + j]
        covariance = np.zeros((len(coefficients), len(coefficients)))
        covariance[: len(affine.terms), : len(affine.terms)] = joint.covariance
        joints.append(
            JointMap(
                joint=joint.joint,
                coefficients=tuple(float(value) for value in coefficients),
                covariance=tuple(tuple(float(value) for value in row) for row in covariance),
                std=joint.std,
            )
        )
    return Discrepancy(
        terms=(*affine.terms, *(f"angle({joint.joint})" for joint in affine.joints)),
        channels=affine.channels,
        tracked=False,
        **{name: both(name) for name in ("centre", "scale", "low", "high", "rate")},
        width=affine.width,
        distance=affine.distance,
        reach=affine.reach,
        correlation_time=affine.correlation_time,
        spread=affine.spread if follows else frame.spread,
        follows=follows,
        band=affine.band,
        logs=affine.logs,
        dropped=affine.dropped,
        joints=tuple(joints),
    )
