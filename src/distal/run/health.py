"""The health of a stream: one function, which Python, C, the lab and FMUs share, says in one word
what is wrong with a sample; `Monitor` skips or bridges samples that are late, missing, dead or
contradictory.

The function remembers ages and means from sample to sample. Its limits stand here, but for those
that the filter uses too (`dead_after`).
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from itertools import compress
from math import degrees, inf, isfinite, isnan, nan
from pathlib import Path
from typing import Literal, TypeAlias

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.confidence import LARGE_PRIOR
from distal.errors import EstimationError
from distal.estimators import LARGEST_ANGLE, SHORTEST, TOUCHED, KernelEstimator, sample_problem
from distal.estimators.estimator_protocol import DEAD, dead_after
from distal.expressions import Scalar, Vector
from distal.kernels import Evaluation, Layout
from distal.logs import LARGEST_READING, Log, Remark
from distal.logs.stamps import REWOUND
from distal.regression import MOST
from distal.rig import (
    FAR,
    RangeEnd,
    Rig,
    Role,
    measurand_of,
    position_range,
    range_ends,
    step_of,
)
from distal.run.exchanged_or_late import Redundancy
from distal.run.live_estimator import LATEST, JointAngles, JointContact, LiveEstimator, Remembered
from distal.run.offline import priors_of

Health = Literal[
    "ok",
    "untested",
    "missing",
    "gap",
    "outside",
    "touched",
    "disagrees",
    "dead",
    "restarted",
    "late",
    "duplicate",
    "bad",
]

HEALTH: dict[Health, str] = {
    "ok": "all sensors were read, and are as in the logs from which the rig was learned",
    "untested": "all sensors were read and none disagrees, but no log has said what is normal, or "
    "no sensor is compared",
    "missing": "a sensor has no value for longer than its own interval; it is bridged",
    "gap": "samples are missing before this one; they are bridged",
    "outside": "a position is where none of the logs has been from which the rig was learned",
    "touched": "forces are not those of free motion: something touches a joint, or a sensor is "
    "wrong",
    "disagrees": "a sensor is not where it can be, its innovations are too large, the members of "
    "a blend differ too much, or a number of the rig left its prior: do not trust the band",
    "dead": f"a sensor has had no value, or always the same one, for {DEAD:g} s or more",
    "restarted": "the clock jumped, or the filter left all bounds: it begins anew with this sample",
    "late": "the stamp is older than the last one's; skipped, no estimate",
    "duplicate": "the stamp is the last one's; skipped, no estimate",
    "bad": "this is no sample; skipped, no estimate",
}
"""Each health word and its meaning. Where several apply, the last one in this order is reported."""

HURRIED = 1000**-0.5
"""Share of the rig's nominal interval below which the unit of time is probably wrong [1]: half way,
in logarithms, from s to ms. Source: definition.
"""

ROUNDING = 1e-9
"""Possible error of an age [s]. Source: rounding (an age is a sum of intervals)."""

NEVER = 1e30
"""An age that no sensor reaches [s], used as infinity: C has none without a header. Source:
definition (of the exported C).
"""


LONGEST_GAP = 1.5
"""Longest time without samples, or with samples without any value, after which drives are taken to
have gone straight to where they are read again [s]. After a longer one without samples, and longer
than three nominal intervals, the filter begins anew. Source: judgement.
"""

WAITING = 1.5
"""Usual intervals without a sample after which there is a gap [1]. Source: judgement."""

OVERDUE = 2.5
"""A sensor's own intervals without a value after which it is missing [1]. Source: judgement."""

AVERAGED = 1.0
"""Time constant of the mean of ν²/S, and of the share of time beyond the stops [s]. Source:
definition (a second).
"""

LARGE = 2.5
"""Mean of ν²/S beyond which a sensor disagrees [1], where no log has taught what forces are normal.
Source: judgement.
"""

UNKNOWN = 1.0
"""Std beyond which the angle is not known [rad]. Source: definition (a radian)."""

LOST = 0.35
"""Std above which nothing is controlled with an angle [rad]. Source: judgement."""

ANYWHERE = 0.5
"""Std of the joint's angle where the filter begins anew [rad]. Source: judgement."""

NEAR = 2.0
"""Distance before the end of its range from which on a joint counts as being there [deg]. Source:
judgement.
"""

AWAY = 10.0
"""Distance beyond which it has left it [deg]. Source: judgement."""


def word_code(word: Health) -> int:
    """Return the position of a word in the order of `HEALTH`."""
    return list(HEALTH).index(word)


Judgement: TypeAlias = tuple[dict[str, Vector], dict[str, Vector]]
"""What is remembered after a sample, and what was found, by the names of the layouts."""


class Watch:
    """The function that judges the samples of an estimator, and the layouts of its vectors. Each
    part of it is a function of memory and sample by name.

    Args:
        estimator: whose samples they are.
    """

    def __init__(self, estimator: KernelEstimator) -> None:
        self.estimator = estimator
        by_name = {sensor.name: sensor for sensor in estimator.rig.sensors}
        self.sensors = [by_name[name] for name in estimator.channels]
        self.redundancy = Redundancy.of(estimator.rig, estimator.channels)
        """What positions say of forces."""
        # of what logs taught, they say where it may be and how often it repeats itself
        self.ends = [
            end
            for end in range_ends(estimator.rig, estimator.channels)
            if estimator.channels[end.position] not in self.redundancy.positions
        ]
        """Ends of the ranges of motors whose joints have stops."""

    @cached_property
    def _roles(self) -> list[Role]:
        return [measurand_of(sensor).role for sensor in self.sensors]

    @property
    def placed(self) -> tuple[int, ...]:
        """Indices of the channels that are positions of drives."""
        return tuple(i for i, role in enumerate(self._roles) if role is Role.POSITION)

    @property
    def _is_untaught(self) -> bool:
        """Whether no log said what is normal: innovations may be too large, but never right."""
        return not self.redundancy.maps

    @cached_property
    def watched(self) -> tuple[int, ...]:
        """Indices of the states that are parameters of the rig. Those of a fitted rig that lacks
        physics stray without end; its forces are tested instead.
        """
        means, stds = priors_of(self.estimator)
        tested = (stds > 0.0) & self._is_untaught
        return tuple(np.flatnonzero(np.isfinite(means) & tested).tolist())

    @cached_property
    def memory(self) -> Layout:
        """Layout of what is remembered. For each channel: its last value, its age, and for how long
        it has been the same. For each drive's position: the share of time beyond its range. For
        each compared sensor: the mean ν²/S. The pace of the stamps. For each of the `ends`, in the
        current visit: its furthest reading, and how far the joint was beyond it [deg]. Then that of
        the `exchanged_or_late`.
        """
        n = len(self.sensors)
        return Layout(
            last=n,
            age=n,
            same=n,
            outside=len(self.placed),
            ratio=len(self.estimator.measured),
            pace=1,
            furthest=len(self.ends),
            found=len(self.ends),
            learned=self.redundancy.memory,
        )

    @cached_property
    def sample(self) -> Layout:
        """Layout of the input: whether it is the first sample, dt, values and mask of the channels,
        stds of the angles, innovations, their mask and their variances, the watched states and
        their variances, and the largest probability that a joint is touched.
        """
        n = len(self.sensors)
        m = len(self.estimator.measured)
        return Layout(
            first=1,
            dt=1,
            values=n,
            mask=n,
            stds=len(self.estimator.rig.joints),
            innovations=m,
            compared=m,
            variances=m,
            watched=len(self.watched),
            watched_variances=len(self.watched),
            touched=1,
        )

    @cached_property
    def subjects(self) -> dict[str, Sequence[str]]:
        """Finding → the sensors, states or sentences that it may be about."""
        channels = self.estimator.channels
        states = self.estimator.state_names
        measured = self.estimator.measured
        return {
            "gap": ["samples"],
            "hurried": ["samples"],
            "nothing": ["all sensors"],
            "untested": ["no log has said what is normal" if measured else "no sensor is compared"],
            "unknown": ["the angle is not known"],
            "touched": ["something touches a joint"],
            "outside": self.redundancy.positions,
            "unlike": self.redundancy.parts,
            "dead": channels,
            "stuck": channels,
            "missing": channels,
            "wrong": [channels[i] for i in self.placed],
            "beyond": [end.motor for end in self.ends],
            "large": measured,
            "left": [states[i] for i in self.watched],
        }

    @cached_property
    def findings(self) -> Layout:
        """Layout of the output: the code of the reported word, then 1 where a finding holds, for
        each of its `subjects`. For each of the `ends` it is by how much the joint is beyond it
        [deg].
        """
        return Layout(code=1, **{name: len(of) for name, of in self.subjects.items()})

    def begun(self) -> Floats:
        """Return the memory before the first sample: means are 1, no end was visited, all else is
        0.
        """
        memory = np.zeros(self.memory.size)
        memory[self.memory["ratio"]] = 1.0
        memory[self.memory["furthest"]] = -NEVER
        return memory

    def function(self) -> ca.Function:
        """Return the function (memory, sample) → (memory⁺, findings)."""
        size = self.memory.size - self.redundancy.memory
        before = ca.SX.sym("memory", size)
        current = ca.SX.sym("sample", self.sample.size)
        # what the redundancy says
        judgements = {
            name: ca.SX.sym(name, len(self.subjects[name])) for name in ("unlike", "outside")
        }
        was = self.memory.parts(ca.vertcat(before, ca.SX.zeros(self.redundancy.memory)))
        came = self.sample.parts(current)
        remembered: dict[str, Vector] = {"learned": ca.SX(0, 1)}
        flags: dict[str, Vector] = {**judgements}
        for part in (
            self._silent,
            self._misplaced,
            self._contradicting,
            self._paced,
            self._ended,
        ):
            after, flagged = part(was, came)
            remembered |= after
            flags |= flagged
        words = {finding: word for finding, (word, _) in SAID.items()}
        if not self.ends:
            del words["beyond"]
        code = reduce(
            ca.fmax, (word_code(word) * _any(flags[name]) for name, word in words.items())
        )
        outputs = [
            ca.vertcat(*(remembered[name] for name in self.memory.names)),
            self.findings.joined(code=code, **flags | {"beyond": remembered["found"]}),
        ]
        inputs = [before, current, *(judgements.values() if self.redundancy.maps else [])]
        judged = ca.Function("judged", inputs, ca.cse(outputs))
        return self.redundancy.around(judged, self.sample)

    def _share(self, dt: Scalar) -> Scalar:
        """Return the share with which a sample counts in a mean."""
        is_usual = ca.logic_and(dt > 0, dt < LONGEST_GAP)
        since = ca.if_else(is_usual, dt, self.estimator.interval)
        return ca.fmin(since / AVERAGED, 1)

    def _silent(self, was: Mapping[str, Vector], came: Mapping[str, Vector]) -> Judgement:
        """Return which sensors are missing, dead or stuck."""
        first, dt, mask = (came[name] for name in ("first", "dt", "mask"))
        # a known angle, which homes, is never missing
        is_read = [role is not Role.REFERENCE for role in self._roles]
        overdue = _column([OVERDUE / sensor.rate for sensor in self.sensors])
        silence = _column([dead_after(sensor) for sensor in self.sensors]) - ROUNDING
        # a sensor without a first value is missing from the beginning
        age = ca.if_else(mask, 0, ca.if_else(first, 1.01 * overdue, was["age"] + dt))
        moved = ca.logic_or(first, ca.logic_and(mask, came["values"] != was["last"]))
        same = ca.if_else(moved, 0, was["same"] + dt)
        # a sensor with noise does not say the same twice for long
        taught = self.redundancy.positions
        noisy = [s.noise > step_of(s) and s.name not in taught for s in self.sensors]
        dead = _column(is_read) * (age >= silence)
        last = ca.if_else(mask, came["values"], was["last"])
        return {"last": last, "age": age, "same": same}, {
            "nothing": ca.logic_not(_any(mask)),
            "missing": ca.logic_and(_column(is_read) * (age > overdue), ca.logic_not(dead)),
            "dead": dead,
            "stuck": _column(noisy) * _column(is_read) * mask * (same >= silence),
        }

    def _misplaced(self, was: Mapping[str, Vector], came: Mapping[str, Vector]) -> Judgement:
        """Return which positions are where drives cannot be."""
        rig = self.estimator.rig
        at = list(self.placed)
        ranges = [position_range(rig, self.sensors[i]) for i in at]
        low, high = (_column([ends[side] for ends in ranges]) for side in (0, 1))
        position = came["values"][at]
        read = came["mask"][at]
        is_outside = read * ca.logic_or(position < low, position > high)
        outside = was["outside"] + self._share(came["dt"]) * (is_outside - was["outside"])
        far = read * (ca.fabs(position - (low + high) / 2) > FAR * (high - low))
        return {"outside": outside}, {"wrong": ca.logic_or(outside > 0.5, far)}

    def _contradicting(self, was: Mapping[str, Vector], came: Mapping[str, Vector]) -> Judgement:
        """Return which innovations are too large, which numbers of the rig left their priors,
        whether a joint is touched, and whether its angle is unknown.
        """
        # a touch is no disagreement, since the filter follows it
        square = ca.fmin(came["innovations"] ** 2 / came["variances"], MOST)
        is_touched = came["touched"] > TOUCHED
        square = ca.if_else(is_touched, ca.fmin(square, 1), square)
        change = self._share(came["dt"]) * (square - was["ratio"])
        ratio = was["ratio"] + ca.if_else(came["compared"], change, 0)
        prior, std = (_column(part[list(self.watched)]) for part in priors_of(self.estimator))
        away = ca.fabs(came["watched"] - prior) - ca.sqrt(ca.fmax(came["watched_variances"], 0))
        is_unknown = _any(came["stds"] > UNKNOWN)
        return {"ratio": ratio}, {
            "untested": ca.SX(self._is_untaught),
            "unknown": ca.logic_and(ca.logic_not(came["first"]), is_unknown),
            "touched": is_touched * self._is_untaught,
            "large": (ratio > LARGE) * self._is_untaught,
            "left": away > LARGE_PRIOR * std,
        }

    def _paced(self, was: Mapping[str, Vector], came: Mapping[str, Vector]) -> Judgement:
        """Return whether samples are missing before this one, or come too fast. Stamps of another
        rate than the rig's are no gaps; before the first interval the pace is 0.
        """
        interval = self.estimator.interval
        first, dt = (came[name] for name in ("first", "dt"))
        usual = ca.if_else(was["pace"] > 0, was["pace"], ca.fmax(dt / interval, 1))
        change = ca.fmin(dt / interval, 2 * usual) - usual
        share = ca.fmin(ca.fmax(dt, interval) / AVERAGED, 1)
        pace = ca.if_else(first, was["pace"], usual + share * change)
        late = dt > WAITING * interval * ca.fmax(usual, 1)
        return {"pace": pace}, {
            "gap": ca.logic_and(ca.logic_not(first), late),
            "hurried": ca.logic_and(ca.logic_not(first), pace < HURRIED),
        }

    def _ended(self, was: Mapping[str, Vector], came: Mapping[str, Vector]) -> Judgement:
        """Return by how much joints are beyond the ends of their ranges."""
        visits = [
            _at_end(end, was["furthest"][k], was["found"][k], came["values"], came["mask"])
            for k, end in enumerate(self.ends)
        ]
        furthest, sizes = (
            ca.vertcat(ca.SX(0, 1), *(visit[part] for visit in visits)) for part in (0, 1)
        )
        return {"furthest": furthest, "found": sizes}, {"beyond": sizes > 0}


def _at_end(
    end: RangeEnd, furthest: Scalar, found: Scalar, values: Vector, mask: Vector
) -> tuple[Scalar, Scalar]:
    """Return the furthest reading of this visit to an end, and how much further the joint is than
    it can be [deg], or 0.

    The stretch of the tendon by its torque is subtracted. Only readings on the way to the end
    count: on the way back friction hides the tendon's tension.
    """
    read = mask[end.position] * mask[end.torque]
    reading = end.way * values[end.position]
    before = degrees(end.joint) * (reading - end.contact)
    further = ca.logic_and(read, ca.logic_and(before > -NEAR, reading > furthest + end.same))
    over = before - degrees(end.joint * end.give) * ca.fabs(values[end.torque])
    found = ca.if_else(ca.logic_and(further, over > degrees(end.room)), ca.fmax(found, over), found)
    left = ca.logic_and(read, before < -AWAY)
    furthest = ca.if_else(further, reading, furthest)
    return ca.if_else(left, -NEVER, furthest), ca.if_else(left, 0, found)


SAID: dict[str, tuple[Health, str]] = {
    "untested": ("untested", "{names}"),
    "missing": ("missing", "{names}"),
    "nothing": ("missing", "{names}"),
    "gap": ("gap", "{size:.3g} s; the rig says every {interval:.3g} s"),
    "outside": ("outside", "{names} is where no log has been{jumped}"),
    "touched": ("touched", "{names}"),
    "unlike": ("touched", "not as in free motion: {names}; {cause}"),
    "beyond": ("disagrees", "{each}"),
    "hurried": (
        "disagrees",
        "samples {size:.3g} s apart, the rig says {interval:.3g} s: unit of time?",
    ),
    "wrong": ("disagrees", "{names} is where its drive cannot be: wrong unit, zero or side?"),
    "large": ("disagrees", "{each}"),
    "left": ("disagrees", "{names}: further from the rig's value than its std allows"),
    "unknown": ("disagrees", "{names}"),
    "stuck": ("dead", "{names} does not change"),
    "dead": ("dead", "{names} for {size:.3g} s"),
}
"""Finding → the health word that reports it, and a sentence."""

EACH = {
    "beyond": "{} goes {:.1f}° beyond its joint's range: its spool slipped, or a tendon loosened "
    "or broke",
    "large": "{} {:.1f}x",
}
"""Finding → what is said of each of its subjects."""

OF_DRIVES = ("beyond", "wrong", "large", "dead", "stuck")
"""Findings on drives and their sensors."""


def _column(values: Sequence[float] | Floats) -> Vector:
    return ca.DM(np.asarray(values, dtype=np.float64).reshape(-1, 1))


def _any(flags: Vector) -> Scalar:
    """Return 1 where at least one flag is set, else 0."""
    return reduce(ca.fmax, ca.vertsplit(flags), ca.SX(0)) if flags.numel() else ca.SX(0)


OF_REMARKS: dict[str, Health] = {
    "turn": "restarted",
    "unknown turn": "restarted",
    "restarted": "restarted",
    "repeated": "missing",
    "full": "missing",
}
"""What the conversion did with a reading → the health word that reports it."""

UNUSABLE = frozenset({"bad", "dead"})
"""The health words of readings with which nothing is controlled."""


@dataclass(frozen=True)
class Reading(JointAngles):
    """The estimate at one sample of a stream, and its health.

    Args:
        time: stamp of the sample [s].
        angles: of the joints [rad], (n_joints,); NaN where the sample was skipped.
        angle_stds: standard deviations of their errors [rad], (n_joints,).
        health: one word of `HEALTH`.
        detail: which sensor, for how long; may be empty.
        torques: external torques [N m] on the joints that may be touched; NaN where the sample was
            skipped.
        torque_stds: standard deviations of their errors [N m].
        contacts: whether something touches each joint that may be touched.
        doubted: drives of which a sensor is dead, stuck or wrong, or whose forces or ends are not
            those of the rig.
    """

    time: float
    angles: tuple[float, ...]
    angle_stds: tuple[float, ...]
    health: Health
    detail: str = ""
    torques: tuple[float, ...] = ()
    torque_stds: tuple[float, ...] = ()
    contacts: tuple[JointContact, ...] = ()
    doubted: tuple[str, ...] = ()

    @property
    def unusable(self) -> str:
        """Why a controller must not use this reading; empty where all angles are known well."""
        if isnan(self.angles[0]):
            return f"no angle: {self.health}"
        lost = f"the angle is not known to ±{np.rad2deg(2 * LOST):.0f}°"
        if self.health in UNUSABLE:
            return self.detail or lost
        return "" if max(self.angle_stds) <= LOST else lost


class Monitor:
    """Feeds a stream to a `LiveEstimator` and judges its health; no sample can make it raise an
    error.
    """

    def __init__(self, live: LiveEstimator) -> None:
        self._live = live
        self._watch = watch = Watch(live.estimator)
        self._check = Evaluation(watch.function())
        self._sample = np.zeros(watch.sample.size)
        self._came = {name: self._sample[watch.sample[name]] for name in watch.sample.names}
        self._begin()

    def _begin(self) -> None:
        self._memory = self._watch.begun()
        self._doubted: tuple[str, ...] = ()
        self._late = 0
        self._last_late = -inf
        self._time = -inf
        self._fresh = True
        self._anew = ""
        self._before: Remembered | None = None

    def reset(self) -> None:
        """Forget everything, also the estimator's belief: the next sample is the first."""
        self._live.reset()
        self._begin()

    def clone(self, live: LiveEstimator) -> Monitor:
        """Return a monitor with the same memory for `live`, a clone of its estimator."""
        other = Monitor(live)
        vars(other).update(self._remembered())
        return other

    def __reduce__(self) -> tuple[object, ...]:
        """Return how to make this monitor again, also in another process: its estimator and its
        memory.
        """
        return Monitor, (self._live,), self._remembered()

    def _remembered(self) -> dict[str, object]:
        names = ("_anew", "_before", "_fresh", "_late", "_last_late", "_memory", "_time")
        return {name: getattr(self, name) for name in names}

    @property
    def rig(self) -> Rig:
        """The description of the rig that the estimator runs on."""
        return self._live.rig

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample."""
        return self._live.channels

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the estimated external torques, one for each joint that may be touched."""
        return self._live.torque_names

    @property
    def contact_names(self) -> tuple[str, ...]:
        """Names of the probabilities of a touch: ``contact``, or ``contact_JOINT`` where there are
        several joints.
        """
        joints = self._live.estimator.contacts
        if len(self.rig.joints) == 1:
            return ("contact",) * len(joints)
        return tuple(f"contact_{joint}" for joint in joints)

    def take(self, time: float, sample: Floats, remarks: Sequence[Remark] = ()) -> Reading:
        """Return the reading at a sample: the estimate with its health, or NaN with the reason why
        the sample was skipped.

        Args:
            time: stamp [s].
            sample: values of `channels`, SI, NaN where missing, (n_channels,).
            remarks: what the `RawToSI` did with its readings.
        """
        live = self._live
        if not isinstance(time, (float, int)) or not abs(time) <= LATEST:
            return self._skipped(nan, "bad", "the stamp is no time")
        problem = sample_problem(sample, live.channels)
        if problem is not None:
            return self._skipped(time, "bad", problem)
        problems = [
            (OF_REMARKS[remark.kind], remark.text)
            for remark in remarks
            if remark.kind in OF_REMARKS
        ]
        wild = np.abs(sample) > LARGEST_READING
        if wild.any():
            sample = np.where(wild, nan, sample)
            names = compress(live.channels, wild)
            problems.append(("missing", f"{', '.join(names)} wild"))
        gap = time - self._time
        if isfinite(gap):
            skipped = self._late_or_twice(time)
            if skipped is not None:
                return skipped
            if self._late >= REWOUND:
                self._restart(f"the clock was set back by {-gap:.3g} s")
            elif gap > max(LONGEST_GAP, 3 * live.interval):
                self._restart(
                    f"no sample for {gap:.3g} s; the rig says every {live.interval:.3g} s"
                )
        self._late = 0
        self._last_late = -inf
        if not live.samples and not np.isfinite(sample).any():
            return self._skipped(time, "bad", "the first sample has no value at all")
        self._time = time
        self._keep(time, sample)
        for _ in range(2):  # if the filter diverges, it begins anew with this sample, once
            try:
                live.step(time, sample)
                break
            except EstimationError:
                self._restart("the filter left all bounds")
        else:
            return self._skipped(time, "bad", "the filter leaves all bounds with this sample")
        if self._anew:
            problems.append(("restarted", self._anew))
            self._anew = ""
        problems += self._problems(gap if isfinite(gap) else 0.0, sample)
        health, detail = max(
            problems, key=lambda problem: word_code(problem[0]), default=("ok", "")
        )
        values = live.angles, live.angle_stds, live.external_torques, live.external_torque_stds
        angles, stds, torques, torque_stds = (tuple(of.tolist()) for of in values)
        contacts = self._contacts(problems)
        return Reading(
            time, angles, stds, health, detail, torques, torque_stds, contacts, self._doubted
        )

    def _keep(self, time: float, sample: Floats) -> None:
        """Keep the belief before a sample without any value. It is as after samples that did not
        come: the first value after them goes on from there, and the drives went straight to it.
        """
        live = self._live
        if not np.isfinite(sample).any():
            self._before = self._before or live.belief()
        elif self._before is not None:
            if time - self._before.time <= LONGEST_GAP:
                live.resumed(self._before)
            self._before = None

    def _contacts(self, problems: Sequence[tuple[Health, str]]) -> tuple[JointContact, ...]:
        """Return the contacts of the joints; where logs taught what forces are normal, there are
        none while these are.
        """
        if not self._watch.redundancy.maps or any(word == "touched" for word, _ in problems):
            return self._live.contacts
        return tuple(replace(c, probability=0.0, since=0.0) for c in self._live.contacts)

    def _problems(self, dt: float, sample: Floats) -> list[tuple[Health, str]]:
        """Return what is wrong with a sample that comes `dt` [s] after the one before, as word and
        detail.
        """
        live = self._live
        watch = self._watch
        came = self._came
        came["mask"][:] = np.isfinite(sample)
        came["values"][:] = np.where(came["mask"], sample, 0.0)
        came["compared"][:] = np.isfinite(live.innovations)
        came["innovations"][:] = np.where(came["compared"], live.innovations, 0.0)
        came["variances"][:] = live.innovation_variances
        came["stds"][:] = live.angle_stds
        came["watched"][:] = live.mean[list(watch.watched)]
        came["watched_variances"][:] = np.diagonal(live.covariance)[list(watch.watched)]
        came["touched"][:] = live.touched
        came["first"][:] = self._fresh
        came["dt"][:] = dt
        self._memory, findings = self._check(self._memory, self._sample)
        self._fresh = False
        self._doubted = ()
        if findings[0] == 0:
            return []
        learned = self._memory[watch.memory["learned"]]
        jumped = watch.redundancy.jumped(learned)
        sizes: dict[str, Iterable[float]] = {
            "gap": [dt],
            "hurried": [dt],
            "dead": self._memory[watch.memory["age"]],
            "large": np.sqrt(self._memory[watch.memory["ratio"]]),
            "beyond": findings[watch.findings["beyond"]],
        }
        sayings = {
            "interval": live.interval,
            "jumped": jumped and f"; {jumped}",
            "cause": watch.redundancy.likely_cause(learned, live.interval),
        }
        problems = []
        doubted = set[str]()
        for finding, (word, sentence) in SAID.items():
            flags = findings[watch.findings[finding]]
            if flags.any():
                names = [*compress(watch.subjects[finding], flags)]
                size = [*compress(sizes.get(finding, flags), flags)]
                each = map(EACH.get(finding, "").format, names, size)
                text = sentence.format(
                    names=", ".join(names), each=", ".join(each), size=max(size), **sayings
                )
                problems.append((word, text))
                doubted.update(names if finding in OF_DRIVES else ())
        doubted |= {sensor.of for sensor in self.rig.sensors if sensor.name in doubted}
        self._doubted = tuple(name for name in self.rig.drive_names if name in doubted)
        return problems

    def _skipped(self, time: float, health: Health, detail: str = "") -> Reading:
        """Return a reading without an estimate."""
        angles = (nan,) * len(self._live.rig.joints)
        torques = (nan,) * len(self._live.torque_names)
        contacts = tuple(replace(contact, probability=nan) for contact in self._live.contacts)
        return Reading(time, angles, angles, health, detail, torques, torques, contacts)

    def _late_or_twice(self, time: float) -> Reading | None:
        """Return a reading without an estimate where a stamp does not rise; None where it may go
        on.
        """
        if time - self._time >= SHORTEST:
            return None
        if time >= self._time:
            return self._skipped(time, "duplicate")
        self._late = self._late + 1 if time > self._last_late else 1
        self._last_late = time
        if self._late >= REWOUND:
            return None
        return self._skipped(time, "late", f"{self._time - time:.3g} s")

    def _restart(self, why: str) -> None:
        # where the joint went meanwhile is not known; angles stay within the joint's reach, since
        # beyond it a second angle fits the tendons
        angles = self._live.angles
        has_angles = self._live.samples and bool(np.all(np.abs(angles) <= LARGEST_ANGLE))
        reached = np.clip(angles, *np.transpose([joint.travel for joint in self.rig.joints]))
        self._before = None
        self._live.reset(tuple(reached.tolist()) if has_angles else None, ANYWHERE)
        self._anew = why
        pace = self._watch.memory["pace"]
        memory = self._watch.begun()
        memory[pace] = self._memory[pace]
        self._memory = memory
        self._fresh = True


def log_health(
    log: Log, rig: Rig | str | Path, estimator: str | None = None, compiled: bool = True
) -> tuple[str, ...]:
    """Return the health word that `distal stream` would give to each sample of a log; see `HEALTH`.

    Args:
        log: values of sensors over time; a sensor that is not in the log counts as missing.

    Raises:
        EstimationError: the estimator cannot run on this rig.
    """
    monitor = Monitor(LiveEstimator(rig, estimator, compiled))
    absent = np.full(len(log), np.nan)
    samples = np.column_stack([log.channels.get(name, absent) for name in monitor.channels])
    return tuple(
        monitor.take(float(time), sample).health for time, sample in zip(log.time, samples)
    )
