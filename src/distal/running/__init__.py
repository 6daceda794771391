"""An estimator over a log, over many, over a stream; homing, smoothing, and a stream's health."""

from distal.running.batch import estimate_batch
from distal.running.diagnosing import diagnose
from distal.running.homing import TRUTH_NOISE, added_reference, check_homing, with_references
from distal.running.live import LiveEstimator
from distal.running.monitor import HEALTH, Monitor, Reading
from distal.running.offline import HOMED, estimate, first_values, samples_of, with_channel
from distal.running.smoothing import smooth
from distal.running.what_if import testability

__all__ = [
    "HEALTH",
    "HOMED",
    "TRUTH_NOISE",
    "LiveEstimator",
    "Monitor",
    "Reading",
    "added_reference",
    "check_homing",
    "diagnose",
    "estimate",
    "estimate_batch",
    "first_values",
    "samples_of",
    "smooth",
    "testability",
    "with_channel",
    "with_references",
]
