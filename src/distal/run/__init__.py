"""Run an estimator over a log, over many logs or over a stream; smooth an estimate; judge the
health of a stream.
"""

from distal.run.health import HEALTH, HealthLimits, Monitor, Reading, log_health
from distal.run.live_estimator import JointContact, LiveEstimator, LogUnits
from distal.run.offline import estimate, estimate_batch, samples_of, smooth, with_channel

__all__ = [
    "HEALTH",
    "HealthLimits",
    "JointContact",
    "LiveEstimator",
    "LogUnits",
    "Monitor",
    "Reading",
    "estimate",
    "estimate_batch",
    "log_health",
    "samples_of",
    "smooth",
    "with_channel",
]
