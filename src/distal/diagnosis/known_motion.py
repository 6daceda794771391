"""Which size of a cause explains best where the drives are, with the joints at known angles.

A drive is at  s = g(θ) + (U − U₀)/K + friction, with the position g that the joints ask of it, its
pull U, the pull U₀ of pre-tension, and the stiffness K of its tendons. What remains of a reading, ρ
= s − g − (U − U₀)/K, is linear in most causes however large they are: its derivatives come from
CasADi, and least squares give the size.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.diagnosis.causes import Cause
from distal.estimators import AdaptiveFilter
from distal.logs import Log
from distal.regression import played
from distal.rig import Sensor

TURNS_BACK = 0.02
"""Way back after which a drive has turned back, as a share of its range [1]. Source: judgement."""


@dataclass(frozen=True)
class _Drive:
    """What remains of a drive's position, (k,) each.

    Args:
        position: sensor of the position.
        force: name of the sensor of the pull; empty where none is read.
        residual: ρ, NaN where it is not known.
        reading: of the position.
        softened: pull over stiffness, U/K.
        slopes: path → derivative of s by the logarithm of a parameter.
    """

    position: Sensor
    force: str
    residual: Floats
    reading: Floats
    softened: Floats
    slopes: dict[str, Floats]


def sizes(
    estimator: AdaptiveFilter, log: Log, truths: Floats, causes: Sequence[Cause]
) -> dict[Cause, list[float]]:
    """Return the sizes of each cause that explain the positions of a drive best, as the only one
    beside friction: with a shift of the position beside it, and without; causes that do not act on
    a position are left out.

    Args:
        estimator: filter of the rig.
        log: with positions and forces.
        truths: known angles of the joints, (k, n_joints) [rad].
        causes: to be sized.
    """
    paths = sorted({path for cause in causes for path in cause.paths})
    sized = dict[Cause, list[float]]()
    for drive in _drives(estimator, log, truths, paths):
        for cause in causes:
            column = _column(cause, drive, log.time)
            if column is not None and np.isfinite(column + drive.residual).any():
                sized[cause] = _fitted(cause, column, drive)
    return sized


def _drives(
    estimator: AdaptiveFilter, log: Log, truths: Floats, paths: Sequence[str]
) -> Iterator[_Drive]:
    rig = estimator.rig
    mechanism = estimator.states.context.mechanism
    parameters = mechanism.parameters
    symbols = parameters.symbols
    values = estimator.parameters[: symbols.numel()]
    names = [path for path in paths if path in parameters.names]
    at = [parameters.names.index(path) for path in names]
    q = ca.SX.sym("q", mechanism.n_bodies)
    pull = ca.SX.sym("pull")
    for sensor in rig.sensors_of("position"):
        if sensor.name not in log.channels:
            continue
        drive = rig.drive_names.index(sensor.of)
        levers = mechanism.length_jacobian(q)[:, mechanism.n_joints + drive]
        stiffness = ca.SX(0)
        standing = ca.SX(0)
        angles = np.zeros((q.numel(), len(log)))
        for i, tendon in enumerate(rig.tendons):
            if tendon.drive == sensor.of:
                stiffness += levers[i] ** 2 * parameters[f"tendons.{i}.stiffness"]
                standing += levers[i] * parameters[f"tendons.{i}.pretension"]
                for joint in map(rig.joint_names.index, tendon.joints):
                    angles[joint] = truths[:, joint]
        stretch = mechanism.stretch(drive, q)
        home = ca.substitute(stretch, q, ca.SX.zeros(q.numel()))
        softened = pull / stiffness
        expected = home - stretch + softened - standing / stiffness
        slopes = ca.jacobian(expected, symbols[at]) * symbols[at].T
        function = ca.Function("position", [q, pull, symbols], [expected, softened, slopes])
        forces = (s.name for s in rig.sensors_of("force") if s.of == sensor.of)
        force = next((name for name in forces if name in log.channels), "")
        pulls = log.channels.get(force, np.zeros(len(log)))
        expect, soft, by = map(np.array, function(angles, pulls[None, :], values))
        reading = log.channels[sensor.name]
        columns = by.reshape(len(log), len(at)).T
        residual = reading - expect.ravel()
        yield _Drive(sensor, force, residual, reading, soft.ravel(), dict(zip(names, columns)))


def _column(cause: Cause, drive: _Drive, time: Floats) -> Floats | None:
    """Return the derivative of a drive's ρ by a cause, (k,); None where it has none."""
    if cause.paths:
        column = -np.sum([drive.slopes.get(path, np.zeros(1)) for path in cause.paths], axis=0)
        return column if np.nansum(np.abs(column)) > 0.0 else None
    if cause.channels == (drive.position.name,):
        readings = np.nan_to_num(drive.reading)
        shift = np.ones(len(time))
        late = np.gradient(readings, time)
        return {"scale": drive.reading, "zero": shift, "delay": late}.get(cause.kind)
    if cause.channels == (drive.force,) and cause.kind == "scale":
        return -drive.softened
    return None


def _fitted(cause: Cause, column: Floats, drive: _Drive) -> list[float]:
    usable = np.isfinite(drive.residual) & np.isfinite(column)
    residual = drive.residual[usable]
    way = _direction(drive.reading[usable])
    matrix = np.column_stack([column[usable], way, way * np.abs(drive.softened[usable])])
    shifted = np.column_stack([matrix, np.ones(len(way))])
    sizes_of = list[float]()
    for columns in [matrix] if cause.kind == "zero" else [shifted, matrix]:
        scales = np.linalg.norm(columns, axis=0)
        scales[scales == 0.0] = 1.0
        fitted = np.linalg.lstsq(columns / scales, residual, rcond=1e-9)[0] / scales
        x = -float(fitted[0])
        if cause.kind == "stiffness":
            x = x / (1.0 - x) if x < 1.0 else -1.0  # ρ is linear in 1/K: 1/(1 + x) = 1 − x'
        if x > -1.0 or not cause.paths:
            sizes_of.append(x)
    return sizes_of


def _direction(readings: Floats) -> Floats:
    """Return the direction in which a drive last moved, −1 to 1, by a play operator."""
    if not len(readings):
        return readings
    half = max(TURNS_BACK * float(np.ptp(readings)), 1e-300)
    return (readings - played(readings, half)) / half
