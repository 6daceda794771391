"""Where a tendon-driven joint is, without a sensor in the joint."""

from distal.errors import DistalError, DistalWarning
from distal.estimators import (
    ESTIMATORS,
    Belief,
    Estimate,
    Estimator,
    Innovation,
    LiveEstimator,
    estimate,
    estimate_batch,
    make_estimator,
    plot_estimates,
)
from distal.identification import Fit, cross_validate, fit, observability
from distal.logs import Log, read_log, write_log
from distal.rig import Rig, load_rig, shipped_rigs
from distal.simulation import Scenario, load_scenario, scenario_rig, shipped_scenarios, simulate, simulate_batch

__all__ = [
    "ESTIMATORS",
    "Belief",
    "DistalError",
    "DistalWarning",
    "Estimate",
    "Estimator",
    "Fit",
    "Innovation",
    "LiveEstimator",
    "Log",
    "Rig",
    "Scenario",
    "cross_validate",
    "estimate",
    "estimate_batch",
    "fit",
    "load_rig",
    "load_scenario",
    "make_estimator",
    "observability",
    "plot_estimates",
    "read_log",
    "scenario_rig",
    "shipped_rigs",
    "shipped_scenarios",
    "simulate",
    "simulate_batch",
    "write_log",
]
