"""What an estimator made of a log: angles, bands, innovations, what they say of the rig, and plots."""

from distal.results.diagnosis import Diagnosis, Finding, diagnose
from distal.results.estimate import Estimate
from distal.results.plots import BAND, COLOURS, DASHES, draw_estimate, figure, plot_estimates, plot_kind, save_figure

__all__ = [
    "BAND",
    "COLOURS",
    "DASHES",
    "Diagnosis",
    "Estimate",
    "Finding",
    "diagnose",
    "draw_estimate",
    "figure",
    "plot_estimates",
    "plot_kind",
    "save_figure",
]
