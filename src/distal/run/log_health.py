"""The health words of a log, as `distal stream` would report them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from distal.estimators import DEFAULT
from distal.logs import Log
from distal.rig import Rig
from distal.run.live_estimator import LiveEstimator
from distal.run.monitor import Monitor


def log_health(
    log: Log, rig: Rig | str | Path, estimator: str = DEFAULT, compiled: bool = True
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
