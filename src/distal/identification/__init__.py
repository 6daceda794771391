"""A rig's parameters and noise from its own logs, and what the logs can tell."""

from distal.identification.crossvalidation import CrossValidation, HeldOut, cross_validate, groups_of
from distal.identification.fit import fit
from distal.identification.fitted import Fitted
from distal.identification.free import Free
from distal.identification.observability import Observability, observability
from distal.identification.result import Fit

__all__ = [
    "CrossValidation",
    "Fit",
    "Fitted",
    "Free",
    "HeldOut",
    "Observability",
    "cross_validate",
    "fit",
    "groups_of",
    "observability",
]
