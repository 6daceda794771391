"""The affine map: the joints' angles as a weighted sum of the readings and a constant, with
directions of motion or plays where they help.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Floats
from distal.regression.learn_map import Kind, Terms
from distal.regression.random_effects import row_of, rows_of_groups
from distal.rig import CONSTANT, LAGS, PLAYS, Affine, Discrepancy, JointMap, LearnedMap

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

DIRECTIONS_HELP = 0.95
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
    plays = f"plays of {len(PLAYS)} widths of"
    # of alike errors the first is taken: plays stay right at other speeds, lags need not
    for terms, adds in (
        (several, f"{plays} positions"),
        ((*linear, *lags), "lags"),
        ((*several, *lags), f"{plays} positions and lags"),
        (every, f"{plays} all readings"),
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
    )


def as_discrepancy(affine: LearnedMap, frame: LearnedMap, follows: bool = False) -> Discrepancy:
    """Return the discrepancy δ = φᵀ b − θ with which a filter of angle θ reports the angle φᵀ b of
    the map `affine`.

    Within the learned range the map replaces the filter's own angle and its error. Beyond it the
    terms stay constant, so that the reported angle moves as the filter's does; with `follows` the
    affine map goes on instead. The range of the filter's own angles is that of `frame`, a
    discrepancy learned from the same logs.
    """
    m = len(affine.channels)
    n = len(affine.terms)
    nj = len(affine.joints)
    joints = []
    for j, joint in enumerate(affine.joints):
        coefficients = np.concatenate([joint.coefficients, np.zeros(nj)])
        coefficients[affine.terms.index(CONSTANT)] -= frame.centre[m + j]
        coefficients[n + j] = -frame.scale[m + j]
        covariance = np.pad(np.asarray(joint.covariance), (0, nj))
        b = row_of(coefficients)
        c = rows_of_groups(covariance)
        joints.append(JointMap(joint=joint.joint, coefficients=b, covariance=c, std=joint.std))
    ranges = ("centre", "scale", "low", "high", "rate")
    same = ("channels", "width", "distance", "reach", "correlation_time", "band", "logs", "dropped")
    return Discrepancy(
        terms=(*affine.terms, *(f"angle({joint.joint})" for joint in affine.joints)),
        tracked=False,
        **{name: (*getattr(affine, name), *getattr(frame, name)[m:]) for name in ranges},
        **{name: getattr(affine, name) for name in same},
        spread=affine.spread if follows else frame.spread,
        follows=follows,
        joints=tuple(joints),
    )
