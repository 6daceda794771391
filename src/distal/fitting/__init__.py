"""Learning from logs: a rig's parameters, the sensors' noise and correction maps, and what the logs
can identify.
"""

from distal.fitting.angle_observability import Observability, observability
from distal.fitting.fit import fit
from distal.fitting.fit_options import Options
from distal.fitting.fitted_parameter import FittedParameter
from distal.fitting.learned_maps import (
    LeftOut,
    MapFit,
    learn_affine,
    learn_contact,
    learn_discrepancy,
)
from distal.fitting.leave_out import ALONE, WRITTEN, Compared, Fold, Score
from distal.fitting.progress import Doing
from distal.fitting.result import Fit
from distal.regression import groups_of

__all__ = [
    "ALONE",
    "WRITTEN",
    "Compared",
    "Doing",
    "Fit",
    "FittedParameter",
    "Fold",
    "LeftOut",
    "MapFit",
    "Observability",
    "Options",
    "Score",
    "fit",
    "groups_of",
    "learn_affine",
    "learn_contact",
    "learn_discrepancy",
    "observability",
]
