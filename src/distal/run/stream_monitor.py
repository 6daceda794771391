"""A stream with its health: samples that are late, missing, dead or contradictory are skipped or
bridged, and one word says so.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from dataclasses import dataclass, replace
from math import inf, isfinite, isnan, nan, sqrt
from pathlib import Path

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import EstimationError
from distal.estimators import LARGEST_ANGLE, SHORTEST, sample_problem
from distal.kernels import Evaluation
from distal.logs import LARGEST_READING, Log, Remark
from distal.logs.stamps import REWOUND
from distal.regression import INDEPENDENT
from distal.rig import Rig
from distal.run.health import LIMITS, WORDS, Health, HealthLimits, Watch, begun, watch_of, word_code
from distal.run.live_estimator import LATEST, JointContact, LiveEstimator, Remembered, only
from distal.run.redundancy import AVERAGED

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
        self._jumps = dict[str, float]()
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
        names = ("_anew", "_before", "_fresh", "_jumps", "_late", "_last_late", "_time")
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
        learned = self._memory[watch.memory["learned"]]
        # a jump after which forces are normal was none
        is_normal = not np.any(findings[watch.findings["unlike"]])
        least = self._time - AVERAGED[0] if is_normal else -inf
        doubts = watch.redundancy.remembered(learned, "doubt")
        now = {name: self._time - doubt for name, doubt in doubts.items() if doubt > 0.0}
        self._jumps = {n: at for n, at in (self._jumps | now).items() if at >= least}
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
        """Return the position that jumped last, in words; empty where none did."""
        if not self._jumps:
            return ""
        last = max(self._jumps, key=self._jumps.__getitem__)
        return f"{last} jumped {self._time - self._jumps[last]:.2g} s ago"

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
