"""A learned map whose weights are in its memory, so that an angle that is known now conditions them
while it runs, in C too.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca

from distal.kernels import Layout
from distal.regression.features import Shape, features_function
from distal.regression.map_function import map_function, map_layout


@lru_cache(maxsize=32)
def homed_layout(shape: Shape, joints: int) -> Layout:
    """Return the layout of the memory: that of the map; for each joint the time since its angle was
    known, and 1 once it was; the weights and, behind them, the constant error of known angles.
    """
    n = shape.features.size + 1
    weights = {f"covariance_{j}": (n, n) for j in range(joints)}
    return Layout(map=shape.memory.size, since=joints, told=joints, mean=(n, joints), **weights)


@lru_cache(maxsize=32)
def homed_memory(shape: Shape, joints: int) -> ca.Function:
    """Return the function (memory of the map, its parameters, std of the constant error) → memory
    before the first sample.
    """
    begun = ca.MX.sym("begun", shape.memory.size)
    parameters = ca.MX.sym("parameters", map_layout(shape, joints).size)
    std = ca.MX.sym("std")
    of = map_layout(shape, joints).parts(parameters)
    n = shape.features.size
    below = ca.MX.zeros(1, n)
    covariances = {
        name: ca.vertcat(ca.horzcat(of[name], below.T), ca.horzcat(below, std**2))
        for name in (f"covariance_{j}" for j in range(joints))
    }
    mean = ca.vertcat(of["mean"], ca.MX.zeros(1, joints))
    memory = homed_layout(shape, joints).joined(
        map=begun, since=ca.MX.zeros(joints), told=ca.MX.zeros(joints), mean=mean, **covariances
    )
    return ca.Function("homed", [begun, parameters, std], [memory])


@lru_cache(maxsize=32)
def homed_function(shape: Shape, joints: int) -> ca.Function:
    """Return the function (memory, dt, readings, mask, parameters, targets, given, beside) →
    (values, gains, variances, memory⁺): that of `map_function` with the weights of the memory,
    which known targets condition first.

    With φ of this sample, one feature more that is 1 for the constant error o of what is known, the
    innovation ν = target − φᵀ m − o and S = (φ, 1)ᵀ C (φ, 1) + R: m⁺ = m + C (φ, 1) ν/S and C⁺ = C
    − C (φ, 1) (φ, 1)ᵀ C/S. R is as over a log: σ² (1 + τ/Δt), for errors that last for a time τ
    and a time Δt since the last known angle, and the variances `beside` the weights. At the first
    known angle the constant's variance is larger by ν² − S if that is positive, see
    `Weights.given`.

    Args:
        shape: of the map's features.
        joints: number of joints. For each, `targets` is what the map should have given, `given` 1
            where that is known, and `beside` the variance of the filter's own angle.
    """
    layout = homed_layout(shape, joints)
    memory = ca.MX.sym("memory", layout.size)
    dt = ca.MX.sym("dt")
    readings = ca.MX.sym("readings", shape.count)
    mask = ca.MX.sym("mask", shape.channels)
    parameters = ca.MX.sym("parameters", map_layout(shape, joints).size)
    targets, is_given, beside = (ca.MX.sym(name, joints) for name in ("targets", "given", "beside"))
    was = layout.parts(memory)
    of = map_layout(shape, joints).parts(parameters)
    outputs, _ = features_function(shape)(was["map"], dt, readings, mask, of["frame"])
    out = shape.outputs.parts(outputs)
    phi = ca.vertcat(out["features"], 1)
    slips = shape.features["slips"]
    n = shape.features.size
    since = was["since"] + dt
    tells = is_given * (since > 0)
    first = tells * (1 - was["told"])
    is_constant = ca.MX(ca.DM.eye(n + 1)[:, 0].full())
    means, covariances = [], {}
    for j in range(joints):
        mean, covariance = was["mean"][:, j], was[f"covariance_{j}"]
        cross = ca.mtimes(covariance, phi)
        variance = of["noise"][j] * (1 + of["error_time"][j] / ca.fmax(since[j], SHORTEST_INTERVAL))
        variance += of["radial"][j] * out["far"] + of["filter"][j] ** 2 * beside[j]
        variance += ca.dot(ca.fabs(mean[slips]), out["doubt"]) ** 2 / 3
        innovation = targets[j] - ca.dot(phi, mean)
        spread = ca.dot(phi, cross) + variance
        zero = first[j] * ca.fmax(innovation**2 - spread, 0)
        cross = cross + zero * is_constant
        gain = is_given[j] * cross / (spread + zero)
        means.append(mean + gain * innovation)
        widened = covariance + zero * ca.mtimes(is_constant, is_constant.T)
        covariances[f"covariance_{j}"] = widened - ca.mtimes(gain, cross.T)
    mean = ca.horzcat(*means)
    weights = {name: covariance[:n, :n] for name, covariance in covariances.items()}
    with_weights = map_layout(shape, joints).joined(**{**of, "mean": mean[:n, :], **weights})
    values, gains, variances, after = map_function(shape, joints)(
        was["map"], dt, readings, mask, with_weights
    )
    following = layout.joined(
        map=after,
        since=since * (1 - is_given),
        told=ca.fmax(was["told"], tells),
        mean=mean,
        **covariances,
    )
    return ca.Function(
        "homed_map",
        [memory, dt, readings, mask, parameters, targets, is_given, beside],
        [values, gains, variances, following],
    )


SHORTEST_INTERVAL = 1e-9
"""Least interval for the number of independent samples [s]. Source: rounding (the first sample has
none, and tells nothing).
"""
