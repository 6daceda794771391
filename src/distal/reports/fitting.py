"""The page on a fit: the fitted parameters, their standard errors, and the errors before and after.

Its figures show each log before and after the fit, and the remaining errors against angle, speed
and load.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.fitting import WRITTEN, Fit, Observability, observability
from distal.logs import Log, check_outputs, outputs_in, shown, true_angles, write_whole
from distal.reports.page import heading, page, paragraph, picture, svg_of
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    BAND_ALPHA,
    BLACK,
    PANELS,
    Estimate,
    Html,
    colour,
    curve_style,
    figure,
    html_table,
    legend_above,
    make_folder,
    plot_estimates,
    verdict,
)
from distal.rig import Rig, named, scales_in_words
from distal.run import estimate, log_health

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


MOST_TRACES = 8
"""Number of logs whose curves are drawn at most; the table holds all logs. Source: layout."""

MOST_PAIRS = 20
"""Number of pairs of parameters whose correlation is shown at most. Source: layout."""

FIT_PAGES = ("index.html",)
"""Names of the files that `fit_report` writes."""


def fit_report(fit: Fit, logs: Sequence[Log], out: str | Path) -> Path:
    """Write one self-contained page on a fit, ``index.html``, to a folder, and return its path.

    Args:
        logs: the logs of the fit.
        out: the folder, which is made where it does not exist.

    Raises:
        OutputError: the folder or the page cannot be written.
    """
    check_outputs(outputs_in(out, FIT_PAGES, "the report"))
    folder = make_folder(out)
    before, after = (
        [estimate(log, rig, homing=fit.homing) for log in logs] for rig in (fit.start, fit.rig)
    )
    parts = [
        picture(rig_svg(fit.rig), "The rig as fitted."),
        *_doubts(fit),
        *_left_out(fit),
        *_parameters(fit),
        *_errors(logs, before, after),
        heading("Along the logs"),
    ]
    caption = (
        "Estimate with the fitted rig and with the rig as it came, their 95 % bands shaded; their "
        "errors; innovations "
        "of the fitted one, of which 95 % should be within ±2; what was measured; a stream's word "
        "on its health."
    )
    for log, nominal, fitted in list(zip(logs, before, after))[:MOST_TRACES]:
        parts.append(picture(svg_of(draw_traces(log, nominal, fitted, fit.rig)), caption))
    parts += [
        heading("What is left, against angle, speed and load"),
        paragraph(
            "Median and the middle 80 % of the errors. A curve that is not flat is physics that "
            "the rig lacks."
        ),
        picture(
            svg_of(draw_residuals(logs, before, after, fit.rig)),
            "Errors of all logs, before and after the fit.",
        ),
    ]
    longest = max(logs, key=len)
    parts += _seen(longest, observability(longest, fit.rig, homing=fit.homing))
    use = (
        ""
        if fit.homing is None
        else f" A reference is used for the first {fit.homing:g} s, then only compared with."
    )
    answer = fit.answer()
    summary = f"{answer[:1].upper()}{answer[1:]}. " if answer else ""
    lead = (
        f"{summary}{fit.samples} samples of {fit.learned_from}, "
        f"fitted by the rig's equations, or by its filter's innovations.{use}"
    )
    path = folder / FIT_PAGES[0]
    write_whole(path, page(f"Fit of {fit.start.name}", lead, parts))
    return path


def _parameters(fit: Fit) -> list[str]:
    rows = [
        (
            part.name,
            Html(
                f"<code>{escape(', '.join(named(fit.model, path) for path in part.paths))}</code>"
            ),
            *part.sizes,
            verdict(part.origin, part.identified),
        )
        for part in fit.fitted
    ]
    columns = ("number", "path", "rig file", "fitted ± standard error", "unit", "from")
    parts = [heading("What was found"), html_table(columns, rows, values=(2, 3))]
    if fit.combinations:
        parts.append(paragraph("These logs tell " + "; ".join(fit.combinations) + "."))
    per_log = [
        (part.name, Path(log).name, f"{number:.5g}", part.si)
        for part in fit.fitted
        for log, number in part.per_log.items()
    ]
    if per_log:
        parts.append(html_table(("number", "log", "value", "unit"), per_log, values=(2,)))
    strong = [
        f"{fit.correlated[i]} and {fit.correlated[j]}: {fit.correlations[i, j]:+.2f}"
        for i, j in np.argwhere(np.tril(np.abs(fit.correlations) > 0.8, -1))
    ]
    if strong and fit.converged:
        sentences = "; ".join(strong[:MOST_PAIRS])
        parts.append(paragraph(f"Errors that go together (correlation): {sentences}."))
    ratios = [
        (name, *(f"{nis:.2f}" if nis < 100 else f"{nis:.0f}" for nis in (before, after)))
        for name, before, after in zip(fit.channels, fit.nis_before, fit.nis_after)
        if np.isfinite(after)
    ]
    nis = (
        "Normalised innovations, mean of ν²/S; 1 is expected, more means that the filter is too "
        "sure of itself."
    )
    ended = (
        "was interrupted"
        if fit.interrupted
        else "converged"
        if fit.converged
        else "stopped before it converged"
    )
    costs = (
        f"−ln p from {fit.cost_before:.1f} to {fit.cost_after:.1f} in {fit.iterations} iterations"
    )
    table = html_table(("sensor", "before", "after"), ratios, values=(1, 2))
    return [*parts, paragraph(nis), table, paragraph(f"{costs}; the search {ended}.")]


def _error(rms: float, inside: float) -> tuple[str, str]:
    """Return cells: an RMS error [rad], and the coverage of the band, NaN where it has none."""
    return f"{np.rad2deg(rms):.3f}", "–" if np.isnan(inside) else f"{100 * inside:.0f} %"


def _errors(
    logs: Sequence[Log], before: Sequence[Estimate], after: Sequence[Estimate]
) -> list[str]:
    rows = [
        (
            shown(Path(log.source).name),
            *_error(nominal.rms_error(), nominal.inside_band()),
            *_error(fitted.rms_error(), fitted.inside_band()),
        )
        for log, nominal, fitted in zip(logs, before, after)
        if fitted.truths is not None
    ]
    if not rows:
        return []
    columns = ("log", "RMS before [°]", "in the band", "RMS after [°]", "in the band")
    return [heading("Errors on the logs that were fitted"), html_table(columns, rows, range(1, 5))]


def _doubts(fit: Fit) -> list[str]:
    lines = fit.advice()
    if fit.rig.taken:
        lines.append(scales_in_words(fit.rig).rstrip("."))
    sentences = [paragraph(f"{line[0].upper()}{line[1:]}.") for line in lines]
    return [heading("Before you use it"), *sentences] if sentences else []


def _left_out(fit: Fit) -> list[str]:
    if not fit.compared:
        return []
    text = (
        "Each log was estimated by what the others teach alone: parameters, maps and least squares "
        "without it. Only the choice among these rows has seen it. Least squares have no prior, no "
        "band and no limits: they show what physics is worth."
    )
    of_all = html_table(
        ("what gives the angle", "RMS error [°]", "inside the 95 % band"),
        [(name, *_error(rms, inside)) for name, rms, inside in fit.scores()],
        values=(1, 2),
    )
    written = [(Path(each.log).name, each.scores[WRITTEN]) for each in fit.compared]
    by_log = html_table(
        ("log", "as written [°]", "in the band"),
        [
            (name, *(("–", "–") if score is None else _error(score.rms, score.inside)))
            for name, score in written
        ],
        values=(1, 2),
    )
    return [heading("On logs that were not fitted"), paragraph(text), of_all, by_log]


def _seen(log: Log, seen: Observability) -> list[str]:
    rows = [
        (
            f"{low:.1f} to {high:.1f}",
            f"{np.rad2deg(std):.3f}",
            f"{np.rad2deg(recovered):.3f}",
            verdict(word, word == "seen"),
        )
        for low, high, std, recovered, word in seen.table()
    ]
    text = (
        f"Along {shown(Path(log.source).name)}: how sure the angle is; and how sure it is again "
        f"after {seen.window:g} s if it was lost by 10°. Where it is not found, friction, slack "
        "or a stop hides the joint, and only memory holds the angle."
    )
    caption = "Estimate with its band; below, its standard deviation, and where it is found again."
    return [
        heading("Where the joint is seen"),
        paragraph(text),
        picture(svg_of(seen.plot()), caption),
        html_table(("time [s]", "std [°]", "found again to [°]", ""), rows, values=(1, 2)),
    ]


POINTS = 1200
"""Number of points that are drawn along a log, about; up to twice as many may be. Source:
layout.
"""

BINS = 16
"""Number of bins of the residuals. Source: layout."""

FEWEST = 10
"""Least number of samples in a bin that is drawn: one for each tenth. Source: layout."""


def draw_traces(log: Log, before: Estimate, after: Estimate, rig: Rig) -> Figure:
    """Return a figure over one log: truth, estimates before and after the fit, their errors,
    innovations, forces and health.
    """
    # fewer points keep a page with a dozen logs small; a printed line shows no more
    rows = slice(None, None, max(1, len(log) // POINTS))
    words = log_health(log, rig)
    estimates = [_thinned(after, rows, "after"), _thinned(before, rows, "before")]
    title = shown(
        Path(log.source).name
    )  # any name of a file can be drawn: what is not printable is escaped
    return plot_estimates(
        estimates, title=title, panels=PANELS, log=log.select(rows), rig=rig, health=words[rows]
    )


def _thinned(estimate: Estimate, rows: slice, name: str) -> Estimate:
    """Return an estimate with some of its rows only, under another name."""
    columns = ("time", "means", "variances", "innovations", "innovation_variances")
    truths = None if estimate.truths is None else estimate.truths[rows]
    return replace(
        estimate,
        estimator=name,
        truths=truths,
        **{key: getattr(estimate, key)[rows] for key in columns},
    )


def draw_residuals(
    logs: Sequence[Log], before: Sequence[Estimate], after: Sequence[Estimate], rig: Rig
) -> Figure:
    """Return a figure of the errors against angle, speed and load, before and after the fit.

    Curves show the median, bands the middle 80 %. A curve that is not flat shows physics that the
    rig lacks. Where no log has a truth, the innovations of the first compared sensor are drawn
    instead of the errors.
    """
    names = rig.joint_names
    force = next(iter(rig.sensors_of("force") or rig.sensors_of("tension")), None)
    truths = [
        np.full_like(result.angles, np.nan) if (true := true_angles(log, names)) is None else true
        for log, result in zip(logs, after)
    ]
    has_truth = any(np.isfinite(truth).any() for truth in truths)
    angles = [
        np.rad2deg(truth if has_truth else result.angles) for truth, result in zip(truths, after)
    ]
    against = {
        "angle θ [°]": angles,
        "speed [°/s]": [_smooth_speed(log.time, angle) for log, angle in zip(logs, angles)],
    }
    if force is not None:
        readings = [log.channels[force.name][:, None] for log in logs]
        against[f"{force.name} [{force.si}]"] = readings
    with figure(1, len(against), (7.2, 2.9), sharey=True) as (drawing, panels):
        for name, estimates, colour in (("before", before, 1), ("after", after, 0)):
            if has_truth:
                residuals = [np.rad2deg(e.angles - t) for e, t in zip(estimates, truths)]
            else:
                first = (e.innovations / np.sqrt(e.innovation_variances) for e in estimates)
                residuals = [scaled[:, :1] for scaled in first]
            for axes, (label, columns) in zip(panels, against.items()):
                both = [np.broadcast_arrays(x, y) for x, y in zip(columns, residuals)]
                x, y = (np.concatenate([np.ravel(part) for part in parts]) for parts in zip(*both))
                _draw_binned(axes, x, y, colour, name)
                axes.set_xlabel(label)
        panels[0].set_ylabel(
            "error [°]" if has_truth else f"innovation / its std, {after[0].measured[0]}"
        )
        for axes in panels:
            axes.axhline(0.0, color=BLACK, lw=0.6)
        legend_above(panels[0])
    return drawing


def _smooth_speed(time: Floats, angles: Floats) -> Floats:
    """Return the mean speeds of angles over a tenth of a second around each stamp, (k, n_joints);
    NaN where an angle is known nowhere.
    """
    speeds = np.full_like(angles, np.nan)
    for j, angle in enumerate(angles.T):
        finite = np.isfinite(angle)
        if finite.any():
            ends = (np.interp(time + t, time[finite], angle[finite]) for t in (-0.05, 0.05))
            speeds[:, j] = np.diff([*ends], axis=0) / 0.1
    return speeds


def _draw_binned(axes: Axes, x: Floats, y: Floats, index: int, name: str) -> None:
    """Draw the quantiles of y in bins of x, which reach over all but a hundredth of its samples."""
    finite = np.isfinite(x) & np.isfinite(y)
    x = x[finite]
    y = y[finite]
    if not len(x):
        return
    low, high = np.quantile(x, [0.005, 0.995])
    edges = np.linspace(low, high, BINS + 1)
    number = np.digitize(x, edges[1:-1])
    bins = [k for k in range(BINS) if np.count_nonzero(number == k) >= FEWEST]
    centres = (edges[1:] + edges[:-1])[bins] / 2.0
    quantiles = [np.quantile(y[number == k], [0.1, 0.5, 0.9]) for k in bins]
    lower, median, upper = np.reshape(quantiles, (-1, 3)).T
    axes.fill_between(centres, lower, upper, color=colour(index), alpha=BAND_ALPHA, lw=0)
    style = curve_style(index)
    axes.plot(centres, median, lw=1.4, marker="o", ms=2.5, label=name, **style)
