"""The map of the angle error that the model leaves (Kennedy and O'Hagan, J. R. Statist. Soc. B 63,
2001): the terms that are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.arrays import Floats
from distal.regression.affine import DEAD_BAND
from distal.regression.learn_map import Kind, Terms
from distal.rig import CONSTANT, Discrepancy

PLAYS = (0.25, 0.5, 1.0)
"""Half-widths of the play operators that are tried, in standard deviations of the reading. Source:
judgement.
"""

NO_CORRECTION = Terms("the angle is not corrected", (CONSTANT,), corrects=False)
"""The set of terms with which only the band of the filter's angle is sized."""

TERMS_HELP = 0.85
"""Share of the error on held-out logs, below which more terms must bring it so that they are used.
Source: judgement.
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

    Args:
        channels: names of the sensors, (m,).
        moving: those among them whose readings change in the logs; only these stand in terms.
        efforts: those of `moving` that measure forces, torques or tensions.
        joints: names of the joints.
        noise: standard deviation of each sensor's random error [SI], (m,).
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
        # with coefficient −1 of the filter's angle this is the affine map
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
