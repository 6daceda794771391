"""Learning from logs: a rig's parameters, the sensors' noise and correction maps, and what the logs
can identify.
"""

from distal.fitting.angle_observability import Observability, observability
from distal.fitting.candidates import AS_GIVEN
from distal.fitting.fit import fit
from distal.fitting.fit_options import Options
from distal.fitting.fitted_parameter import FittedParameter
from distal.fitting.learned_maps import (
    MapFit,
    learn_map,
)
from distal.fitting.leave_out import WRITTEN, Compared, Fold, Score
from distal.fitting.progress import Doing
from distal.fitting.result import Fit
from distal.regression import groups_of

__all__ = [
    "AS_GIVEN",
    "WRITTEN",
    "Compared",
    "Doing",
    "Fit",
    "FittedParameter",
    "Fold",
    "MapFit",
    "Observability",
    "Options",
    "Score",
    "fit",
    "groups_of",
    "learn_map",
    "observability",
]
