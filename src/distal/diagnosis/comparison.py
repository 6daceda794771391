"""Comparison of an estimate with kinematic estimates, which use no dynamics: whether their bands
exclude each other.
"""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.finding import Finding
from distal.errors import EstimationError
from distal.logs import Log
from distal.results import Estimate
from distal.rig import Rig
from distal.run.offline import estimate

OFTEN = 0.25
"""Share of a log in which both bands exclude each other, from which on a finding says so [1].

On 35 right rigs with the truth inside the band, `elastic` reached 8 %, `inextensible` without
forces 4 %. Source: judgement.
"""


def disagreement(
    result: Estimate, log: Log, rig: Rig, homing: float | None = None
) -> list[Finding]:
    """Return a finding where `elastic`, or without forces `inextensible`, lies outside both bands
    for more than `OFTEN` of the log.

    The kinematic band knows only sensors and the start. It is widened by what friction and an
    unknown stiffness may stretch, δθ = (2 f + |F − F_0| σ_k/k)/(k r), with friction f up to the
    limits in the rig, which may act at the first sample and now.

    Args:
        result: the estimate.
        log: of the estimate.
        rig: of the estimate.
        homing: time for which the reference angle is used [s], or None.
    """
    forces = any(sensor.name in log.channels for sensor in rig.sensors_of("force"))
    name = "elastic" if forces else "inextensible"
    kinematic = _estimate(log, rig, name, homing)
    if kinematic is None:
        return []
    outside = np.zeros(len(log), dtype=bool)
    for j, joint in enumerate(rig.joints):
        band = BAND * (result.angle_stds[:, j] + kinematic.angle_stds[:, j]) + stretch(
            log, rig, joint.name
        )
        outside |= np.abs(result.angles[:, j] - kinematic.angles[:, j]) > band
    share = float(np.mean(outside))
    return [] if share <= OFTEN else [texts.kinematics_disagree(name, share)]


def disagreement_with_map(
    result: Estimate, log: Log, rig: Rig, homing: float | None = None
) -> list[Finding]:
    """Return a finding where `regression`, by the map in the rig file, lies outside both bands
    for more than `OFTEN` of the log.

    Args:
        result: the estimate.
        log: of the estimate.
        rig: of the estimate.
        homing: time for which the reference angle is used [s], or None.
    """
    has_map = rig.map is not None and rig.map.readings
    other = _estimate(log, rig, "regression", homing) if has_map else None
    if other is None:
        return []
    apart = np.abs(result.angles - other.angles) > BAND * (result.angle_stds + other.angle_stds)
    share = float(np.mean(apart.any(axis=1)))
    return [] if share <= OFTEN else [texts.map_disagrees(share)]


def _estimate(log: Log, rig: Rig, name: str, homing: float | None) -> Estimate | None:
    try:
        return estimate(log, rig, name, compiled=False, homing=homing, covariances=False)
    except EstimationError:
        return None


def stretch(log: Log, rig: Rig, joint: str) -> Floats:
    """Return the largest error of a kinematic estimate by friction and an unknown stiffness, at a
    joint, (k,) [rad].
    """
    parts = []
    drives = {drive.name: drive for drive in rig.drives}
    for tendon in rig.tendons:
        if joint not in tendon.joints:
            continue
        drive = drives[tendon.drive]
        mates = [mate for mate in rig.tendons if mate.drive == tendon.drive]
        lever = drive.radius.value if drive.kind == "capstan" else 1.0
        sensor = next(
            (s for s in rig.sensors_of("force") if s.of == drive.name and s.name in log.channels),
            None,
        )
        pull = np.zeros(len(log))
        limit = 0.0
        if sensor is None:
            unknown = 2 * BAND * drive.nominal_force.total_std / lever
            tension = max(abs(drive.nominal_force.value) / lever, tendon.pretension.value)
        else:
            read = log.channels[sensor.name] / lever
            pull = np.abs(np.nan_to_num(read - read[np.isfinite(read)][0]))
            unknown = 2 * BAND * sensor.noise / lever
            tension = float(np.nanmax(np.abs(read))) + tendon.pretension.value
            limit = _high(drive.friction.constant) / lever + _high(drive.friction.load) * tension
        if drive.hysteresis is not None:
            limit += (
                _high(drive.hysteresis.constant) / lever + _high(drive.hysteresis.load) * tension
            )
        if tendon.path is not None:
            limit += tension * float(
                np.expm1(_high(tendon.path.friction) * abs(_high(tendon.path.wrap)))
            )
        stiffness = tendon.stiffness
        relative = BAND * stiffness.total_std / stiffness.value
        soft = stiffness.value * max(1 - relative, 0.2)
        stretched = (2 * limit + unknown + pull * min(relative, 1.0)) / (soft * len(mates))
        parts.append(stretched / max(abs(tendon.arms()[joint]), 1e-9))
    return np.mean(parts, axis=0) if parts else np.zeros(len(log))


def _high(parameter: object) -> float:
    """Return the upper end of a parameter's 95 % band."""
    mean = getattr(parameter, "value", 0.0)
    std = getattr(parameter, "total_std", 0.0)
    return float(mean + BAND * std)
