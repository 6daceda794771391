"""The estimators by their names."""

from __future__ import annotations

from collections.abc import Callable

from distal.errors import EstimationError, did_you_mean
from distal.estimators.adaptive import AdaptiveFilter
from distal.estimators.estimator_protocol import KernelEstimator
from distal.estimators.kinematic import KinematicEstimator
from distal.estimators.paper_2008 import FullStateFilter, paper_noise, rig_noise
from distal.estimators.regression_estimator import RegressionEstimator
from distal.rig import Rig

ESTIMATORS: dict[str, Callable[[Rig, bool], KernelEstimator]] = {
    "adaptive": AdaptiveFilter,
    "regression": RegressionEstimator,
    "inextensible": lambda rig, compiled: KinematicEstimator("inextensible", rig, False, compiled),
    "elastic": lambda rig, compiled: KinematicEstimator("elastic", rig, True, compiled),
    "ekf": lambda rig, compiled: FullStateFilter("ekf", rig, rig_noise(rig), compiled),
    "ekf-2008": lambda rig, compiled: FullStateFilter(
        "ekf-2008", rig, paper_noise(rig), compiled, passes=2
    ),
}
"""Name of an estimator → function (rig, compiled) that makes it. A program adds its own here."""

ON_REQUEST = ("ekf", "ekf-2008")
"""Names of the estimators that run only where they are asked for: the yardsticks of the field."""

DEFAULT = "adaptive"
"""Name of the estimator that is used where none is named."""


def usual_estimator(rig: Rig) -> str:
    """Return the name of the estimator of a rig where none is named: `DEFAULT`, or ``regression``
    where logs taught what readings alone tell and no filter could follow them.
    """
    return "regression" if rig.map is not None and rig.map.alone else DEFAULT


def make_estimator(name: str | None, rig: Rig, compiled: bool = True) -> KernelEstimator:
    """Return a new estimator for a rig, by one of the names of `ESTIMATORS`; None stands for the
    rig's usual one.

    Raises:
        EstimationError: the name is unknown, or the rig's sensors do not suffice.
    """
    if name is None and isinstance(rig, Rig):
        name = usual_estimator(rig)
    if not isinstance(name, str) or not isinstance(rig, Rig):
        raise EstimationError(
            f"make_estimator takes a name and a Rig, {name!r} and {type(rig).__name__} came"
        )
    if name not in ESTIMATORS:
        raise EstimationError(f"unknown estimator '{name}'{did_you_mean(name, ESTIMATORS)}")
    return ESTIMATORS[name](rig, compiled)
