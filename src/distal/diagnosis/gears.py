"""Gears between motor and capstan that the rig file lacks, or has too much: how far the joint turns says so."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from distal.arrays import Floats
from distal.diagnosis import sentences
from distal.diagnosis.explanations import UNIT_FACTORS
from distal.diagnosis.finding import Finding
from distal.diagnosis.states import LARGEST_TRAVEL
from distal.logs import Log, true_angles
from distal.rig import Rig, Sensor

SMALLEST_GEAR = 1.7
"""A ratio below this may be friction or stretch, 1.1 on right rigs: a motor that turns back moves its joint later."""

ALIKE = 0.7
"""Correlation of joint and motor from which on one follows the other."""

SAME = 0.05
"""A ratio that is as near to a unit's factor, as a logarithm, is that unit."""


def geared(log: Log, rig: Rig) -> list[Finding]:
    """Return the capstans that turn so many times as far as their joint's true angle asks for that a gear explains it."""
    angles, findings = true_angles(log, [joint.name for joint in rig.joints]), list[Finding]()
    if angles is None:
        return findings
    for sensor, joint, expected in _expected(log, rig):
        compared = np.isfinite(angles[:, joint]) & np.isfinite(expected)
        angle, turned = angles[compared, joint], expected[compared]
        if len(angle) < 10 or min(np.std(angle), np.std(turned)) == 0.0:
            continue
        ratio = float(np.std(turned) / np.std(angle))
        follows = abs(float(np.corrcoef(turned, angle)[0, 1])) > ALIKE
        if follows and not 1 / SMALLEST_GEAR < ratio < SMALLEST_GEAR:
            words = (w for f, w in UNIT_FACTORS.items() if "" in w and abs(np.log(abs(ratio * f))) < SAME)
            unit = next((w.get("rad", w[""]) for w in words), None)
            by_gear = sentences.looks_geared(sensor.name, ratio, getattr(sensor, "gear", 1.0))
            findings.append(by_gear if unit is None else sentences.looks(sensor.name, unit))
    return findings


def out_of_reach(log: Log, rig: Rig) -> list[Finding]:
    """Return the capstans whose angle would turn their joint much further than it can turn."""
    findings = []
    for sensor, joint, expected in _expected(log, rig):
        span = float(np.nanmax(expected) - np.nanmin(expected)) if np.isfinite(expected).any() else 0.0
        stops = rig.joints[joint].stops
        least = span / (LARGEST_TRAVEL if stops is None else stops[1] - stops[0])
        if least > SMALLEST_GEAR:
            findings.append(sentences.looks_geared_at_least(sensor.name, least))
    return findings


def _expected(log: Log, rig: Rig) -> Iterator[tuple[Sensor, int, Floats]]:
    """Yield for each capstan of one joint the sensor of its angle, the joint, and how that turns without stretch [rad]."""
    joints, drives = [joint.name for joint in rig.joints], {drive.name: drive for drive in rig.drives}
    for sensor in rig.sensors_of("position"):
        drive, pulled = drives[sensor.of], [tendon for tendon in rig.tendons if tendon.drive == sensor.of]
        alone = {name for tendon in pulled for name in tendon.joints}
        if drive.kind == "capstan" and sensor.name in log.channels and len(alone) == 1:
            arm = float(np.mean([tendon.total_arm for tendon in pulled]))
            turned: Floats = log.channels[sensor.name] * drive.radius.value / max(arm, 1e-9)
            yield sensor, joints.index(alone.pop()), turned
