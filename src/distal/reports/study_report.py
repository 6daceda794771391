"""The answer of a study as one self-contained page, which fetches nothing: a sentence, then its
evidence.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from html import escape
from math import degrees
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.logs import write_together
from distal.reports.page import (
    heading,
    page,
    picture,
    resource,
    script_with,
)
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    html_table,
)
from distal.study import Axis, Plan, Space
from distal.study.answer import Answer, words_of
from distal.study.execution import Columns
from distal.study.runs import BUILT, MEASURES
from distal.units import rounded

if TYPE_CHECKING:
    pass

MOST_DOTS = 2000
"""Number of dots in a chart at most; more make the page slow without showing more. Source:
layout.
"""

SHOWN = 10
"""Number of parameters, of regions and of problems that are listed at most. Source: layout."""

WORDS = {
    "rms_deg": "RMS error [°]",
    "worst_deg": "largest error [°]",
    "within": "share of the time within the limit",
    "inside": "share of the time inside the band",
    "half_band_deg": "half-width of the band [°]",
    "met": "share of rigs that meet the requirement",
}
"""Name of a measure → its label."""

MORE = frozenset({"within", "inside", "met"})
"""Names of the measures of which more is better."""


CHART = """<div class='axes'>
<label>across <select id='x'></select> <select id='dx' aria-label='better'></select></label>
<label>up <select id='y'></select> <select id='dy' aria-label='better'></select></label>
<label>colour <select id='z'></select></label></div>
<div id='designs'></div><p id='said'></p>"""
"""A chart and its controls, which the page's script fills."""


def study_report(plan: Plan, space: Space, columns: Columns, answer: Answer, folder: Path) -> Path:
    """Write the answer of a study as ``index.html`` and ``answer.json`` to a folder, and return the
    page's path.

    Raises:
        OutputError: a file cannot be written.
    """
    from plotly.offline import get_plotlyjs

    asked = plan.study.requirement
    title = plan.study.name or plan.rig.name
    lead = (
        f"{len(space):,} designs, {plan.study.seeds} rigs as built of each, in "
        f"{', '.join(plan.study.scenarios)}. "
        f"Asked: joint {asked.joint} within ±{rounded(degrees(asked.within), 3)}° for "
        f"{100 * asked.time:.3g} % of the time. "
        "Every rig as built is drawn from the standard deviations of the rig file; the estimator "
        "knows the rig file only."
    )
    rows = [
        [name, f"{part.met:,} of {part.rigs:,}", part] for name, part in answer.scenarios.items()
    ]
    measured = [[WORDS[name], f"{answer.measures[name]:.3g}"] for name in MEASURES]
    parts = [
        f"<p class='answer'>{escape(answer.sentence)}</p>",
        html_table(["scenario", "rigs that meet it", "share"], rows),
        html_table(["mean over all runs", ""], measured, [1]),
    ]
    if answer.needs:
        needs = [
            [need.verdict.value if k == 0 else "", part, share]
            for need in answer.needs
            for k, (part, share) in enumerate(need.shares)
        ]
        table = html_table(["", "where it is best", "rigs that meet it"], needs)
        parts += [heading("What is needed"), table]
    if answer.regions:
        regions = [[where, part, f"{part.rigs:,}"] for where, part in answer.regions[:SHOWN]]
        table = html_table(["designs", "rigs that meet it", "rigs"], regions, [2])
        parts += [heading("Where it is met"), table]
    parts += [heading("What is traded for what"), CHART]
    parts += [heading("The rig"), picture(rig_svg(plan.rig), "The rig before any change.")]
    if answer.problems:
        problems = [*answer.problems.items()][:SHOWN]
        parts += [heading("Runs that failed"), html_table(["why", "runs"], problems, [1])]
    points = _points(plan, space, columns)
    first, second, *_ = (name for name in points if name != "rms_deg")
    charts = {"columns": points, "shown": {"x": first, "y": "rms_deg", "z": second}}
    parts.append(script_with("study-data", charts, get_plotlyjs(), resource("study_page.js")))
    text = json.dumps(asdict(answer), indent=2, ensure_ascii=False, default=lambda v: v.value)
    write_together(
        {folder / "index.html": page(title, lead, parts), folder / "answer.json": text + "\n"}
    )
    return folder / "index.html"


def _points(plan: Plan, space: Space, columns: Columns) -> dict[str, dict[str, object]]:
    """Return the columns of the charts: a value for each design, or for each rig where there is
    only one design.
    """
    n_scenarios = len(plan.scenarios)
    runs_per_dot = n_scenarios * (plan.study.seeds if space.axes else 1)
    count = len(columns["met"]) // runs_per_dot
    dots = np.sort(np.random.default_rng(0).permutation(count)[:MOST_DOTS])
    points = {
        axis.path: _along(plan, axis, columns[axis.path][::runs_per_dot][dots])
        for axis in space.axes
    }
    if not space.axes:
        for name in (name for name in columns if name.startswith(BUILT)):
            drawn = columns[name][::runs_per_dot][dots]
            points[name] = {"words": f"{words_of(plan, name)} [σ]", "values": _values(drawn)}
    good = np.repeat(columns["met"].reshape(-1, n_scenarios).all(axis=1), n_scenarios)
    for name, words in WORDS.items():
        column = good if name == "met" else columns[name]
        runs: Floats = column.astype(np.float64).reshape(count, runs_per_dot)[dots]
        merged = {"worst_deg": runs.max, "within": runs.min}.get(name, runs.mean)(axis=1)
        points[name] = {"words": words, "values": _values(merged), "more": name in MORE}
    return points


def _along(plan: Plan, axis: Axis, settings: NDArray[np.generic]) -> dict[str, object]:
    words = words_of(plan, axis.path)
    if axis.choices and not isinstance(axis.choices[0], float):
        order = list(dict.fromkeys(axis.choices))
        labels = [
            ("with" if choice else "without") if isinstance(choice, bool) else str(choice)
            for choice in order
        ]
        return {
            "words": words,
            "labels": labels,
            "values": [order.index(choice) for choice in settings.tolist()],
        }
    values = _values(settings)
    return {
        "words": f"{words} [{axis.unit}]" if axis.unit else words,
        "values": values,
        "log": axis.scale == "log",
    }


def _values(values: NDArray[np.generic]) -> list[float | None]:
    return [
        float(f"{number:.4g}") if np.isfinite(number) else None
        for number in values.astype(np.float64)
    ]
