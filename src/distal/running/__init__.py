"""An estimator over a log, over many, over a stream; homing, smoothing, and a stream's health."""

from distal.running.batch import estimate_batch
from distal.running.calibration import held, numbers_homed, plain_samples
from distal.running.diagnosing import diagnose
from distal.running.health import log_health
from distal.running.homing import TRUTH_NOISE, added_reference, at_known_angle, check_homing, with_references
from distal.running.homing_window import Window
from distal.running.live import LiveEstimator
from distal.running.monitor import HEALTH, Monitor, Reading
from distal.running.offline import HOMED, estimate, first_values, samples_of, with_channel
from distal.running.smoothing import smooth
from distal.running.what_if import cannot_test

__all__ = [
    "HEALTH",
    "HOMED",
    "TRUTH_NOISE",
    "LiveEstimator",
    "Monitor",
    "Reading",
    "Window",
    "added_reference",
    "at_known_angle",
    "cannot_test",
    "check_homing",
    "diagnose",
    "estimate",
    "estimate_batch",
    "first_values",
    "held",
    "log_health",
    "numbers_homed",
    "plain_samples",
    "samples_of",
    "smooth",
    "with_channel",
    "with_references",
]
