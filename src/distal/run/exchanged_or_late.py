"""What readings predict of each other: the forces and tensions of a part of the rig by the
positions of its drives and what these remember, as they are in free motion.

Their errors e tell together that something touches a joint, or that a sensor is wrong: T² = eᵀ Σ⁻¹
e/n, with the covariance Σ of the errors of n forces on logs left out (Hotelling, in Techniques of
Statistical Analysis, 1947). It is the only test that no state of a filter can explain away.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache, reduce
from itertools import combinations

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.estimators.adaptive.drive_tracking import (
    MEMORY,
    REMEMBERED,
    BothReadings,
    begun_alone,
    judged_alone,
)
from distal.estimators.adaptive.filter_inputs import judged_by
from distal.expressions import VectorNode
from distal.kernels import Feed, Kernel, Layout, advance
from distal.logs import Log
from distal.regression import (
    INDEPENDENT,
    MOST,
    JudgedJumps,
    Shape,
    begun_by,
    forces_function,
    forces_parameters,
)
from distal.rig import LearnedMap, Rig

AVERAGED = (1.0, 30.0)
"""Time constants of the means of T² [s]: a touch is felt within the first, a wrong sensor within
the second. Source: benchmark (docs/results/reliability.md).
"""

LATE = 0.2
"""Delay of a position that is supposed [s]. Source: benchmark (docs/results/reliability.md)."""

KEPT = 4
"""Number of readings that are kept over that delay [1]. Source: benchmark
(docs/results/reliability.md).
"""

PRIOR = 1e-3
"""Probability that a reading is wrong from the beginning [1]. Source: definition (level)."""

LATER = 1e-9
"""Least probability that a reading is wrong, or right [1]: it may change. Source: definition
(level).
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
        supposes: whether it is asked if a position is late, or two are exchanged.
        judged: of each position its index, what it is judged by (`JUDGED`), and the indices of what
            its motor reads with it.
    """

    maps: tuple[LearnedMap, ...]
    channels: tuple[str, ...]
    supposes: bool = True
    judged: tuple[tuple[int, tuple[float, ...], tuple[int, ...]], ...] = ()

    @classmethod
    def of(cls, rig: Rig, channels: Sequence[str]) -> Redundancy:
        """Return what a rig's logs taught of some channels."""
        judges = JudgedJumps.among(() if rig.map is None else rig.map.efforts, channels)
        maps = tuple(judge.learned for judge in judges)
        at = channels.index
        forces = rig.sensors_of("force")
        judged = []
        for sensor in rig.sensors_of("position") if maps else ():
            if sensor.name in channels:
                read = [sensor, *(force for force in forces if force.of == sensor.of)]
                message = tuple(at(each.name) for each in read if each.name in channels)
                judged_with = tuple(judged_by(rig, sensor).tolist())
                judged.append((at(sensor.name), judged_with, message))
        return cls(maps, tuple(channels), judged=tuple(judged))

    @property
    def positions(self) -> list[str]:
        """Names of the sensors that predict them."""
        return [name for learned in self.maps for name in learned.channels]

    @property
    def parts(self) -> list[str]:
        """Names of the forces that are tested together."""
        return [", ".join(learned.joints) for learned in self.maps]

    @cached_property
    def _layout(self) -> Layout:
        """What is remembered: of each part, of each judge of jumps, and of each position."""
        sizes = {f"part_{k}": part.memory.size for k, part in enumerate(self._parts)}
        judges = sum(judge.memory.size for judge in self._judges)
        return Layout(**sizes, judges=judges, tracks=(MEMORY, len(self.judged)))

    @property
    def memory(self) -> int:
        """Length of what is remembered."""
        return self._layout.size

    @cached_property
    def _judges(self) -> list[JudgedJumps]:
        return JudgedJumps.among(self.maps, self.channels)

    @cached_property
    def _parts(self) -> list[_Part]:
        return [_Part(j.learned, [*j.positions, *j.forces]) for j in self._judges]

    def supposed(self, memory: Floats) -> list[str]:
        """Return what is likelier than that all positions are right, touched or not, in words, by
        what is remembered.
        """
        causes = list[tuple[float, str]]()
        for k, part in enumerate(self._parts):
            of_part = memory[self._layout[f"part_{k}"]]
            evidence = of_part[part.memory["beside_touch"]]
            causes += [pair for pair in zip(evidence, part.suspicions) if pair[0] > -np.log(PRIOR)]
        return [text for _, text in sorted(causes, reverse=True)]

    def jumped(self, memory: Floats) -> str:
        """Return the position that jumped last and may be off, in words; empty where none is."""
        tracks = self._tracks(memory)
        jumped = [(was["doubt"], name) for name, was in tracks.items() if was["shift"]]
        return "{1} jumped {0:.2g} s ago".format(*min(jumped)) if jumped else ""

    def likely_cause(self, memory: Floats, interval: float) -> str:
        """Return what forces that are not those of free motion most likely come of, in words.

        Args:
            memory: what is remembered.
            interval: between samples [s].
        """
        tracks = self._tracks(memory)
        same = [name for name, was in tracks.items() if was["repeats"] * interval > INDEPENDENT]
        stuck = f"{', '.join(same)} does not change: is it stuck"
        causes = [
            *self.supposed(memory),
            self.jumped(memory),
            stuck if 0 < len(same) < len(tracks) else "",
            "something touches, or a sensor is wrong",
        ]
        return next(filter(None, causes))

    def _tracks(self, memory: Floats) -> dict[str, dict[str, float]]:
        """Return position → what the `memory` holds of it, by the names of `REMEMBERED`."""
        rows = memory[self._layout["tracks"]].reshape(-1, MEMORY).tolist()
        named = [dict(zip(REMEMBERED, row)) for row in rows]
        return dict(zip([self.channels[k] for k, *_ in self.judged], named))

    def around(self, judged: ca.Function, sample: Layout) -> ca.Function:
        """Return the function (memory, sample) → (memory⁺, findings) around one that also takes
        whether each of `parts` is unlike free motion, and each of `positions` where no log has
        been; what is remembered of them is behind its own memory.
        """
        if not self.maps:
            return judged
        own = judged.size1_in(0)
        memory = ca.MX.sym("memory", own + self.memory)
        x = ca.MX.sym("sample", sample.size)
        after, _, unlike, outside = self._step(memory[own:], sample.parts(x))
        left, findings = judged(memory[:own], x, unlike, outside)
        return ca.Function("judged_with_maps", [memory, x], [ca.vertcat(left, after), findings])

    def along(self, time: Floats, values: Floats, mask: Bools) -> tuple[Floats, Floats, Floats]:
        """Return what each sample costs each of `parts`, −2 ln of its likelihood for each force,
        but a constant, over a log, and whether its mean T² is beyond what is normal, (k, n_parts)
        both; and whether each of `positions` is where no log has been, (k, n_positions).

        Args:
            time: stamps [s], (k,).
            values: of the channels, zero where missing, (k, n).
            mask: whether each is there, (k, n).
        """
        rows = np.column_stack(
            [np.arange(len(time)) == 0, np.diff(time, prepend=time[:1]), values, mask]
        )
        ys = advance(_kernel(self), Feed(np.zeros(self.memory), rows.astype(np.float64), NONE)).ys
        costs, unlike, outside = np.hsplit(ys, [len(self.maps), 2 * len(self.maps)])
        return costs, unlike, outside

    def _step(
        self, memory: VectorNode, came: Mapping[str, VectorNode]
    ) -> tuple[VectorNode, VectorNode, VectorNode, VectorNode]:
        """Return what is remembered after a sample, and what `along` returns."""
        layout = self._layout
        remembered = layout.parts(memory)
        sample, after = self._tracked(remembered, came)
        values = ca.if_else(sample.chance > 0.5, sample.real, sample.off)
        judgements = []
        for k, part in enumerate(self._parts):
            was = part.memory.parts(remembered[f"part_{k}"])
            read = values[part.read]
            mask = sample.masks[part.read]
            square, spread, beyond, left = part.compared(
                was["features"], came["first"], came["dt"], read, mask
            )
            is_read = _every(mask)
            is_outside = _any(beyond > 0)
            now = averaged(was, came["first"], square, came["dt"], is_read * (1 - is_outside))
            now = {**was, "features": left, **now}
            if self.supposes:
                now |= part.supposed(was, came, read, mask, (square, spread, beyond), is_read)
            is_unlike = 1 - _every(now["means"] <= ca.DM(part.learned.normal))
            is_wrong = _any(now["evidence"] > -np.log(PRIOR))
            unlike = ca.fmax(ca.fmax(is_unlike, is_wrong), _any(sample.lasting[part.read]))
            cost = ca.if_else(is_outside, MOST, _cost(square, spread, beyond))
            judgements.append((cost, unlike, beyond > 0))
            after[f"part_{k}"] = part.memory.joined(**now)
        costs, unlike, outside = (ca.vertcat(*of) for of in zip(*judgements))
        return layout.joined(**after), costs, unlike, outside

    def _tracked(
        self, was: Mapping[str, VectorNode], came: Mapping[str, VectorNode]
    ) -> tuple[BothReadings, dict[str, VectorNode]]:
        """Return a sample as its positions are believed, and what is remembered of them and of
        jumps after it, by the names of the layout.
        """
        first, dt, values, mask = (came[name] for name in ("first", "dt", "values", "mask"))
        begun = [begun_alone(values[k], mask[k]) for k, *_ in self.judged]
        positions = [(k, ca.MX(ca.DM(judged)), message) for k, judged, message in self.judged]
        judges = self._judges
        at_first = [j.begun(values[list(j.positions)], mask[list(j.positions)]) for j in judges]
        sample = judged_alone(
            ca.if_else(first, ca.vertcat(ca.MX(0, 1), *begun), ca.vec(was["tracks"])),
            dt,
            values,
            mask,
            positions,
            judges,
            ca.if_else(first, ca.vertcat(*at_first), was["judges"]),
            ca.DM(np.concatenate([forces_parameters(judge.learned) for judge in judges])),
        )
        tracks = ca.reshape(sample.drives, MEMORY, len(self.judged))
        return sample, {"judges": sample.judges, "tracks": tracks}


@dataclass(frozen=True)
class _Part:
    """A part of the rig: its map, and where its readings are in a sample, forces last."""

    learned: LearnedMap
    read: list[int]

    @property
    def shape(self) -> Shape:
        """The shape of its map."""
        return Shape.of(self.learned)

    def hypotheses(self, read: VectorNode, earlier: VectorNode) -> dict[str, VectorNode]:
        """Return what may be wrong in words → what the readings would be without it.

        Args:
            read: the readings.
            earlier: those `LATE` before.
        """
        names = self.learned.channels
        hypotheses = dict[str, VectorNode]()
        for i, j in combinations(range(len(names)), 2):
            order = list(range(len(self.read)))
            order[i], order[j] = j, i
            hypotheses[f"{names[i]} and {names[j]} look exchanged"] = read[order]
        for k, name in enumerate(names):
            hypotheses[f"{name} looks late"] = ca.vertcat(earlier[:k], read[k], earlier[k + 1 :])
        for k, name in enumerate(names):
            turned = ca.vertcat(read[:k], -read[k], read[k + 1 :])
            hypotheses[f"{name} looks as if its sign were wrong"] = turned
        return hypotheses

    @cached_property
    def suspicions(self) -> list[str]:
        """What may be wrong, in words."""
        return [*self.hypotheses(*[ca.MX(len(self.read), 1)] * 2)]

    @property
    def memory(self) -> Layout:
        """What is remembered: by the features; `MEANS`; of the hypotheses, whose turn is next, what
        their features remember, how long ago they were asked [s], negative before, and the
        evidence for them beside free motion, and beside a touch; and the readings before, with the
        time since the last of them [s].
        """
        count = len(self.suspicions)
        size = self.shape.memory.size
        return Layout(
            features=size,
            means=len(AVERAGED),
            time=1,
            turn=1,
            supposed=(size, count),
            since=count,
            evidence=count,
            beside_touch=count,
            clock=1,
            kept=(len(self.read), KEPT + 1),
        )

    def compared(
        self, was: VectorNode, first: VectorNode, dt: VectorNode, read: VectorNode, mask: VectorNode
    ) -> tuple[VectorNode, VectorNode, VectorNode, VectorNode]:
        """Return T² of the forces and its spread, see `forces_function`, by how much of its range
        each position is beyond all logs, and what the features remember.
        """
        shape = self.shape
        positions = read[: shape.channels]
        given = mask[: shape.channels]
        begun = begun_by(self.learned, positions, given)
        was += first * (begun - was)
        count = len(self.learned.joints)
        square, spread, left = forces_function(shape, count)(
            was, dt, positions, given, read[shape.channels :], forces_parameters(self.learned)
        )
        low, high = (ca.DM([end[side] for end in self.learned.reach.values()]) for side in (0, 1))
        away = ca.fmax(ca.fmax(low - positions, positions - high), 0) / (high - low)
        return square, spread, away * given, left

    def supposed(
        self,
        was: Mapping[str, VectorNode],
        came: Mapping[str, VectorNode],
        read: VectorNode,
        mask: VectorNode,
        compared: tuple[VectorNode, VectorNode, VectorNode],
        judged: VectorNode,
    ) -> dict[str, VectorNode]:
        """Return what is remembered of the hypotheses, of which each sample asks one; `compared`
        is what `compared` returns of it as it is read.
        """
        dt = came["dt"]
        # until each sensor has been read there is nothing to compare
        begins = ca.logic_or(came["first"], was["turn"] < 0)
        clock = ca.if_else(begins, 0, was["clock"] + dt)
        is_next = ca.logic_and(clock + dt / 2 >= LATE / KEPT, _every(mask))
        kept = ca.if_else(begins, ca.horzcat(*[read] * (KEPT + 1)), was["kept"])
        kept = ca.if_else(is_next, ca.horzcat(read, kept[:, :-1]), kept)
        clock = ca.if_else(is_next, 0, clock)
        earlier = kept[:, -1] + ca.fmin(clock * KEPT / LATE, 1) * (kept[:, -2] - kept[:, -1])
        count = len(self.suspicions)
        readings = ca.horzcat(*self.hypotheses(read, earlier).values())
        turn = ca.if_else(begins, 0, was["turn"])
        chosen = ca.DM(range(count)) == turn
        since = ca.if_else(begins, -1, was["since"])
        age = ca.dot(chosen, since)
        waited = ca.fmax(age, 0) + dt
        *theirs, left = self.compared(
            ca.mtimes(was["supposed"], chosen),
            age < 0,
            waited,
            ca.mtimes(readings, chosen),
            mask,
        )
        # a pose tells one thing, however long it is held: as much as a way of one std tells
        scale = ca.DM(self.learned.arrays["scale"][: self.shape.channels])
        way = _any(ca.fabs(read - earlier)[: self.shape.channels] / scale) * waited / LATE
        spans = ca.fmin(ca.fmin(waited / INDEPENDENT, way), 1) * (age >= 0) * judged
        square, *beside = compared
        evidence = dict[str, VectorNode]()
        # a touch makes forces MOST times as uncertain: as they are read they cost no more
        touched = ca.fmin(square, self.learned.normal[-1] + np.log(MOST))
        for name, own in (("evidence", square), ("beside_touch", touched)):
            gain = _cost(own, *beside) - _cost(*theirs)
            total = ca.if_else(begins, 0, was[name])
            total += chosen * spans * gain * len(self.learned.joints) / 2
            evidence[name] = ca.fmin(ca.fmax(total, np.log(LATER)), -np.log(LATER))
        waits = ca.logic_and(begins, _every(mask) < 1)
        changed = left - ca.mtimes(was["supposed"], chosen)
        return {
            "turn": ca.if_else(waits, -1, ca.if_else(turn + 1 < count, turn + 1, 0)),
            "supposed": was["supposed"] + ca.mtimes(changed, chosen.T),
            "since": ca.if_else(chosen, 0, ca.if_else(since < 0, since, since + dt)),
            **evidence,
            "clock": clock,
            "kept": kept,
        }


def _cost(square: VectorNode, spread: VectorNode, beyond: VectorNode) -> VectorNode:
    """Return −2 ln of the likelihood of a sample for each force, but a constant: a position that is
    a whole range beyond the logs is as unlikely as any force.
    """
    return ca.fmin(square + MOST * _any(beyond), MOST) + spread


def _every(flags: VectorNode) -> VectorNode:
    return reduce(ca.fmin, ca.vertsplit(flags))


def _any(flags: VectorNode) -> VectorNode:
    return reduce(ca.fmax, ca.vertsplit(flags))


MEANS = Layout(means=len(AVERAGED), time=1)
"""Means of T² of a part, and for how long it has been compared [s]. Source: definition (layout of a
vector).
"""


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
