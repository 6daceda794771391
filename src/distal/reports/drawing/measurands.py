"""The badge of a sensor by what it measures (see `distal.rig.measurands`)."""

from __future__ import annotations

from collections.abc import Sequence

from distal.reports.drawing.sheet import Line
from distal.rig import Rig


def letters(sensor_measures: str, kind: str) -> str:
    """Return the letter of a sensor's badge; its kind of part is "slider", "capstan", "joint" or "tendon"."""
    of_drive = {"slider": {"position": "x", "force": "U"}, "capstan": {"position": "φ", "force": "τ"}}
    return of_drive.get(kind, {"tension": "T", "angle": "θ", "torque": "τ"})[sensor_measures]


def sensor_lines(rig: Rig, of: str, measures: Sequence[str], kind: str) -> list[Line]:
    """Return a line with its badge for each sensor of a part that measures one of `measures`."""
    sensors = [sensor for sensor in rig.sensors if sensor.of == of and sensor.measures in measures]
    return [Line(sensor.name, badge=letters(sensor.measures, kind)) for sensor in sensors]
