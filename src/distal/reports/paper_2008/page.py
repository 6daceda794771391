"""The files of the reproduction: figures, results and a page on the 2008 paper."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path

from distal.logs import check_outputs, outputs_in, write_together
from distal.reports.page import heading, page, paragraph, picture, svg_of
from distal.reports.paper_2008.claims import GROUPS, Claim, measure_claims, rms
from distal.reports.paper_2008.figures import CAPTIONS, draw_figure
from distal.reports.paper_2008.series import PLANTS, SEEDS, SERIES_2, TESTS, SeriesRun, all_runs
from distal.reports.rig_drawing import rig_svg
from distal.results import Html, figure_bytes, html_table, make_folder, verdict
from distal.rig import load_rig

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
    runs = list(all_runs(advance))
    claims = measure_claims(runs)
    pictures = list[str]()
    files = dict[Path, bytes | str]()
    for name, caption in CAPTIONS.items():
        drawing = draw_figure(name, runs)
        files |= {
            path: figure_bytes(drawing, path)
            for path in (folder / f"{name}.png", folder / f"{name}.svg")
        }
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


def errors_of(runs: Sequence[SeriesRun]) -> Errors:
    """Return the errors in Series 2 of all estimates."""
    return {
        plant.name: {
            series: {name: rms(runs, series, name, plant.name) for name in ESTIMATES}
            for series in SERIES_2
        }
        for plant in PLANTS
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
            values = [by_name[name] for name in ESTIMATES]
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
