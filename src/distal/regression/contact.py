"""The map of the external torque on the joints from the readings at the proximal end: the terms
that are tried.
"""

from __future__ import annotations

from collections.abc import Sequence

from distal.arrays import Floats
from distal.regression.learn_map import Kind, Terms
from distal.rig import CONSTANT, Contact

SLIPS = (0.025, 0.05, 0.1)
"""Half-widths of the play operators that are tried, in standard deviations of the reading of a
drive's position. Source: judgement.
"""

TERMS_HELP = 0.97
"""Share of the error on held-out logs, below which more terms must bring it so that they are used.
Source: judgement.
"""


def contact_kind(
    channels: Sequence[str], positions: Sequence[str], joints: Sequence[str], noise: Floats
) -> Kind:
    """Return the kind of map of the external torque.

    Its terms are efforts, and friction of the whole chain, which acts against each drive's last
    direction of motion.

    Args:
        channels: names of the sensors, (m,).
        positions: those among them that measure drives' positions; the others measure efforts:
            forces, torques or tensions.
        joints: names of the joints.
        noise: standard deviation of each sensor's random error [SI], (m,).
    """
    efforts = [name for name in channels if name not in positions]
    linear = (CONSTANT, *efforts)
    sets = [
        Terms("a constant", (CONSTANT,), SLIPS[0]),
        Terms("linear in the efforts", linear, SLIPS[0]),
    ]
    for width in SLIPS:
        rubbing = tuple(f"slip({x})" for x in positions)
        products = tuple(f"slip({x})*abs({e})" for x in positions for e in efforts)
        along = tuple(t for x in positions for t in (x, f"{x}*{x}", *(f"{x}*{e}" for e in efforts)))
        friction = f"with friction by a play of {width:g} std"
        sets.append(Terms(f"efforts {friction}", (*linear, *rubbing, *products), width))
        sets.append(
            Terms(f"efforts and places {friction}", (*linear, *rubbing, *products, *along), width)
        )
    return Kind(Contact, "contact", tuple(channels), tuple(joints), noise, tuple(sets), TERMS_HELP)
