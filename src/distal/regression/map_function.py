"""A learned map as a CasADi function of one sample, with a memory between samples."""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Expression, ScalarNode, VectorNode
from distal.kernels import Layout
from distal.regression.features import Shape, features_function, first_function
from distal.rig import HALF_WIDTHS, IN_RADIAL, TIME_CONSTANTS, LearnedMap


@lru_cache(maxsize=32)
def map_layout(shape: Shape, joints: int) -> Layout:
    """Return the layout of a map's numbers: its share of the answer, features, then weights."""
    n = shape.features.size
    weights = {f"covariance_{j}": (n, n) for j in range(joints)}
    return Layout(
        share=joints,
        frame=shape.frame.size,
        rate=shape.count,
        mean=(n, joints),
        radial=joints,
        noise=joints,
        filter=joints,
        error_time=joints,
        correlation=(joints, joints),
        **weights,
    )


def map_parameters(learned: LearnedMap) -> Floats:
    """Return the parameters of the function of a map, (n_p,), see `map_function`."""
    arrays = learned.arrays
    shape = Shape.of(learned)
    names = ("rate", "mean", "radial", "noise", "filter", "error_time", "correlation", "covariance")
    share = learned.share or np.zeros(len(learned.joints))
    parts = (arrays[name].ravel() for name in names)
    return np.concatenate([share, shape.flat(arrays.by_name), *parts])


def begun_by(learned: LearnedMap, readings: Expression, mask: Expression) -> Expression:
    """Return the memory of a map before the first sample, by its `readings` and their `mask`."""
    centre, scale = (learned.arrays[name] for name in ("centre", "scale"))
    memory: Expression = first_function(Shape.of(learned))(readings, mask, centre, scale)
    return memory


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
        spread = ca.dot(phi, ca.mtimes(of[f"covariance_{j}"], phi))
        beside = variance_beside(shape, mean, out, frame, unknown)
        variances.append(
            ca.fmax(spread, 0) + of["noise"][j] + of["radial"][j] * out["far"] + beside
        )
    values = ca.mtimes(of["mean"].T, phi)
    results = [values, of["filter"], ca.vertcat(*variances), after]
    return ca.Function("map", [memory, dt, readings, mask, parameters], results)


def variance_beside(
    shape: Shape,
    mean: VectorNode,
    out: dict[str, VectorNode],
    frame: dict[str, VectorNode],
    unknown: ScalarNode,
) -> ScalarNode:
    """Return the variance of a value that comes of slips whose interval is wide, and of readings
    that are missing: (Σ_i |∂y/∂slip_i| d_i)²/3 + Σ_i (∂y/∂z_i)² v_i, see `map_function`.

    Args:
        shape: of the features.
        mean: weights of the value, (n,).
        out: parts of `Shape.outputs`.
        frame: parts of `Shape.frame`.
        unknown: variances v of the scaled readings, (n_channels,).
    """
    slopes, turns = _slopes(shape, mean, out, frame)
    of_readings = ca.dot(slopes[: shape.channels] ** 2, unknown)
    return ca.dot(turns, out["doubt"]) ** 2 / 3 + of_readings


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
