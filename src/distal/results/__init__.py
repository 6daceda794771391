"""What an estimator made of a log: angles, bands, innovations, what they say of the rig, and
plots.
"""

from distal.results.angle_plots import (
    PANELS,
    check_panels,
    draw_estimate,
    from_start,
    plot_estimates,
    time_label,
)
from distal.results.estimate import ANGLE_UNITS, Estimate
from distal.results.innovation_plots import HEALTH_COLOURS
from distal.results.style import (
    BAD,
    BAND_ALPHA,
    BLACK,
    COLOURS,
    DASHES,
    FAINT,
    GOOD,
    INK,
    PALE,
    SOFT,
    TRUTH,
    WHITE,
    figure,
    figure_bytes,
    legend_above,
    make_folder,
    plot_kind,
    save_figure,
    styled,
)
from distal.results.thresholds import LARGE_PRIOR, SMALL

__all__ = [
    "ANGLE_UNITS",
    "BAD",
    "BAND_ALPHA",
    "BLACK",
    "COLOURS",
    "DASHES",
    "FAINT",
    "GOOD",
    "HEALTH_COLOURS",
    "INK",
    "LARGE_PRIOR",
    "PALE",
    "PANELS",
    "SMALL",
    "SOFT",
    "TRUTH",
    "WHITE",
    "Estimate",
    "check_panels",
    "draw_estimate",
    "figure",
    "figure_bytes",
    "from_start",
    "legend_above",
    "make_folder",
    "plot_estimates",
    "plot_kind",
    "save_figure",
    "styled",
    "time_label",
]
