"""Least squares over several logs: terms of the readings, coefficients that differ from log to log,
the width of the band, the update by a homing move, and the kernel of a learned map.
"""

from distal.regression.affine import affine_kind, as_discrepancy
from distal.regression.after_homing import EXPECTED, calibrate_window, seen
from distal.regression.band import Errors, conformal_factor, inflate_band, rms_beyond_noise, student
from distal.regression.blend import Blend
from distal.regression.contact import contact_kind
from distal.regression.cross_validation import folds_of, groups_of, splits
from distal.regression.discrepancy import discrepancy_kind
from distal.regression.extrapolation import Learner, errors_beyond
from distal.regression.features import Samples, design, limits, outside, played, predict
from distal.regression.learn_map import (
    HeldOut,
    Kind,
    Terms,
    calibrate_band,
    errors_of,
    fit_coefficients,
    learn_map,
    left_out_errors,
    sized_by,
)
from distal.regression.map_function import (
    carried_size,
    first_memory,
    map_coefficients_of,
    map_function,
    memory_size,
    reporting_function,
)
from distal.regression.random_effects import correlated_samples, independent, line, row_of
from distal.regression.servos import servos_of
from distal.regression.yardsticks import YARDSTICKS, yardstick_error

__all__ = [
    "EXPECTED",
    "YARDSTICKS",
    "Blend",
    "Errors",
    "HeldOut",
    "Kind",
    "Learner",
    "Samples",
    "Terms",
    "affine_kind",
    "as_discrepancy",
    "calibrate_band",
    "calibrate_window",
    "carried_size",
    "conformal_factor",
    "contact_kind",
    "correlated_samples",
    "design",
    "discrepancy_kind",
    "errors_beyond",
    "errors_of",
    "first_memory",
    "fit_coefficients",
    "folds_of",
    "groups_of",
    "independent",
    "inflate_band",
    "learn_map",
    "left_out_errors",
    "limits",
    "line",
    "map_coefficients_of",
    "map_function",
    "memory_size",
    "outside",
    "played",
    "predict",
    "reporting_function",
    "rms_beyond_noise",
    "row_of",
    "seen",
    "servos_of",
    "sized_by",
    "splits",
    "student",
    "yardstick_error",
]
