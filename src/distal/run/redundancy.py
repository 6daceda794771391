"""What readings predict of each other: the forces and tensions of a part of the rig by the
positions of its drives and what these remember, as they are in free motion.

Their errors e tell together that something touches a joint, or that a sensor is wrong: T² = eᵀ Σ⁻¹
e/n, with the covariance Σ of the errors of n forces on logs left out (Hotelling, in Techniques of
Statistical Analysis, 1947). It is the only test that no state of a filter can explain away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache, reduce

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.expressions import Vector, VectorNode
from distal.kernels import Feed, Kernel, Layout, advance
from distal.logs import Log
from distal.regression import Shape, begun_by, features_function, variance_beside
from distal.rig import LearnedMap, Rig

AVERAGED = (1.0, 30.0)
"""Time constants of the means of T² [s]: a touch is felt within the first, a wrong sensor within
the second. Source: benchmark (docs/results/reliability.md).
"""

MOST = 25.0
"""Upper limit of one T² [1], so that no single value decides. Source: benchmark
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
    def parts(self) -> list[str]:
        """Names of the forces that are tested together."""
        return [", ".join(learned.joints) for learned in self.maps]

    @property
    def memory(self) -> int:
        """Length of what is remembered: for each map that of its features, then `MEANS`."""
        return sum(Shape.of(learned).memory.size + MEANS.size for learned in self.maps)

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

    def around(self, judged: ca.Function, sample: Layout) -> ca.Function:
        """Return the function (memory, sample) → (memory⁺, findings) around one that also takes
        whether each of `parts` is unlike free motion; what is remembered of them is behind its own
        memory.
        """
        if not self.maps:
            return judged
        own = judged.size1_in(0)
        memory = ca.MX.sym("memory", own + self.memory)
        x = ca.MX.sym("sample", sample.size)
        after, _, unlike, _ = self._step(memory[own:], sample.parts(x))
        left, findings = judged(memory[:own], x, unlike)
        return ca.Function("judged_with_maps", [memory, x], [ca.vertcat(left, after), findings])

    def along(self, time: Floats, values: Floats, mask: Bools) -> tuple[Floats, Floats, Floats]:
        """Return T² of each of `parts` over a log, whether its means are beyond what is normal, and
        whether a position is where no log has been, all (k, n_parts).

        Args:
            time: stamps [s], (k,).
            values: of the channels, zero where missing, (k, n).
            mask: whether each is there, (k, n).
        """
        rows = np.column_stack(
            [np.arange(len(time)) == 0, np.diff(time, prepend=time[:1]), values, mask]
        )
        ys = advance(_kernel(self), Feed(np.zeros(self.memory), rows.astype(np.float64), NONE)).ys
        squares, unlike, outside = np.hsplit(ys, 3)
        return squares, unlike, outside

    def _step(
        self, memory: VectorNode, came: Mapping[str, VectorNode]
    ) -> tuple[VectorNode, VectorNode, VectorNode, VectorNode]:
        """Return what is remembered after a sample, and what `along` returns."""
        squares: list[VectorNode] = []
        unlike: list[VectorNode] = []
        outside: list[VectorNode] = []
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
            errors = []
            for k, effort in enumerate(efforts):
                mean = ca.MX(ca.DM(arrays["mean"][k]))
                error = came["values"][effort] - ca.dot(mean, out["features"])
                # at first nobody knows on which side of its play a drive is
                beside = variance_beside(
                    shape, mean, out, shape.frame.parts(frame), ca.MX.zeros(shape.channels)
                )
                errors.append(error / ca.sqrt(learned.rms[k] ** 2 + beside))
            square = _mean_square(whitening(arrays["correlation"]), ca.vertcat(*errors))
            low, high = (ca.DM([end[side] for end in learned.reach.values()]) for side in (0, 1))
            reached = ca.logic_and(positions >= low, positions <= high)
            inside = _every(ca.logic_or(reached, ca.logic_not(mask)))
            compared = _every(ca.vertcat(came["mask"][[*efforts, *read]], inside))
            outside.append(1 - inside)
            at += shape.memory.size
            means = MEANS.parts(memory[at : at + MEANS.size])
            now = averaged(means, came["first"], square, came["dt"], compared)
            at += MEANS.size
            squares.append(square)
            unlike.append(1 - _every(now["means"] <= ca.DM(learned.normal)))
            after += [left, MEANS.joined(**now)]
        return ca.vertcat(*after), *(ca.vertcat(*of) for of in (squares, unlike, outside))


def _every(flags: VectorNode) -> VectorNode:
    return reduce(ca.fmin, ca.vertsplit(flags))


MEANS = Layout(means=len(AVERAGED), time=1)
"""Means of T² of a part, and for how long it has been compared [s]. Source: definition (layout of a
vector).
"""


def whitening(correlation: Floats) -> Floats:
    """Return W with Wᵀ W = C⁻¹ for a correlation C, (n, n)."""
    rounding = 1e-9 * np.eye(len(correlation))
    return np.linalg.inv(np.linalg.cholesky(correlation + rounding))


def _mean_square(whitener: Floats, errors: VectorNode) -> VectorNode:
    independent = [ca.dot(ca.DM(row), errors) for row in whitener]
    return sum((value**2 for value in independent), ca.MX(0)) / len(whitener)


def averaged(
    was: Mapping[str, VectorNode],
    first: VectorNode,
    square: VectorNode,
    dt: VectorNode,
    compared: VectorNode,
) -> dict[str, VectorNode]:
    """Return the means of T² after a sample, and for how long it has been compared: until that is
    a mean's time constant, all samples count alike. The means begin at 1, which counts as much as
    the shortest time constant.

    Args:
        was: both before, see `MEANS`.
        first: whether it is the first sample.
        square: T².
        dt: time since the sample before [s].
        compared: whether T² could be compared.
    """
    dt = ca.fmin(dt, AVERAGED[0])  # of a gap no more is known
    time = ca.if_else(first, 0, was["time"]) + compared * dt
    means = ca.if_else(first, 1, was["means"])
    change = ca.fmin(square, MOST) - means
    memory = ca.fmin(ca.DM(AVERAGED), AVERAGED[0] + time)
    return {"means": means + compared * ca.fmin(dt / memory, 1) * change, "time": time}


def means_along(time: Floats, squares: Floats) -> Floats:
    """Return the means of T² over a log in which each sample is compared, (k, n_means).

    Args:
        time: stamps [s], (k,).
        squares: T², (k,).
    """
    memory = ca.MX.sym("memory", MEANS.size)
    x = ca.MX.sym("x", 3)
    now = averaged(MEANS.parts(memory), x[0], x[1], x[2], ca.MX(1))
    rows = np.column_stack([np.arange(len(time)) == 0, squares, np.diff(time, prepend=time[:1])])
    kernel = _step_kernel(memory, x, MEANS.joined(**now), now["means"])
    return advance(kernel, Feed(np.zeros(MEANS.size), rows, NONE)).ys


NONE = np.zeros(0)
"""Parameters of a kernel that has none. Source: definition."""


def _step_kernel(memory: VectorNode, x: VectorNode, after: VectorNode, y: VectorNode) -> Kernel:
    return Kernel(ca.Function("step", [memory, x, ca.MX.sym("p", 0)], [after, y]))


@lru_cache(maxsize=4)
def _kernel(redundancy: Redundancy) -> Kernel:
    """Return the kernel (memory, sample) → (memory⁺, what `Redundancy.along` returns)."""
    count = len(redundancy.channels)
    sample = Layout(first=1, dt=1, values=count, mask=count)
    memory = ca.MX.sym("memory", redundancy.memory)
    x = ca.MX.sym("sample", sample.size)
    after, *outputs = redundancy._step(memory, sample.parts(x))
    return _step_kernel(memory, x, after, ca.vertcat(*outputs))


def unlike_free_motion(log: Log, rig: Rig) -> dict[str, float]:
    """Return forces → share of a log in which they are not those of free motion at these positions;
    those that are normal are left out.
    """
    redundancy = Redundancy.of(rig, list(log.channels))
    if not redundancy.maps:
        return {}
    values = np.column_stack(list(log.channels.values()))
    mask = np.isfinite(values)
    _, unlike, _ = redundancy.along(log.time, np.where(mask, values, 0.0), mask)
    shares = dict(zip(redundancy.parts, np.mean(unlike, axis=0).tolist(), strict=True))
    return {names: share for names, share in shares.items() if share > 1 - NORMAL}
