"""A learned map as a CasADi function of one sample, with a memory between samples; and the function
of a filter whose report maps correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import reduce

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Scalar, Vector, VectorNode
from distal.kernels.mask import is_read
from distal.regression.after_homing import ANYWHERE
from distal.regression.features import PASSED, SMALLEST_HALF, columns, fade, limits, variables
from distal.rig import Contact, LearnedMap

CARRIED_TIME = 0.3
"""Time constant with which a map's correction is forgotten while something touches a joint [s]: the
map was learned in free motion, and does not hold there. Source: benchmark (docs/results/touch.md).
"""

PARAMETERS = (
    "centre",
    "scale",
    "low",
    "high",
    "rate",
    "width",
    "distance",
    "reach",
    "own",
    "between",
    "spread",
    "band",
)
"""Names of the fields of a `LearnedMap` that are parameters of its function, in their order; the
parameters of its joints follow.
"""

UNREAD_AGE = 1e6
"""Age of a reading before its first value [s], so large that the reading counts as unknown. Source:
judgement.
"""


def memory_size(learned: LearnedMap) -> int:
    """Return the length of a map's memory.

    It holds the last readings, their ages, the states of play operators and lags, and what
    `remembered` needs: where its moving readings were, and its value. Last is how far the members
    of a blend are apart, see `LearnedMap.apart`.
    """
    return sum(_memory_sizes(learned))


def _memory_sizes(learned: LearnedMap) -> list[int]:
    m = len(learned.channels)
    remembers = [len(learned.moves), 1] if learned.stays else [0, 0]
    return [m, m, len(learned.played), len(learned.lagged), *remembers, int(bool(learned.apart))]


def carried_size(learned: LearnedMap, touched: Sequence[int]) -> int:
    """Return how many values of a map are remembered beside its memory while something touches a
    joint: one for each joint, none for a map of the external torque.
    """
    return len(learned.joints) if touched and not isinstance(learned, Contact) else 0


def map_coefficients_of(learned: LearnedMap) -> Floats:
    """Return the parameters of the function of a map, (n_p,), see `map_function`."""
    return np.concatenate(_parameters(learned))


def _spread(learned: LearnedMap, parameters: VectorNode) -> VectorNode:
    """Return the RMS over the logs of the mapped value of each joint, from the map's parameters."""
    sizes = [len(part) for part in _parameters(learned)]
    at = PARAMETERS.index("spread")
    begin = sum(sizes[:at])
    return parameters[begin : begin + sizes[at]]


def _parameters(learned: LearnedMap) -> list[Floats]:
    parameters = [
        np.asarray(getattr(learned, name), dtype=np.float64).ravel() for name in PARAMETERS
    ]
    homed = np.array(learned.homed or [ANYWHERE] * len(learned.joints))
    none = [0.0] * len(learned.joints)
    parameters += [np.array(learned.stays or none), np.array(learned.extrapolation or none)]
    parameters += [*homed.T, np.ravel(learned.apart)]
    for joint in learned.joints:
        parameters += [
            np.asarray(joint.coefficients),
            np.asarray(joint.covariance).ravel(),
            np.array([joint.std]),
        ]
    return parameters


def map_function(learned: LearnedMap, width: int, placed: Sequence[bool]) -> ca.Function:
    """Return the function of a map: (memory, x, positions, angles, numbers) → (values, gains,
    variances, outside, memory⁺).

    A value is φᵀ b. An error e of the filter's own angle becomes gain · e in the reported angle,
    gain = own (1 + ∂value/∂θ). The map's own variance is c² (g² φᵀ C φ + s²) + d² (s² + spread²), g
    being `LearnedMap.between` and d how far the readings are outside the learned range, see
    `outside`. It grows by (z r)², z being what is `remembered` of d, and r `LearnedMap.stays`. For
    each reading that has been missing for a time a it grows by the square of ∂value/∂reading times
    min(rate · a, the reading's whole range). Beyond what a homing move covered it grows by (κ h)²,
    see `beyond_homing`.

    Args:
        learned: the map; its coefficients and ranges are the function's inputs `numbers`, see
            `map_coefficients_of`.
        width: number of the estimator's channels, of which those of the map are the first.
        placed: for each channel of the map, whether the function takes it from `positions`, the
            estimated positions of the drives, instead of from the reading.
    """
    nj = len(learned.joints)
    m = len(learned.channels)
    n = len(learned.centre)
    memory = ca.SX.sym("memory", memory_size(learned))
    x = ca.SX.sym("x", 1 + 2 * width)
    positions = ca.SX.sym("positions", m)
    angles = ca.SX.sym("angles", nj)
    sizes = [len(part) for part in _parameters(learned)]
    parameters = ca.SX.sym("numbers", sum(sizes))
    centre, scale, low, high, rate, half_play, distance, reach, *parts = _split(parameters, sizes)
    share, between, spread, band, stays, extrapolation, homed_low, homed_high, *parts = parts
    apart, *of_joints = parts
    held, ages, plays, lags, trail, remains, _ = _split(memory, _memory_sizes(learned))
    is_present = [is_read(x[1 + width + i]) for i in range(m)]
    aged = [ca.if_else(is_present[i], 0, ages[i] + x[0]) for i in range(m)]
    readings = [
        positions[i] if placed[i] else ca.if_else(is_present[i], x[1 + i], held[i])
        for i in range(m)
    ]
    symbols = ca.SX.sym("symbols", n)
    half = ca.fmax((high - low) / 2, SMALLEST_HALF)
    middle = (high + low) / 2
    share_in = ca.SX.sym("share")
    scaled = [
        (middle[i] + share_in * (symbols[i] - middle[i]) - centre[i]) / scale[i] for i in range(n)
    ]
    inner = ca.SX(1)
    follows = [ca.SX(1)] * n
    if np.isfinite(learned.margin) and learned.used:
        away = [ca.fabs(symbols[i] - middle[i]) / half[i] for i in range(n)]
        furthest = ca.mmax(ca.vertcat(*(away[i] for i in learned.used)))
        inner = (1 + learned.margin) / ca.fmax(1 + learned.margin, furthest)
        follows = [ca.if_else(excess < 1 + learned.margin, 1, 0) for excess in away]
    after = {
        (i, ratio): ca.fmin(
            ca.fmax(plays[at], scaled[i] - ratio * half_play[i]), scaled[i] + ratio * half_play[i]
        )
        for at, (i, ratio) in enumerate(learned.played)
    }
    late = {
        (i, constant): lags[at] + (1 - ca.exp(-x[0] / constant)) * (scaled[i] - lags[at])
        for at, (i, constant) in enumerate(learned.lagged)
    }
    widths = [half_play[i] for i in range(m)]
    named = variables(learned, scaled, after, late, widths, ca.fabs)
    phi = ca.vertcat(*columns(learned.terms, named, ca.SX(1)))
    z = (symbols[:m] - centre[:m]) / scale[:m]
    far = ca.fmax(0, ca.sqrt(ca.fmax(_form(distance, z), 0)) / reach - 1)
    for i in range(n):
        far = ca.fmax(far, ca.fmax(low[i] - symbols[i], symbols[i] - high[i]) / half[i])
    passed = []
    way = ca.SX(0)
    for at, name in enumerate(learned.moves if learned.stays else ()):
        i = learned.channels.index(name)
        inner_reading = ca.fmin(ca.fmax(symbols[i], low[i]), high[i])
        room = PASSED * half[i]
        now = ca.fmin(ca.fmax(trail[at], inner_reading - room), inner_reading + room)
        moved = ca.fmin(ca.fabs(now - trail[at]), rate[i] * (ages[i] + x[0]))
        way = ca.fmax(way, moved / (2 * half[i]))
        passed.append(now)
    remains = ca.fmax(far, remains * ca.exp(-way)) if learned.stays else remains
    faded = ca.SX.sym("faded")  # a weight that slopes do not see change
    weights = ca.vertcat(*(faded if fades else 1 for fades in learned.fading))
    shown = weights * phi
    values = []
    gains = []
    variances = []
    for j in range(nj):
        coefficients, covariance, std = of_joints[3 * j : 3 * j + 3]
        value = ca.dot(coefficients, shown)
        slopes = ca.jacobian(value, symbols).T * ca.vertcat(*follows)
        variance = band[j] ** 2 * (between**2 * _form(covariance, shown) + std**2)
        variance += far**2 * (std**2 + spread[j] ** 2)
        if learned.stays:
            variance += (remains * stays[j]) ** 2
        corrected = symbols[m + j] + value if n > m else value
        past = ca.fmax(0, ca.fmax(homed_low[j] - corrected, corrected - homed_high[j]))
        variance += (extrapolation[j] * past) ** 2
        for i in range(m):
            variance += (slopes[i] * ca.fmin(rate[i] * aged[i], 2 * half[i])) ** 2
        values.append(value)
        gains.append(share * (1 + (slopes[m + j] if n > m else 0)))
        variances.append(variance)
    outputs = [ca.vertcat(*column) for column in (values, gains, variances)]
    states = [*readings, *aged, *after.values(), *late.values(), *passed, remains]
    if learned.apart:
        differences = (ca.dot(row, shown) for row in ca.vertsplit(apart, len(learned.terms)))
        states.append(reduce(ca.fmax, (difference**2 for difference in differences)))
    outputs += [far, ca.vertcat(*states)]
    outputs = ca.substitute(outputs, [share_in, faded], [inner, fade(learned, far)])
    outputs = ca.substitute(outputs, [symbols], [ca.vertcat(*readings, angles)[:n]])
    return ca.Function(
        "map", [memory, x, positions, angles, parameters], ca.cse([ca.densify(y) for y in outputs])
    )


def first_memory(learned: LearnedMap, values: Vector, mask: Vector) -> Vector:
    """Return a map's memory before the first sample: the readings of that sample, or the mean of
    the learned readings for those that are missing.

    The `values` and the `mask` are of the estimator's channels, those of the map first.
    """
    m = len(learned.channels)
    (low, high) = limits(learned)
    held = [ca.if_else(is_read(mask[i]), values[i], learned.centre[i]) for i in range(m)]
    ages = [ca.if_else(is_read(mask[i]), 0.0, UNREAD_AGE) for i in range(m)]
    plays = [
        (ca.fmin(ca.fmax(held[i], float(low[i])), float(high[i])) - learned.centre[i])
        / learned.scale[i]
        for i, _ in (*learned.played, *learned.lagged)
    ]
    moving = [learned.channels.index(name) for name in learned.moves if learned.stays]
    trail = [ca.fmin(ca.fmax(held[i], learned.low[i]), learned.high[i]) for i in moving]
    return ca.vertcat(
        *held,
        *ages,
        *plays,
        *trail,
        *([0.0] if learned.stays else []),
        *([0.0] if learned.apart else []),
    )


def reporting_function(
    inner: ca.Function,
    maps: Sequence[tuple[LearnedMap, Sequence[int], bool]],
    width: int,
    positions: Sequence[int | None],
    joints: int,
    touched: Sequence[int] = (),
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a filter that also reports
    some of its states with learned maps.

    The filter's own states are as without maps. In y, after the filter's own outputs, stand for
    each map the reported values of its states, the gains of these states' own errors, and the
    variances that are added; see `distal.estimators.report`.

    A map of angles was learned in free motion. Where touches have shares of the joints, of which w
    is the largest, the map's difference d from the filter's own angle θ is kept and forgotten: d⁺ =
    (1 − w) (value − θ) + w e^{−dt/T} d. The filter's own error then counts more: gain⁺ = (1 − w)
    gain + w.

    Args:
        inner: the filter's function; the first states are the joints' angles.
        maps: each map with the indices of the states that it reports, and whether its values are
            added to these states or replace them.
        width: number of the filter's channels, those of the maps first.
        positions: for each channel of the maps, the index in the kernel state of its drive's
            position, None for a channel that is read.
        joints: number of joints.
        touched: for each joint that may be touched, the index in the kernel state of the share that
            a touch has of it.
    """
    n_kernel_state = inner.size1_in(0)
    n_parameters = inner.size1_in(2)
    sizes = [memory_size(learned) + carried_size(learned, touched) for learned, *_ in maps]
    counts = [len(map_coefficients_of(learned)) for learned, *_ in maps]
    kernel_state = ca.MX.sym("kernel_state", n_kernel_state + sum(sizes))
    x = ca.MX.sym("x", inner.size1_in(1))
    p = ca.MX.sym("p", n_parameters + sum(counts))
    following, y = inner(kernel_state[:n_kernel_state], x, p[:n_parameters])
    read = ca.vertcat(*(0 if position is None else following[position] for position in positions))
    memories = []
    reports = []
    at = n_kernel_state
    number = n_parameters
    share = reduce(ca.fmax, (following[at] for at in touched), ca.MX(0))
    left = share * ca.exp(-x[0] / CARRIED_TIME)
    for (learned, states, corrects), size, count in zip(maps, sizes, counts):
        function = map_function(
            learned, width, [position is not None and learned.tracked for position in positions]
        )
        memory = kernel_state[at : at + size]
        parameters = p[number : number + count]
        angles = following[list(states)]
        carried = carried_size(learned, touched)
        values, gains, variances, _, after = function(
            memory[: size - carried], x, read, following[list(range(joints))], parameters
        )
        if not corrects:
            values = values - angles
            gains = ca.MX.zeros(len(states))
        if carried:
            values = (1 - share) * values + left * memory[size - carried :]
            gains = (1 - share) * gains + share
            if corrects:  # without the map the filter errs by as much as the map corrects
                variances += share * _spread(learned, parameters) ** 2
            after = ca.vertcat(after, values)
        reports += [angles + values, gains, variances]
        memories.append(after)
        at = at + size
        number = number + count
    names = ["kernel_state", "x", "p"], ["next", "y"]
    return ca.Function(
        "reporting",
        [kernel_state, x, p],
        [ca.vertcat(following, *memories), ca.vertcat(y, *reports)],
        *names,
    )


def _split(column: Vector, sizes: Sequence[int]) -> list[Vector]:
    parts: list[Vector] = ca.vertsplit(column, [int(i) for i in np.cumsum([0, *sizes])])
    return parts


def _form(matrix: Vector, vector: Vector) -> Scalar:
    """Return vᵀ M v of a symmetric matrix M whose rows stand one after the other."""
    n = vector.numel()
    return sum(
        (vector[i] * ca.dot(matrix[i * n : (i + 1) * n], vector) for i in range(n)), start=ca.SX(0)
    )
