"""A stream's health: late, missing, dead or contradictory samples are skipped or bridged, and named by one word."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Literal

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import EstimationError
from distal.estimators import LARGEST_ANGLE, SHORTEST, sample_problem
from distal.logs import LARGEST_READING
from distal.results import LARGE_PRIOR, SMALL
from distal.rig import Rig, Sensor, step_of
from distal.run.live import LATEST, LiveEstimator
from distal.run.places import FAR, place_range

Health = Literal["ok", "untested", "missing", "gap", "disagrees", "dead", "restarted", "late", "duplicate", "bad"]

HEALTH: dict[Health, str] = {
    "ok": "all sensors were read, and those that are compared agree",
    "untested": "all sensors were read, and none can disagree: no force is compared, or its innovations are far too small",
    "missing": "a sensor has no value for longer than its own interval; it is bridged",
    "gap": "samples are missing before this one; they are bridged",
    "disagrees": "a sensor is not where it can be, its innovations are too large, or a number of the rig left its prior: "
    "do not trust the band",
    "dead": "a sensor has had no value, or always the same one, for half a second or more",
    "restarted": "the clock jumped, or the filter left all bounds: it begins anew with this sample",
    "late": "the stamp is older than the last one's; skipped, no estimate",
    "duplicate": "the stamp is the last one's; skipped, no estimate",
    "bad": "this is no sample; skipped, no estimate",
}
"""Each word and its meaning. Where several apply, the last one in this order is reported."""

DEAD = 0.5
"""A sensor without a value for so long is dead [s]."""

LONGEST_GAP = 0.5
"""After a longer gap the filter begins anew [s]."""

REWOUND = 3
"""After this many late samples in a row, each newer than the one before, the clock counts as set back."""

ANYWHERE = 0.5
"""Standard deviation of the joint's angle where the filter begins anew [rad]."""

LARGE = 2.5
"""Mean of ν²/S of a sensor beyond which it disagrees."""

MEMORY = 1.0
"""Time over which that mean, and the share of time beyond the stops, is taken [s]."""

UNKNOWN = 1.0
"""Standard deviation of the angle beyond which it is not known [rad]."""

HURRIED = 0.2
"""If intervals are below this share of the rig's nominal interval, the unit of time is probably wrong."""

OVERDUE = 2.5
"""A sensor without a value for longer than this times its own interval is missing."""

CAPPED = 25.0
"""Upper limit of one ν²/S: a single wild value alone does not make a sensor disagree."""


def overdue(sensors: Sequence[Sensor]) -> Floats:
    """Return after which time without a value each sensor is missing [s]; a known angle, which homes, never is."""
    return np.array([inf if sensor.measures == "angle" else OVERDUE / sensor.rate for sensor in sensors])


@dataclass(frozen=True)
class Reading:
    """One estimate of a stream, and its health.

    Args:
        time: stamp of the sample [s].
        angles: of the joints [rad], (n_joints,); NaN where the sample was skipped.
        angle_stds: standard deviations of their errors [rad], (n_joints,).
        health: one word.
        detail: which sensor, how long; may be empty.
        torques: external ones [N m], of each joint that the rig allows to be touched; NaN where the sample was skipped.
        torque_stds: standard deviations of their errors [N m].
    """

    time: float
    angles: tuple[float, ...]
    angle_stds: tuple[float, ...]
    health: Health
    detail: str = ""
    torques: tuple[float, ...] = ()
    torque_stds: tuple[float, ...] = ()

    @property
    def angle(self) -> float:
        """Angle of the one joint [rad].

        Raises:
            EstimationError: there are several.
        """
        return self._only(self.angles, "angle")

    @property
    def angle_std(self) -> float:
        """Standard deviation of its error [rad].

        Raises:
            EstimationError: there are several joints.
        """
        return self._only(self.angle_stds, "angle_std")

    def _only(self, values: tuple[float, ...], name: str) -> float:
        if len(values) != 1:
            raise EstimationError(f"'{name}' is for rigs of one joint, this one has {len(values)}; use '{name}s'")
        return values[0]


class Monitor:
    """Feeds a stream to a `LiveEstimator`; no sample can make it raise an error.

    Args:
        live: the estimator.
    """

    def __init__(self, live: LiveEstimator) -> None:
        self._live = live
        sensors = {sensor.name: sensor for sensor in live.rig.sensors}
        chosen = [sensors[name] for name in live.channels]
        self._overdue = overdue(chosen)
        self._dead = np.maximum(DEAD, 2 * self._overdue)
        # a sensor with noise does not say the same twice for long
        self._noisy = np.array([sensor.noise > step_of(sensor) and sensor.measures != "angle" for sensor in chosen])
        self._ranges = np.array([place_range(live.rig, sensor) for sensor in chosen]).reshape(-1, 2)
        self._reach = np.array([joint.travel for joint in live.rig.joints]).T
        self._seen = np.full(len(chosen), nan)
        self._changed = np.full(len(chosen), nan)
        self._last = np.full(len(chosen), nan)
        self._outside = np.zeros(len(chosen))
        self._ratios = np.ones(len(live.measured))
        self._late, self._last_late, self._time, self._pace = 0, -inf, -inf, 1.0
        self._anew = ""

    @property
    def rig(self) -> Rig:
        """The description."""
        return self._live.rig

    @property
    def torque_names(self) -> tuple[str, ...]:
        """Names of the estimated external torques."""
        return self._live.torque_names

    @property
    def channels(self) -> tuple[str, ...]:
        """Names of the sensors in a sample."""
        return self._live.channels

    def take(self, time: float, sample: Floats) -> Reading:
        """Return the estimate at a sample, or why there is none.

        Args:
            time: stamp [s].
            sample: values of `channels`, SI, NaN where missing, (n_channels,).
        """
        live = self._live
        if not isinstance(time, (float, int)) or not abs(time) <= LATEST:
            return self._skipped(nan, "bad", "the stamp is no time")
        problem = sample_problem(sample, live.channels)
        if problem is not None:
            return self._skipped(time, "bad", problem)
        said: list[tuple[Health, str]] = []
        wild = np.abs(sample) > LARGEST_READING
        if wild.any():
            sample = np.where(wild, nan, sample)
            said.append(("missing", f"{self._names(wild)} wild"))
        gap = time - self._time
        if isfinite(gap):
            skipped = self._late_or_twice(time)
            if skipped is not None:
                return skipped
            if self._late >= REWOUND:
                self._restart(f"the clock was set back by {-gap:.3g} s")
            elif gap > max(LONGEST_GAP, 3 * live.interval):
                self._restart(f"no sample for {gap:.3g} s; the rig says every {live.interval:.3g} s")
            elif gap > 1.5 * live.interval:
                said.append(("gap", f"{gap:.3g} s; the rig says every {live.interval:.3g} s"))
            share = min(live.interval / MEMORY, 1.0) if gap > 0 else 0.0
            self._pace += share * (min(gap / live.interval, 2.0) - self._pace)
            if self._pace < HURRIED:
                said.append(
                    ("disagrees", f"samples {gap:.3g} s apart, the rig says {live.interval:.3g} s: unit of time?")
                )
        self._late, self._last_late = 0, -inf
        if not live.samples and not np.isfinite(sample).any():
            return self._skipped(time, "bad", "the first sample has no value at all")
        before, self._time = self._time, time
        try:
            live.step(time, sample)
        except EstimationError:
            # what led here may be in the belief: begin anew, with this sample
            self._restart("the filter left all bounds")
            try:
                live.step(time, sample)
            except EstimationError:
                self._restart("the filter left all bounds")
                return self._skipped(time, "bad", "the filter leaves all bounds with this sample")
        if self._anew:
            said.append(("restarted", self._anew))
            self._anew = ""
        dt = time - before if 0.0 < time - before < LONGEST_GAP else live.interval
        said += self._sensors(time, sample, min(dt / MEMORY, 1.0))
        said += self._innovations(min(dt / MEMORY, 1.0))
        gone = live.left_priors(LARGE_PRIOR)
        if gone:
            said.append(("disagrees", f"{', '.join(gone)}: further from the rig's value than its std allows"))
        # a filter that has just begun has not yet had what it needs to say so
        if not np.any(self._ratios >= SMALL):
            said.append(("untested", ", ".join(live.measured) or "no sensor is compared"))
        stds = live.angle_stds
        if stds.max() > UNKNOWN and live.samples > 1:
            said.append(("disagrees", "the angle is not known"))
        health, detail = max(said, key=lambda one: list(HEALTH).index(one[0]), default=("ok", ""))
        torques, torque_stds = live.external_torques.tolist(), live.external_torque_stds.tolist()
        return Reading(
            time, tuple(live.angles.tolist()), tuple(stds.tolist()), health, detail, tuple(torques), tuple(torque_stds)
        )

    def _skipped(self, time: float, health: Health, detail: str = "") -> Reading:
        """Return a reading without an estimate."""
        nothing, untouched = (nan,) * len(self._live.rig.joints), (nan,) * len(self._live.torque_names)
        return Reading(time, nothing, nothing, health, detail, untouched, untouched)

    def _late_or_twice(self, time: float) -> Reading | None:
        """Return a reading without an estimate where a stamp does not rise; None where it may go on."""
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
        # where the joint went meanwhile is not known; a tendon's geometry has a second angle beyond what a joint can reach
        angles = self._live.angles
        known = self._live.samples and bool(np.all(np.abs(angles) <= LARGEST_ANGLE))
        reached = np.clip(angles, *self._reach)
        self._live.reset(tuple(reached.tolist()) if known else None, ANYWHERE)
        self._anew = why
        self._seen[:] = self._changed[:] = nan
        self._outside[:] = 0.0
        self._ratios[:] = 1.0

    def _sensors(self, time: float, sample: Floats, share: float) -> list[tuple[Health, str]]:
        """Return which sensors are overdue, dead, stuck, or where their drive cannot be."""
        there = np.isfinite(sample)
        moved = there & (sample != self._last)
        np.copyto(self._last, sample, where=there)
        self._changed[moved | np.isnan(self._changed)] = time
        never = np.isnan(self._seen) & ~there
        self._seen[there | never] = time
        self._seen[never] -= self._overdue[never] * 1.01  # it has not been there at all: overdue from the beginning
        ages, same = time - self._seen, time - self._changed
        dead = ages >= self._dead
        stuck = self._noisy & there & (same >= self._dead)
        said: list[tuple[Health, str]] = []
        if dead.any() or stuck.any():
            names = [f"{self._names(dead)} for {ages[dead].max():.3g} s"] if dead.any() else []
            names += [f"{self._names(stuck)} does not change"] if stuck.any() else []
            said.append(("dead", ", ".join(names)))
        missing = (ages > self._overdue) & ~dead
        if missing.any() or not there.any():
            said.append(("missing", self._names(missing) or "all sensors"))
        outside = there & ((sample < self._ranges[:, 0]) | (sample > self._ranges[:, 1]))
        far = there & (np.abs(sample - self._ranges.mean(axis=1)) > FAR * np.ptp(self._ranges, axis=1))
        self._outside += share * (outside - self._outside)
        wrong = (self._outside > 0.5) | far
        if wrong.any():
            said.append(("disagrees", f"{self._names(wrong)} is where its drive cannot be: wrong unit, zero or side?"))
        return said

    def _innovations(self, share: float) -> list[tuple[Health, str]]:
        """Return which sensors disagree with the filter."""
        live = self._live
        for i in range(len(self._ratios)):
            innovation = live.innovations[i]
            if isfinite(innovation):
                value = float(innovation)
                ratio = min(value * value / float(live.innovation_variances[i]), CAPPED)
                self._ratios[i] += share * (ratio - self._ratios[i])
        large = [i for i, ratio in enumerate(self._ratios) if ratio > LARGE]
        if not large:
            return []
        return [("disagrees", ", ".join(f"{live.measured[i]} {np.sqrt(self._ratios[i]):.1f}x" for i in large))]

    def _names(self, chosen: Bools) -> str:
        return ", ".join(name for name, there in zip(self._live.channels, chosen) if there)
