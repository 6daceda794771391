"""The angle error that the model leaves (Kennedy and O'Hagan, J. R. Statist. Soc. B 63, 2001): the
terms that are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.arrays import Floats
from distal.regression.affine import DEAD_BAND
from distal.regression.learn_map import Kind, Terms
from distal.rig import CONSTANT, Discrepancy

PLAYS = (0.25, 0.5, 1.0)
"""Half-widths of plays that are tried, in standard deviations of the reading."""

NO_CORRECTION = Terms("the angle is not corrected", (CONSTANT,), corrects=False)

TERMS_HELP = 0.85
"""More terms are taken where they bring the error on left-out logs below this share of that of
fewer.
"""


def discrepancy_kind(
    channels: Sequence[str],
    moving: Sequence[str],
    efforts: Sequence[str],
    joints: Sequence[str],
    noise: Floats,
) -> Kind:
    """Return the kind of map of a filter's angle errors, from readings and from the filter's own
    angles.

    Channels that are `moving` have independent information, some of them are efforts: forces,
    torques or tensions; `noise` is as in `Kind`.
    """
    theta = tuple(f"angle({joint})" for joint in joints)
    linear = (CONSTANT, *moving)
    squares = tuple(
        f"{a}*{b}"
        for i, a in enumerate(moving)
        for b in moving[i:]
        if not (a == b and a in efforts)
    )
    magnitudes = tuple(f"{name}*abs({name})" for name in efforts)
    positions = tuple(name for name in moving if name not in efforts)
    turns = tuple(f"slip({name})" for name in positions)
    sets = [
        NO_CORRECTION,
        Terms("a constant", (CONSTANT,)),
        Terms("linear in what the sensors read", linear),
        Terms("linear in what the sensors read, all logs as one", linear, pooled=True),
        Terms("linear in what the sensors read and in the filter's own angle", (*linear, *theta)),
        Terms(
            "linear in sensors and the filter's own angle, all logs as one",
            (*linear, *theta),
            pooled=True,
        ),
        # with the filter's angle taken off it is what `affine` says
        Terms(
            "linear with directions and the filter's own angle",
            (*linear, *turns, *theta),
            DEAD_BAND,
            of_noise=True,
        ),
    ]
    lines = (*linear, *(f"play({name})" for name in moving))
    mixed = tuple(f"{position}*play({effort})" for position in positions for effort in efforts)
    curves = (*linear, *(f"play({name})" for name in efforts), *squares, *magnitudes, *mixed)
    shapes = [("linear", lines), *([("curves", curves)] if efforts else [])]
    for width in PLAYS:
        for shape, terms in shapes:
            sets.append(Terms(f"{shape}, with a play of {width:g} std", terms, width))
            name = f"{shape} with the filter's own angle, with a play of {width:g} std"
            sets.append(Terms(name, (*terms, *theta), width))
    return Kind(
        Discrepancy,
        "discrepancy",
        tuple(channels),
        tuple(joints),
        noise,
        tuple(sets),
        TERMS_HELP,
        by_group=True,
    )
