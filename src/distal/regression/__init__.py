"""The map from what the readings show and remember to what is sought: features, posterior, and the
kernel; and other regressions of several logs.

In: features φ of readings, plays and lags, and targets y over several logs; out: y = φᵀ b with
b ~ N(m, C), whose variance φᵀ C φ + σ² grows away from the logs (docs/explanation/map.md).

    import numpy as np
    from distal.regression import Shape, features_along
    from distal.regression.features import empty_frame

    shape = Shape(channels=1, angles=0, moving=(0,), radial=0)
    time = np.arange(0.0, 1.0, 0.01)
    frame = shape.flat(empty_frame(shape))
    print(features_along(shape, frame, time, np.sin(time)[:, None])["features"].shape)
"""

from distal.regression.features import (
    INDEPENDENT,
    MOST,
    MOST_EVIDENCE,
    JudgedJumps,
    Shape,
    added,
    begun_by,
    evidence_of_jumps,
    features_along,
    features_function,
    forces_function,
    forces_layout,
    forces_parameters,
    map_function,
    map_layout,
    map_parameters,
    variance_beside,
    whitening,
)
from distal.regression.least_squares import (
    FEWEST_LOGS,
    YARDSTICKS,
    folds_of,
    groups_of,
    line_errors,
    splits,
    yardstick_error,
)
from distal.regression.pool_of_filter_and_map import ReportedMap, homed_memory, reporting_function
from distal.regression.posterior import (
    Evidence,
    Prior,
    Samples,
    Weights,
    conformal_factor,
    evidence_of,
    framed,
    from_prior,
    from_window,
    given,
    map_from,
    played,
    rates_of,
    shape_for,
    with_arrays,
)

__all__ = [
    "FEWEST_LOGS",
    "INDEPENDENT",
    "MOST",
    "MOST_EVIDENCE",
    "YARDSTICKS",
    "Evidence",
    "JudgedJumps",
    "Prior",
    "ReportedMap",
    "Samples",
    "Shape",
    "Weights",
    "added",
    "begun_by",
    "conformal_factor",
    "evidence_of",
    "evidence_of_jumps",
    "features_along",
    "features_function",
    "folds_of",
    "forces_function",
    "forces_layout",
    "forces_parameters",
    "framed",
    "from_prior",
    "from_window",
    "given",
    "groups_of",
    "homed_memory",
    "line_errors",
    "map_from",
    "map_function",
    "map_layout",
    "map_parameters",
    "played",
    "rates_of",
    "reporting_function",
    "shape_for",
    "splits",
    "variance_beside",
    "whitening",
    "with_arrays",
    "yardstick_error",
]
