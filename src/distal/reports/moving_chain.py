"""A picture of the chain of a log that moves: links, the band of each angle as a fan, tendons
coloured by tension.
"""

from __future__ import annotations

from html import escape
from importlib import resources

import numpy as np

from distal.arrays import Floats
from distal.confidence import in_percent
from distal.logs import Log
from distal.reports.page import script_with
from distal.results import BAND_ALPHA, BLACK, COLOURS, FAINT, INK, SOFT, WHITE, Estimate, from_start
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


def moving_chain(estimate: Estimate, log: Log, rig: Rig) -> tuple[str, str]:
    """Return the HTML of a picture of the moving chain, which the reader plays or drags, and the
    HTML of its script, which stands after the curves.
    """
    step = max(1, -(-len(log) // MOST_FRAMES))
    rows = slice(None, None, step)
    time = from_start(estimate.time)
    columns = [
        None if column is None else _parameters(column[rows], 2) for column in _tensions(rig, log)
    ]
    tensions = [tension for column in columns for tension in column or () if tension is not None]
    most = max(tensions, default=0.0)
    frames = chain_shape(rig, most) | {
        "tensions": columns,
        "time": _parameters(time[rows] - time[0], 4),
        "from": float(time[0]),
        "angles": [_parameters(column, 4) for column in estimate.angles[rows].T],
        "halves": [
            _parameters(estimate.stds_of_band * column, 4) for column in estimate.angle_stds[rows].T
        ],
        "truths": None
        if estimate.truths is None
        else [_parameters(column, 4) for column in estimate.truths[rows].T],
    }
    scale = tension_scale(f"{most:.3g} N") if tensions else ""
    cells = "".join(
        f"<tr><td>{escape(joint.name)}</td><td class='n'></td></tr>" for joint in rig.joints
    )
    dashed = ", dashed is the truth" if estimate.truths is not None else ""
    script = chain_script() + resources.files("distal.reports").joinpath("moving.js").read_text(
        encoding="utf-8"
    )
    speeds = "".join(
        f"<option value='{x}'{' selected' if x == 1 else ''}>{x}×</option>"
        for x in (0.1, 0.25, 1, 2, 5)
    )
    picture = (
        f"<style>{_STYLE}</style><figure id='moving'><div><canvas role='img' aria-label='The "
        "chain as it is estimated to "
        "stand; its angles are in the table'></canvas><p class='controls'><button "
        "type='button'>Play</button> "
        f"<label>speed <select>{speeds}</select></label> <output></output> {scale}"
        f"<input type='range' min='0' max='{time[-1] - time[0]:.4f}' step='any' value='0' "
        "aria-label='time'></p></div>"
        f"<table><tbody>{cells}</tbody></table>"
        f"<figcaption>The joints as they are estimated{dashed}; "
        f"fans are {in_percent(estimate.level)} bands. Grey tendons "
        "have no sensor of their "
        "own. Drag to turn the view, click a curve to go to its time.</figcaption></figure>"
    )
    return picture, script_with("moving-data", frames, script)


def chain_script() -> str:
    """Return the JavaScript that draws a chain."""
    return resources.files("distal.reports").joinpath("chain.js").read_text(encoding="utf-8")


def chain_shape(rig: Rig, most: float) -> dict[str, object]:
    """Return the data of a rig that `chain_script` draws.

    Args:
        most: tension at the end of the scale of colours [N].
    """
    index = {joint.name: j for j, joint in enumerate(rig.joints)}
    parents = [
        -1 if (parent := rig.parent_of(j)) is None else parent for j in range(len(rig.joints))
    ]
    return {
        "joints": [
            {"parent": parent, "offset": joint.offset, "axis": joint.axis, "link": list(link)}
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
            "faint": FAINT,
            "paper": WHITE,
            "estimate": COLOURS[0],
            "band": COLOURS[0] + f"{round(255 * BAND_ALPHA):02x}",
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


_STYLE = f"""
#moving {{ display: grid; grid-template-columns: minmax(0, 1fr) auto; gap: 0 1.2rem;
  align-items: start; }}
#moving canvas {{ width: 100%; height: 20rem; touch-action: none; cursor: grab;
  border: 1px solid {FAINT}; }}
#moving table {{ width: auto; margin: 0; }} #moving td.n {{ min-width: 7.5rem; }}
#moving figcaption {{ grid-column: 1 / -1; }} #moving .controls {{ margin: .4rem 0; }}
#moving button {{ min-width: 4.5rem; }} #moving input {{ width: 100%; accent-color: {INK}; }}
@media (min-width: 75rem) {{ body {{ max-width: 100rem; }}
  .beside {{ display: grid; grid-template-columns: minmax(0, 2fr) minmax(0, 3fr); gap: 1rem;
    align-items: start; }}
  #moving {{ position: sticky; top: 1rem; grid-template-columns: minmax(0, 1fr); }} }}
@media (max-width: 40rem) {{ #moving {{ grid-template-columns: minmax(0, 1fr); }}
  #moving tr {{ display: table-row; }}
  #moving td {{ display: table-cell; }} }}
"""


def _links(rig: Rig) -> Floats:
    """Return where each link ends in its joint's frame [m], (n_joints, 3).

    This is the furthest joint that it carries, else twice the way to its centre of mass, else a
    length in terms of the moment arms.
    """
    arms = [abs(arm) for tendon in rig.tendons for arm in tendon.arms().values()]
    length = LENGTHS * max(arms, default=0.01)
    ends = np.tile([length, 0.0, 0.0], (len(rig.joints), 1))
    for j, joint in enumerate(rig.joints):
        carried = [
            np.array(rig.joints[i].offset) for i in range(len(rig.joints)) if rig.parent_of(i) == j
        ]
        far = max(carried, key=lambda offset: float(np.linalg.norm(offset)), default=np.zeros(3))
        centre = np.zeros(3) if joint.link is None else 2 * np.array(joint.link.centre)
        axis = np.array(joint.axis)
        for end in (far, centre):
            # a link along the axis would not show how the joint turns
            if np.linalg.norm(_across(end, axis)) > 0.1 * length:
                ends[j] = end
                break
        else:
            start = np.eye(3)[int(np.argmin(np.abs(axis))) if abs(axis[0]) > 0.9 else 0]
            ends[j] = length * _unit(_across(start, axis))
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
    drives = {drive.name: drive for drive in rig.drives}
    sensors = [sensor for sensor in rig.sensors if sensor.name in log.channels]
    columns: list[Floats | None] = []
    for tendon in rig.tendons:
        drive = drives[tendon.drive]
        column = None
        alone = sum(neighbour.drive == drive.name for neighbour in rig.tendons) == 1
        for sensor in sensors:
            if sensor.measures == "tension" and sensor.of == tendon.name:
                column = np.asarray(log.channels[sensor.name])
            elif sensor.measures == "force" and sensor.of == drive.name and alone:
                arm = drive.radius.value if drive.kind == "capstan" else 1.0
                column = np.asarray(log.channels[sensor.name]) / arm
        columns.append(column)
    return columns


def _unit(vector: Floats) -> Floats:
    return vector / np.linalg.norm(vector)


def _across(vector: Floats, axis: Floats) -> Floats:
    """Return the part of a vector that is perpendicular to an axis."""
    return vector - (vector @ axis) * axis


def _parameters(column: Floats, digits: int) -> list[float | None]:
    return [round(number, digits) if np.isfinite(number) else None for number in column.tolist()]
