"""What a page needs of a rig to draw its chain as it moves: links, the band of each angle as a fan,
tendons coloured by tension (``chain.js``).
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.results import (
    BLACK,
    COLOURS,
    SOFT,
    WHITE,
    band_colour,
)
from distal.rig import Rig

LENGTHS = 2.6
"""Length of a link that the rig does not describe [largest moment arms]. Source: layout."""

CIVIDIS = ((0, 34, 78), (66, 78, 108), (124, 123, 120), (187, 172, 108), (255, 233, 69))
"""Colours (red, green, blue) of tensions from zero to the largest. Source: reference (Nuñez,
Anderton, Renslow, PLOS ONE 13, 2018).
"""

OBLIQUE = ((0.83, 0.56, 0.0), (-0.19, 0.28, 0.94))
"""Vectors that point right and up in the picture of a chain whose axes are not parallel. Source:
layout.
"""


def chain_shape(rig: Rig, most: float) -> dict[str, object]:
    """Return the data of a rig that ``chain.js`` draws.

    Args:
        most: tension at the end of the scale of colours [N].
    """
    index = {joint.name: j for j, joint in enumerate(rig.joints)}
    parents = map(rig.parent_of, range(len(rig.joints)))
    return {
        "joints": [
            {
                "parent": -1 if parent is None else parent,
                "offset": joint.offset,
                "axis": joint.axis,
                "link": list(link),
            }
            for parent, joint, link in zip(parents, rig.joints, _links(rig))
        ],
        "tendons": [
            {
                "name": tendon.name,
                "crossings": sorted(
                    (index[name], float(arm)) for name, arm in tendon.arms().items()
                ),
            }
            for tendon in rig.tendons
        ],
        "most": most,
        "ramp": CIVIDIS,
        "view": _view(rig),
        "colours": {
            "ink": BLACK,
            "soft": SOFT,
            "paper": WHITE,
            "estimate": COLOURS[0],
            "band": band_colour(),
        },
    }


def tension_scale(most: str) -> str:
    """Return the HTML of the scale of colours of tensions; `most` is the text at its end."""
    ramp = ", ".join(f"rgb{colour}" for colour in CIVIDIS)
    return (
        f"<span style='white-space:nowrap'>tension 0 <span "
        "style='display:inline-block;width:6rem;height:.7rem;"
        f"background:linear-gradient(to right, {ramp})'></span> {most}</span>"
    )


def _links(rig: Rig) -> Floats:
    """Return where each link ends in its joint's frame [m], (n_joints, 3).

    This is the furthest joint that it carries, else twice the way to its centre of mass, else a
    length in terms of the moment arms.
    """
    arms = [abs(arm) for tendon in rig.tendons for arm in tendon.arms().values()]
    length = LENGTHS * max(arms, default=0.01)
    ends = np.zeros((len(rig.joints), 3))
    for j, joint in enumerate(rig.joints):
        carried = [
            np.array(rig.joints[i].offset) for i in range(len(rig.joints)) if rig.parent_of(i) == j
        ]
        far = max(carried, key=lambda offset: float(np.linalg.norm(offset)), default=np.zeros(3))
        centre = np.zeros(3) if joint.link is None else 2 * np.array(joint.link.centre)
        axis = np.array(joint.axis)
        # a link along the axis would not show how the joint turns
        start = np.eye(3)[int(np.argmin(np.abs(axis))) if abs(axis[0]) > 0.9 else 0]
        straight = length * _unit(_across(start, axis))
        shown = (e for e in (far, centre) if np.linalg.norm(_across(e, axis)) > 0.1 * length)
        ends[j] = next(shown, straight)
    return ends


def _view(rig: Rig) -> tuple[tuple[float, ...], ...]:
    """Return the vectors that point right and up in the picture.

    A chain in one plane is seen along its axes, any other from the side and above.
    """
    first = np.array(rig.joints[0].axis)
    if any(abs(float(first @ np.array(joint.axis))) < 0.99 for joint in rig.joints):
        return OBLIQUE
    x, y, z = np.eye(3)
    right = _unit(x - first[0] * first) if abs(first[0]) < 0.9 else y
    up = z if abs(first[2]) < 0.9 else y
    up = _unit(up - (up @ first) * first - (up @ right) * right)
    return tuple(map(float, right)), tuple(map(float, up))


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _across(vector: Floats, axis: Floats) -> Floats:
    """Return the part of a vector that is perpendicular to an axis."""
    return vector - (vector @ axis) * axis
