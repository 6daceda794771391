"""Cross-validation: how well a rig, fitted to some logs, does on the others. By log, never by halves of one."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from distal.errors import FitError
from distal.fitting.fit import fit
from distal.fitting.groups import groups_of
from distal.fitting.result import Fit
from distal.logs import Log, read_log, true_angles
from distal.results import Estimate
from distal.rig import Rig, load_rig
from distal.run import estimate


@dataclass(frozen=True)
class HeldOut:
    """One log, estimated with a rig that was fitted to other logs.

    Args:
        log: its name.
        group: that was held out together.
        before: estimate with the rig as it came.
        after: with the fitted one.
    """

    log: str
    group: str
    before: Estimate
    after: Estimate


@dataclass(frozen=True)
class CrossValidation:
    """Every log once, estimated with a rig that has not seen it.

    Args:
        held_out: one for each log.
        fits: one for each group.
    """

    held_out: tuple[HeldOut, ...]
    fits: tuple[Fit, ...]

    @property
    def mean_rms(self) -> float:
        """Mean over the logs of the RMS error [rad]."""
        return float(np.mean([one.after.rms_error() for one in self.held_out]))

    @property
    def worst_rms(self) -> float:
        """Largest RMS error of a log [rad]."""
        return float(np.max([one.after.rms_error() for one in self.held_out]))

    @property
    def inside_band(self) -> float:
        """Mean share of samples inside the 95 % band."""
        return float(np.mean([one.after.inside_band() for one in self.held_out]))


def cross_validate(
    logs: Sequence[Any],
    rig: Rig | str | Path,
    pattern: str | None = None,
    homing: float | None = None,
    truth: str | None = None,
    progress: Callable[[str, int, float], None] | None = None,
    **options: Any,
) -> CrossValidation:
    """Fit to all groups of logs but one, and estimate that one; for each group in turn.

    Args:
        logs: as for `fit`; all need a truth.
        rig: as for `fit`.
        pattern: how logs are grouped; see `groups_of`.
        homing: as for `fit`, and for the estimates.
        truth: as for `fit`.
        progress: as for `fit`.
        options: others of `fit`.

    Raises:
        FitError: as `fit`; fewer than two groups; a log without truth.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    logs = [logs] if isinstance(logs, (Log, str, Path)) else list(logs)
    read = [log if isinstance(log, Log) else read_log(log, rig, truth) for log in logs]
    for log in read:
        if true_angles(log, [joint.name for joint in rig.joints]) is None:
            raise FitError(f"{log.source}: has no truth; cross-validation compares with it")
    groups = groups_of([log.source for log in read], pattern)
    held, fits = [], []
    for group in dict.fromkeys(groups):
        report = None if progress is None else _named(progress, group)
        fitted = fit(
            [log for log, g in zip(read, groups) if g != group], rig, homing=homing, progress=report, **options
        )
        fits.append(fitted)
        for log in (log for log, g in zip(read, groups) if g == group):
            estimates = [estimate(log, each, homing=homing) for each in (rig, fitted.rig)]
            held.append(HeldOut(log.source, group, *estimates))
        if fitted.interrupted:
            break
    return CrossValidation(tuple(held), tuple(fits))


def _named(progress: Callable[[str, int, float], None], group: str) -> Callable[[str, int, float], None]:
    name = Path(group).name
    return lambda stage, iteration, cost: progress(f"without {name}: {stage}", iteration, cost)
