"""What an estimator made of a log: angles, bands, innovations, what they say of the rig, and plots."""

from distal.results.curves import BAND
from distal.results.estimate import ANGLE_UNITS, Estimate
from distal.results.panels import HEALTH_COLOURS
from distal.results.plots import (
    PANELS,
    check_panels,
    draw_errors,
    draw_estimate,
    from_start,
    limit_errors,
    plot_estimates,
    time_label,
)
from distal.results.style import (
    COLOURS,
    DASHES,
    figure,
    figure_bytes,
    legend_above,
    plot_kind,
    save_figure,
    title_above,
)
from distal.results.thresholds import LARGE_PRIOR, SMALL

__all__ = [
    "ANGLE_UNITS",
    "BAND",
    "COLOURS",
    "DASHES",
    "HEALTH_COLOURS",
    "LARGE_PRIOR",
    "PANELS",
    "SMALL",
    "Estimate",
    "check_panels",
    "draw_errors",
    "draw_estimate",
    "figure",
    "figure_bytes",
    "from_start",
    "legend_above",
    "limit_errors",
    "plot_estimates",
    "plot_kind",
    "save_figure",
    "time_label",
    "title_above",
]
