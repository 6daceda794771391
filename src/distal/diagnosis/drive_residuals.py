"""What the positions of drives leave beside a known truth: the residual, the columns of what may
explain it, and how well the rig knows each; see `causes`.
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
"""Two columns are exchanged where that gains more in −2 ln p (Kass and Raftery, 1995: above 10 is
very strong evidence).
"""

INDEPENDENT = 0.25
"""Residuals are correlated over so long [s]: friction lasts as long as a motion does."""

FRICTION = 0.3
"""Prior std of friction in a drive, as a share of its pull."""

COMPLIANCE = 0.1
"""No stiffness or force scale is taken as known better than this share."""

STAYS = 0.02
"""A drive turns back where it has moved by this share of its range the other way."""

LEAST = 0.03
"""No moment arm, gear or unit is taken as known better than this share."""

MOVES = float(np.deg2rad(1.0))
"""A joint that turns by less [rad] says nothing of its arms."""


def residual_of(log: Log, rig: Rig, angles: Floats, sensor: Sensor) -> DriveResidual | None:
    """Return what the position of one drive leaves beside the true `angles`, (k, n_joints) [rad];
    None where nothing can be told of it.
    """
    if sensor.name not in log.channels:
        return None
    mechanism = Mechanism(rig)
    readings = log.channels[sensor.name]
    drive = rig.drive_names.index(sensor.of)
    asked, slopes, compliance, standing = _asked(mechanism, drive, angles)
    asked = np.where(slopes != 0.0, asked, 0.0)  # of another joint the truth may be missing
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
    """Return which way a drive last moved, −1 to 1, by a play of some half-width."""
    passed = np.empty_like(readings)
    held = readings[0]
    for k, reading in enumerate(readings.tolist()):
        held = min(max(held, reading - half), reading + half)
        passed[k] = held
    ways: Floats = (readings - passed) / half
    return ways


def _stiffness_std(pulled: Sequence[Tendon]) -> float:
    """Return how well the stiffness of a drive's tendons is known, as a share."""
    return max(
        (t.stiffness.total_std / t.stiffness.value for t in pulled if t.stiffness.value > 0.0),
        default=0.0,
    )


def _zero_std(sensor: Sensor, pulled: Sequence[Tendon], compliance: float, soft: float) -> float:
    """Return how well the zero of a drive's position is known [m, rad]: its sensor's, what
    pre-tension stretches, and what is `soft` of that.
    """
    bias = getattr(sensor, "bias", None)
    own = 0.0 if bias is None else bias.total_std
    tension = max((t.pretension.total_std for t in pulled), default=0.0) * abs(compliance)
    least = LEAST_ZERO[sensor.si]
    return float(np.sqrt(own**2 + tension**2 + soft**2 + least**2))


LEAST_ZERO = {"m": 1e-4, "rad": float(np.deg2rad(1.0))}
"""No zero of a slider or a motor is taken as known better than this [m, rad]."""


def swaps(log: Log, rig: Rig, angles: Floats, drives: Sequence[DriveResidual]) -> list[Cause]:
    """Return the columns of a kind that explain more when they are exchanged, beside the true
    `angles`, (k, n_joints) [rad].
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
    """Return how well the moment arm of a drive's tendons at a joint is known, as a share."""
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
    1/K and F_0.
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
