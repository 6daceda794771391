"""Analysis: the paper's test series and its statements, measured."""

from distal.analysis.bounds import lower_bound
from distal.analysis.claims import Claim, Measure, hidden_motion, measure_claims, potentiometer_errors, rms
from distal.analysis.reproduction import (
    PLANTS,
    READINGS,
    SEEDS,
    SERIES_1,
    SERIES_2,
    Run,
    all_runs,
    plant_scenario,
    run_count,
    run_series,
)

__all__ = [
    "PLANTS",
    "READINGS",
    "SEEDS",
    "SERIES_1",
    "SERIES_2",
    "Claim",
    "Measure",
    "Run",
    "all_runs",
    "hidden_motion",
    "lower_bound",
    "measure_claims",
    "plant_scenario",
    "potentiometer_errors",
    "rms",
    "run_count",
    "run_series",
]
