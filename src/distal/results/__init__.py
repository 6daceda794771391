"""Results of an estimator on a log: angles, bands and innovations, and their plots.

In: means and covariances of an estimator; out: an `Estimate`, whose 95 % band is θ ± 1.96 σ.

    import distal

    scenario = distal.load_scenario("template")
    rig = distal.scenario_rig(scenario)
    result = distal.estimate(distal.simulate(rig, scenario, seed=1), rig)
    print(result.summary())
    result.plot("estimate.png")
"""

from distal.results.estimate import UNKNOWN, Estimate, plot_estimates
from distal.results.plots import (
    BAD,
    BLACK,
    COLOURS,
    DASHES,
    FAINT,
    GOOD,
    INK,
    PALE,
    PANELS,
    SOFT,
    TRUTH,
    WHITE,
    Html,
    band_colour,
    check_panels,
    colour,
    curve_style,
    figure,
    figure_bytes,
    html_table,
    legend_above,
    make_folder,
    plot_kind,
    save_figure,
    verdict,
)

__all__ = [
    "BAD",
    "BLACK",
    "COLOURS",
    "DASHES",
    "FAINT",
    "GOOD",
    "INK",
    "PALE",
    "PANELS",
    "SOFT",
    "TRUTH",
    "UNKNOWN",
    "WHITE",
    "Estimate",
    "Html",
    "band_colour",
    "check_panels",
    "colour",
    "curve_style",
    "figure",
    "figure_bytes",
    "html_table",
    "legend_above",
    "make_folder",
    "plot_estimates",
    "plot_kind",
    "save_figure",
    "verdict",
]
