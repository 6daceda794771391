"""Gears between motor and capstan that the rig file lacks, found without a reference angle by how
far a joint would turn.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.finding import Finding
from distal.diagnosis.states import LARGEST_TRAVEL
from distal.logs import Log
from distal.rig import Rig, Sensor


def out_of_reach(log: Log, rig: Rig) -> list[Finding]:
    """Return the capstans whose angle would turn their joint much further than it can turn."""
    findings = []
    for sensor, joint, expected in _expected(log, rig):
        span = (
            float(np.nanmax(expected) - np.nanmin(expected)) if np.isfinite(expected).any() else 0.0
        )
        stops = rig.joints[joint].stops
        least = span / (LARGEST_TRAVEL if stops is None else stops[1] - stops[0])
        if least > texts.SMALLEST_GEAR:
            findings.append(texts.looks_geared_at_least(sensor.name, least))
    return findings


def _expected(log: Log, rig: Rig) -> Iterator[tuple[Sensor, int, Floats]]:
    """Yield for each capstan that pulls one joint the sensor of its angle, the index of the joint,
    and the angle of the joint without stretch [rad].
    """
    joints = rig.joint_names
    drives = {drive.name: drive for drive in rig.drives}
    for sensor in rig.sensors_of("position"):
        drive = drives[sensor.of]
        pulled = [tendon for tendon in rig.tendons if tendon.drive == sensor.of]
        alone = {name for tendon in pulled for name in tendon.joints}
        if drive.kind == "capstan" and sensor.name in log.channels and len(alone) == 1:
            arm = float(np.mean([tendon.total_arm for tendon in pulled]))
            turned: Floats = log.channels[sensor.name] * drive.radius.value / max(arm, 1e-9)
            yield sensor, joints.index(alone.pop()), turned
