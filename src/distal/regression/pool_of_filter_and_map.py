"""A filter that reports some of its states with learned maps, whose weights may be in its memory,
so that an angle that is known now conditions them while it runs, in C too.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, reduce
from typing import NamedTuple

import casadi as ca

from distal.expressions import VectorNode, symbols
from distal.kernels import Layout
from distal.kernels.layout import is_read
from distal.regression.features import (
    JudgedJumps,
    Shape,
    added,
    apart,
    evidence_of_jumps,
    features_function,
    map_function,
    map_inputs,
    map_layout,
)
from distal.rig import LearnedMap


def homed_layout(shape: Shape, joints: int) -> Layout:
    """Return the layout of the memory: that of the map; for each joint the time since its angle was
    known, and 1 once it was; the weights and, behind them, the constant error of known angles.
    """
    n = shape.features.size + 1
    weights = {f"covariance_{j}": (n, n) for j in range(joints)}
    return Layout(map=shape.memory.size, since=joints, told=joints, mean=(n, joints), **weights)


def homed_memory(shape: Shape, joints: int) -> ca.Function:
    """Return the function (memory of the map, its parameters, std of the constant error) → memory
    before the first sample.
    """
    of_map = map_layout(shape, joints)
    inputs = symbols(ca.MX, begun=shape.memory.size, parameters=of_map.size, std=1)
    begun, parameters, std = inputs
    of = of_map.parts(parameters)
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
    return ca.Function("homed", inputs, [memory])


@cache
def homed_function(shape: Shape, joints: int, beside_filter: bool) -> ca.Function:
    """Return the function (memory, dt, readings, mask, parameters, doubts, elsewhere, chance,
    targets, given, beside) → (values, gains, variances, memory⁺): that of `map_function` with the
    weights of the memory, which known targets condition first.

    With φ of this sample, one feature more that is 1 for the constant error o of what is known, the
    innovation ν = target − φᵀ m − o and S = (φ, 1)ᵀ C (φ, 1) + R: m⁺ = m + C (φ, 1) ν/S and C⁺ = C
    − C (φ, 1) (φ, 1)ᵀ C/S. R is as over a log: σ² (1 + τ/Δt), for errors that last for a time τ
    and a time Δt since the last known angle, and the variances `beside` the weights. At the first
    known angle the constant's variance is larger by ν² − S if that is positive, see
    `Weights.given`.

    Args:
        shape: of the map's features.
        beside_filter: whether it corrects a filter's angles, see `map_function`.
        joints: number of joints. For each, `targets` is what the map should have given, `given` 1
            where that is known, and `beside` the variance of the filter's own angle.
    """
    layout = homed_layout(shape, joints)
    _, dt, readings, mask, parameters, *jumps = map_inputs(shape, joints)
    sample = [dt, readings, mask]
    (memory,) = symbols(ca.MX, memory=layout.size)
    angles = symbols(ca.MX, targets=joints, given=joints, beside=joints)
    targets, is_given, beside = angles
    was = layout.parts(memory)
    of = map_layout(shape, joints).parts(parameters)
    outputs, _ = features_function(shape)(was["map"], *sample, of["frame"])
    out = shape.outputs.parts(outputs)
    phi = ca.vertcat(out["features"], 1)
    slips = shape.features["slips"]
    n = shape.features.size
    since = was["since"] + dt
    tells = is_given * (since > 0)
    first = tells * (1 - was["told"])
    is_constant = ca.MX(ca.DM.eye(n + 1)[:, 0].full())
    means = list[VectorNode]()
    covariances = dict[str, VectorNode]()
    for j in range(joints):
        mean = was["mean"][:, j]
        covariance = was[f"covariance_{j}"]
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
    values, gains, variances, after = map_function(shape, joints, beside_filter)(
        was["map"], *sample, with_weights, *jumps
    )
    following = layout.joined(
        map=after,
        since=since * (1 - is_given),
        told=ca.fmax(was["told"], tells),
        mean=mean,
        **covariances,
    )
    inputs = [memory, *sample, parameters, *jumps, *angles]
    return ca.Function("homed_map", inputs, [values, gains, variances, following])


SHORTEST_INTERVAL = 1e-9
"""Least interval for the number of independent samples [s]. Source: rounding (the first sample has
none, and tells nothing).
"""


@dataclass(frozen=True)
class ReportedMap:
    """A map beside a filter.

    Args:
        learned: the map.
        channels: indices of the filter's channels that it reads.
        states: indices of the filter's states that it speaks of; maps of the same ones are pooled.
        homes: for each of its joints the index of the channel that says where it is known to stand;
            none where no channel does.
    """

    learned: LearnedMap
    channels: tuple[int, ...]
    states: tuple[int, ...]
    homes: tuple[int, ...] = ()

    @property
    def shape(self) -> Shape:
        """The sizes of its features."""
        return Shape.of(self.learned)

    @property
    def joints(self) -> int:
        """Number of its joints."""
        return len(self.learned.joints)

    @property
    def size(self) -> int:
        """Length of its memory, in which are its weights where angles may be known."""
        layout = homed_layout(self.shape, self.joints) if self.homes else self.shape.memory
        return layout.size

    @property
    def parameters(self) -> int:
        """Number of its parameters."""
        return map_layout(self.shape, self.joints).size


def reporting_function(
    inner: ca.Function,
    maps: Sequence[ReportedMap],
    positions: Sequence[int | None],
    variances: Sequence[int],
    touched: Sequence[int],
    tracked: ca.Function,
    judges: Sequence[JudgedJumps],
    evidence: Sequence[int],
) -> ca.Function:
    """Return the function (kernel_state, x, p) → (kernel_state⁺, y) of a filter that also reports
    some of its states with learned maps.

    The filter's own states are as without this. In y, after the filter's own outputs, stand for
    each map the reported values of its states, the gains of these states' own errors, and the
    variances that are added; see `distal.estimators.estimator_protocol`. Channels that say where a
    joint is known to stand condition the map; the filter does not read them.

    A map beside the filter was learned in free motion. Where touches have shares of the joints, of
    which s is the largest, the filter's own error and what the map adds, a, count as unknown:
    gain⁺ = (1 − s) gain + s, variance⁺ = variance + s a². Its share of a pool goes towards one
    half, since the variances are of free motion too.

    Args:
        inner: the filter's function; the first states are the joints' own.
        maps: what is reported.
        positions: for each channel the index in the kernel state of its drive's position, None for
            a channel that is read.
        variances: indices in the kernel state of the variances of the joints' angles.
        touched: for each joint that may be touched, the index in the kernel state of the share that
            a touch has of it.
        tracked: function (kernel_state, p) → positions of drives as their sensors should read them,
            if their last jumps were none, and if they were real; the chance of that, the variances
            beside it; whether each channel is believed; variances of joints by jumps.
        judges: what forces say of jumps.
        evidence: for each position the index in the kernel state of the evidence of its jump.
    """
    sizes = [placed.size for placed in maps]
    counts = [placed.parameters for placed in maps]
    sizes = [inner.size1_in(0), *sizes, sum(judge.memory.size for judge in judges)]
    counts = [inner.size1_in(2), *counts, sum(judge.parameters for judge in judges)]
    inputs = symbols(ca.MX, kernel_state=sum(sizes), x=inner.size1_in(1), p=sum(counts))
    kernel_state, x, p = inputs
    state, *memories_before, of_judges = apart(kernel_state, sizes)
    parameters, *parameters_of, parameters_of_judges = apart(p, counts)
    width = (x.numel() - 1) // 2
    read = ca.MX(x)
    for home in {home for placed in maps for home in placed.homes}:
        read[1 + width + home] = 0
    following, y = inner(state, read, parameters)
    memories = []
    answers = dict[tuple[int, ...], list[tuple[VectorNode, ...]]]()
    doubts = ca.MX.zeros(width)
    readings = x[1 : 1 + width]
    elsewhere = x[1 : 1 + width]
    masks = x[1 + width :]
    tracks, second, chance, variances_of_tracks, believed, of_joints = tracked(
        following, parameters
    )
    readings[: tracks.numel()] = tracks
    elsewhere[: tracks.numel()] = second
    doubts[: tracks.numel()] = variances_of_tracks
    masks *= believed
    # what the logs taught of the filter's errors holds neither in a touch nor after a jump
    opened = reduce(ca.fmax, (following[at] for at in touched), 4 * chance * (1 - chance))
    sample = _Sample(x, readings, elsewhere, masks, doubts, chance, opened, following, of_joints)
    for placed, before, own in zip(maps, memories_before, parameters_of):
        answer, after = _answer(placed, sample, before, own, positions, variances)
        answers.setdefault(placed.states, []).append(answer)
        memories.append(after)
    ratios, after = evidence_of_jumps(
        judges, of_judges, x[0], readings, elsewhere, masks, parameters_of_judges
    )
    memories.append(after)
    following = ca.MX(following)
    for k, index in enumerate(evidence):
        following[index] = added(following[index], ratios[k])
    reports = [part for of_states in answers.values() for part in _pooled(opened, *of_states)]
    outputs = [ca.vertcat(following, *memories), ca.vertcat(y, *reports)]
    return ca.Function("reporting", inputs, outputs)


class _Sample(NamedTuple):
    """A sample for maps.

    Args:
        x: the row of the kernel.
        readings: of the channels, if the last jumps were none of the drives.
        elsewhere: the same if they were real.
        masks: of those that are believed.
        doubts: variances of readings beside that.
        chance: that the jumps were real.
        opened: the largest share of a touch or a jump, with which maps beside the filter are open.
        following: the filter's kernel state after the sample.
        of_joints: variances of joints by jumps.
    """

    x: VectorNode
    readings: VectorNode
    elsewhere: VectorNode
    masks: VectorNode
    doubts: VectorNode
    chance: VectorNode
    opened: VectorNode
    following: VectorNode
    of_joints: VectorNode


def _answer(
    placed: ReportedMap,
    sample: _Sample,
    memory: VectorNode,
    parameters: VectorNode,
    positions: Sequence[int | None],
    variances: Sequence[int],
) -> tuple[tuple[VectorNode, ...], VectorNode]:
    """Return what a map says of a sample, (values, gains, added variances, variances), and its
    memory⁺; see `reporting_function`.
    """
    x = sample.x
    following = sample.following
    width = (x.numel() - 1) // 2
    channels, states, homes = map(list, (placed.channels, placed.states, placed.homes))
    beside_filter = placed.learned.beside_filter
    read: list[VectorNode] = []
    for i in channels:
        tracked = positions[i] if beside_filter else None
        read.append(sample.readings[i] if tracked is None else following[tracked])
    angles = following[states]
    of_filter = following[[variances[i] for i in states]]
    if placed.shape.angles:
        read.append(angles)
    arguments = [
        memory,
        x[0],
        ca.vertcat(*read),
        (x[1 + width :] if beside_filter else sample.masks)[channels],
        parameters,
        sample.doubts[channels],
        sample.elsewhere[channels],
        sample.chance,
    ]
    function = map_function
    if homes:
        function = homed_function
        given = x[[1 + i for i in homes]]
        is_given = is_read(x[[1 + width + i for i in homes]])
        if beside_filter:
            arguments += [given - angles, is_given, of_filter]
        else:
            arguments += [given, is_given, ca.MX.zeros(len(homes))]
    values, gains, spreads, after = function(placed.shape, placed.joints, beside_filter)(*arguments)
    if beside_filter:
        # while touched, nobody knows whether the map still holds
        spreads = spreads + sample.opened * values**2 + sample.of_joints[states]
        gains = (1 - sample.opened) * gains + sample.opened
        values = angles + values
    else:
        gains = ca.MX.zeros(len(states))
    return (values, gains, spreads, gains**2 * of_filter + spreads), after


def _pooled(
    opened: VectorNode,
    beside: Sequence[VectorNode],
    alone: Sequence[VectorNode] | None = None,
) -> tuple[VectorNode, ...]:
    """Return the value, gain and variance of some states by a map beside the filter and one on
    readings alone: the mean and the variance of the linear pool of both, with shares by the inverse
    of their variances (Bates and Granger, Operational Research Quarterly 20, 1969).

    With the difference d of their values, the value is w a + (1 − w) b and the variance w v_a +
    (1 − w) v_b + w (1 − w) d² (Stone, The opinion pool, Annals of Mathematical Statistics 32,
    1961).

    Args:
        opened: the largest share that a touch has of a joint; then both count the same.
        beside: value, gain, added and whole variance.
        alone: the same of the map on readings alone; None where there is none.
    """
    value, gain, spread, variance = beside
    if alone is None:
        return value, gain, spread
    second, _, second_spread, other_variance = alone
    share = (1 - opened) * other_variance / (variance + other_variance) + opened / 2
    other = 1 - share
    return (
        share * value + other * second,
        ca.sqrt(share) * gain,
        share * spread + other * second_spread + share * other * (value - second) ** 2,
    )
