"""A picture of the chain of a log that moves: links, the band of each angle as a fan, tendons
coloured by tension.
"""

from __future__ import annotations

from html import escape
from string import Template

import numpy as np

from distal.arrays import Floats
from distal.confidence import in_percent
from distal.logs import Log
from distal.reports.page import resource, script_with
from distal.results import (
    BLACK,
    COLOURS,
    SOFT,
    WHITE,
    Estimate,
    band_colour,
    from_start,
    pulls_of,
)
from distal.rig import Rig

MOST_FRAMES = 6_000
"""Number of frames at most; of a longer log every second, third, … sample is a frame. Source:
layout.
"""

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


def moving_chain(
    estimate: Estimate, log: Log, rig: Rig, naive: Estimate | None = None
) -> tuple[str, str]:
    """Return the HTML of a picture of the moving chain, which the reader plays or drags, and the
    HTML of its script, which stands after the curves.

    Args:
        naive: an estimate by inextensible tendons, which is drawn too; the picture then plays at
            once.
    """
    rows = slice(None, None, max(1, -(-len(log) // MOST_FRAMES)))
    time = from_start(estimate.time)
    columns = [None if c is None else _listed(c[rows], 2) for c in _tensions(rig, log)]
    tensions = [tension for column in columns for tension in column or () if tension is not None]
    most = max(tensions, default=0.0)

    def angles(table: Floats | None) -> list[list[float | None]] | None:
        return None if table is None else [_listed(column, 4) for column in table[rows].T]

    frames = chain_shape(rig, most) | {
        "tensions": columns,
        "time": _listed(time[rows], 4),
        "angles": angles(estimate.angles),
        "halves": angles(estimate.stds_of_band * estimate.angle_stds),
        "truths": angles(estimate.truths),
        "naive": None if naive is None else angles(naive.angles),
    }
    dashed = ", dashed is the truth" if estimate.truths is not None else ""
    more = ", click a curve to go to its time"
    if naive is not None:
        dashed += ", dotted is what the motors say as if the tendons did not stretch"
        more = ". No estimate has a sensor at the joint"
    blanks = {
        "speeds": "".join(
            f"<option value='{x}'{' selected' * (x == 1)}>{x}×</option>"
            for x in (0.1, 0.25, 1, 2, 5)
        ),
        "scale": tension_scale(f"{most:.3g} N") if tensions else "",
        "last": f"{time[-1]:.4f}",
        "cells": "".join(
            f"<tr><td>{escape(joint.name)}</td><td class='n'></td></tr>" for joint in rig.joints
        ),
        "dashed": dashed,
        "more": more,
        "level": in_percent(estimate.level),
    }
    scripts = resource("chain.js"), resource("moving.js")
    picture = Template(resource("moving.html")).substitute(blanks)
    return picture, script_with("moving-data", frames, *scripts)


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
            "naive": COLOURS[3],
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


def _tensions(rig: Rig, log: Log) -> list[Floats | None]:
    """Return the measured tension of each tendon [N], (k,), or None where it is not measured."""
    read = {(s.measures, s.of): log.channels[s.name] for s in pulls_of(log, rig)}
    columns: list[Floats | None] = []
    for tendon in rig.tendons:
        drive = rig.drive(tendon.drive)
        tension = read.get(("tension", tendon.name))
        force = read.get(("force", drive.name))
        if tension is None and force is not None and len(rig.tendons_of(drive.name)) == 1:
            tension = force / drive.lever
        columns.append(tension)
    return columns


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _across(vector: Floats, axis: Floats) -> Floats:
    """Return the part of a vector that is perpendicular to an axis."""
    return vector - (vector @ axis) * axis


def _listed(column: Floats, digits: int) -> list[float | None]:
    return [round(number, digits) if np.isfinite(number) else None for number in column.tolist()]
