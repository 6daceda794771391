"""The adaptive filter: docs/reference/adaptive-equations.md has its equations, `filter_function`
all its steps in order.
"""

from distal.estimators.adaptive.estimator import AdaptiveFilter, state_vector
from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.guard_settings import Robustness
from distal.estimators.adaptive.states import (
    KINDS,
    Kind,
    State,
    StateVector,
    uncertain_parameters,
)

__all__ = [
    "KINDS",
    "AdaptiveFilter",
    "FilterContext",
    "Kind",
    "Robustness",
    "State",
    "StateVector",
    "state_vector",
    "uncertain_parameters",
]
