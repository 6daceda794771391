"""The estimators and their common base.

In: a belief (mean, covariance, what is remembered) and samples; out: means, covariances and
innovations. `adaptive` is a Kalman filter around the model with drives as inputs: m⁺ = m + K ν,
P⁺ = P − K S Kᵀ (docs/reference/adaptive-equations.md); others are maps or geometry.

    import distal
    from distal.estimators import make_estimator

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    print(make_estimator("adaptive", rig).state_names)
    print(distal.estimate(distal.simulate(rig, scenario, seed=1), rig, "elastic"))
"""

from distal.estimators.adaptive import AdaptiveFilter, Robustness
from distal.estimators.estimator_protocol import (
    LARGEST_ANGLE,
    SHORTEST,
    TOUCHED,
    WILD,
    Belief,
    Channels,
    KernelEstimator,
    StateKind,
    channels_of,
    check_time,
    external_torques_of,
    first_values,
    sample_problem,
    state_units,
    states_of,
    wild_problem,
)
from distal.estimators.kinematic import KinematicEstimator, directions
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
