"""The kinds of states of the adaptive filter, one file for each, and the vector that they form."""

from distal.estimators.adaptive.states.parameter import uncertain_parameters
from distal.estimators.adaptive.states.state import Begin, State
from distal.estimators.adaptive.states.vector import KINDS, Kind, StateVector

__all__ = [
    "KINDS",
    "Begin",
    "Kind",
    "State",
    "StateVector",
    "uncertain_parameters",
]
