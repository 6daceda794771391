"""Run an estimator over a log, over many logs or over a stream; smoothing, and the health of a stream."""

from distal.run.batch import estimate_batch
from distal.run.health import log_health
from distal.run.live import LiveEstimator
from distal.run.monitor import HEALTH, Monitor, Reading
from distal.run.offline import HOMED, estimate, samples_of, with_channel
from distal.run.smoothing import smooth

__all__ = [
    "HEALTH",
    "HOMED",
    "LiveEstimator",
    "Monitor",
    "Reading",
    "estimate",
    "estimate_batch",
    "log_health",
    "samples_of",
    "smooth",
    "with_channel",
]
