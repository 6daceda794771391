"""What is compared: measured forces, tensions and angles against what follows from the state. Equations (16) and (17)."""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.context import FilterContext
from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.mechanics import mechanics_function
from distal.estimators.adaptive.robustness import extra_variance
from distal.estimators.adaptive.states import StateVector
from distal.expressions import Scalar, Vector

TIE = 0.3
"""How closely the transmitted effort fits the tendons' pull, in standard deviations of the effort's sensor."""

NOMINAL_TIME = 1.0
"""Time over which an unmeasured pull's departure from its nominal value lasts [s]."""


@dataclass(frozen=True)
class Row:
    """One force, tension or angle to compare, as expressions of a symbolic state.

    Args:
        name: of its sensor, or of the drive where the pull is only nominal.
        residual: measured minus expected without friction.
        variance: of the sensor and of the drive's place.
        mask: 0 where it does not count, else see `distal.kernels.mask`.
        limit: friction limit of the drive, the mean of both directions.
        asymmetry: by how much the limit is larger against motion to +, and smaller against motion to −.
        drive: index of the drive whose friction is in it, or None.
        measured: whether a sensor measures it; else the pull is nominal.
        trusted: a reference, which is never taken as wild.
    """

    name: str
    residual: Scalar
    variance: Scalar
    mask: Scalar
    limit: Scalar = 0
    asymmetry: Scalar = 0
    drive: int | None = None
    measured: bool = True
    trusted: bool = False


def rows_of(states: StateVector, state: Vector, tracks: Tracks[ca.SX], rates: Vector, x: Vector) -> list[Row]:
    """Return what is compared: U = Σ T ∂ℓ/∂s + b ṡ + friction of each drive, measured tensions, a reference's angle.

    Args:
        state: symbolic, (n,).
        rates: mean speed of each drive over the interval, (n_drives,).
        x: the sample.
    """
    context, mechanism, nj = states.context, states.context.mechanism, states.context.n_joints
    places = [states.place(i, tracks[i].place, state) for i in range(context.n_drives)]
    q, v = ca.vertcat(state[:nj], *places), ca.vertcat(state[nj : 2 * nj], rates)
    mechanics = mechanics_function(context)(q, v, states.parameters(state))
    tensions, pulls, dampings, limits, asymmetries, tension_slopes, pull_slopes = mechanics
    rows = []
    for i, drive in enumerate(mechanism.rig.drives):
        sensor, body, track = context.force_sensor(i), nj + i, tracks[i]
        unsure = track.variance + extra_variance(context.robustness, track.lost, track.unknown)
        spread = unsure * pull_slopes[body, body] ** 2
        free, expected = away_from_stops(context, i, track.place), pulls[body] + states.force(i, state)
        friction = (limits[body] + states.friction(i, state), asymmetries[body], i)
        if sensor is None:
            known = float(drive.nominal_force.std > 0.0)
            lasting = drive.nominal_force.std**2 * 2 * NOMINAL_TIME / ca.fmax(x[0], 1e-6)
            residual = drive.nominal_force.value - expected
            rows.append(Row(drive.name, residual, spread + lasting, known * free, *friction, measured=False))
            continue
        own, mask = context.noise(sensor), context.mask(x, sensor) * free
        transmitted = states.transmitted(i)
        if transmitted is not None:
            damped = dampings[body] * rates[i]
            rows.append(Row(sensor.name, state[transmitted[0]] - (expected - damped), TIE**2 * own + spread, mask))
            continue
        read = context.value(x, sensor)
        residual = read - expected - states.sensor_error(sensor, read, state)
        rows.append(Row(sensor.name, residual, own + spread, mask, *friction))
    tendons = [tendon.name for tendon in mechanism.rig.tendons]
    for sensor in context.channels.tensions:
        t = tendons.index(sensor.of)
        body = mechanism.drive_of[t]
        own = context.noise(sensor) + tension_slopes[t, body] ** 2 * tracks[body - nj].variance
        read = context.value(x, sensor)
        residual = read - tensions[t] - states.sensor_error(sensor, read, state)
        rows.append(Row(sensor.name, residual, own, context.mask(x, sensor)))
    joints = [joint.name for joint in mechanism.rig.joints]
    for sensor in context.channels.angles:
        read = context.value(x, sensor)
        residual = read - state[joints.index(sensor.of)] - states.sensor_error(sensor, read, state)
        rows.append(Row(sensor.name, residual, context.noise(sensor), context.mask(x, sensor), trusted=True))
    # as the filter names its innovations: by the rig's order of sensors; nominal pulls come last
    names = [sensor.name for sensor in context.channels.compared]
    return sorted(rows, key=lambda row: names.index(row.name) if row.measured else len(names))


def away_from_stops(context: FilterContext, drive: int, place: Scalar) -> Scalar:
    """Return 1 where a drive is certainly not at a stop: there the contact force is unknown, (17).

    Args:
        place: what its sensor reads.
    """
    part, sensor = context.mechanism.rig.drives[drive], context.position_sensor(drive)
    if part.stops is None or sensor is None:
        return ca.SX(1)
    low, high = part.stops
    # one that is held by its stop may read a place before it
    wrong = sensor.linearity + 2 * ca.sqrt(context.noise(sensor) + context.bias_std(sensor) ** 2)
    return ca.if_else(ca.logic_and(place > low + wrong, place < high - wrong), 1, 0)


def row_functions(states: StateVector) -> tuple[list[Row], ca.Function]:
    """Return what is compared, and (state, tracks, rates, x, p) → (values, slopes) of all of it.

    Values are residual, limit, asymmetry, variance and mask of each row; slopes of the first three are columns.
    """
    context, state = states.context, ca.SX.sym("state", len(states))
    vector, rates = ca.SX.sym("tracks", Tracks.size(context.n_drives)), ca.SX.sym("rates", context.n_drives)
    x = ca.SX.sym("x", context.width)
    rows = rows_of(states, state, Tracks(vector, context.n_drives), rates, x)
    values = [part for row in rows for part in (row.residual, row.limit, row.asymmetry, row.variance, row.mask)]
    sloped = [ca.SX(part) for row in rows for part in (row.residual, row.limit, row.asymmetry)]
    slopes = [ca.sparsify(ca.jacobian(part, state)).T for part in sloped]
    arguments = [state, vector, rates, x, context.mechanism.parameters.symbols]
    return rows, ca.Function("rows", arguments, ca.cse([ca.densify(ca.vertcat(*values)), *slopes]))
