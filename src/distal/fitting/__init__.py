"""Learning from logs: a rig's parameters, the sensors' noise and correction maps, and what the logs
can identify.
"""

from distal.fitting.candidates import AS_GIVEN, WRITTEN, Compared, Score
from distal.fitting.fit import Fit, fit, learn
from distal.fitting.free_parameters import FittedParameter, Options
from distal.fitting.learned_maps import (
    SETTLING,
    MapFit,
)
from distal.regression import groups_of

__all__ = [
    "AS_GIVEN",
    "SETTLING",
    "WRITTEN",
    "Compared",
    "Fit",
    "FittedParameter",
    "MapFit",
    "Options",
    "Score",
    "fit",
    "groups_of",
    "learn",
]
