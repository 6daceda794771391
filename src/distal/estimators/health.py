"""A stream's health: what is late, missing, dead or contradictory is skipped or bridged, and said in a word."""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, isfinite, nan
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from distal.errors import EstimationError
from distal.estimators.contract import LARGEST_ANGLE
from distal.estimators.live import LiveEstimator

Floats = NDArray[np.float64]
Health = Literal["ok", "missing", "gap", "disagrees", "dead", "restarted", "late", "duplicate", "bad"]

HEALTH: dict[Health, str] = {
    "ok": "all sensors were read and agree",
    "missing": "a sensor has no value for longer than its own interval; it is bridged",
    "gap": "samples are missing before this one; they are bridged",
    "disagrees": "a sensor's innovations are larger than the filter expects: do not trust the band",
    "dead": "a sensor has had no value for half a second; the band grows",
    "restarted": "the clock jumped, or the filter left all bounds: it begins anew with this sample",
    "late": "the stamp is older than the last one's; skipped, no estimate",
    "duplicate": "the stamp is the last one's; skipped, no estimate",
    "bad": "this is no sample; skipped, no estimate",
}
"""Each word, and what it means. Where several hold, the last of this order is said."""

DEAD = 0.5
"""A sensor without a value for so long is dead [s]."""

LONGEST_GAP = 2.0
"""After a longer gap the filter begins anew [s]."""

REWOUND = 3
"""So many late samples in a row, each newer than the one before, are a clock that was set back."""

ANYWHERE = 0.5
"""Standard deviation of the joint's angle where the filter begins anew [rad]."""

LARGE = 4.0
"""Mean of ν²/S of a sensor beyond which it disagrees."""

MEMORY = 0.5
"""Time over which that mean is taken [s]."""

OVERDUE = 2.5
"""A sensor without a value for longer than this times its own interval is missing."""

CAPPED = 25.0
"""One ν²/S counts as at most this much: a single wild value is none of a sensor's habits."""


@dataclass(frozen=True)
class Reading:
    """An estimate of a stream, and how it came about.

    Args:
        time: stamp of the sample [s].
        angle: of the joint [rad]; NaN where the sample was skipped.
        angle_std: standard deviation of its error [rad].
        health: one word.
        detail: which sensor, how long; may be empty.
    """

    time: float
    angle: float
    angle_std: float
    health: Health
    detail: str = ""


class Monitor:
    """Feeds a stream to a `LiveEstimator`; nothing in a sample can make it raise.

    Args:
        live: the estimator.
    """

    def __init__(self, live: LiveEstimator) -> None:
        self._live = live
        rates = {sensor.name: sensor.rate for sensor in live.rig.sensors}
        self._overdue = [OVERDUE / rates[name] for name in live.channels]
        self._seen = np.full(len(live.channels), nan)
        self._ratios = np.ones(len(live.measured))
        self._late, self._last_late = 0, -inf

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
        if not isfinite(time):
            return Reading(time, nan, nan, "bad", "the stamp is no finite number")
        said: list[tuple[Health, str]] = []
        infinite = np.isinf(sample)
        if infinite.any():
            sample = np.where(infinite, nan, sample)
            said.append(("missing", f"{self._names(infinite)} infinite"))
        if live.samples:
            skipped = self._late_or_twice(time)
            if skipped is not None:
                return skipped
            gap = time - live.time
            if self._late >= REWOUND:
                said.append(("restarted", f"the clock was set back by {live.time - time:.3g} s"))
                self._restart()
            elif gap > LONGEST_GAP:
                said.append(("restarted", f"no sample for {gap:.3g} s"))
                self._restart()
            elif gap > 1.5 * live.interval:
                said.append(("gap", f"{gap:.3g} s"))
        self._late, self._last_late = 0, -inf
        if not live.samples and not np.isfinite(sample).any():
            return Reading(time, nan, nan, "bad", "the first sample has no value at all")
        before = live.time
        try:
            live.step(time, sample)
        except EstimationError:
            # what led here may be in the belief: begin anew, with this sample
            self._restart()
            said.append(("restarted", "the filter left all bounds"))
            try:
                live.step(time, sample)
            except EstimationError as problem:
                self._restart()
                return Reading(time, nan, nan, "bad", str(problem))
        said += self._sensors(time, sample)
        said += self._innovations(time - before)
        health, detail = max(said, key=lambda one: list(HEALTH).index(one[0]), default=("ok", ""))
        return Reading(time, live.angle, live.angle_std, health, detail)

    def _late_or_twice(self, time: float) -> Reading | None:
        """Return a reading without an estimate where a stamp does not rise; None where it may go on."""
        live = self._live
        if time > live.time:
            return None
        if time == live.time:
            return Reading(time, nan, nan, "duplicate")
        self._late = self._late + 1 if time > self._last_late else 1
        self._last_late = time
        if self._late >= REWOUND:
            return None
        return Reading(time, nan, nan, "late", f"{live.time - time:.3g} s")

    def _restart(self) -> None:
        # where the joint went meanwhile is not known
        last = self._live.angle if self._live.samples and abs(self._live.angle) <= LARGEST_ANGLE else None
        self._live.reset(last, ANYWHERE)
        self._seen[:] = nan
        self._ratios[:] = 1.0

    def _sensors(self, time: float, sample: Floats) -> list[tuple[Health, str]]:
        """Return which sensors are overdue or dead."""
        there = np.isfinite(sample)
        self._seen[there | np.isnan(self._seen)] = time
        ages = time - self._seen
        dead = ages >= DEAD
        if dead.any():
            return [("dead", f"{self._names(dead)} for {ages.max():.3g} s")]
        missing = ages > self._overdue
        return [("missing", self._names(missing))] if missing.any() else []

    def _innovations(self, dt: float) -> list[tuple[Health, str]]:
        """Return which sensors disagree with the filter."""
        live = self._live
        share = min(dt / MEMORY, 1.0) if isfinite(dt) else 0.0
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

    def _names(self, chosen: NDArray[np.bool_]) -> str:
        return ", ".join(name for name, there in zip(self._live.channels, chosen) if there)
