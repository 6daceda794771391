"""The affine map: the joints' angles as a weighted sum of the readings and a constant, with
directions of motion or plays where they help.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import combinations_with_replacement

import numpy as np

from distal.arrays import Floats
from distal.regression.learn_map import Kind, Terms
from distal.regression.random_effects import joint_map
from distal.rig import CONSTANT, LAGS, PLAYS, Affine, Discrepancy, LearnedMap

DEAD_BAND = 6.0
"""Half-width of the play operator that gives a drive's direction of motion, in standard deviations
of the position sensor's random error. Source: judgement.
"""

WIDTHS = (0.1, 0.3, 0.8)
"""Half-widths of single play operators that are tried, in standard deviations of the reading.
Source: judgement.
"""

NARROWEST = 0.03
"""Half-width of the narrowest of several play operators, in standard deviations of the reading.
Source: judgement.
"""

DIRECTIONS_HELP = 0.98
"""Share of the RMS error on held-out logs, below which directions or plays must bring it so that
they are used. Source: judgement.
"""


def affine_kind(
    channels: Sequence[str], positions: Sequence[str], joints: Sequence[str], noise: Floats
) -> Kind:
    """Return the kind of map that gives the joints' angles from readings alone.

    Args:
        channels: names of the sensors, (m,).
        positions: those among them that measure drives' positions.
        joints: names of the joints.
        noise: standard deviation of each sensor's random error [SI], (m,).
    """
    linear = (CONSTANT, *channels)
    turning = (*linear, *(f"slip({name})" for name in positions))
    playing = (*linear, *(f"play({name})" for name in positions))
    line = "a straight line of what the sensors read"
    directions = "a straight line, with directions of motion"
    sets = [
        Terms(name + suffix, terms, DEAD_BAND, of_noise=True, pooled=pooled)
        for name, terms in ((line, linear), (directions, turning))
        for suffix, pooled in (("", False), (", all logs as one", True))
    ]
    for width in WIDTHS:
        name = f"a straight line, with a play of {width:g} std, all logs as one"
        sets.append(Terms(name, playing, width, pooled=True))
    several = (*linear, *(f"{play}({name})" for name in positions for play in PLAYS))
    every = (*linear, *(f"{play}({name})" for name in channels for play in PLAYS))
    lags = tuple(f"{lag}({name})" for name in channels for lag in LAGS)
    products = tuple(f"{a}*{b}" for a, b in combinations_with_replacement(channels, 2))
    plays = f"plays of {len(PLAYS)} widths of"
    # of alike errors the first is taken: plays stay right at other speeds, lags need not
    for terms, adds in (
        (several, f"{plays} positions"),
        ((*linear, *lags), "lags"),
        ((*several, *lags), f"{plays} positions and lags"),
        (every, f"{plays} all readings"),
        ((*every, *products), f"{plays} all readings and products of readings"),
    ):
        name = f"a straight line, with {adds}, all logs as one"
        sets.append(Terms(name, terms, NARROWEST, pooled=True))
    channels = tuple(channels)
    joints = tuple(joints)
    return Kind(
        Affine,
        "affine",
        channels,
        joints,
        noise,
        tuple(sets),
        DIRECTIONS_HELP,
        by_motion=True,
        unknown_outside=False,
        moves=tuple(positions),
    )


def as_discrepancy(affine: LearnedMap, frame: LearnedMap) -> Discrepancy:
    """Return the discrepancy δ = φᵀ b − θ with which a filter of angle θ reports the angle φᵀ b of
    the map `affine`, within the range of the logs and beyond it.

    The range of the filter's own angles is that of `frame`, a discrepancy learned from the same
    logs.
    """
    m = len(affine.channels)
    wider = affine.model_copy(
        update={
            name: (*getattr(affine, name), *getattr(frame, name)[m:])
            for name in ("centre", "scale", "low", "high", "rate")
        }
    )
    fields = less_the_angle(wider).model_dump(exclude={"tracked", "follows"})
    return Discrepancy(**fields, tracked=False, follows=True)


def less_the_angle(line: LearnedMap) -> LearnedMap:
    """Return the map of δ = φᵀ b − θ for a map φᵀ b of the angle: with it a filter of angle θ
    reports φᵀ b.
    """
    m = len(line.channels)
    own = [f"angle({joint.joint})" for joint in line.joints]
    terms = (*line.terms, *own)
    joints = []
    for j, joint in enumerate(line.joints):
        coefficients = np.pad(joint.coefficients, (0, len(own)))
        coefficients[terms.index(CONSTANT)] -= line.centre[m + j]
        coefficients[terms.index(own[j])] = -line.scale[m + j]
        covariance = np.pad(np.asarray(joint.covariance), (0, len(own)))
        joints.append(joint_map(joint.joint, coefficients, covariance, joint.std))
    return line.model_copy(update={"terms": terms, "joints": tuple(joints)})
