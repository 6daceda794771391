"""The files of the reproduction: figures, results and a page on the 2008 paper."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from html import escape
from math import degrees
from pathlib import Path

import numpy as np

from benchmarks.paper_2008.claims import GROUPS, Claim, measure_claims, rms
from benchmarks.paper_2008.figures import CAPTIONS, FIGURES, POSITIONED, SUMMARY, draw_figure
from benchmarks.paper_2008.series import PLANTS, SEEDS, SERIES_2, SeriesRun, all_runs
from distal.confidence import BAND, COVERED_TEXT
from distal.control import ClosedLoop, closed_loop, plot_control, trackings_of
from distal.errors import OutputError
from distal.logs import check_outputs, outputs_in, write_together
from distal.reports import rig_svg, svg_of
from distal.reports.page import heading, page, paragraph, picture
from distal.results import Html, figure_bytes, html_table, make_folder, verdict
from distal.rig import load_rig
from distal.simulation import load_scenario, scenario_rig

ESTIMATORS = ("inextensible", "simulation", "ekf-2008", "observed friction", "ekf", "adaptive")
"""Estimators in the tables of errors."""

SCENARIO = "control-paper"
"""Name of the scenario of the closed loops."""

FEEDBACKS = ("encoder", "adaptive", "ratio")
"""Feedbacks of the closed loops: the encoder, the estimator `adaptive`, and displacements divided
by radii.
"""

REPRODUCTION_FILES = (
    *(f"{name}.{kind}" for name in CAPTIONS for kind in ("png", "svg")),
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

SEARCH_NOTE = (
    "How the plant with more friction was found: plants were drawn over what the paper does not "
    "print, and the one on which most of the twelve statements hold was taken, so all twelve have "
    "chosen it. python -m benchmarks.paper_search does this again and tests each statement on the "
    "plant that the other eleven choose."
)
"""Text on how the plant with more friction was found."""

EKF_NOTE = (
    "Bold is the smallest error of a row. ekf is the filter of 2008 with the noise of the sensors "
    "as the simulation has it; on the plant with the friction of Table 1 it has the exact model "
    "too, and nothing can be better. At 2 N / 6 N Table 1 is nearly right on the other plant, and "
    "filters that take it for exact beat adaptive, which keeps room for friction that is wrong. "
    "From 3 N / 9 N on that room is what keeps adaptive right."
)
"""Text below the table of errors."""


def reproduce(
    out: Path, advance: Callable[[], None], lab: Path | None
) -> tuple[tuple[Claim, ...], list[SeriesRun]]:
    """Simulate and filter the paper's two series, and write the figures, ``results.json`` and
    ``index.html``.

    Return the paper's statements C1 to C12, and the runs on which they were measured.

    Args:
        out: the folder, which is made where it does not exist.
        advance: called after each test (`benchmarks.paper_2008.series.TESTS`), then after each
            closed loop, then after each figure.
        lab: a page of `tools.lab`, which is copied beside the page and linked from it; or None.

    Raises:
        OutputError: the folder or a file cannot be written, or the lab cannot be read.
    """
    written = REPRODUCTION_FILES if lab is None else (*REPRODUCTION_FILES, LAB)
    check_outputs(outputs_in(out, written, "the reproduction"))
    try:
        moving = None if lab is None else lab.read_bytes()
    except OSError as problem:
        raise OutputError(
            f"{lab}: cannot be read ({problem.strerror}); python -m tools.lab writes one"
        ) from None
    folder = make_folder(out)
    runs = list(all_runs(advance))
    claims = measure_claims(runs)
    loops = positioned(advance)
    drawings = dict[str, str]()
    files = dict[Path, bytes | str]()
    for name in CAPTIONS:
        drawing = plot_control(loops) if name == POSITIONED else draw_figure(name, runs)
        files |= {
            path: figure_bytes(drawing, path)
            for path in (folder / f"{name}.png", folder / f"{name}.svg")
        }
        drawings[name] = svg_of(drawing, CAPTIONS[name])
        advance()
    errors = errors_of(runs)
    text = json.dumps(results(claims, errors), indent=2, ensure_ascii=False)
    files[folder / "results.json"] = text + "\n"
    files[folder / "index.html"] = _page(
        claims, runs, errors, drawings, positioned_text(loops), moving is not None
    )
    if moving is not None:
        files[folder / LAB] = moving
    write_together(files)
    return claims, runs


def positioned(advance: Callable[[], None]) -> list[ClosedLoop]:
    """Return the closed loop of the link with each of `FEEDBACKS`; `advance` is called after
    each.
    """
    scenario = load_scenario(SCENARIO)
    runs = []
    rig = scenario_rig(scenario)
    for feedback in FEEDBACKS:
        runs.append(closed_loop(rig, scenario, 1, feedback=feedback))
        advance()
    return runs


def positioned_text(runs: list[ClosedLoop]) -> str:
    """Return a text on the tracking errors of the closed loops."""
    away = {run.feedback: degrees(trackings_of(run)[0].rms) for run in runs}
    return (
        "The paper ends with what its estimate is for: joints without sensors that are still "
        "positioned accurately. Here "
        "a PID controller turns the link, with drives that follow in 40 ms in place of the "
        "paper's weights. The link's "
        f"distance from its reference is {away['encoder']:.1f}° RMS with an encoder, "
        f"{away['adaptive']:.1f}° with the "
        f"estimate, most of it at the steps, and {away['ratio']:.1f}° where the stretch of the "
        "tendons is taken for "
        "motion. The rig file has the observed friction, known to 20 %."
    )


Errors = dict[str, dict[str, dict[str, float]]]
"""Name of a plant → scenario → estimate → RMS error [°]."""


def errors_of(runs: Sequence[SeriesRun]) -> Errors:
    """Return the errors in Series 2 of all estimators."""
    return {
        plant.name: {
            series: {name: rms(runs, series, name, plant.name) for name in ESTIMATORS}
            for series in SERIES_2
        }
        for plant in PLANTS
    }


def results(claims: Sequence[Claim], errors: Errors) -> dict[str, object]:
    """Return the content of `results.json`: for C1 to C12 their measures and group, and the errors
    of all estimators.
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


def _page(
    claims: Sequence[Claim],
    runs: Sequence[SeriesRun],
    errors: Errors,
    drawings: dict[str, str],
    positioned_sentences: str,
    lab: bool,
) -> str:
    observed = PLANTS[1].name
    highest = errors[observed][SERIES_2[-1]]
    held = sum(claim.holds(observed) for claim in claims)
    lead = (
        "Joints that are pulled by tendons are light, but a sensor in the joint is one more thing "
        "to fit, wire and break. "
        "The motors have sensors already. Tendons stretch and rub, so what these say is not where "
        "the joint is."
    )
    moving = next(run for run in runs if run.plant == observed and run.series == SERIES_2[-1])
    parts = [
        *_moving_link(moving),
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
            f"{highest['inextensible']:.1f}°, "
            f"the filter of 2008 by {highest['ekf-2008']:.1f}°, and adaptive, the filter of "
            "distal, by "
            f"{highest['adaptive']:.1f}°."
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
        picture(drawings[POSITIONED], CAPTIONS[POSITIONED]),
        heading("RMS errors in Series 2"),
        _errors_table(runs, errors),
        paragraph(EKF_NOTE),
        paragraph(
            f"All errors are RMS over all samples of {len(SEEDS)} seeds of the sensors' errors."
        ),
    ]
    return page("Where is the joint, without a sensor in it?", lead, parts)


def _moving_link(run: SeriesRun) -> list[str]:
    """Return a text that explains a band."""
    estimate = run.estimates["adaptive"]
    naive = run.estimates["inextensible"]
    text = (
        f"A {COVERED_TEXT} band: so much of the time the link should be inside it. Here it is "
        f"inside in {100 * estimate.inside_band():.0f} %, and half of the band is "
        f"{degrees(BAND * np.median(estimate.theta_std)):.1f}°. The less is known, the wider it "
        "is. Read as if nothing stretched, this link is "
        f"{degrees(naive.rms_error()):.1f}° off (RMS), as distal says it "
        f"{degrees(estimate.rms_error()):.1f}°."
    )
    return [
        heading("What the band is"),
        paragraph(text),
    ]


def _errors_table(runs: Sequence[SeriesRun], errors: Errors) -> str:
    rows = []
    sources = {run.series: run.log.source.removeprefix("Series 2: ") for run in runs}
    for plant, by_series in errors.items():
        for series, by_name in by_series.items():
            values = [by_name[name] for name in ESTIMATORS]
            cells = [
                Html(f"<b>{value:.2f}</b>") if value == min(values) else f"{value:.2f}"
                for value in values
            ]
            rows.append([plant, sources[series], *cells])
    names = [
        {"simulation": "simulation alone", "observed friction": "ekf-2008, observed friction"}.get(
            name, name
        )
        for name in ESTIMATORS
    ]
    columns = ["plant", "weights", *(f"{name} [°]" for name in names)]
    return html_table(columns, rows, range(2, len(columns)))


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = list[list[str]]()
    for claim in claims:
        statement = claim.statement
        first = Html(
            f"{escape(statement.text)}<br><span class='why'>{escape(statement.reason)}</span>"
        )
        for i, measure in enumerate(statement.measures):
            values = [claim.values[plant.name][i] for plant in PLANTS]
            holds = [measure.margin(value) >= 0.0 for value in values]
            cells = [
                verdict(f"{value:.2f} {'✓' if yes else '✗'}", yes)
                for value, yes in zip(values, holds)
            ]
            bound = f"≥ {measure.least:g}" if measure.least is not None else f"≤ {measure.most:g}"
            rows.append([first if i == 0 else "", measure.text, bound, *cells])
    columns = ["statement, and why it stands here", "measure", "threshold"]
    return html_table([*columns, *(plant.name for plant in PLANTS)], rows, values=(2, 3, 4))
