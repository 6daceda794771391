"""What a learned map sees (readings, and what they remember), and the map itself, each as one
CasADi function of a sample with a memory between samples.

It is the same function live, in C, in vector lanes, and over logs when weights are learned.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache, cached_property, reduce
from itertools import accumulate, pairwise

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.expressions import Expression, ScalarNode, Vector, VectorNode, symbols
from distal.kernels import Feed, Kernel, Layout, advance
from distal.kernels.layout import is_read, is_there, rows_left
from distal.rig import HALF_WIDTHS, IN_RADIAL, TIME_CONSTANTS, LearnedMap

WILD = 4.8916
"""Distance of a force from its mean in the logs, in stds, from which on the map knows nothing of
it. Source: definition (probability 1e-6 of a normal value).
"""

NEVER_READ = 1e6
"""Age of a reading before its first value [s]. Source: definition (older than any reading)."""

SCALES = ("centre", "scale", "play")
"""Names of the numbers of a frame by which readings are scaled."""


@dataclass(frozen=True)
class Shape:
    """The sizes of a map's features.

    Args:
        channels: number of sensors.
        angles: number of the filter's angles, which are readings too.
        moving: indices of the readings whose slips enter the radial functions.
        radial: number of radial functions.
    """

    channels: int
    angles: int
    moving: tuple[int, ...]
    radial: int

    @classmethod
    def of(cls, learned: LearnedMap) -> Shape:
        """Return the shape of a map."""
        channels = len(learned.channels)
        return cls(channels, learned.count - channels, learned.moving, len(learned.arrays["root"]))

    @property
    def count(self) -> int:
        """Number of readings."""
        return self.channels + self.angles

    @property
    def efforts(self) -> tuple[int, ...]:
        """Indices of the sensors that read no position."""
        return tuple(i for i in range(self.channels) if i not in self.moving)

    @cached_property
    def memory(self) -> Layout:
        """What is remembered between samples: each last reading, and its age for a sensor; of each
        play of each reading the lowest and highest place where it may be; of each lag its state.
        """
        plays = self.count * len(HALF_WIDTHS)
        return Layout(
            last=self.count,
            age=self.channels,
            low=plays,
            high=plays,
            lags=self.count * len(TIME_CONSTANTS),
        )

    @cached_property
    def frame(self) -> Layout:
        """The numbers of the features."""
        inputs = self.count + len(self.moving)
        return Layout(
            centre=self.count,
            scale=self.count,
            play=1,
            lengths=inputs,
            points=(self.radial, inputs),
            root=(self.radial, self.radial),
        )

    def flat(self, arrays: Mapping[str, Floats]) -> Floats:
        """Return the numbers of the features, by name, as one vector; see `frame`."""
        return np.concatenate([arrays[name].ravel(order="F") for name in self.frame.names])

    @cached_property
    def features(self) -> Layout:
        """The features φ. Each play and each lag has one for every reading."""
        return Layout(
            constant=1,
            readings=self.count,
            slips=self.count * len(HALF_WIDTHS),
            lags=self.count * len(TIME_CONSTANTS),
            radial=self.radial,
        )

    @cached_property
    def outputs(self) -> Layout:
        """What `features_function` gives beside the memory.

        `doubt` is half of the width of the interval in which each slip lies, `far` the share of the
        radial part's variance that no radial function explains, `inputs` those of the radial
        functions over their lengths, `kernel` their values, `amplitude` their common factor.
        """
        return Layout(
            features=self.features.size,
            doubt=self.count * len(HALF_WIDTHS),
            far=1,
            inputs=self.count + len(self.moving),
            kernel=self.radial,
            amplitude=1,
        )


@cache
def features_function(shape: Shape) -> ca.Function:
    """Return the function (memory, dt, readings, mask, frame) → (outputs, memory⁺).

    z is a reading less its centre, over its scale; a missing one keeps its last value, and a force
    far beyond those of the logs is as one that is missing. A play of half-width w, a factor on one
    of `HALF_WIDTHS`, follows z so that |z − p| ≤ w; since nobody knows where it began, an interval
    is remembered: p ∈ [low, high], low⁺ = min(max(low, z − w), z + w). The slip is (z − p)/w at the
    middle of that interval, from −1 to 1. A lag follows z with its time constant T: s⁺ = s + (1 −
    e^{−dt/T}) (z − s), and its feature is z − s. The radial functions are those of a sparse
    Gaussian process (Nyström; Quiñonero-Candela and Rasmussen, JMLR 6, 2005): φ_r = a L⁻¹ k, k_i =
    exp(−½ |ρ − p_i|²) with inputs ρ over their lengths and the points p_i, and K = L Lᵀ. The factor
    a = √(1 + |ρ_z|²) lets the prior's variance grow beyond the logs, as that of a line does.

    Args:
        shape: of the features; `readings` are the sensors' and then the filter's angles.
    """
    sample = _sample(ca.MX, shape)
    (frame,) = symbols(ca.MX, frame=shape.frame.size)
    parts = shape.frame.parts(frame)
    scales = (parts[name] for name in SCALES)
    z, slips, doubt, lags, after = _remembered(shape)(*sample, *scales)
    inputs = z
    if shape.moving:
        begin = IN_RADIAL * shape.count
        inputs = ca.vertcat(z, slips[[begin + i for i in shape.moving]])
    inputs = inputs / parts["lengths"]
    amplitude: ScalarNode = ca.sqrt(1 + ca.sumsqr(inputs[: shape.count]))
    radial, kernel, far = ca.MX(0, 1), ca.MX(0, 1), ca.MX(1)
    if shape.radial:
        points = parts["points"]
        squares = ca.sum2(points**2) - 2 * ca.mtimes(points, inputs) + ca.sumsqr(inputs)
        kernel = ca.exp(-ca.fmax(squares, 0) / 2)
        explained: VectorNode = ca.mtimes(parts["root"], kernel)
        far = ca.fmax(1 - ca.sumsqr(explained), 0)
        radial = amplitude * explained
    outputs = shape.outputs.joined(
        features=ca.vertcat(1, z, slips, lags, radial),
        doubt=doubt,
        far=amplitude**2 * far,
        inputs=inputs,
        kernel=kernel,
        amplitude=amplitude,
    )
    return ca.Function("features", [*sample, frame], [outputs, after])


def _sample(kind: type[Expression], shape: Shape) -> list[Expression]:
    """Return the symbols memory, dt, readings and mask of a sample."""
    return symbols(kind, memory=shape.memory.size, dt=1, readings=shape.count, mask=shape.channels)


def _remembered(shape: Shape) -> ca.Function:
    """Return the function (memory, dt, readings, mask, centre, scale, play) → (z, slips, doubt,
    lags, memory⁺).
    """
    sample = _sample(ca.SX, shape)
    memory, dt, readings, mask = sample
    frame = symbols(ca.SX, centre=shape.count, scale=shape.count, play=1)
    centre, scale, play = frame
    was = shape.memory.parts(memory)
    n = shape.channels
    # over a gap a position goes in a straight line to the reading that ends it
    there = ca.vertcat(is_there(mask), ca.SX.ones(shape.angles))
    steps = [rows_left(mask[i]) for i in range(n)] + [1] * shape.angles
    before = (was["last"] - centre) / scale
    if shape.efforts:
        is_wild = ca.fabs((readings - centre) / scale)[list(shape.efforts)] > WILD
        there[list(shape.efforts)] *= 1 - is_wild
    z: Vector = before + ca.if_else(there, (readings - centre) / scale - before, 0) / ca.vertcat(
        *steps
    )
    age = ca.if_else(there[:n], 0, was["age"] + dt)
    # before the first sample, whose dt is 0, the filter has only its prior
    first = ca.vertcat(ca.SX.zeros(n, 1), ca.repmat(dt <= 0, shape.angles, 1))

    def each(values: Vector) -> Vector:
        """Return each of some values once for every reading."""
        return ca.vec(ca.repmat(values.T, shape.count, 1))

    half = play * ca.DM(HALF_WIDTHS)
    way = each(half)
    repeated = ca.repmat(z, len(HALF_WIDTHS), 1)
    low, high = (
        ca.if_else(
            ca.repmat(first, len(HALF_WIDTHS), 1),
            repeated + side,
            ca.fmin(ca.fmax(was[name], repeated - way), repeated + way),
        )
        for name, side in (("low", -way), ("high", way))
    )
    slips = (repeated - (low + high) / 2) / way
    doubts = (high - low) / each(2 * half)
    share = each(1 - ca.exp(-dt / ca.DM(TIME_CONSTANTS)))
    repeated = ca.repmat(z, len(TIME_CONSTANTS), 1)
    lags = ca.if_else(
        ca.repmat(first, len(TIME_CONSTANTS), 1),
        repeated,
        was["lags"] + share * (repeated - was["lags"]),
    )
    after = shape.memory.joined(last=centre + scale * z, age=age, low=low, high=high, lags=lags)
    outputs = [z, slips, doubts, repeated - lags, after]
    return ca.Function("remembered", [*sample, *frame], outputs)


@cache
def first_function(shape: Shape) -> ca.Function:
    """Return the function (readings, mask, centre, scale, play) → a map's memory before the first
    sample: the readings of that sample, their centre for those that are missing. A play may be
    anywhere around its reading; lags are at rest.

    The readings are (count,), as are their centre and scale; the mask is of the sensors,
    (channels,).
    """
    n = shape.count
    inputs = symbols(ca.SX, readings=n, mask=shape.channels, centre=n, scale=n, play=1)
    readings, mask, centre, scale, play = inputs
    is_there_or_angle = ca.vertcat(is_read(mask), ca.SX.ones(shape.angles))
    begun = ca.if_else(is_there_or_angle, readings, centre)
    z = (begun - centre) / scale
    memory = shape.memory.joined(
        last=begun,
        age=ca.if_else(is_read(mask), 0, NEVER_READ),
        low=ca.vertcat(*(z - play * half for half in HALF_WIDTHS)),
        high=ca.vertcat(*(z + play * half for half in HALF_WIDTHS)),
        lags=ca.repmat(z, len(TIME_CONSTANTS), 1),
    )
    return ca.Function("first", inputs, [memory])


@cache
def features_kernel(shape: Shape) -> Kernel:
    """Return the kernel (memory, (dt, readings, mask), frame) → (memory⁺, outputs) of a map's
    features over a log.
    """
    row = 1 + shape.count + shape.channels
    inputs = symbols(ca.MX, memory=shape.memory.size, x=row, frame=shape.frame.size)
    memory, x, frame = inputs
    readings, mask = x[1 : 1 + shape.count], x[1 + shape.count :]
    outputs, after = features_function(shape)(memory, x[0], readings, mask, frame)
    return Kernel(ca.Function("features", inputs, [after, outputs]))


def features_along(
    shape: Shape, frame: Floats, time: Floats, readings: Floats
) -> dict[str, Floats]:
    """Return the parts of `Shape.outputs` over a log, (k, …) each.

    Args:
        frame: the features' own parameters, see `Shape.frame`.
        time: stamps [s], (k,).
        readings: the sensors' readings, NaN where missing, and the filter's angles, (k, count).
    """
    is_present = np.isfinite(readings[:, : shape.channels])
    scales = (frame[shape.frame[name]] for name in SCALES)
    first = first_function(shape)(np.nan_to_num(readings[0]), is_present[0], *scales)
    rows = np.column_stack([np.diff(time, prepend=time[:1]), np.nan_to_num(readings), is_present])
    ys = advance(features_kernel(shape), Feed(np.array(first).ravel(), rows, frame), keep=[0]).ys
    return shape.outputs.views(ys)


def empty_frame(shape: Shape) -> dict[str, Floats]:
    """Return the numbers of features that are not scaled yet and have no points."""
    frame = shape.frame.views(np.zeros(shape.frame.size))
    for name in ("scale", "play", "lengths"):
        frame[name][:] = 1.0
    return frame


def map_layout(shape: Shape, joints: int) -> Layout:
    """Return the layout of a map's numbers: features, then weights."""
    n = shape.features.size
    weights = {f"covariance_{j}": (n, n) for j in range(joints)}
    return Layout(
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
    parts = (arrays[name].ravel() for name in names)
    return np.concatenate([shape.flat(arrays.by_name), *parts])


def begun_by(learned: LearnedMap, readings: Expression, mask: Expression) -> Expression:
    """Return the memory of a map before the first sample, by its `readings` and their `mask`."""
    scales = (learned.arrays[name] for name in SCALES)
    memory: Expression = first_function(Shape.of(learned))(readings, mask, *scales)
    return memory


@cache
def map_function(shape: Shape, joints: int, beside_filter: bool = False) -> ca.Function:
    """Return the function of a map: (memory, dt, readings, mask, parameters, doubts, elsewhere,
    chance) → (values, gains, variances, memory⁺).

    A value is φᵀ m. Its variance is φᵀ C φ + σ² + s_r² (what no radial function explains) + (Σ_i
    |∂y/∂slip_i| d_i)²/3, d_i being the half-width of the interval in which a slip lies, + Σ_i
    (∂y/∂z_i)² v_i for readings that have been missing for a time a: v = 2 (1 − exp(−(rate a)²/2)),
    from a steady motion to the difference of two readings that have nothing to do with each other;
    and for those with a variance beyond their noise, the `doubts`.
    An error e of the filter's own angle stays with the share `filter`, its gain.
    """
    layout = map_layout(shape, joints)
    inputs = map_inputs(shape, joints)
    memory, dt, readings, mask, parameters, doubts, elsewhere, chance = inputs
    of = layout.parts(parameters)
    outputs, after = features_function(shape)(*inputs[:4], of["frame"])
    out = shape.outputs.parts(outputs)
    phi = out["features"]
    frame = shape.frame.parts(of["frame"])
    age = shape.memory.part(after, "age")
    unknown = 2 * (1 - ca.exp(-((of["rate"][: shape.channels] * age) ** 2) / 2))
    unknown += doubts / frame["scale"][: shape.channels] ** 2
    variances = []
    for j in range(joints):
        mean = of["mean"][:, j]
        spread = ca.dot(phi, ca.mtimes(of[f"covariance_{j}"], phi))
        beside = variance_beside(shape, mean, out, frame, unknown)
        variances.append(
            ca.fmax(spread, 0) + of["noise"][j] + of["radial"][j] * out["far"] + beside
        )
    values = ca.mtimes(of["mean"].T, phi)
    spreads = ca.vertcat(*variances)
    if not beside_filter:
        second = ca.MX(readings)
        second[: shape.channels] = elsewhere
        of_second, _ = features_function(shape)(memory, dt, second, mask, of["frame"])
        apart = ca.mtimes(of["mean"].T, shape.outputs.part(of_second, "features")) - values
        values += chance * apart
        spreads += chance * (1 - chance) * apart**2
    return ca.Function("map", inputs, [values, of["filter"], spreads, after])


def map_inputs(shape: Shape, joints: int) -> list[VectorNode]:
    """Return the symbols of the inputs of `map_function`."""
    n = shape.channels
    return [
        *_sample(ca.MX, shape),
        *symbols(ca.MX, parameters=map_layout(shape, joints).size, doubts=n, elsewhere=n, chance=1),
    ]


def forces_layout(shape: Shape, forces: int) -> Layout:
    """Return the layout of the numbers of `forces_function`."""
    n = shape.features.size
    return Layout(frame=shape.frame.size, mean=(n, forces), rms=forces, whitener=(forces, forces))


def forces_parameters(learned: LearnedMap) -> Floats:
    """Return the parameters of `forces_function`, (n_p,)."""
    arrays = learned.arrays
    parts = (
        arrays["mean"].ravel(),
        np.array(learned.rms),
        whitening(arrays["correlation"]).ravel(order="F"),
    )
    return np.concatenate([Shape.of(learned).flat(arrays.by_name), *parts])


@cache
def forces_function(shape: Shape, forces: int) -> ca.Function:
    """Return the function (memory, dt, positions, mask, forces, parameters) → (T², spread,
    memory⁺): how unlike free motion the forces are at these positions, T² = eᵀ Σ⁻¹ e/n, and
    ln(det Σ/det Σ₀)/n, Σ₀ being that of settled plays: else it would be likeliest to know nothing.
    """
    layout = forces_layout(shape, forces)
    sample = _sample(ca.MX, shape)
    read, parameters = symbols(ca.MX, forces=forces, parameters=layout.size)
    of = layout.parts(parameters)
    outputs, after = features_function(shape)(*sample, of["frame"])
    out = shape.outputs.parts(outputs)
    errors = []
    spreads = []
    for k in range(forces):
        mean = of["mean"][:, k]
        # at first nobody knows on which side of its play a drive is
        beside = variance_beside(
            shape, mean, out, shape.frame.parts(of["frame"]), ca.MX.zeros(shape.channels)
        )
        error = read[k] - ca.dot(mean, out["features"])
        wider = 1 + beside / of["rms"][k] ** 2
        spreads.append(ca.log(wider))
        errors.append(error / (of["rms"][k] * ca.sqrt(wider)))
    square = ca.sumsqr(ca.mtimes(of["whitener"], ca.vertcat(*errors))) / forces
    results = [square, sum(spreads) / forces, after]
    return ca.Function("forces", [*sample, read, parameters], results)


def whitening(correlation: Floats) -> Floats:
    """Return W with Wᵀ W = C⁻¹ for a correlation C, (n, n)."""
    rounding = 1e-9 * np.eye(len(correlation))
    return np.linalg.inv(np.linalg.cholesky(correlation + rounding))


INDEPENDENT = 0.5
"""Time over which errors of forces are independent in motion [s]. Source: benchmark
(docs/results/reliability.md).
"""

MOST = 25.0
"""Upper limit of one T² [1], so that no single value decides. Source: benchmark
(docs/results/reliability.md).
"""


@dataclass(frozen=True)
class JudgedJumps:
    """A map of forces that says which of two readings is right: as they are if the last jumps were
    none of the drives, or if they were real.

    Args:
        learned: the map.
        positions: indices of its positions among the channels.
        forces: indices of its forces.
    """

    learned: LearnedMap
    positions: tuple[int, ...]
    forces: tuple[int, ...]

    @classmethod
    def among(cls, maps: Sequence[LearnedMap], channels: Sequence[str]) -> list[JudgedJumps]:
        """Return those of maps whose sensors are all among the channels."""
        at = list(channels).index
        return [
            cls(m, tuple(map(at, m.channels)), tuple(map(at, m.joints)))
            for m in maps
            if {*m.joints, *m.channels} <= set(channels)
        ]

    @property
    def shape(self) -> Shape:
        """The shape of its map."""
        return Shape.of(self.learned)

    @property
    def memory(self) -> Layout:
        """What is remembered: of the features at either reading, whether the `real` one is asked
        next, what the last one cost, and the interval before it [s].
        """
        size = self.shape.memory.size
        return Layout(off=size, real=size, is_next=1, cost=1, waited=1)

    def begun(self, positions: Expression, mask: Expression) -> Expression:
        """Return its memory before the first sample."""
        memory = begun_by(self.learned, positions, mask)
        beginning: Expression = ca.vertcat(memory, memory, 0, 0, 0)
        return beginning

    @property
    def parameters(self) -> int:
        """Number of its parameters."""
        return forces_layout(self.shape, len(self.forces)).size

    def evidence(
        self,
        memory: VectorNode,
        dt: VectorNode,
        off: VectorNode,
        real: VectorNode,
        mask: VectorNode,
        parameters: VectorNode,
    ) -> tuple[VectorNode, VectorNode]:
        """Return the logarithm of the likelihood ratio of the `real` readings to those that are
        `off`, and the memory⁺, by a sample. After a jump samples ask both in turn.
        """
        positions = list(self.positions)
        forces = list(self.forces)
        was = self.memory.parts(memory)
        differs = reduce(ca.fmax, ca.vertsplit(off[positions] != real[positions]))
        is_real = differs * was["is_next"]
        # what plays remember differs from the jump on, and is the same while there is none
        square, spread, after = forces_function(self.shape, len(forces))(
            ca.if_else(is_real, was["real"], was["off"]),
            dt + differs * was["waited"],
            ca.if_else(is_real, real[positions], off[positions]),
            mask[positions],
            off[forces],
            parameters,
        )
        is_read = reduce(ca.fmin, ca.vertsplit(mask[[*positions, *forces]] > 0))
        cost = ca.fmin(square, MOST) + spread
        count = len(forces) * ca.fmin((dt + was["waited"]) / INDEPENDENT, 1) / 2
        following = self.memory.joined(
            off=ca.if_else(is_real, was["off"], after),
            real=ca.if_else(differs * (1 - is_real), was["real"], after),
            is_next=differs * (1 - is_real),
            cost=cost,
            waited=differs * dt,
        )
        return is_read * is_real * count * (was["cost"] - cost), following


def apart(vector: VectorNode, sizes: Iterable[int]) -> list[VectorNode]:
    """Return the parts of a column that follow each other, of these sizes."""
    return [vector[begin:end] for begin, end in pairwise(accumulate(sizes, initial=0))]


def evidence_of_jumps(
    judges: Sequence[JudgedJumps],
    memory: VectorNode,
    dt: VectorNode,
    off: VectorNode,
    real: VectorNode,
    masks: VectorNode,
    parameters: VectorNode,
) -> tuple[VectorNode, VectorNode]:
    """Return for each channel the logarithm of the likelihood ratio of its `real` reading to that
    which is `off`, by all `judges`, and their memory⁺; see `JudgedJumps.evidence`.

    Args:
        memory: of one judge after the other.
        parameters: of one judge after the other.
    """
    ratios = ca.MX.zeros(off.numel())
    after = [ca.MX(0, 1)]
    memories = apart(memory, [judge.memory.size for judge in judges])
    parameters_of_each = apart(parameters, [judge.parameters for judge in judges])
    for judge, memory_of, parameters_of in zip(judges, memories, parameters_of_each):
        ratio, following = judge.evidence(memory_of, dt, off, real, masks, parameters_of)
        after.append(following)
        for k in judge.positions:
            ratios[k] += ratio * (off[k] != real[k])
    return ratios, ca.vertcat(*after)


MOST_EVIDENCE = 50.0
"""Largest logarithm of odds [1]: e⁵⁰ is certain. Source: rounding (overflow of the exponential
function).
"""


def added(evidence: Expression, ratio: Expression) -> Expression:
    """Return the logarithm of odds after more evidence, within `MOST_EVIDENCE`."""
    total: Expression = ca.fmin(ca.fmax(evidence + ratio, -MOST_EVIDENCE), MOST_EVIDENCE)
    return total


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
    parts = shape.features.parts(mean)
    n = shape.count
    slopes = parts["readings"]  # ∂y/∂z
    for k in range(len(TIME_CONSTANTS)):
        slopes = slopes + parts["lags"][k * n : (k + 1) * n]
    turns = ca.fabs(parts["slips"])  # |∂y/∂slip|
    if shape.radial:
        pull = ca.mtimes(frame["root"].T, parts["radial"]) * out["kernel"] * out["amplitude"]
        towards = ca.mtimes(frame["points"].T, pull) - out["inputs"] * ca.sum1(pull)
        towards = towards / frame["lengths"]
        slopes = slopes + towards[:n]
        if shape.moving:
            turns[[IN_RADIAL * n + i for i in shape.moving]] += ca.fabs(towards[n:])
    of_readings = ca.dot(slopes[: shape.channels] ** 2, unknown)
    return ca.dot(turns, out["doubt"]) ** 2 / 3 + of_readings
