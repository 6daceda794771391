"""The page on a fit: the fitted parameters, their standard errors, and the errors of the angle.

Its figures show each log with the fitted rig.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import COVERED_TEXT
from distal.fitting import WRITTEN, Fit
from distal.logs import Log, check_outputs, outputs_in, shown, write_whole
from distal.reports.page import heading, page, paragraph, picture, svg_of
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    PANELS,
    Estimate,
    Html,
    html_table,
    make_folder,
    plot_estimates,
    verdict,
)
from distal.rig import Rig, named, scales_in_words
from distal.run import estimate, log_health

if TYPE_CHECKING:
    from matplotlib.figure import Figure


MOST_TRACES = 8
"""Number of logs whose curves are drawn at most; the table holds all logs. Source: layout."""

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
    estimates = [estimate(log, fit.rig, homing=fit.homing) for log in logs]
    parts = [
        picture(rig_svg(fit.rig), "The rig as fitted."),
        *_doubts(fit),
        *_left_out(fit),
        *_parameters(fit),
        *_errors(logs, estimates),
        heading("Along the logs"),
    ]
    caption = (
        f"Estimate with the fitted rig, {COVERED_TEXT} band shaded; errors; innovations, "
        "of which 95 % should be within ±2; what was measured; a stream's word "
        "on its health."
    )
    for log, result in zip(logs[:MOST_TRACES], estimates):
        parts.append(picture(svg_of(draw_traces(log, result, fit.rig)), caption))
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
    per_log = [
        (part.name, Path(log).name, f"{number:.5g}", part.si)
        for part in fit.fitted
        for log, number in part.per_log.items()
    ]
    if per_log:
        parts.append(html_table(("number", "log", "value", "unit"), per_log, values=(2,)))
    if fit.interrupted:
        parts.append(paragraph("The search was interrupted: these are the best values so far."))
    return parts


def _error(rms: float, inside: float) -> tuple[str, str]:
    """Return cells: an RMS error [rad], and the coverage of the band, NaN where it has none."""
    return f"{np.rad2deg(rms):.3f}", "–" if np.isnan(inside) else f"{100 * inside:.0f} %"


def _errors(logs: Sequence[Log], estimates: Sequence[Estimate]) -> list[str]:
    rows = [
        (shown(Path(log.source).name), *_error(result.rms_error(), result.inside_band()))
        for log, result in zip(logs, estimates)
        if result.truths is not None
    ]
    if not rows:
        return []
    table = html_table(("log", "RMS [°]", "in the band"), rows, range(1, 3))
    return [heading("Errors on the logs that were fitted"), table]


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
        ("what gives the angle", "RMS error [°]", f"inside the {COVERED_TEXT} band"),
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


DRAWN_POINTS = 1200
"""Number of points that are drawn along a log, about; up to twice as many may be. Source:
layout.
"""


def draw_traces(log: Log, estimate: Estimate, rig: Rig) -> Figure:
    """Return a figure over one log: truth, estimate, its errors, innovations, forces and health."""
    # fewer points keep a page with a dozen logs small; a printed line shows no more
    rows = slice(None, None, max(1, len(log) // DRAWN_POINTS))
    words = log_health(log, rig)
    columns = ("time", "means", "variances", "innovations", "innovation_variances")
    truths = None if estimate.truths is None else estimate.truths[rows]
    thinned = {key: getattr(estimate, key)[rows] for key in columns}
    return plot_estimates(
        [replace(estimate, truths=truths, **thinned)],
        # any name of a file can be drawn: what is not printable is escaped
        title=shown(Path(log.source).name),
        panels=PANELS,
        log=log.select(rows),
        rig=rig,
        health=words[rows],
    )
