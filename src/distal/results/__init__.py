"""What an estimator made of a log: angles, bands, innovations, what they say of the rig, and plots."""

from distal.results.diagnosis import LARGE_PRIOR, SMALL, Diagnosis, Finding, Kind, diagnose
from distal.results.estimate import Estimate
from distal.results.plots import (
    BAND,
    COLOURS,
    DASHES,
    draw_estimate,
    figure,
    figure_bytes,
    plot_estimates,
    plot_kind,
    save_figure,
)

__all__ = [
    "BAND",
    "COLOURS",
    "DASHES",
    "LARGE_PRIOR",
    "SMALL",
    "Diagnosis",
    "Estimate",
    "Finding",
    "Kind",
    "diagnose",
    "draw_estimate",
    "figure",
    "figure_bytes",
    "plot_estimates",
    "plot_kind",
    "save_figure",
]
