"""The update of the displacement-driven filter: measured forces against the tensions that follow from the state."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.kalman import lowered
from distal.estimators.motion import MEMORY
from distal.estimators.stick_slip import friction_row
from distal.sensors import variance

WILD_FORCE = 9.0
"""A squared innovation beyond this times its variance counts less: its variance grows in proportion."""

STOP_MARGIN = 1.0
"""A slider nearer to a stop than this times its sensor's linearity may touch it: its force tells nothing."""


TIE = 0.3
"""How closely the transmitted effort fits the tendons' pull, in standard deviations of the effort's sensor."""

FOLLOWS = 0.05
"""Time in which the joint follows a drive whose place is not known [s]."""

ALONG = 20.0
"""How many times the variance of a place that is lost is added where the joint went along."""

NOMINAL_TIME = 1.0
"""Time over which an unmeasured pull's departure from its nominal value lasts [s]."""


@dataclass(frozen=True)
class ForceRow:
    """One force or tension to compare, as expressions of a symbolic state.

    Args:
        name: of its sensor, or of the drive where the pull is only nominal.
        residual: measured minus expected without friction.
        limit: friction limit of the drive, the mean of both directions, 0 for a tension.
        lean: by how much the limit is larger against motion to +, and smaller against motion to −.
        variance: of the sensor.
        mask: 1 where it counts.
        drive: index of the drive, or None for a tension.
        measured: whether a sensor measures it; else the pull is nominal.
        trusted: a reference, which is never taken as wild.
    """

    name: str
    residual: Any
    limit: Any
    lean: Any
    variance: Any
    mask: Any
    drive: int | None
    measured: bool = True
    trusted: bool = False


def force_rows(augmented: AugmentedState, state: Any, motions: Any, speeds: Any, noise: Any, x: Any) -> list[ForceRow]:
    """Return what is compared: U = Σ T ∂ℓ/∂s + b ṡ + friction of each drive, and measured tensions.

    Args:
        augmented: the layout of the state.
        state: symbolic, (n,).
        motions: of the drives; see `prepare_function`.
        speeds: of the drives, (n_drives,).
        noise: variance of each place, (n_drives,).
        x: the sample.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    p, nb, nj, width = mechanism.parameters.symbols, mechanism.n_bodies, mechanism.n_joints, len(channels.names)
    places = []
    for i in range(mechanism.n_drives):
        if i in augmented.places_at:
            places.append(state[augmented.places_at[i]])
        else:
            reading = motions[MEMORY * i]
            places.append(reading - augmented.systematic_error(i, reading, state))
    q, v = ca.vertcat(state[0], *places), ca.vertcat(state[1], speeds)
    symbols = [ca.SX.sym("q", nb), ca.SX.sym("v", nb), p]
    tensions = mechanism.tensions(*symbols[:2])
    pulls = ca.mtimes(mechanism.length_jacobian(symbols[0]).T, tensions) + mechanism.dampings() * symbols[1]
    friction = mechanism.friction_limits(symbols[0], symbols[1], tensions)
    outputs = [
        tensions,
        pulls,
        *(ca.vertcat(*(getattr(limit, part) for limit in friction)) for part in ("mean", "asymmetry")),
    ]
    outputs += [ca.jacobian(tensions, symbols[0]), ca.jacobian(pulls, symbols[0])]
    values = ca.Function("pulls", symbols, outputs)(q, v, augmented.model_parameters(state))
    tensions, pulls, limits, leans, tension_slopes, pull_slopes = values
    rows = []
    for i, drive in enumerate(mechanism.rig.drives):
        sensor, body = sensor_for(channels.forces, drive.name), nj + i
        spread = (noise[i] + _went_along(motions, i)) * pull_slopes[body, body] ** 2
        limit, lean = limits[body], leans[body]
        if i in augmented.friction_at:
            limit += state[augmented.friction_at[i]]
        free = _away_from_stops(augmented, i, motions[MEMORY * i])
        if sensor is None:
            dt = ca.fmax(x[0], 1e-6)
            unsure = drive.nominal_force.std**2 * 2 * NOMINAL_TIME / dt
            known = float(drive.nominal_force.std > 0.0)
            residual = drive.nominal_force.value - pulls[body]
            rows.append(ForceRow(drive.name, residual, limit, lean, spread + unsure, known * free, i, measured=False))
            continue
        k = channels.names.index(sensor.name)
        if i in augmented.transmitted_at:
            damped = mechanism.dampings()[body] * speeds[i]
            residual = state[augmented.transmitted_at[i]] - (pulls[body] - damped)
            if i in augmented.considered:
                residual += state[augmented.considered[i]]
            own = TIE**2 * augmented.noise(sensor) + spread
            rows.append(ForceRow(sensor.name, residual, ca.SX(0), ca.SX(0), own, x[1 + width + k] * free, None))
            continue
        residual = x[1 + k] - augmented.offset(sensor) - pulls[body] - augmented.bias(sensor.name, state)
        own = augmented.noise(sensor)
        rows.append(ForceRow(sensor.name, residual, limit, lean, own + spread, x[1 + width + k] * free, i))
    tendons = [tendon.name for tendon in mechanism.rig.tendons]
    for sensor in channels.tensions:
        k, t = channels.names.index(sensor.name), tendons.index(sensor.of)
        body = mechanism.drive_of[t]
        own = augmented.noise(sensor) + tension_slopes[t, body] ** 2 * noise[body - nj]
        residual = x[1 + k] - augmented.offset(sensor) - tensions[t] - augmented.bias(sensor.name, state)
        rows.append(ForceRow(sensor.name, residual, ca.SX(0), ca.SX(0), own, x[1 + width + k], None))
    for sensor in channels.angles:
        k = channels.names.index(sensor.name)
        residual = x[1 + k] - augmented.offset(sensor) - state[0] - augmented.bias(sensor.name, state)
        rows.append(
            ForceRow(
                sensor.name, residual, ca.SX(0), ca.SX(0), augmented.noise(sensor), x[1 + width + k], None, trusted=True
            )
        )
    # as the filter names its innovations: by the rig's order of sensors; nominal pulls come last
    names = [sensor.name for sensor in channels.compared]
    return sorted(rows, key=lambda row: names.index(row.name) if row.measured else len(names))


def _went_along(motions: Any, drive: int) -> Any:
    """Return the variance to add to a place that has long been missing, so that its force does not speak of the joint.

    The joint went where the drive went: its error and the place's are one, and cancel in the tension. The filter, to
    which they are independent, would otherwise share the residual between them.
    """
    unknown, lost = motions[MEMORY * drive + 4], motions[MEMORY * drive + 5]
    return ALONG * (lost / (lost + FOLLOWS)) ** 3 * unknown


def _away_from_stops(augmented: AugmentedState, drive: int, place: Any) -> Any:
    """Return 1 where a drive is certainly not at a stop: there the contact force is unknown."""
    part = augmented.mechanism.rig.drives[drive]
    sensor = sensor_for(augmented.channels.positions, part.name)
    if part.stops is None or sensor is None:
        return ca.SX(1)
    low, high = part.stops
    margin = STOP_MARGIN * sensor.linearity + 10 * np.sqrt(variance(sensor)) + 0.002 * (high - low)
    return ca.if_else(ca.logic_and(place > low + margin, place < high - margin), 1, 0)


def force_update(
    augmented: AugmentedState,
    prior: Any,
    covariance: Any,
    motions: Any,
    speeds: Any,
    noise: Any,
    residuals: list[Any],
    x: Any,
    p: Any,
    updates: int,
    ideal: bool = False,
    loops: bool = False,
) -> tuple[Any, Any, list[Any], Any]:
    """Return mean, covariance, remembered mean residuals, and (innovations, variances) after the forces of a sample.

    A drive that moves has friction against its motion. One that sticks has any friction up to its limit: where the rig
    declares friction, its mean residual is compared with the limits and only what is beyond them counts (a clipped
    residual); where friction is unknown, a sample counts little. A wild force counts little too.

    Args:
        augmented: the layout of the state.
        prior: state before, (n,).
        covariance: before, (n, n).
        motions: of the drives.
        speeds: of the drives.
        noise: variance of each place.
        residuals: what is remembered of each drive's force; see `TakenRow`.
        x: the sample.
        p: the parameters.
        updates: how often each row is linearised again.
        ideal: leave out all that guards against a wrong model.
        loops: whether this stays a function of matrices.
    """
    rows, tables = row_functions(augmented)
    arguments = [motions, speeds, noise, x, p]
    mean, kept = prior, list(residuals)
    innovations, spreads = [], []
    for k, row in enumerate(rows):
        taken = taken_function(augmented, row, ideal)
        held = ca.MX(0) if row.drive is None else kept[row.drive]
        point = prior
        for _ in range(updates):
            table, *slopes = tables(point, *arguments)
            slope, limit_slope, lean_slope = slopes[3 * k : 3 * k + 3]
            ahead = [ca.mtimes(covariance, each) for each in slopes[3 * k : 3 * k + 3]]
            steps = [_along(each, mean - point) for each in slopes[3 * k : 3 * k + 3]]
            known, unsure = _along(slope, ahead[0]), _along(limit_slope, ahead[1])
            numbers = ca.vertcat(*steps, known, unsure, held)
            innovation, own, memory, by_limit, by_lean, counts = taken(table[5 * k : 5 * k + 5], numbers, motions, x, p)
            across = -ahead[0]
            for share, each, there in ((by_limit, ahead[1], limit_slope), (by_lean, ahead[2], lean_slope)):
                across = across + share * each if there.nnz() else across
            variance = -_along(slope, across)
            variance += by_limit * _along(limit_slope, across) + by_lean * _along(lean_slope, across)
            weight, root, spread, told = weights(ideal or row.trusted)(
                variance + own, innovation, table[5 * k + 4], counts
            )
            change = (weight * innovation) * across
            point = mean + change
        for at in augmented.considered.values():
            change[at] = (
                0  # considered, not estimated (Schmidt, 1966): what the model leaves out is no state to be found
            )
        if row.drive is not None:
            # a mean residual moves with the state; a count of samples does not
            kept[row.drive] = memory if augmented.is_clean(row.drive) else memory + _along(slope, change)
        mean = mean + change
        if augmented.considered:
            gain = weight * across
            for at in augmented.considered.values():
                gain[at] = 0
            covariance = lowered(covariance, gain, across - (0.5 * spread) * gain, loops)
        else:
            covariance = lowered(covariance, root * across, None, loops)
        innovations.append(told)
        spreads.append(variance + own)
    measured = [k for k, row in enumerate(rows) if row.measured]
    y = ca.vertcat(*(innovations[k] for k in measured), *(spreads[k] for k in measured))
    return mean, covariance, kept, y


def _along(slope: Any, values: Any) -> Any:
    """Return a slope times a vector."""
    return ca.mtimes(slope.T, values) if slope.nnz() else ca.MX(0)


def row_functions(augmented: AugmentedState) -> tuple[list[ForceRow], ca.Function]:
    """Return what is compared, and (state, motions, speeds, noise, x, p) → (values, slopes) of all of it.

    Values are residual, limit, lean, variance and mask of each row; slopes of the first three are columns of their own.

    Args:
        augmented: the layout of the state.
    """
    n, nd, width = len(augmented), augmented.mechanism.n_drives, len(augmented.channels.names)
    state, motions = ca.SX.sym("state", n), ca.SX.sym("motions", nd * (MEMORY + 1))
    speeds, noise, x = ca.SX.sym("speeds", nd), ca.SX.sym("noise", nd), ca.SX.sym("x", 1 + 2 * width)
    rows = force_rows(augmented, state, motions, speeds, noise, x)
    values = [part for row in rows for part in (row.residual, row.limit, row.lean, row.variance, row.mask)]
    slopes = [ca.sparsify(ca.jacobian(part, state)).T for row in rows for part in (row.residual, row.limit, row.lean)]
    arguments = [state, motions, speeds, noise, x, augmented.mechanism.parameters.symbols]
    return rows, ca.Function("rows", arguments, ca.cse([ca.densify(ca.vertcat(*values)), *slopes]))


def taken_function(augmented: AugmentedState, row: ForceRow, ideal: bool) -> ca.Function:
    """Return (values, numbers, motions, x, p) → `TakenRow` of one row.

    Args:
        augmented: the layout of the state.
        row: which.
        ideal: leave out all that guards against a wrong model.
    """
    nd, width = augmented.mechanism.n_drives, len(augmented.channels.names)
    values, numbers = ca.SX.sym("values", 5), ca.SX.sym("numbers", 6)
    motions, x = ca.SX.sym("motions", nd * (MEMORY + 1)), ca.SX.sym("x", 1 + 2 * width)
    residual, limit, lean = (values[i] + numbers[i] for i in range(3))
    known, unsure, kept = (numbers[i] for i in range(3, 6))
    taken = friction_row(
        augmented,
        row.drive,
        motions,
        residual,
        ca.fmax(limit, 0),
        lean,
        values[3],
        unsure,
        known,
        kept,
        values[4],
        x[0],
        ideal,
    )
    parts = (taken.innovation, taken.variance, taken.memory, taken.by_limit, taken.by_lean, taken.counts)
    arguments = [values, numbers, motions, x, augmented.mechanism.parameters.symbols]
    return ca.Function("taken", arguments, ca.cse([ca.densify(ca.SX(part)) for part in parts]))


def weights(trusted: bool) -> ca.Function:
    """Return (S, ν, mask, counts) → (mask/S', its root, S', ν to tell): S' = S max(1, ν²/(9 S)), for a wild force.

    Args:
        trusted: never taken as wild.
    """
    spread, innovation, mask, counts = (ca.SX.sym(name) for name in ("S", "nu", "mask", "counts"))
    robust = spread * (1 if trusted else ca.fmax(1, innovation**2 / (WILD_FORCE * spread)))
    # a mask of −1: compared, but not used
    weight = ca.fmax(mask, 0) / robust
    # what is not compared (its slider at a stop) has no innovation
    told = ca.if_else(ca.logic_and(mask != 0, counts), innovation, np.nan)
    return ca.Function("weights", [spread, innovation, mask, counts], [weight, ca.sqrt(weight), robust, told])
