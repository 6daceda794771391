"""Residuals of the drives' positions beside reference angles, with the columns of their possible
causes and the rig's stds of these; see `causes`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from itertools import combinations

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.diagnosis.causes import Cause, DriveResidual
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import Rig, Sensor, Tendon

SURE_GAIN = 20.0
"""Gain in −2 ln p from which on two columns count as exchanged [1]; above 10 is very strong
evidence (Kass and Raftery, 1995). Source: judgement.
"""

INDEPENDENT = 0.25
"""Time over which residuals are correlated [s]: friction lasts as long as a motion does. Source:
judgement.
"""

FRICTION = 0.3
"""Prior std of the friction in a drive, as a share of its pull [1]. Source: judgement."""

COMPLIANCE = 0.1
"""Least prior std of a stiffness or of the scale of a force, as a share [1]. Source: judgement."""

STAYS = 0.02
"""Way back after which a drive has turned back, as a share of its range [1]. Source: judgement."""

LEAST = 0.03
"""Least prior std of a moment arm, a gear or a unit, as a share [1]. Source: judgement."""

MOVES = float(np.deg2rad(1.0))
"""Std of the angle of a joint below which its log says nothing of its moment arms [rad]. Source:
judgement.
"""


def residual_of(log: Log, rig: Rig, angles: Floats, sensor: Sensor) -> DriveResidual | None:
    """Return the residual of the position of one drive with its possible causes; None where nothing
    can be found of it.

    Args:
        log: with the drive's position.
        rig: of the log.
        angles: reference angles, (k, n_joints) [rad].
        sensor: of the drive's position.
    """
    if sensor.name not in log.channels:
        return None
    mechanism = Mechanism(rig)
    readings = log.channels[sensor.name]
    drive = rig.drive_names.index(sensor.of)
    asked, slopes, compliance, standing = _asked(mechanism, drive, angles)
    asked = np.where(slopes != 0.0, asked, 0.0)  # another joint may have no reference angle
    turned = [
        int(j)
        for j in np.flatnonzero(slopes)
        if np.isfinite(angles[:, j]).any() and np.nanstd(angles[:, j]) > MOVES
    ]
    if not turned:
        return None
    force = next(
        (s for s in rig.sensors_of("force") if s.of == sensor.of and s.name in log.channels), None
    )
    pull = np.zeros(len(log)) if force is None else log.channels[force.name]
    stretch = np.zeros(len(log)) if force is None else (pull - standing) * compliance
    rate = np.gradient(np.where(np.isfinite(readings), readings, 0.0), log.time)
    expected = asked.sum(axis=1) + stretch
    pulled = {i: tendon for i, tendon in enumerate(rig.tendons) if tendon.drive == sensor.of}
    arms = [_arm_std([*pulled.values()], joint.name) for joint in rig.joints]
    radii = {
        j: tuple(
            f"tendons.{i}.{path}"
            for i, tendon in pulled.items()
            for path in _radii(tendon, rig.joints[j].name)
        )
        for j in turned
    }
    every = tuple(path for paths in radii.values() for path in paths)
    tried = [Cause(sensor.name, "scale", expected, max(arms[j] for j in turned), paths=every)]
    if len(turned) > 1:
        for j in turned:
            subject = f"{sensor.of} at {rig.joints[j].name}"
            tried.append(Cause(subject, "arm", asked[:, j], arms[j], paths=radii[j]))
    soft = float(np.hypot(COMPLIANCE, _stiffness_std([*pulled.values()])))
    if force is not None:
        paths = tuple(f"tendons.{i}.stiffness" for i in pulled)
        tried.append(Cause(force.name, "force", pull * compliance, soft, paths=paths))
        tried.append(Cause(force.name, "stiffness", stretch, soft, paths=paths))
    known = np.isfinite(np.column_stack([readings, rate, *(cause.values for cause in tried)])).all(
        axis=1
    )
    if known.sum() < 10 * len(tried) or np.ptp(readings[known]) == 0.0:
        return None
    interval = float(np.median(np.diff(log.time)))
    stands = _zero_std(sensor, [*pulled.values()], compliance, soft * standing * compliance)
    tried += [
        Cause(sensor.name, "delay", -rate, interval),
        Cause(sensor.name, "zero", 1.0 + 0.0 * rate, stands),
    ]
    span = float(np.ptp(readings[known]))
    way = _direction(readings[known], STAYS * span)
    friction = FRICTION * float(np.median(np.abs(pull[known]))) * compliance
    nuisances = [(way, max(friction, 1e-3 * span))]
    if force is not None:
        nuisances.append((way * pull[known] * compliance, FRICTION))
    return DriveResidual(
        sensor,
        (readings - expected)[known],
        tuple(replace(cause, values=cause.values[known], sensor=sensor) for cause in tried),
        tuple(nuisances),
        max(float(known.sum()) * min(1.0, interval / INDEPENDENT), 2.0),
        max(abs(slopes[j]) for j in turned),
    )


def _direction(readings: Floats, half: float) -> Floats:
    """Return the direction in which a drive last moved, −1 to 1, by a play operator of some
    half-width.
    """
    passed = np.empty_like(readings)
    held = readings[0]
    for k, reading in enumerate(readings.tolist()):
        held = min(max(held, reading - half), reading + half)
        passed[k] = held
    ways: Floats = (readings - passed) / half
    return ways


def _stiffness_std(pulled: Sequence[Tendon]) -> float:
    """Return the std of the stiffness of a drive's tendons, as a share."""
    return max(
        (t.stiffness.total_std / t.stiffness.value for t in pulled if t.stiffness.value > 0.0),
        default=0.0,
    )


def _zero_std(sensor: Sensor, pulled: Sequence[Tendon], compliance: float, soft: float) -> float:
    """Return the std of the zero of a drive's position [m, rad]: of its sensor, of the stretch by
    pre-tension, and of that stretch by an uncertain stiffness, `soft`.
    """
    bias = getattr(sensor, "bias", None)
    own = 0.0 if bias is None else bias.total_std
    tension = max((t.pretension.total_std for t in pulled), default=0.0) * abs(compliance)
    least = LEAST_ZERO[sensor.si]
    return float(np.sqrt(own**2 + tension**2 + soft**2 + least**2))


LEAST_ZERO = {"m": 1e-4, "rad": float(np.deg2rad(1.0))}
"""Least prior std of the zero of a slider [m] and of a motor [rad]. Source: judgement."""


def swaps(log: Log, rig: Rig, angles: Floats, drives: Sequence[DriveResidual]) -> list[Cause]:
    """Return the pairs of columns of one kind that explain more if they are exchanged.

    Args:
        log: with the columns.
        rig: of the log.
        angles: reference angles, (k, n_joints) [rad].
        drives: residuals as the columns stand.
    """
    before = {drive.sensor.name: drive.fit() for drive in drives}
    by_drive = {drive.sensor.of: drive.sensor for drive in drives}
    found = list[Cause]()
    for kind in ("position", "force"):
        read = [s for s in rig.sensors_of(kind) if s.of in by_drive and s.name in log.channels]
        for first, second in combinations(read, 2):
            positions = [by_drive[first.of], by_drive[second.of]]
            exchanged = replace(log, channels={**log.channels, **_exchanged(log, first, second)})
            after = [residual_of(exchanged, rig, angles, sensor) for sensor in positions]
            fits = [drive.fit() for drive in after if drive is not None]
            if len(fits) < len(positions):
                continue
            gain = sum(before[sensor.name].cost for sensor in positions) - sum(f.cost for f in fits)
            if gain < SURE_GAIN:
                continue
            size = max(
                float(np.sqrt(np.mean((before[drive.sensor.name].left) ** 2))) / drive.lever
                for drive in drives
                if drive.sensor in positions
            )
            subject = f"{first.name} and {second.name}"
            found.append(Cause(subject, "swap", np.zeros(0), size=size, gain=gain))
    return found


def _exchanged(log: Log, first: Sensor, second: Sensor) -> dict[str, Floats]:
    return {first.name: log.channels[second.name], second.name: log.channels[first.name]}


def _arm_std(pulled: Sequence[Tendon], joint: str) -> float:
    """Return the std of the moment arm of a drive's tendons at a joint, as a share."""
    stds = [LEAST]
    for meeting in (
        meeting for tendon in pulled for meeting in tendon.meetings if joint in meeting.joints
    ):
        radius = getattr(meeting.shape, "radius", None)
        if radius is not None and radius.value:
            stds.append(radius.total_std / abs(radius.value))
    return max(stds)


def _radii(tendon: Tendon, joint: str) -> list[str]:
    """Return the paths, behind that of a tendon, of the radii at which it meets a joint."""
    return [
        f"{meeting.path}.radius"
        for meeting in tendon.meetings
        if joint in meeting.joints and hasattr(meeting.shape, "radius")
    ]


def _asked(mechanism: Mechanism, drive: int, angles: Floats) -> tuple[Floats, Floats, float, float]:
    """Return the position that each joint alone asks of a drive, (k, n_joints), its slopes at zero,
    the compliance 1/K and the pull F_0 of pre-tension.
    """
    nj = mechanism.n_joints
    n = mechanism.n_bodies
    body = mechanism.n_joints + drive
    q = ca.SX.sym("q", n)
    p = mechanism.parameters
    stretch = mechanism.stretch(drive, q)
    levers = mechanism.length_jacobian(q)[:, body]
    pulled = [i for i, of in enumerate(mechanism.drive_of) if of == body]
    stiffness = sum((levers[i] ** 2 * p[f"tendons.{i}.stiffness"] for i in pulled), ca.SX(0))
    standing = sum((levers[i] * p[f"tendons.{i}.pretension"] for i in pulled), ca.SX(0))
    outputs = [-stretch, -ca.jacobian(stretch, q[:nj]), 1 / stiffness, standing]
    look = ca.Function("asked", [q, p.symbols], outputs)
    zero, slopes, compliance, pull = look(np.zeros(n), p.values)
    asked = np.zeros(angles.shape)
    for j in range(nj):
        at = np.zeros((n, len(angles)))
        at[j] = angles[:, j]
        asked[:, j] = np.array(look(at, p.values)[0]).ravel() - float(zero)
    return asked, np.array(slopes).ravel(), float(compliance), float(pull)
