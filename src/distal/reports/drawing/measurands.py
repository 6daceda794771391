"""The badge of a sensor by what it measures (see `distal.rig.measurands`)."""

from __future__ import annotations

from distal.reports.drawing.sheet import Line
from distal.rig import Rig

LETTERS = {
    "slider": {"position": "x", "force": "U"},
    "capstan": {"position": "φ", "force": "τ"},
    "joint": {"angle": "θ", "torque": "τ"},
    "tendon": {"tension": "T"},
}
"""Kind of part → what a sensor measures of it → the letter of its badge."""


def sensor_lines(rig: Rig, part: str, kind: str) -> list[Line]:
    """Return a line with its badge for each sensor of a part of a kind."""
    letters = LETTERS[kind]
    return [Line(s.name, badge=letters[s.measures]) for s in rig.sensors if s.of == part and s.measures in letters]
