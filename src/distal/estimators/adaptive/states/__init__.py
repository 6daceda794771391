"""The kinds of states of the adaptive filter, one file for each, and the vector that they form."""

from distal.estimators.adaptive.states.drive import Transmitted
from distal.estimators.adaptive.states.parameter import UncertainParameter, uncertain_parameters
from distal.estimators.adaptive.states.state import Begin, Fading, State
from distal.estimators.adaptive.states.vector import KINDS, Kind, StateVector

__all__ = [
    "KINDS",
    "Begin",
    "Fading",
    "Kind",
    "State",
    "StateVector",
    "Transmitted",
    "UncertainParameter",
    "uncertain_parameters",
]
