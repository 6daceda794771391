"""`reproduce`: figures, results and a page for the 2008 paper."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

from distal.analysis import PLANTS, READINGS, SEEDS, SERIES_2, Claim, Measure, Run, all_runs, measure_claims, rms
from distal.errors import OutputError
from distal.logs import check_outputs, outputs_in, write_together
from distal.reports.page import heading, html_table, page, paragraph, picture
from distal.reports.reproduction_figures import CAPTIONS, FIGURES, draw_figure
from distal.results import figure_bytes

if TYPE_CHECKING:
    from matplotlib.figure import Figure

ESTIMATORS = ("inextensible", "simulation", "ekf-2008", "ekf", "adaptive")

REPRODUCTION_FILES = (*(f"{name}.{kind}" for name in FIGURES for kind in ("png", "svg")), "results.json", "index.html")
"""Files that `reproduce` writes."""


def reproduce(out: str | Path, advance: Callable[[], None] = lambda: None) -> tuple[Claim, ...]:
    """Simulate and filter the paper's two series, and write figures 2 to 5, ``results.json`` and ``index.html``.

    Args:
        out: folder, made if need be.
        advance: called after each of `distal.analysis.run_count` runs, then after each figure.

    Returns:
        claims: the paper's statements C1 to C12, measured.

    Raises:
        OutputError: the folder or a file cannot be written.
    """
    check_outputs(outputs_in(out, REPRODUCTION_FILES, "the reproduction"))
    folder = make_folder(out)
    runs = list(all_runs(advance))
    claims = measure_claims(runs)
    drawings, files = dict[str, str](), dict[Path, bytes | str]()
    for name in FIGURES:
        made = draw_figure(name, runs)
        files |= {path: figure_bytes(made, path) for path in (folder / f"{name}.png", folder / f"{name}.svg")}
        drawings[name] = _svg(made)
        advance()
    files[folder / "results.json"] = json.dumps(results(claims, runs), indent=2, ensure_ascii=False) + "\n"
    files[folder / "index.html"] = _page(claims, runs, drawings)
    write_together(files)
    return claims


def make_folder(path: str | Path) -> Path:
    """Return the folder, made if need be.

    Raises:
        OutputError: it cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror or problem})") from None
    return folder


def _svg(made: Figure) -> str:
    buffer = io.StringIO()
    made.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def results(claims: Sequence[Claim], runs: Sequence[Run]) -> dict[str, object]:
    """Return what `results.json` holds: C1 to C12 with numbers and verdict, and the errors of all estimators.

    Args:
        claims: of `measure_claims`.
        runs: of `all_runs`.
    """
    held: dict[str, object] = {
        claim.key: {
            "statement": claim.statement,
            "verdict": claim.verdict,
            "threshold": claim.why,
            "measures": [_measure(measure) for measure in claim.measures],
        }
        for claim in claims
    }
    held["rms_error_deg"] = {
        plant: {series: {name: round(_rms(runs, plant, series, name), 4) for name in ESTIMATORS} for series in SERIES_2}
        for plant in PLANTS
    }
    held["readings_of_q_and_r_rms_deg"] = {
        plant: {name: round(_rms(runs, plant, "series-2", f"reading {name}"), 4) for name in READINGS}
        for plant in PLANTS
    }
    held["seeds"] = list(SEEDS)
    return held


def _measure(measure: Measure) -> dict[str, object]:
    values = {plant: round(value, 4) for plant, value in measure.values.items()}
    holds = {plant: measure.holds(plant) for plant in measure.values}
    return {"measure": measure.text, "least": measure.least, "most": measure.most, "values": values, "holds": holds}


def _rms(runs: Sequence[Run], plant: str, series: str, estimator: str) -> float:
    return rms([run for run in runs if run.plant == plant], series, estimator)


def _page(claims: Sequence[Claim], runs: Sequence[Run], drawings: dict[str, str]) -> str:
    parts = [
        heading("The rig"),
        paragraph(
            "A link is turned by two opposed nylon tendons. To keep it light there is no sensor in it: potentiometers and "
            "load cells at the far ends of the tendons must tell its angle. The tendons stretch, everything rubs, and a "
            "2008 paper put a dynamic model into an extended Kalman filter to get the angle back. Here its two test "
            "series are simulated and filtered again."
        ),
        paragraph(
            "Two plants are simulated. “As printed” has the parameters of the paper's Table 1, which cannot produce the "
            "errors the paper shows. “As observed” has more friction: 0.1 of the tension at the sliders, and an axle "
            "friction that grows faster than the load. Every filter knows Table 1 only. Start angles, the manner of "
            "loading and the higher weights are not printed; what is assumed stands in the scenario files."
        ),
    ]
    for name, drawing in drawings.items():
        parts.append(picture(drawing, f"{name.replace('-', ' ').capitalize()}. {CAPTIONS[name]}"))
    parts += [
        heading("Errors in Series 2"),
        _errors_table(runs),
        heading("What the paper states"),
        _claims_table(claims),
    ]
    parts += [paragraph(NOTE), heading("What 0.001 can have meant"), paragraph(READING_NOTE), _readings_table(runs)]
    lead = (
        f"Simulated with {len(SEEDS)} seeds per test. Errors are RMS over all samples of all seeds. Thresholds of the "
        "statements were written down before the first run."
    )
    return page("Proximal measurement of a tendon-driven link, reproduced", lead, parts)


NOTE = (
    "C2 fails for a reason that can be worked out: friction μT stretches the opposing tendon by Uμ/((1−μ)k) and shortens "
    "the assisting one by Uμ/((1+μ)k), so the assisting tendon is the better one. C6 is bounded by geometry: the angle "
    "taken from the loaded tendon saturates at 90°, so its error cannot grow beyond 90° minus the angle of the link."
)

READING_NOTE = (
    "The paper sets Q = R = 0.001·I without units. In SI, R would be a potentiometer that errs by 32 mm, three times its "
    "travel; in mm² it errs by 32 µm, between its random error and its linearity. ekf-2008 reads R in mm² and the rest in "
    "SI. What each reading gives at 2 N / 6 N, one pass:"
)


def _errors_table(runs: Sequence[Run]) -> str:
    rows = []
    for plant in PLANTS:
        for series in SERIES_2:
            name = next(run.log.source for run in runs if run.series == series).removeprefix("Series 2: ")
            values = [f"{_rms(runs, plant, series, estimator):.2f}" for estimator in ESTIMATORS]
            rows.append([escape(plant), escape(name), *values])
    names = [f"{name} [°]" for name in ("inextensible", "free simulation", "ekf-2008", "ekf", "adaptive")]
    return html_table(["plant", "weights", *names], rows, numbers=range(2, 7))


def _readings_table(runs: Sequence[Run]) -> str:
    rows = [
        [escape(name), *(f"{_rms(runs, plant, 'series-2', f'reading {name}'):.2f}" for plant in PLANTS)]
        for name in READINGS
    ]
    return html_table(["reading", *(f"RMS, plant {plant} [°]" for plant in PLANTS)], rows, numbers=(1, 2))


def _claims_table(claims: Sequence[Claim]) -> str:
    rows = []
    for claim in claims:
        colour = "no" if claim.verdict == "does not hold" else "yes"
        for i, measure in enumerate(claim.measures):
            bound = f"≥ {measure.least:g}" if measure.least is not None else f"≤ {measure.most:g}"
            values = [
                f"<span class='{'yes' if measure.holds(plant) else 'no'}'>{measure.values[plant]:.2f} "
                f"{'✓' if measure.holds(plant) else '✗'}</span>"
                for plant in PLANTS
            ]
            first = (
                [claim.key, f"{escape(claim.statement)}<br><span class='why'>{escape(claim.why)}</span>"]
                if i == 0
                else ["", ""]
            )
            verdict = f"<span class='verdict {colour}'>{escape(claim.verdict)}</span>" if i == 0 else ""
            rows.append([*first, escape(measure.text), bound, *values, verdict])
    columns = ["", "statement", "measure", "threshold", "as printed", "as observed", "verdict"]
    return html_table(columns, rows, numbers=(3, 4, 5))
