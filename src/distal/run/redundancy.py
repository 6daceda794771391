"""What readings predict of each other: each force and tension by the positions of the drives and
what these remember, as it is in free motion.

The squared prediction error of a force tells that something touches a joint, or that a sensor is
wrong (Q statistic of process monitoring; Jackson and Mudholkar, Technometrics 21, 1979). It is the
only test that no state of a filter can explain away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import reduce
from math import exp

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.expressions import Scalar, Vector, VectorNode
from distal.kernels import Feed, Kernel, Layout, advance
from distal.logs import Log
from distal.regression import Shape, begun_by, features_function, variance_beside
from distal.rig import LearnedMap, Rig

AVERAGED = 3.0
"""Time constant of the mean of e²/σ² [s]. Source: benchmark (docs/results/reliability.md)."""

MOST = 25.0
"""Upper limit of one e²/σ² [1], so that no single value decides. Source: benchmark
(docs/results/reliability.md).
"""

NORMAL = 0.997
"""Share of the time in which a force in free motion is normal [1]. Source: benchmark
(docs/results/touch.md).
"""


@dataclass(frozen=True)
class Redundancy:
    """The forces of a sample as its positions predict them.

    Args:
        maps: `LearnedMaps.efforts` of those parts whose sensors are all among the channels.
        channels: names of the sensors in a sample.
    """

    maps: tuple[LearnedMap, ...]
    channels: tuple[str, ...]

    @classmethod
    def of(cls, rig: Rig, channels: Sequence[str]) -> Redundancy:
        """Return what a rig's logs taught of some channels."""
        maps = () if rig.map is None else rig.map.efforts
        among = [m for m in maps if {*m.joints, *m.channels} <= set(channels)]
        return cls(tuple(among), tuple(channels))

    @property
    def efforts(self) -> list[str]:
        """Names of the sensors that are predicted."""
        return [name for learned in self.maps for name in learned.joints]

    @property
    def positions(self) -> list[str]:
        """Names of the sensors that predict them."""
        return [name for learned in self.maps for name in learned.channels]

    @property
    def limits(self) -> list[float]:
        """Largest normal mean of e²/σ² of each force, e its prediction error of variance σ²."""
        return [limit for learned in self.maps for limit in learned.normal]

    @property
    def memory(self) -> int:
        """Length of what the maps remember."""
        return sum(Shape.of(learned).memory.size for learned in self.maps)

    def outside(self, values: Vector, mask: Vector) -> Vector:
        """Return 1 for each of `positions` that is read where no log has been, else 0.

        Args:
            values: of the channels.
            mask: whether each of them is read.
        """
        ends = [end for learned in self.maps for end in learned.reach.values()]
        at = [self.channels.index(name) for name in self.positions]
        low, high = (ca.DM([end[side] for end in ends]) for side in (0, 1))
        return mask[at] * ca.logic_or(values[at] < low, values[at] > high)

    def compared(self, mask: Vector, outside: Vector) -> Vector:
        """Return 1 for each of `efforts` that can be compared: it is read, and all positions are,
        where the logs have been.

        Args:
            mask: whether each channel is read.
            outside: see `outside`.
        """
        comparable = []
        at = 0
        for learned in self.maps:
            read = [mask[self.channels.index(name)] for name in learned.channels]
            inside = [1 - outside[at + i] for i in range(len(read))]
            for name in learned.joints:
                comparable.append(
                    reduce(ca.fmin, (mask[self.channels.index(name)], *read, *inside))
                )
            at += len(read)
        return ca.vertcat(ca.SX(0, 1), *comparable)

    def means(self, before: Vector, squares: Vector, dt: Scalar, compared: Vector) -> Vector:
        """Return the means of e²/σ² after a sample that comes `dt` [s] after the one before.

        Args:
            before: the means at that one.
            squares: e²/σ² of each force.
            dt: time since then [s].
            compared: see `compared`.
        """
        return before + compared * ca.fmin(dt / AVERAGED, 1) * (ca.fmin(squares, MOST) - before)

    def around(self, judged: ca.Function, sample: Layout) -> ca.Function:
        """Return the function (memory, sample) → (memory⁺, findings) around one that also takes
        e²/σ² of each force; what the maps remember is behind its own memory.
        """
        if not self.maps:
            return judged
        own = judged.size1_in(0)
        memory = ca.MX.sym("memory", own + self.memory)
        x = ca.MX.sym("sample", sample.size)
        after, squares = self._predicted(memory[own:], sample.parts(x))
        left, findings = judged(memory[:own], x, squares)
        return ca.Function("judged_with_maps", [memory, x], [ca.vertcat(left, after), findings])

    def along(self, time: Floats, values: Floats, mask: Bools) -> Floats:
        """Return e²/σ² of each force over a log, (k, n_forces).

        Args:
            time: stamps [s], (k,).
            values: of the channels, zero where missing, (k, n).
            mask: whether each is there, (k, n).
        """
        sample = Layout(first=1, dt=1, values=len(self.channels), mask=len(self.channels))
        memory = ca.MX.sym("memory", self.memory)
        x = ca.MX.sym("sample", sample.size)
        function = ca.Function(
            "predicted",
            [memory, x, ca.MX.sym("p", 0)],
            [*self._predicted(memory, sample.parts(x))],
        )
        rows = np.column_stack(
            [np.arange(len(time)) == 0, np.diff(time, prepend=time[:1]), values, mask]
        )
        feed = Feed(np.zeros(self.memory), rows.astype(np.float64), np.zeros(0))
        return advance(Kernel(function), feed).ys

    def _predicted(
        self, memory: VectorNode, came: Mapping[str, VectorNode]
    ) -> tuple[VectorNode, VectorNode]:
        """Return what the maps remember, and e²/σ² of each force, at a sample."""
        squares: list[VectorNode] = []
        after: list[VectorNode] = []
        at = 0
        for learned in self.maps:
            shape = Shape.of(learned)
            arrays = learned.arrays
            efforts, read = (
                [self.channels.index(name) for name in names]
                for names in (learned.joints, learned.channels)
            )
            positions, mask = came["values"][read], came["mask"][read]
            begun = begun_by(learned, positions, mask)
            was = memory[at : at + shape.memory.size]
            was = was + came["first"] * (begun - was)
            frame = ca.MX(ca.DM(shape.flat(arrays.by_name)))
            outputs, left = features_function(shape)(was, came["dt"], positions, mask, frame)
            out = shape.outputs.parts(outputs)
            for k, effort in enumerate(efforts):
                mean = ca.MX(ca.DM(arrays["mean"][k]))
                error = came["values"][effort] - ca.dot(mean, out["features"])
                # at first nobody knows on which side of its play a drive is
                beside = variance_beside(
                    shape, mean, out, shape.frame.parts(frame), ca.MX.zeros(shape.channels)
                )
                squares.append(error**2 / (learned.rms[k] ** 2 + beside))
            after.append(left)
            at += shape.memory.size
        return ca.vertcat(*after), ca.vertcat(*squares)


def unlike_free_motion(log: Log, rig: Rig) -> dict[str, float]:
    """Return sensor → share of a log in which its force is not that of free motion at these
    positions; those that are normal are left out.
    """
    redundancy = Redundancy.of(rig, list(log.channels))
    if not redundancy.maps:
        return {}
    values = np.column_stack(list(log.channels.values()))
    mask = np.isfinite(values)
    names = redundancy.channels
    squares = redundancy.along(log.time, np.where(mask, values, 0.0), mask)
    unlike = dict[str, float]()
    at = 0
    for learned in redundancy.maps:
        read = [names.index(name) for name in learned.channels]
        low, high = np.array(list(learned.reach.values())).T
        usable = np.all(mask[:, read] & (values[:, read] >= low) & (values[:, read] <= high), 1)
        for name, limit in zip(learned.joints, learned.normal, strict=True):
            compared = usable & mask[:, names.index(name)]
            means = recent_mean(np.minimum(squares[compared, at], MOST), log.time, AVERAGED)
            share = float(np.sum(means > limit)) / len(log)
            if share > 1 - NORMAL:
                unlike[name] = share
            at += 1
    return unlike


def recent_mean(values: Floats, stamps: Floats, time: float) -> Floats:
    """Return exponentially fading means as a stream computes them.

    Args:
        values: what is averaged, (k,) or (k, m).
        stamps: times of the samples [s], (n,), as far apart as the values.
        time: time constant of the mean [s].
    """
    from scipy.signal import lfilter  # takes as long to load as distal

    fade = exp(-float(np.median(np.diff(stamps))) / time)
    means: Floats = lfilter([1 - fade], [1, -fade], values, axis=0)
    return means
