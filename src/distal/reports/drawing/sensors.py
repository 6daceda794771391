"""Sensors in a drawing: a line of text with a badge for each."""

from __future__ import annotations

from distal.reports.drawing.sheet import DrawnLine
from distal.rig import Capstan, Joint, Rig, Sensor, Slider, Tendon, measurand_of, part_of


def sensors_of_part(rig: Rig, part: Slider | Capstan | Tendon | Joint) -> list[Sensor]:
    """Return the sensors of a joint, drive or tendon, in the rig's order."""
    return [s for s in rig.sensors if rig.components[measurand_of(s).of][part_of(s, rig)] is part]


def sensor_lines(rig: Rig, part: Slider | Capstan | Tendon | Joint) -> list[DrawnLine]:
    """Return a line for each sensor of a joint, drive or tendon: its name, with the letter of the
    measured quantity as badge.
    """
    return [
        DrawnLine(sensor.name, badge=measurand_of(sensor).letter(part))
        for sensor in sensors_of_part(rig, part)
    ]
