"""Sections 6 and 7 of docs/reference/adaptive-equations.md for the naive twin: rows, stick and
slip, the update.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import exp, inf, nan, sqrt
from typing import TYPE_CHECKING, Any

import numpy as np

from distal.arrays import Floats
from distal.sensor_models import variance

if TYPE_CHECKING:
    from tests.estimators.adaptive.twin import Tracked, Twin

MOTION_TIME, RESIDUAL_TIME = 10e-3, 0.1


@dataclass
class Row:
    """One comparison, linearised at x⁻: residual r and its slope, limits l and a and theirs,
    variance R.
    """

    drive: int | None
    r: float
    r_x: Floats
    variance: float
    counts: bool
    l: float = 0.0  # noqa: E741
    l_x: Floats | None = None
    a: float = 0.0
    a_x: Floats | None = None
    identified: bool = True  # among the innovations
    reference: bool = False
    friction: bool = False
    sensor: int | None = None


def sign(value: float) -> float:
    return float(np.sign(value))


def update(
    twin: Twin, dt: float, z: Floats, mask: Floats, tracked: list[Tracked]
) -> tuple[Floats, Floats]:
    """Take row after row in; returns ν and S of the sensors."""
    n_y = len(twin.compared)
    innovations, variances = np.full(n_y, nan), np.full(n_y, nan)
    before = twin.m.copy()
    for row in rows_of(twin, dt, z, mask, tracked):
        change = twin.m - before
        r = row.r + row.r_x @ change
        limit, asymmetry = row.l, row.a
        if row.friction:
            limit = row.l + row.l_x @ change
            twin.taken["limit kept at zero"] += bool(limit < 0)
            limit = max(limit, 0.0)
            asymmetry = row.a + row.a_x @ change
        nu, r_prime, beta, gamma, counts = friction_of(twin, row, r, limit, asymmetry, dt, tracked)
        slope = -row.r_x.copy()  # (22)
        if row.friction:
            slope = slope + beta * row.l_x + gamma * row.a_x
        across = twin.P @ slope
        s = slope @ across + r_prime  # (23)
        s_wild = s
        if not row.reference and twin.guards.wild_force < inf:
            s_wild = s * max(1.0, nu**2 / (twin.guards.wild_force * s))
        gain = across / s_wild  # (24)
        for i, state in enumerate(twin.states):
            if state.considered or (state.unidentified and not row.reference):
                gain[i] = 0.0
            elif state.kind in ("parameter", "factor", "deviation") and not row.reference:
                guarded = row.drive is not None and not twin.declared[row.drive]
                tau = twin.guards.learning_time_guarded if guarded else twin.guards.learning_time
                gain[i] *= min(1.0, twin.interval / tau) if tau > 0 else 1.0
        if not counts:
            gain = np.zeros(twin.n)
        twin.taken["wild force"] += bool(counts and s_wild > s)
        twin.m = twin.m + gain * nu  # (25)
        twin.P = (
            twin.P - np.outer(gain, across) - np.outer(across, gain) + s_wild * np.outer(gain, gain)
        )
        if row.drive is not None and row.friction and twin.declared[row.drive]:
            d = twin.drives[row.drive]
            twin.drives[row.drive] = replace(d, residual=d.residual + row.r_x @ gain * nu)  # (26)
        if row.sensor is not None:
            innovations[row.sensor] = nu if counts and row.identified else nan
            variances[row.sensor] = s
    for i, state in enumerate(twin.states):
        if twin.m[i] < state.lowest:
            twin.taken["kept above the lowest"] += 1
            twin.m[i] = state.lowest  # (27)
    for j, joint in enumerate(twin.rig.joints):
        if joint.stops is not None:
            low, high = joint.stops
            depth = max(low - twin.m[j], twin.m[j] - high, 0.0)
            twin.taken["in a stop"] += depth > 0
            twin.taken["deep in a stop"] += depth**2 > twin.P[j, j]
            twin.P[j, j] = max(twin.P[j, j], depth**2)  # (27b)
    return innovations, variances


def rows_of(twin: Twin, dt: float, z: Floats, mask: Floats, tracked: list[Tracked]) -> list[Row]:
    """All comparisons at the predicted state, in their order."""
    end, rates, slopes = twin.position
    m, found = twin.m, twin.model.compared(twin.m, end, rates)
    twin.taken["slack"] += bool(np.any(found["tension"][0] == 0.0))
    rows = []

    def total(name: str, k: int) -> tuple[float, Floats, float]:
        """Value, slope in x (places included) and slope in the drives' own places."""
        value, by_x, by_s = found[name]
        return float(value[k]), by_x[k] + by_s[k] @ slopes, by_s[k]

    for index, sensor in enumerate(twin.compared):
        column = twin.channels.index(sensor)
        reading, there = z[column] - sensor.bias.value, mask[column] > 0
        bias = twin.at("bias", index)
        unit = np.zeros(twin.n)
        offset = 0.0
        if bias is not None:
            unit[bias], offset = 1.0, m[bias]
        if sensor.measures == "force":
            i = twin.rig.drive_names.index(sensor.of)
            rows.append(force_row(twin, i, index, dt, reading, there, tracked, total))
        elif sensor.measures == "tension":
            k = twin.rig.tendon_names.index(sensor.of)
            value, by_x, by_s = total("tension", k)
            own = sum(by_s[i] ** 2 * tracked[i].variance for i in range(twin.n_d))
            r, spread = reading - value - offset, variance(sensor) + own
            rows.append(Row(None, r, -by_x - unit, spread, there, sensor=index))
        else:
            j = twin.rig.joint_names.index(sensor.of)
            r, by_x = reading - m[j] - offset, np.eye(twin.n)[j]
            row = Row(None, r, -by_x - unit, variance(sensor), there, sensor=index)
            row.reference = True
            rows.append(row)
    for i, drive in enumerate(twin.rig.drives):
        if twin.force_of[i] is None and drive.nominal_force.filter_std > 0:
            rows.append(
                force_row(twin, i, None, dt, drive.nominal_force.value, True, tracked, total)
            )
    return rows


def force_row(
    twin: Twin,
    i: int,
    index: int | None,
    dt: float,
    reading: float,
    there: bool,
    tracked: list[Tracked],
    total: Any,
) -> Row:
    """A drive's force, what its transmission passes on, or its nominal force."""
    drive, m, sensor = twin.rig.drives[i], twin.m, twin.force_of[i]
    added, added_x = 0.0, np.zeros(twin.n)
    error = twin.at("error", i)
    if error is not None:
        added, added_x[error] = -m[error], -1.0
    counts = there and not near_stop(twin, i, tracked[i].s)
    transmitted = twin.at("transmitted", i)
    if transmitted is not None:
        value, by_x, by_s = total("elastic", i)
        spread = 0.3**2 * variance(sensor) + tracked[i].variance * by_s[i] ** 2
        r_x = -by_x - added_x
        r_x[transmitted] += 1.0
        return Row(i, m[transmitted] - value - added, r_x, spread, counts, sensor=index)
    value, by_x, by_s = total("pull", i)
    bias_x, offset = np.zeros(twin.n), 0.0
    if index is not None:
        bias = twin.at("bias", index)
        if bias is not None:
            bias_x[bias], offset = 1.0, m[bias]
        spread = variance(sensor)
    else:
        spread = drive.nominal_force.filter_std**2 * 2.0 / max(dt, 1e-6)
    spread += tracked[i].variance * by_s[i] ** 2
    r, r_x = reading - value - added - offset, -by_x - added_x - bias_x
    row = Row(i, r, r_x, spread, counts, friction=True, sensor=index)
    row.l, row.l_x, _ = total("mean", i)
    row.a, row.a_x, _ = total("asymmetry", i)
    friction = twin.at("friction", i)
    if friction is not None:
        row.l, row.l_x = row.l + m[friction], row.l_x.copy()
        row.l_x[friction] += 1.0
    return row


def near_stop(twin: Twin, i: int, s: float) -> bool:
    """Whether the drive may touch a stop, (17)."""
    stops, sensor = twin.rig.drives[i].stops, twin.position_of[i]
    if stops is None or sensor is None:
        return False
    low, high = stops
    wrong = sensor.linearity + 2 * sqrt(variance(sensor) + sensor.bias.filter_std**2)
    near = not low + wrong < s < high - wrong
    twin.taken["at a stop"] += near
    return near


def friction_of(
    twin: Twin,
    row: Row,
    r: float,
    limit: float,
    asymmetry: float,
    dt: float,
    tracked: list[Tracked],
) -> tuple[float, float, float, float, bool]:
    """ν, R', c_l, c_a, and whether the row counts: stick and slip, (18) to (21)."""
    if not row.friction:
        return r, row.variance, 0.0, 0.0, row.counts
    i, guards = row.drive, twin.guards
    sensor, d, b = twin.position_of[i], twin.drives[i], tracked[i].bend
    own = row.l_x @ twin.P @ row.l_x
    if sensor is None:  # a drive whose place is a state
        twin.taken["friction of a lost drive"] += row.counts
        return r, row.variance + limit**2, 0.0, 0.0, row.counts
    noise, span = variance(sensor), max(dt, 1e-6)
    declared = twin.declared[i]
    n = (0.6 if declared else 0.8) ** 2 * noise
    moved = MOTION_TIME**2 * d.square - 2 * noise * MOTION_TIME**2 / span**2
    mu = max(moved, (MOTION_TIME * d.speed) ** 2, 0.0)
    kappa = n / (mu + n)  # (18)
    way = MOTION_TIME * d.speed / sqrt(mu + n) / (1 + b**2 / (100 * noise))  # (19)
    force = twin.force_of[i]
    delta_t = twin.interval if force is None else 1 / force.rate
    counts, stuck = row.counts, guards.sticking_time
    if not declared:
        clear = counts and kappa < 0.15 and abs(way) > 0.5
        y = sign(way) * delta_t if clear else d.direction + sign(d.direction) * dt
        twin.drives[i] = d = replace(d, direction=y)
        if counts:
            twin.taken["undeclared, moves" if kappa < 0.15 else "undeclared, sticks"] += 1
        if kappa >= 0.15:
            way = sign(d.direction)
        long = d.direction**2 / stuck if stuck > 0 else 0.0
        twin.taken["undeclared, sticks for long"] += bool(counts and long > stuck)
        twin.taken["undeclared, has not moved yet"] += bool(counts and d.direction == 0)
        delta = (
            kappa * max(stuck, long) + guards.turning_time * (1 - kappa) * (1 - way**2)
        ) / delta_t
    else:
        if guards.moving_only:
            clear = kappa < 0.15 and abs(way) > 0.9
            twin.taken["does not clearly move"] += bool(counts and not clear)
            # what does not clearly move is left out of the innovations, not of the estimate
            row.identified = bool(clear)
        if counts:
            f = exp(-dt / RESIDUAL_TIME)
            twin.drives[i] = d = replace(d, residual=f * d.residual + (1 - f) * r)
        delta = (stuck * kappa + 3 * guards.turning_time * (1 - kappa) * (1 - way**2)) / delta_t
        if guards.moving_only and row.identified:
            delta = 0.0
        if kappa > 0.5:
            return *clipped(twin, row, d.residual, limit, asymmetry, own, counts), counts
        twin.taken["declared, slips"] += counts
    # (20)
    nu = r - way * limit - abs(way) * asymmetry
    return nu, row.variance + delta * (limit**2 + own), way, abs(way), counts


def clipped(
    twin: Twin, row: Row, residual: float, limit: float, asymmetry: float, own: float, counts: bool
) -> tuple[float, float, float, float]:
    """A drive that sticks: only what is beyond the limits counts, (21)."""
    side = sign(residual)
    reach = limit + asymmetry * side
    if abs(residual) > reach:
        twin.taken["sticks, beyond the limits"] += counts
        return residual - reach * side, row.variance, side, 1.0
    twin.taken["sticks, within the limits"] += counts
    b = (0.42 * limit) ** 2 + row.variance + own
    spread = max(row.r_x @ twin.P @ row.r_x, 1e-12)
    return 0.0, 1 / max(1 / b - 1 / spread, 1e-9), 0.0, 0.0
