"""The estimators and their common base."""

from distal.estimators.adaptive import AdaptiveFilter, Robustness
from distal.estimators.belief import Belief
from distal.estimators.estimator_protocol import (
    LARGEST_ANGLE,
    SHORTEST,
    TOUCHED,
    WILD,
    KernelEstimator,
    check_time,
    sample_problem,
    wild_problem,
)
from distal.estimators.kinematic import KinematicEstimator
from distal.estimators.read_channels import Channels, channels_of, first_values
from distal.estimators.registry import (
    DEFAULT,
    ESTIMATORS,
    ON_REQUEST,
    make_estimator,
    usual_estimator,
)
from distal.estimators.regression_estimator import (
    RegressionEstimator,
    of_part,
    offsets_of,
    parts_of,
    samples_of_angles,
)
from distal.estimators.state_kinds import (
    StateKind,
    external_torques_of,
    kinds_of,
    state_units,
    states_of,
)
from distal.estimators.unsensed_directions import directions

__all__ = [
    "DEFAULT",
    "ESTIMATORS",
    "LARGEST_ANGLE",
    "ON_REQUEST",
    "SHORTEST",
    "TOUCHED",
    "WILD",
    "AdaptiveFilter",
    "Belief",
    "Channels",
    "KernelEstimator",
    "KinematicEstimator",
    "RegressionEstimator",
    "Robustness",
    "StateKind",
    "channels_of",
    "check_time",
    "directions",
    "external_torques_of",
    "first_values",
    "kinds_of",
    "make_estimator",
    "of_part",
    "offsets_of",
    "parts_of",
    "sample_problem",
    "samples_of_angles",
    "state_units",
    "states_of",
    "usual_estimator",
    "wild_problem",
]
