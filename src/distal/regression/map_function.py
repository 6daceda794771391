"""A learned map as a CasADi function of one sample, with a memory between samples; and the function
of a filter whose report maps correct.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache, reduce

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import VectorNode
from distal.kernels import Layout
from distal.regression.features import Shape, features_function
from distal.rig import HALF_WIDTHS, IN_RADIAL, TIME_CONSTANTS, LearnedMap

CARRIED_TIME = 0.3
"""Time constant with which a map's correction is forgotten while something touches a joint [s]: the
map was learned in free motion, and does not hold there. Source: benchmark (docs/results/touch.md).
"""


def memory_size(learned: LearnedMap) -> int:
    """Return the length of a map's memory, see `Shape.memory`."""
    return Shape.of(learned).memory.size


@lru_cache(maxsize=32)
def map_layout(shape: Shape, joints: int) -> Layout:
    """Return the layout of a map's numbers: those of its features, then its weights."""
    n = shape.features.size
    weights = {f"covariance_{j}": (n, n) for j in range(joints)}
    return Layout(
        frame=shape.frame.size,
        rate=shape.count,
        mean=(n, joints),
        radial=joints,
        noise=joints,
        filter=joints,
        **weights,
    )


def map_parameters(learned: LearnedMap) -> Floats:
    """Return the parameters of the function of a map, (n_p,), see `map_function`."""
    arrays = learned.arrays
    shape = Shape.of(learned)
    frame = [arrays[name].ravel(order="F") for name in shape.frame.names]
    names = ("rate", "mean", "radial", "noise", "filter", "covariance")
    return np.concatenate([*frame, *(arrays[name].ravel() for name in names)])


@lru_cache(maxsize=32)
def map_function(shape: Shape, joints: int) -> ca.Function:
    """Return the function of a map: (memory, dt, readings, mask, parameters) → (values, gains,
    variances, memory⁺).

    A value is φᵀ m. Its variance is φᵀ C φ + σ² + s_r² (what no radial function explains) + (Σ_i
    |∂y/∂slip_i| d_i)²/3, d_i being the half-width of the interval in which a slip lies, + Σ_i
    (∂y/∂z_i)² v_i for readings that have been missing for a time a: v = 2 (1 − exp(−(rate a)²/2)),
    from a steady motion to the difference of two readings that have nothing to do with each other.
    An error e of the filter's own angle stays with the share `filter`, its gain.
    """
    memory = ca.MX.sym("memory", shape.memory.size)
    dt = ca.MX.sym("dt")
    readings = ca.MX.sym("readings", shape.count)
    mask = ca.MX.sym("mask", shape.channels)
    layout = map_layout(shape, joints)
    parameters = ca.MX.sym("parameters", layout.size)
    of = layout.parts(parameters)
    outputs, after = features_function(shape)(memory, dt, readings, mask, of["frame"])
    out = shape.outputs.parts(outputs)
    phi = out["features"]
    frame = shape.frame.parts(of["frame"])
    age = shape.memory.part(after, "age")
    unknown = 2 * (1 - ca.exp(-((of["rate"][: shape.channels] * age) ** 2) / 2))
    variances = []
    for j in range(joints):
        mean = of["mean"][:, j]
        slopes, turns = _slopes(shape, mean, out, frame)
        spread = ca.dot(phi, ca.mtimes(of[f"covariance_{j}"], phi))
        variance = ca.fmax(spread, 0) + of["noise"][j] + of["radial"][j] * out["far"]
        variance += ca.dot(turns, out["doubt"]) ** 2 / 3
        variance += ca.dot(slopes[: shape.channels] ** 2, unknown)
        variances.append(variance)
    values = ca.mtimes(of["mean"].T, phi)
    results = [values, of["filter"], ca.vertcat(*variances), after]
    return ca.Function("map", [memory, dt, readings, mask, parameters], results)


def _slopes(
    shape: Shape, mean: VectorNode, out: dict[str, VectorNode], frame: dict[str, VectorNode]
) -> tuple[VectorNode, VectorNode]:
    """Return ∂y/∂z of each scaled reading, and |∂y/∂slip| of each play."""
    parts = shape.features.parts(mean)
    n = shape.count
    slopes = parts["readings"]
    for k in range(len(TIME_CONSTANTS)):
        slopes = slopes + parts["lags"][k * n : (k + 1) * n]
    turns = ca.fabs(parts["slips"])
    if not shape.radial:
        return slopes, turns
    pull = ca.mtimes(frame["root"].T, parts["radial"]) * out["kernel"] * out["amplitude"]
    towards = ca.mtimes(frame["points"].T, pull) - out["inputs"] * ca.sum1(pull)
    towards = towards / frame["lengths"]
    slopes = slopes + towards[:n]
    if shape.moving:
        into = ca.DM(n * len(HALF_WIDTHS), len(shape.moving))
        for k, i in enumerate(shape.moving):
            into[IN_RADIAL * n + i, k] = 1
        turns = turns + ca.mtimes(ca.densify(into), ca.fabs(towards[n:]))
    return slopes, turns


def carried_size(learned: LearnedMap, touched: Sequence[int]) -> int:
    """Return how many values of a map are remembered beside its memory while something touches a
    joint: one for each joint, none for a map of the torque.
    """
    return len(learned.joints) if touched and learned.beside_filter else 0


def reporting_function(
    inner: ca.Function,
    maps: Sequence[tuple[LearnedMap, Sequence[int], Sequence[int]]],
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

    A map of own was learned in free motion. Where touches have shares of the joints, of which w
    is the largest, the map's difference d from the filter's own angle θ is kept and forgotten: d⁺ =
    (1 − w) (value − θ) + w e^{−dt/T} d. The filter's own error then counts more: gain⁺ = (1 − w)
    gain + w.

    Args:
        inner: the filter's function; the first states are the joints' own.
        maps: each map with the indices of the channels that it reads and of the states that it
            reports, and whether these are own.
        width: number of the filter's channels.
        positions: for each channel the index in the kernel state of its drive's position, None for
            a channel that is read.
        joints: number of joints.
        touched: for each joint that may be touched, the index in the kernel state of the share that
            a touch has of it.
    """
    n_kernel_state = inner.size1_in(0)
    n_parameters = inner.size1_in(2)
    shapes = [Shape.of(learned) for learned, *_ in maps]
    carried = [carried_size(learned, touched) for learned, *_ in maps]
    sizes = [shape.memory.size + more for shape, more in zip(shapes, carried)]
    counts = [
        map_layout(shape, len(learned.joints)).size for shape, (learned, *_) in zip(shapes, maps)
    ]
    kernel_state = ca.MX.sym("kernel_state", n_kernel_state + sum(sizes))
    x = ca.MX.sym("x", inner.size1_in(1))
    p = ca.MX.sym("p", n_parameters + sum(counts))
    following, y = inner(kernel_state[:n_kernel_state], x, p[:n_parameters])
    memories = []
    reports = []
    at = n_kernel_state
    number = n_parameters
    share = reduce(ca.fmax, (following[at] for at in touched), ca.MX(0))
    left = share * ca.exp(-x[0] / CARRIED_TIME)
    for (learned, channels, states), shape, more, count in zip(maps, shapes, carried, counts):
        readings = [
            x[1 + i]
            if positions[i] is None or not learned.beside_filter
            else following[positions[i]]
            for i in channels
        ]
        angles = following[list(states)]
        if shape.angles:
            readings.append(angles)
        mask = x[[1 + width + i for i in channels]]
        size = shape.memory.size
        parameters = p[number : number + count]
        values, gains, variances, after = map_function(shape, len(learned.joints))(
            kernel_state[at : at + size], x[0], ca.vertcat(*readings), mask, parameters
        )
        if not learned.beside_filter:
            values = values - angles
            gains = ca.MX.zeros(len(states))
        if more:
            # while touched, nobody knows whether the correction still holds
            variances = variances + share * values**2
            values = (1 - share) * values + left * kernel_state[at + size : at + size + more]
            gains = (1 - share) * gains + share
            after = ca.vertcat(after, values)
        reports += [angles + values, gains, variances]
        memories.append(after)
        at += size + more
        number += count
    names = ["kernel_state", "x", "p"], ["next", "y"]
    return ca.Function(
        "reporting",
        [kernel_state, x, p],
        [ca.vertcat(following, *memories), ca.vertcat(y, *reports)],
        *names,
    )
