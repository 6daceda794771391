"""Figures 2 to 5 of the 2008 paper, simulated.

The files of the reproduction: figures, results and a page on the 2008 paper.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import BAND, COVERED_TEXT
from distal.logs import check_outputs, outputs_in, write_together
from distal.reports.page import heading, page, paragraph, picture, svg_of
from distal.reports.paper_2008.claims import (
    GROUPS,
    PLANTS,
    SEEDS,
    SERIES_2,
    SIDES,
    TESTS,
    Claim,
    Runs,
    SeriesRun,
    all_runs,
    measure_claims,
    potentiometer_errors,
    rms,
)
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    BLACK,
    SOFT,
    TRUTH,
    Html,
    band_colour,
    curve_style,
    figure,
    figure_bytes,
    html_table,
    make_folder,
    verdict,
)
from distal.rig import load_rig

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

FIGURES = {
    "figure-2": "series-1-soft",
    "figure-3": "series-2",
    "figure-4": "series-2-medium",
    "figure-5": "series-2-high",
}
"""Name of a figure → its scenario; the paper does not print the higher weights of its figures 4 and
5.
"""

CAPTIONS = {
    "figure-2": "Series 1: the link is moved by hand, 2 N on each tendon, k = 403 N/m. The angle "
    "from each potentiometer, tendons taken as inextensible, against the encoder.",
    "figure-3": "Series 2: 2 N against 6 N, k = 806 N/m. Inextensible estimate, simulation from "
    "the measured forces alone, and Kalman filters; below, the errors of all but the first with "
    f"the {COVERED_TEXT} band of adaptive. The link rests afterwards, up to 8 s.",
    "figure-4": "Series 2 at higher tension: 3 N against 9 N.",
    "figure-5": "Series 2 at the highest tension: 4 N against 12 N.",
}
"""Name of a figure → its caption."""

FILTERS = {"ekf-2008": 1, "ekf": 2, "adaptive": 0, "simulation": 4, "inextensible": 3}
"""Estimate in the figures of Series 2 → index of its colour and dash."""

NAMES = {"simulation": "simulation alone", "ekf-2008": "2008 filter", "ekf": "ekf, exact noise"}
"""Estimator → its label in figures, where that is not its own name."""

AFTER = 0.4
"""Time that the figures show after the link has come to rest [s]. Source: layout."""


def end_of_motion(shown: Sequence[SeriesRun]) -> float:
    """Return the time at which the figures of some runs end [s]: `AFTER` the link has come to rest
    in all.
    """
    ends = []
    for run in shown:
        theta = run.log.truth["theta"]
        moving = np.abs(theta - theta[-1]) > np.deg2rad(0.1)
        ends.append(run.log.time[moving].max(initial=0.0))
    return float(min(max(ends) + AFTER, shown[0].log.time[-1]))


def draw_figure(name: str, runs: Runs) -> Figure:
    """Return one of `FIGURES`: the plant with the friction of Table 1 beside that with more.

    Curves are of the first seed.
    """
    shown = [
        next(run for run in of_plant if run.series == FIGURES[name]) for of_plant in runs.values()
    ]
    n = len(shown)
    layout = {"sharex": True, "sharey": "row", "height_ratios": [1.6, 1]}
    with figure(2, n, (7.2, 5.2), **layout) as (drawing, axes):
        for top, bottom, run in zip(axes[:n], axes[n:], shown):
            readings = np.rad2deg(run.log.channels["encoder"])
            style = {"color": SOFT, "linewidth": 2.2, "drawstyle": "steps-post"}
            top.plot(run.log.time, readings, label="encoder (1°)", **style)
            top.plot(run.log.time, np.rad2deg(run.log.truth["theta"]), label="truth", **TRUTH)
            if name == "figure-2":
                _draw_potentiometers(top, bottom, run)
            else:
                _draw_filters(top, bottom, run)
            top.set_title(f"plant with {run.plant}", fontsize=9, loc="left")
            bottom.axhline(0.0, color=BLACK, linewidth=0.6)
            bottom.set_xlabel("time [s]")
        if name != "figure-2":
            axes[0].set_xlim(0.7, end_of_motion(shown))
        axes[0].set_ylabel("link angle θ [°]")
        axes[n].set_ylabel("error [°]")
        legend = axes[0].get_legend_handles_labels()
        drawing.legend(*legend, loc="outside lower center", ncols=n + 2, fontsize=8)
    return drawing


def _draw_potentiometers(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    truth = np.rad2deg(run.log.truth["theta"])
    for i, (side, error) in enumerate(zip(SIDES, np.rad2deg(potentiometer_errors(run)))):
        style = {"linewidth": 1.2, **curve_style(i)}
        top.plot(run.log.time, truth + error, label=f"from {side} potentiometer", **style)
        bottom.plot(run.log.time, error, **style)


def _draw_filters(top: Axes, bottom: Axes, run: SeriesRun) -> None:
    """Draw estimates, their errors but that of inextensible, and the band of adaptive about
    zero.
    """
    for name, index in FILTERS.items():
        estimate = run.estimates[name]
        style = curve_style(index)
        theta = np.rad2deg(estimate.theta)
        top.plot(run.log.time, theta, linewidth=1.2, label=NAMES.get(name, name), **style)
        if name != "inextensible":
            error = np.rad2deg(estimate.errors())
            bottom.plot(run.log.time, error, linewidth=1.1, **style)
    band = np.rad2deg(BAND * run.estimates["adaptive"].theta_std)
    style = {"color": band_colour(), "linewidth": 0}
    bottom.fill_between(run.log.time, -band, band, **style)
    top.fill_between([], [], [], label=f"{COVERED_TEXT} band of adaptive", **style)


ESTIMATES = ("inextensible", "simulation", "ekf-2008", "observed friction", "ekf", "adaptive")
"""Estimates in the table of errors."""

FILES = (
    *(f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")),
    "results.json",
    "index.html",
)
"""Names of the files that `reproduce` writes."""

INTRODUCTION = (
    "Proximal measurement of a tendon-driven rotating link, Canadian Conference on Electrical and "
    "Computer Engineering (CCECE), 2008, IEEE 978-1-4244-1643-1/08. A link is turned by two "
    "opposed nylon tendons; potentiometers and load cells at their far ends must tell its angle. "
    "Here the paper's tests are simulated again, on two plants. One has the friction of Table 1, "
    "which cannot produce the errors that the paper shows. The other has that with which most of "
    "the paper's statements hold. Every filter knows Table 1 only. The scenario files say what is "
    "assumed where the paper prints nothing."
)
"""Text at the top of the page."""

NOTE = (
    f"RMS over all samples of {len(SEEDS)} seeds of the sensors' errors; bold is the smallest of a "
    "row. ekf is the filter of 2008 with the noise of the sensors as the simulation has it, "
    "observed friction that filter with the friction of the second plant."
)
"""Text below the table of errors."""


def steps() -> int:
    """Return how often `reproduce` calls its `advance`."""
    return len(TESTS) + len(CAPTIONS)


def reproduce(out: Path, advance: Callable[[], None]) -> tuple[Claim, ...]:
    """Simulate and filter the paper's two series, and write the figures, ``results.json`` and
    ``index.html``.

    Return the paper's statements C1 to C12 with their measures.

    Args:
        out: the folder, which is made where it does not exist.
        advance: called after each test and after each figure.

    Raises:
        OutputError: the folder or a file cannot be written.
    """
    check_outputs(outputs_in(out, FILES, "the reproduction"))
    folder = make_folder(out)
    runs = all_runs(advance)
    claims = measure_claims(runs)
    pictures = list[str]()
    files = dict[Path, bytes | str]()
    for name, caption in CAPTIONS.items():
        drawing = draw_figure(name, runs)
        for path in (folder / f"{name}.png", folder / f"{name}.svg"):
            files[path] = figure_bytes(drawing, path)
        titled = f"{name.replace('-', ' ').capitalize()}. {caption}"
        pictures.append(picture(svg_of(drawing, caption), titled))
        advance()
    errors = errors_of(runs)
    text = json.dumps(results(claims, errors), indent=2, ensure_ascii=False)
    files[folder / "results.json"] = text + "\n"
    files[folder / "index.html"] = _page(claims, errors, pictures)
    write_together(files)
    return claims


Errors = dict[str, dict[str, dict[str, float]]]
"""Name of a plant → scenario → estimate → RMS error [°]."""


def errors_of(runs: Runs) -> Errors:
    """Return the errors in Series 2 of all estimates."""
    return {
        plant: {
            series: {name: rms(of_plant, series, name) for name in ESTIMATES} for series in SERIES_2
        }
        for plant, of_plant in runs.items()
    }


def results(claims: Sequence[Claim], errors: Errors) -> dict[str, object]:
    """Return the content of `results.json`: for C1 to C12 their measures and group, and the errors
    of all estimates.
    """
    content: dict[str, object] = {
        claim.statement.key: {
            "statement": claim.statement.text,
            "group": claim.group,
            "threshold": claim.statement.why,
            "measures": [
                {
                    "measure": measure.text,
                    "least": measure.least,
                    "most": measure.most,
                    "values": {plant: values[i] for plant, values in claim.values.items()},
                    "holds": {
                        plant: measure.margin(values[i]) >= 0.0
                        for plant, values in claim.values.items()
                    },
                }
                for i, measure in enumerate(claim.statement.measures)
            ],
        }
        for claim in claims
    }
    return content | {"rms_error_deg": errors, "seeds": list(SEEDS)}


def _page(claims: Sequence[Claim], errors: Errors, pictures: Sequence[str]) -> str:
    held = sum(claim.holds(PLANTS[1].name) for claim in claims)
    rig = rig_svg(load_rig("paper-2008-printed"))
    parts = [
        picture(rig, "The rig, with the numbers of Table 1."),
        heading("Figures 2 to 5, simulated"),
        *pictures,
        heading(f"{held} of {len(claims)} statements hold on the plant with more friction"),
        paragraph(
            "The thresholds were written down before the first run and have not been changed since."
        ),
    ]
    for group in GROUPS:
        chosen = [claim for claim in claims if claim.group == group]
        if chosen:
            parts.append(heading(f"{group.capitalize()}: {len(chosen)} of {len(claims)}", 3))
            parts.append(_claims_table(chosen))
    parts += [heading("RMS errors in Series 2"), _errors_table(errors), paragraph(NOTE)]
    return page("The tests of a paper of 2008", INTRODUCTION, parts)


def _errors_table(errors: Errors) -> str:
    rows = []
    for plant, by_series in errors.items():
        for series, by_name in by_series.items():
            values = by_name.values()
            cells = [
                Html(f"<b>{value:.2f}</b>") if value == min(values) else f"{value:.2f}"
                for value in values
            ]
            rows.append([plant, series, *cells])
    columns = ["plant", "scenario", *(f"{name} [°]" for name in ESTIMATES)]
    return html_table(columns, rows, range(2, len(columns)))


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = list[list[str]]()
    for claim in claims:
        statement = claim.statement
        first = Html(
            f"{escape(statement.text)}<br><span class='why'>{escape(statement.reason)}</span>"
        )
        for i, measure in enumerate(statement.measures):
            cells = []
            for values in claim.values.values():
                holds = measure.margin(values[i]) >= 0.0
                cells.append(verdict(f"{values[i]:.2f} {'✓' if holds else '✗'}", holds))
            bound = f"≥ {measure.least:g}" if measure.least is not None else f"≤ {measure.most:g}"
            rows.append([first if i == 0 else "", measure.text, bound, *cells])
    columns = ["statement, and why it stands here", "measure", "threshold"]
    return html_table([*columns, *(plant.name for plant in PLANTS)], rows, values=(2, 3, 4))
