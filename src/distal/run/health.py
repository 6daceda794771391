"""The health of a stream as one function, which Python, C, the lab and FMUs share: what is wrong
with a sample.

The function remembers ages and means from sample to sample. Its limits stand here, but for those
that the filter uses too (`dead_after`).

A stream with its health: samples that are late, missing, dead or contradictory are skipped or
bridged, and one word says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import reduce
from math import degrees, inf, isfinite, isnan, nan, sqrt
from pathlib import Path
from typing import Literal

import casadi as ca
import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import LARGE_PRIOR
from distal.errors import EstimationError
from distal.estimators import LARGEST_ANGLE, SHORTEST, TOUCHED, KernelEstimator, sample_problem
from distal.estimators.estimator_protocol import DEAD, dead_after
from distal.expressions import Scalar, Vector
from distal.kernels import Evaluation, Layout
from distal.logs import LARGEST_READING, Log, Remark
from distal.logs.stamps import REWOUND
from distal.regression import INDEPENDENT, MOST
from distal.rig import FAR, RangeEnd, Rig, Role, measurand_of, position_range, range_ends, step_of
from distal.run.live_estimator import LATEST, JointContact, LiveEstimator, Remembered, only
from distal.run.offline import priors_of
from distal.run.redundancy import Redundancy

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


@dataclass(frozen=True, kw_only=True)
class HealthLimits:
    """What a `Monitor` says a word about; exported filters have the defaults.

    Args:
        longest_gap: longest time without samples, or with samples without any value, after which
            drives are taken to have gone straight to where they are read again [s]. After a longer
            one without samples, and longer than three nominal intervals, the filter begins anew.
        waiting: usual intervals without a sample after which there is a gap [1].
        overdue: a sensor's own intervals without a value after which it is missing [1].
        memory: time constant of the mean of ν²/S, and of the share of time beyond the stops [s].
        large: mean of ν²/S beyond which a sensor disagrees [1], where no log has taught what forces
            are normal.
        unknown: std beyond which the angle is not known [rad].
        lost: std above which nothing is controlled with an angle [rad].
        anywhere: std of the joint's angle where the filter begins anew [rad].
        near: distance before the end of its range from which on a joint counts as being there
            [deg].
        away: distance beyond which it has left it [deg].
    """

    longest_gap: float = 1.5
    waiting: float = 1.5
    overdue: float = 2.5
    memory: float = 1.0
    large: float = 2.5
    unknown: float = 1.0
    lost: float = 0.35
    anywhere: float = 0.5
    near: float = 2.0
    away: float = 10.0


LIMITS = HealthLimits()


@dataclass(frozen=True)
class Watch:
    """The function that judges the samples of an estimator, and the layouts of its vectors.

    Args:
        memory: layout of what is remembered. For each channel: its last value, its age, and for how
            long it has been the same. For each drive's position: the share of time beyond its
            range. For each compared sensor: the mean ν²/S. The pace of the stamps. For each of the
            `ends`, in the current visit: its furthest reading, and how far the joint was beyond it
            [deg]. Then that of the `redundancy`.
        sample: layout of the input: whether it is the first sample, dt, values and mask of the
            channels, stds of the angles, innovations, their mask and their variances, the watched
            states and their variances, and the largest probability that a joint is
            touched.
        findings: layout of the output: the code of the reported word, then 1 where a finding holds:
            gap, hurried, nothing read, untested, unknown, touched by the filter; for each position
            that predicts forces outside, for each part's forces unlike; for each
            channel dead, stuck, missing; for each position wrong; for each compared sensor large;
            for each watched state left. For each of the `ends` it is by how much the joint is
            beyond it [deg].
        placed: indices of the channels that are positions of drives.
        ends: ends of the ranges of motors whose joints have stops.
        watched: indices of the states that are parameters of the rig.
        redundancy: what positions say of forces.
        function: (memory, sample) → (memory⁺, findings).
    """

    memory: Layout
    sample: Layout
    findings: Layout
    placed: tuple[int, ...]
    ends: tuple[RangeEnd, ...]
    watched: tuple[int, ...]
    redundancy: Redundancy
    function: ca.Function


def begun(watch: Watch) -> Floats:
    """Return the memory before the first sample: means are 1, no end was visited, all else is 0."""
    memory = np.zeros(watch.memory.size)
    memory[watch.memory["ratio"]] = 1.0
    memory[watch.memory["furthest"]] = -NEVER
    return memory


def word_code(word: Health) -> int:
    """Return the position of a word in the order of `HEALTH`."""
    return list(HEALTH).index(word)


def watch_of(estimator: KernelEstimator, limits: HealthLimits = LIMITS) -> Watch:
    """Return the function that judges the samples of an estimator, with its layouts."""
    sensors = {sensor.name: sensor for sensor in estimator.rig.sensors}
    chosen = [sensors[name] for name in estimator.channels]
    interval = estimator.interval
    no_prior = np.full(len(estimator.state_names), np.nan)
    means, stds = (no_prior if prior is None else prior for prior in priors_of(estimator))
    # of a fitted rig that lacks physics, numbers stray without end; its forces are tested instead
    redundancy = Redundancy.of(estimator.rig, estimator.channels)
    is_untaught = not redundancy.maps
    tested = (stds > 0.0) & is_untaught
    watched = tuple(np.flatnonzero(np.isfinite(means) & tested).tolist())
    roles = [measurand_of(sensor).role for sensor in chosen]
    placed = tuple(i for i, role in enumerate(roles) if role is Role.POSITION)
    # of what logs taught, they say where it may be and how often it repeats itself
    taught = redundancy.positions
    ends = tuple(
        end
        for end in range_ends(estimator.rig, estimator.channels)
        if estimator.channels[end.position] not in taught
    )
    n = len(chosen)
    m = len(estimator.measured)
    j = len(estimator.rig.joints)
    k = len(watched)
    p = len(placed)
    parts = {
        "last": n,
        "age": n,
        "same": n,
        "outside": p,
        "ratio": m,
        "pace": 1,
        "furthest": len(ends),
        "found": len(ends),
    }
    memory = Layout(**parts)
    sample = Layout(
        first=1,
        dt=1,
        values=n,
        mask=n,
        stds=j,
        innovations=m,
        compared=m,
        variances=m,
        watched=k,
        watched_variances=k,
        touched=1,
    )
    findings = Layout(
        code=1,
        gap=1,
        hurried=1,
        nothing=1,
        untested=1,
        unknown=1,
        touched=1,
        outside=len(redundancy.positions),
        unlike=len(redundancy.maps),
        dead=n,
        stuck=n,
        missing=n,
        wrong=p,
        beyond=len(ends),
        large=m,
        left=k,
    )
    before = ca.SX.sym("memory", memory.size)
    current = ca.SX.sym("sample", sample.size)
    unlike = ca.SX.sym("unlike", len(redundancy.maps))
    was = memory.parts(before)
    came = sample.parts(current)
    first = came["first"]
    dt = came["dt"]
    mask = came["mask"]
    since = ca.if_else(ca.logic_and(dt > 0, dt < limits.longest_gap), dt, interval)
    share = ca.fmin(since / limits.memory, 1)
    # a sensor without a first value is missing from the beginning; a known angle, which homes,
    # never is
    overdue = _column(
        [
            NEVER if role is Role.REFERENCE else limits.overdue / s.rate
            for s, role in zip(chosen, roles)
        ]
    )
    silence = _column(
        [NEVER if role is Role.REFERENCE else dead_after(s) for s, role in zip(chosen, roles)]
    )
    age = ca.if_else(mask, 0, ca.if_else(first, 1.01 * overdue, was["age"] + dt))
    moved = ca.logic_or(first, ca.logic_and(mask, came["values"] != was["last"]))
    same = ca.if_else(moved, 0, was["same"] + dt)
    # a sensor with noise does not say the same twice for long
    noisy = _column(
        [
            s.noise > step_of(s) and role is not Role.REFERENCE and s.name not in taught
            for s, role in zip(chosen, roles)
        ]
    )
    dead = age >= silence - ROUNDING
    stuck = noisy * mask * (same >= silence - ROUNDING)
    missing = ca.logic_and(age > overdue, ca.logic_not(dead))
    low, high = (
        _column([position_range(estimator.rig, chosen[i])[end] for i in placed]) for end in (0, 1)
    )
    position = came["values"][list(placed)]
    read = mask[list(placed)]
    outside = was["outside"] + share * (
        read * ca.logic_or(position < low, position > high) - was["outside"]
    )
    far = read * (ca.fabs(position - (low + high) / 2) > FAR * (high - low))
    wrong = ca.logic_or(outside > 0.5, far)
    # a touch is no disagreement, since the filter follows it
    square = ca.fmin(came["innovations"] ** 2 / came["variances"], MOST)
    is_touched = came["touched"] > TOUCHED
    square = ca.if_else(is_touched, ca.fmin(square, 1), square)
    ratio = was["ratio"] + ca.if_else(came["compared"], share * (square - was["ratio"]), 0)
    beyond_logs = redundancy.outside(came["values"], mask)
    prior = _column(means[list(watched)])
    allowed = LARGE_PRIOR * _column(stds[list(watched)])
    left = (
        ca.fabs(came["watched"] - prior) - ca.sqrt(ca.fmax(came["watched_variances"], 0)) > allowed
    )
    # stamps of another rate than the rig's are no gaps; before the first interval the pace is 0
    usual_pace = ca.if_else(was["pace"] > 0, was["pace"], ca.fmax(dt / interval, 1))
    change = ca.fmin(dt / interval, 2 * usual_pace) - usual_pace
    pace = ca.if_else(
        first, was["pace"], usual_pace + ca.fmin(ca.fmax(dt, interval) / limits.memory, 1) * change
    )
    flags: dict[str, Vector] = {
        "gap": ca.logic_and(
            ca.logic_not(first), dt > limits.waiting * interval * ca.fmax(usual_pace, 1)
        ),
        "hurried": ca.logic_and(ca.logic_not(first), pace < HURRIED),
        "nothing": ca.logic_not(_any(mask)),
        # where no log said what is normal, innovations may be too large, but never right
        "untested": ca.SX(is_untaught),
        "unknown": ca.logic_and(ca.logic_not(first), _any(came["stds"] > limits.unknown)),
    }
    flags |= {
        "touched": is_touched * is_untaught,
        "outside": beyond_logs,
        "unlike": unlike,
        "dead": dead,
        "stuck": stuck,
        "missing": missing,
        "wrong": wrong,
        "large": (ratio > limits.large) * is_untaught,
        "left": left,
    }
    visits = [
        _at_end(end, was["furthest"][k], was["found"][k], came["values"], mask, limits)
        for k, end in enumerate(ends)
    ]
    furthest, sizes = (
        ca.vertcat(ca.SX(0, 1), *(visit[part] for visit in visits)) for part in (0, 1)
    )
    flags["beyond"] = sizes > 0
    said = {name: word for name, word in WORDS.items() if name != "beyond" or ends}
    code = reduce(ca.fmax, (word_code(word) * _any(flags[name]) for name, word in said.items()))
    last = ca.if_else(mask, came["values"], was["last"])
    remembered = memory.joined(
        last=last,
        age=age,
        same=same,
        outside=outside,
        ratio=ratio,
        pace=pace,
        furthest=furthest,
        found=sizes,
    )
    outputs = [remembered, findings.joined(code=code, **flags | {"beyond": sizes})]
    inputs = [before, current, *([unlike] if redundancy.maps else [])]
    function = redundancy.around(ca.Function("judged", inputs, ca.cse(outputs)), sample)
    memory = Layout(**parts, learned=redundancy.memory)
    return Watch(memory, sample, findings, placed, ends, watched, redundancy, function)


def _at_end(
    end: RangeEnd,
    furthest: Scalar,
    found: Scalar,
    values: Vector,
    mask: Vector,
    limits: HealthLimits,
) -> tuple[Scalar, Scalar]:
    """Return the furthest reading of this visit to an end, and how much further the joint is than
    it can be [deg], or 0.

    The stretch of the tendon by its torque is subtracted. Only readings on the way to the end
    count: on the way back friction hides the tendon's tension.
    """
    read = mask[end.position] * mask[end.torque]
    reading = end.way * values[end.position]
    before = degrees(end.joint) * (reading - end.contact)
    further = ca.logic_and(read, ca.logic_and(before > -limits.near, reading > furthest + end.same))
    over = before - degrees(end.joint * end.give) * ca.fabs(values[end.torque])
    found = ca.if_else(ca.logic_and(further, over > degrees(end.room)), ca.fmax(found, over), found)
    left = ca.logic_and(read, before < -limits.away)
    return ca.if_else(left, -NEVER, ca.if_else(further, reading, furthest)), ca.if_else(
        left, 0, found
    )


WORDS: dict[str, Health] = {
    "untested": "untested",
    "missing": "missing",
    "nothing": "missing",
    "gap": "gap",
    "outside": "outside",
    "touched": "touched",
    "unlike": "touched",
    "beyond": "disagrees",
    "hurried": "disagrees",
    "wrong": "disagrees",
    "large": "disagrees",
    "left": "disagrees",
    "unknown": "disagrees",
    "stuck": "dead",
    "dead": "dead",
}
"""Finding → the health word that reports it."""


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
class Reading:
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
    def angle(self) -> float:
        """Angle of the joint [rad].

        Raises:
            EstimationError: there are several joints.
        """
        return only(self.angles, "angle")

    @property
    def angle_std(self) -> float:
        """Standard deviation of the error of the joint's angle [rad].

        Raises:
            EstimationError: there are several joints.
        """
        return only(self.angle_stds, "angle_std")

    @property
    def unusable(self) -> str:
        """Why a controller must not use this reading; empty where all angles are known well."""
        if isnan(self.angles[0]):
            return f"no angle: {self.health}"
        lost = f"the angle is not known to ±{np.rad2deg(2 * LIMITS.lost):.0f}°"
        if self.health in UNUSABLE:
            return self.detail or lost
        return "" if max(self.angle_stds) <= LIMITS.lost else lost


class Monitor:
    """Feeds a stream to a `LiveEstimator` and judges its health; no sample can make it raise an
    error.
    """

    def __init__(self, live: LiveEstimator, limits: HealthLimits = LIMITS) -> None:
        self._live = live
        self._limits = limits
        self._watch = watch = watch_of(live.estimator, limits)
        self._drive_of = list(_drives_of_findings(watch, live))
        self._check = Evaluation(watch.function)
        self._sample = np.zeros(watch.sample.size)
        self._came = {name: self._sample[watch.sample[name]] for name in watch.sample.names}
        self._reach = np.array([joint.travel for joint in live.rig.joints]).T
        self._begin()

    def _begin(self) -> None:
        self._memory = begun(self._watch)
        self._findings = np.zeros(self._watch.findings.size)
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
        return _with_memory(live, self._limits, self._remembered())

    def __reduce__(self) -> tuple[object, ...]:
        """Return how to make this monitor again, also in another process: its estimator and its
        memory.
        """
        return _with_memory, (self._live, self._limits, self._remembered())

    def _remembered(self) -> dict[str, object]:
        names = ("_anew", "_before", "_fresh", "_late", "_last_late", "_time")
        return {"_memory": self._memory.copy()} | {name: getattr(self, name) for name in names}

    @property
    def rig(self) -> Rig:
        """The description of the rig that the estimator runs on."""
        return self._live.rig

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

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample."""
        return self._live.channels

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
            problems.append(("missing", f"{self._names(wild)} wild"))
        gap = time - self._time
        if isfinite(gap):
            skipped = self._late_or_twice(time)
            if skipped is not None:
                return skipped
            if self._late >= REWOUND:
                self._restart(f"the clock was set back by {-gap:.3g} s")
            elif gap > max(self._limits.longest_gap, 3 * live.interval):
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
        torques = live.external_torques.tolist()
        torque_stds = live.external_torque_stds.tolist()
        angles = live.angles.tolist()
        stds = live.angle_stds.tolist()
        return Reading(
            time,
            tuple(angles),
            tuple(stds),
            health,
            detail,
            tuple(torques),
            tuple(torque_stds),
            self._contacts(problems),
            self._doubted(),
        )

    def _keep(self, time: float, sample: Floats) -> None:
        """Keep the belief before a sample without any value. It is as after samples that did not
        come: the first value after them goes on from there, and the drives went straight to it.
        """
        live = self._live
        if not np.isfinite(sample).any():
            self._before = self._before or live.belief()
        elif self._before is not None:
            if time - self._before.time <= self._limits.longest_gap:
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
        self._findings = findings.copy()
        self._fresh = False
        if findings[0] == 0:
            return []
        flags = {name: findings[watch.findings[name]] != 0 for name in watch.findings.names}
        details = self._details(flags, dt)
        details["beyond"] = ", ".join(
            f"{end.motor} goes {size:.1f}° beyond its joint's range: its spool slipped, or a "
            "tendon loosened or broke"
            for end, size in zip(watch.ends, findings[watch.findings["beyond"]])
            if size > 0.0
        )
        return [(WORDS[name], details[name]) for name in WORDS if flags[name].any()]

    def _jumped(self) -> str:
        """Return the position that jumped last and may be off, in words; empty where none is."""
        redundancy = self._watch.redundancy
        learned = self._memory[self._watch.memory["learned"]]
        shifts, times = (redundancy.remembered(learned, name) for name in ("shift", "doubt"))
        jumped = [(times[name], name) for name, shift in shifts.items() if shift]
        return "" if not jumped else "{1} jumped {0:.2g} s ago".format(*min(jumped))

    def _likely_cause(self) -> str:
        """Return what forces that are not those of free motion most likely come of, in words."""
        learned = self._memory[self._watch.memory["learned"]]
        repeats = self._watch.redundancy.remembered(learned, "repeats")
        interval = self._live.interval
        same = [name for name, count in repeats.items() if count * interval > INDEPENDENT]
        stuck = f"{', '.join(same)} does not change: is it stuck"
        causes = [
            *self._watch.redundancy.supposed(learned),
            self._jumped(),
            stuck if 0 < len(same) < len(repeats) else "",
            "something touches, or a sensor is wrong",
        ]
        return next(filter(None, causes))

    def _doubted(self) -> tuple[str, ...]:
        """Return the drives that the findings of the last sample are about."""
        names = {drive for at, drive in self._drive_of if self._findings[at] > 0.0}
        return tuple(name for name in self.rig.drive_names if name in names)

    def _details(self, flags: Mapping[str, Bools], dt: float) -> dict[str, str]:
        """Return the sentence on each finding."""
        live = self._live
        watch = self._watch
        interval = self._live.interval
        age, ratio = (self._memory[watch.memory[name]] for name in ("age", "ratio"))
        positions = [
            live.channels[i] for i, is_wrong in zip(watch.placed, flags["wrong"]) if is_wrong
        ]
        dead = f"{self._names(flags['dead'])} for {age.max():.3g} s" if flags["dead"].any() else ""
        stuck = f"{self._names(flags['stuck'])} does not change"
        large = (
            f"{live.measured[i]} {sqrt(ratio[i]):.1f}x" for i in np.flatnonzero(flags["large"])
        )

        def named(finding: str, names: Sequence[str]) -> str:
            return ", ".join(name for name, holds in zip(names, flags[finding]) if holds)

        left = (live.state_names[i] for i, is_left in zip(watch.watched, flags["left"]) if is_left)
        return {
            "untested": "no log has said what is normal"
            if live.measured
            else "no sensor is compared",
            "missing": self._names(flags["missing"]),
            "nothing": "all sensors",
            "outside": f"{named('outside', watch.redundancy.positions)} is where no log has been"
            + (f"; {self._jumped()}" if self._jumped() else ""),
            "touched": "something touches a joint",
            "unlike": f"not as in free motion: {named('unlike', watch.redundancy.parts)}; "
            f"{self._likely_cause()}",
            "gap": f"{dt:.3g} s; the rig says every {interval:.3g} s",
            "hurried": f"samples {dt:.3g} s apart, the rig says {interval:.3g} s: unit of time?",
            "wrong": f"{', '.join(positions)} is where its drive cannot be: wrong unit, "
            "zero or side?",
            "large": ", ".join(large),
            "left": f"{', '.join(left)}: further from the rig's value than its std allows",
            "unknown": "the angle is not known",
            "stuck": f"{dead}, {stuck}" if dead else stuck,
            "dead": dead,
        }

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
        reached = np.clip(angles, *self._reach)
        self._before = None
        self._live.reset(tuple(reached.tolist()) if has_angles else None, self._limits.anywhere)
        self._anew = why
        pace = self._watch.memory["pace"]
        memory = begun(self._watch)
        memory[pace] = self._memory[pace]
        self._memory = memory
        self._fresh = True

    def _names(self, chosen: Bools) -> str:
        return ", ".join(name for name, is_chosen in zip(self._live.channels, chosen) if is_chosen)


def _drives_of_findings(watch: Watch, live: LiveEstimator) -> Iterator[tuple[int, str]]:
    """Yield the index of each finding on a sensor or an end of a drive, and the drive."""
    channels = live.channels
    read = {
        "dead": channels,
        "stuck": channels,
        "wrong": [channels[i] for i in watch.placed],
        "large": live.measured,
    }
    sensors = {sensor.name: sensor.of for sensor in live.rig.sensors}
    drives = {finding: [sensors[name] for name in names] for finding, names in read.items()}
    drives["beyond"] = [end.motor for end in watch.ends]
    for finding, names in drives.items():
        yield from zip(range(watch.findings[finding].start, watch.findings.size), names)


def _with_memory(
    live: LiveEstimator, limits: HealthLimits, remembered: Mapping[str, object]
) -> Monitor:
    monitor = Monitor(live, limits)
    for name, value in remembered.items():
        setattr(monitor, name, copy(value))
    return monitor


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
