"""The files of `distal reproduce`: figures, results and a page on the 2008 paper."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from distal.control import plot_control
from distal.errors import OutputError
from distal.logs import check_outputs, outputs_in, write_together
from distal.paper.claims import GROUPS, Claim, Measure, measure_claims, rms
from distal.paper.moving import moving_link
from distal.paper.paper_figures import CAPTIONS, FIGURES, SUMMARY, draw_figure
from distal.paper.positioned import CAPTION, POSITIONED, positioned, positioned_text
from distal.paper.reasons import EKF_NOTE, REASONS, SEARCH_NOTE
from distal.paper.series import PLANTS, READINGS, SEEDS, SERIES_2, Plant, SeriesRun, all_runs
from distal.reports import rig_svg, svg_of
from distal.reports.page import heading, html_table, page, paragraph, picture
from distal.results import figure_bytes, make_folder
from distal.rig import load_rig

ESTIMATORS = ("inextensible", "simulation", "ekf-2008", "observed friction", "ekf", "adaptive")
"""Estimators in the tables of errors."""

DRAWN = (SUMMARY, *FIGURES, POSITIONED)
"""Names of all figures."""

REPRODUCTION_FILES = (
    *(f"{name}.{kind}" for name in DRAWN for kind in ("png", "svg")),
    "results.json",
    "index.html",
)
"""Names of the files that `reproduce` writes."""

LAB = "lab.html"
"""Name of the copy of a lab's page, which is written if a lab is given."""

REFERENCE = (
    "The paper: proximal measurement of a tendon-driven rotating link, Canadian Conference on "
    "Electrical and Computer "
    "Engineering (CCECE), 2008, IEEE 978-1-4244-1643-1/08."
)
"""The paper's title and source, for the page."""


def reproduce(
    out: Path, advance: Callable[[], None], lab: Path | None
) -> tuple[tuple[Claim, ...], list[SeriesRun]]:
    """Simulate and filter the paper's two series, and write the figures, ``results.json`` and
    ``index.html``.

    Return the paper's statements C1 to C12, and the runs on which they were measured.

    Args:
        out: the folder, which is made where it does not exist.
        advance: called after each test (`distal.paper.series.series_count` times), then after each
            closed loop, then after each figure.
        lab: a page of `distal lab`, which is copied beside the page and linked from it; or None.

    Raises:
        OutputError: the folder or a file cannot be written, or the lab cannot be read.
    """
    written = REPRODUCTION_FILES if lab is None else (*REPRODUCTION_FILES, LAB)
    check_outputs(outputs_in(out, written, "the reproduction"))
    try:
        moving = None if lab is None else lab.read_bytes()
    except OSError as problem:
        raise OutputError(
            f"{lab}: cannot be read ({problem.strerror}); distal lab writes one"
        ) from None
    folder = make_folder(out)
    runs = list(all_runs(advance))
    claims = measure_claims(runs)
    loops = positioned(advance)
    drawings = dict[str, str]()
    files = dict[Path, bytes | str]()
    for name in DRAWN:
        drawing = plot_control(loops) if name == POSITIONED else draw_figure(name, runs)
        files |= {
            path: figure_bytes(drawing, path)
            for path in (folder / f"{name}.png", folder / f"{name}.svg")
        }
        drawings[name] = svg_of(drawing, CAPTION if name == POSITIONED else CAPTIONS[name])
        advance()
    files[folder / "results.json"] = (
        json.dumps(results(claims, runs), indent=2, ensure_ascii=False) + "\n"
    )
    files[folder / "index.html"] = _page(
        claims, runs, drawings, positioned_text(loops), moving is not None
    )
    if moving is not None:
        files[folder / LAB] = moving
    write_together(files)
    return claims, runs


def results(claims: Sequence[Claim], runs: Sequence[SeriesRun]) -> dict[str, object]:
    """Return the content of `results.json`: for C1 to C12 their measures and group, and the errors
    of all estimators.
    """

    def error_of(plant: Plant, series: str, estimator: str) -> float:
        return round(rms_of(runs, plant.name, series, estimator), 4)

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
                    "values": {
                        plant: round(values[i], 4) for plant, values in claim.values.items()
                    },
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
    content["rms_error_deg"] = {
        plant.name: {
            series: {name: error_of(plant, series, name) for name in ESTIMATORS}
            for series in SERIES_2
        }
        for plant in PLANTS
    }
    content["readings_of_q_and_r_rms_deg"] = {
        plant.name: {name: error_of(plant, "series-2", f"reading {name}") for name in READINGS}
        for plant in PLANTS
    }
    content["seeds"] = list(SEEDS)
    return content


def rms_of(runs: Sequence[SeriesRun], plant: str, series: str, estimator: str) -> float:
    """Return the RMS error of an estimator in a series on a plant, pooled over all samples and
    seeds [°].

    Args:
        plant: name of the plant.
        series: name of the scenario.
        estimator: a key of `SeriesRun.estimates`.
    """
    return rms([run for run in runs if run.plant == plant], series, estimator)


def _page(
    claims: Sequence[Claim],
    runs: Sequence[SeriesRun],
    drawings: dict[str, str],
    positioned_sentences: str,
    lab: bool,
) -> str:
    observed = PLANTS[1].name
    errors = {
        name: rms_of(runs, observed, SERIES_2[-1], name)
        for name in ("inextensible", "ekf-2008", "adaptive")
    }
    held = sum(claim.holds(observed) for claim in claims)
    lead = (
        "Joints that are pulled by tendons are light, but a sensor in the joint is one more thing "
        "to fit, wire and break. "
        "The motors have sensors already. Tendons stretch and rub, so what these say is not where "
        "the joint is."
    )
    moving = next(run for run in runs if run.plant == observed and run.series == SERIES_2[-1])
    parts = [
        *moving_link(moving),
        f"<p><a href='{LAB}'>See it move in the lab</a>: change what is true, pull the link, and "
        "see when the encoder can "
        "be left out.</p>"
        if lab
        else "",
        heading("The proof: the tests of a paper of 2008"),
        paragraph(
            "A link is turned by two opposed nylon tendons; potentiometers and load cells at "
            "their far ends must tell "
            "its angle. In 2008 a dynamic model inside an extended Kalman filter did that. Here "
            "the paper's tests are "
            "simulated again. At the highest tension, tendons taken as inextensible err by "
            f"{errors['inextensible']:.1f}°, "
            f"the filter of 2008 by {errors['ekf-2008']:.1f}°, and adaptive, the filter of "
            "distal, by "
            f"{errors['adaptive']:.1f}°."
        ),
        picture(drawings[SUMMARY], CAPTIONS[SUMMARY]),
        picture(
            rig_svg(load_rig("paper-2008-printed")),
            "The rig of the paper, with the numbers of its Table 1.",
        ),
        paragraph(REFERENCE),
        paragraph(
            "Two plants are simulated. One has the friction of the paper's Table 1, which cannot "
            "produce the errors that "
            "the paper shows. The other has more: the friction with which most of the paper's "
            "statements hold. Every "
            "filter knows Table 1 only. Start angles, the manner of loading and the higher "
            "weights are not printed; what "
            "is assumed stands in the scenario files."
        ),
        heading("Figures 2 to 5 of the paper, simulated"),
    ]
    parts += [
        *(
            picture(drawings[name], f"{name.replace('-', ' ').capitalize()}. {CAPTIONS[name]}")
            for name in FIGURES
        ),
        heading(
            f"What the paper states: {held} of {len(claims)} statements hold on the plant with "
            "more friction"
        ),
        paragraph(
            "The thresholds were written down before the first run and have not been changed since."
        ),
        paragraph(SEARCH_NOTE),
    ]
    for group in GROUPS:
        chosen = [claim for claim in claims if claim.group == group]
        if chosen:
            parts.append(heading(f"{group.capitalize()}: {len(chosen)} of {len(claims)}", 3))
            parts.append(_claims_table(chosen))
    parts += [
        heading("What it is for: the link positioned without its encoder"),
        paragraph(positioned_sentences),
        picture(drawings[POSITIONED], CAPTION),
        heading("RMS errors in Series 2"),
        _errors_table(runs),
        paragraph(EKF_NOTE),
        heading("What Q = R = 0.001 can have meant"),
        paragraph(READING_NOTE),
        _readings_table(runs),
        paragraph(
            f"All errors are RMS over all samples of {len(SEEDS)} seeds of the sensors' errors."
        ),
    ]
    return page("Where is the joint, without a sensor in it?", lead, parts)


READING_NOTE = (
    "The paper sets Q = R = 0.001·I without units. In SI, R would be a potentiometer that errs by "
    "32 mm, three "
    "times its travel; in mm² it errs by 32 µm, between its random error and its linearity. "
    "ekf-2008 reads R in mm² "
    "and the rest in SI. What each reading gives at 2 N / 6 N, one pass:"
)
"""Text of the page on the readings of the paper's Q and R."""


def _errors_table(runs: Sequence[SeriesRun]) -> str:
    rows = []
    for plant in PLANTS:
        for series in SERIES_2:
            name = next(run.log.source for run in runs if run.series == series).removeprefix(
                "Series 2: "
            )
            values = [rms_of(runs, plant.name, series, estimator) for estimator in ESTIMATORS]
            best = min(values)
            cells = [f"<b>{value:.2f}</b>" if value == best else f"{value:.2f}" for value in values]
            rows.append([escape(plant.name), escape(name), *cells])
    names = (
        "inextensible",
        "simulation alone",
        "ekf-2008",
        "ekf-2008, observed friction",
        "ekf",
        "adaptive",
    )
    return html_table(
        ["plant", "weights", *(f"{name} [°]" for name in names)], rows, values=range(2, 8)
    )


def _readings_table(runs: Sequence[SeriesRun]) -> str:
    rows = [
        [
            escape(name),
            *(f"{rms_of(runs, plant.name, 'series-2', f'reading {name}'):.2f}" for plant in PLANTS),
        ]
        for name in READINGS
    ]
    return html_table(
        ["reading", *(f"RMS, plant with {plant.name} [°]" for plant in PLANTS)],
        rows,
        values=(1, 2),
    )


def _cell(measure: Measure, value: float) -> str:
    holds = measure.margin(value) >= 0.0
    return f"<span class='{'yes' if holds else 'no'}'>{value:.2f} {'✓' if holds else '✗'}</span>"


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = []
    for claim in claims:
        statement = claim.statement
        reason = REASONS.get(claim.statement.key, "")
        for i, measure in enumerate(statement.measures):
            values = [_cell(measure, claim.values[plant.name][i]) for plant in PLANTS]
            sentences = (
                f"{escape(statement.text)}<br><span "
                f"class='why'>{escape(reason or statement.why)}</span>"
            )
            bound = f"≥ {measure.least:g}" if measure.least is not None else f"≤ {measure.most:g}"
            first = [sentences] if i == 0 else [""]
            rows.append([*first, escape(measure.text), bound, *values])
    columns = [
        "statement, and why it stands here",
        "measure",
        "threshold",
        *(plant.name for plant in PLANTS),
    ]
    return html_table(columns, rows, values=(2, 3, 4))
