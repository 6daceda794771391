"""The map from what the readings show and remember to what is sought: features, posterior, and the
kernel; and other regressions of several logs.
"""

from distal.regression.features import Shape, features_along, features_function
from distal.regression.folds import FEWEST_LOGS, folds_of, groups_of, splits
from distal.regression.homed_map import homed_memory
from distal.regression.known_window import (
    conformal_factor,
    from_prior,
    from_window,
    given,
)
from distal.regression.least_squares import YARDSTICKS, line_errors, servos_of, yardstick_error
from distal.regression.map_function import (
    begun_by,
    map_function,
    map_layout,
    map_parameters,
    variance_beside,
)
from distal.regression.posterior import (
    Evidence,
    Prior,
    Weights,
    evidence_of,
    framed,
    rates_of,
    shape_for,
)
from distal.regression.reported_map import ReportedMap, reporting_function
from distal.regression.samples import Samples, played

__all__ = [
    "FEWEST_LOGS",
    "YARDSTICKS",
    "Evidence",
    "Prior",
    "ReportedMap",
    "Samples",
    "Shape",
    "Weights",
    "begun_by",
    "conformal_factor",
    "evidence_of",
    "features_along",
    "features_function",
    "folds_of",
    "framed",
    "from_prior",
    "from_window",
    "given",
    "groups_of",
    "homed_memory",
    "line_errors",
    "map_function",
    "map_layout",
    "map_parameters",
    "played",
    "rates_of",
    "reporting_function",
    "servos_of",
    "shape_for",
    "splits",
    "variance_beside",
    "yardstick_error",
]
