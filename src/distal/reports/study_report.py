"""The answer of a study as one self-contained page, which fetches nothing: a sentence, then its
evidence.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from html import escape
from math import degrees
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.logs import write_together
from distal.reports.page import heading, page, paragraph, picture, resource, script_with
from distal.reports.rig_drawing import rig_svg
from distal.results import Html, html_table
from distal.rounded import rounded
from distal.study import Axis, Plan, Space
from distal.study.answer import Answer, Influence
from distal.study.execution import Columns
from distal.study.runs import BUILT, MEASURES
from distal.study.shares import words_of

MOST_DOTS = 2000
"""Number of dots in a chart at most; more make the page slow without showing more. Source:
layout.
"""

CELLS = 8
"""Number of cells of the map along each axis. Source: layout."""

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


def study_report(plan: Plan, space: Space, columns: Columns, answer: Answer, folder: Path) -> Path:
    """Write the answer of a study as ``index.html`` and ``answer.json`` to a folder, and return the
    page's path.

    Raises:
        OutputError: a file cannot be written.
    """
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
    parts = [f"<p class='answer'>{escape(answer.sentence)}</p>", *_scenarios(answer)]
    if answer.needs:
        parts += [heading("What is needed"), _needs(answer)]
    if answer.regions:
        parts += [heading("Where it is met"), _regions(answer)]
    if answer.influences:
        parts += [heading("Which numbers matter"), *_influences(answer.influences)]
    points = _points(plan, space, columns)
    if len(points) > 1:
        axes = {"x": "across", "y": "up"}
        parts += [heading("What is traded for what"), *_chart("pareto", axes)]
        parts += [heading("Map"), *_chart("map", axes | {"z": "shown"})]
    if answer.worst:
        parts.append(heading("Worst cases"))
        parts.append(paragraph("Black is the true angle, blue the estimate with its 95 % band."))
        for k, case in enumerate(answer.worst):
            parts.append(picture(f"<svg class='chart' id='case-{k}' role='img'></svg>", case.words))
    parts += [heading("The rig"), picture(rig_svg(plan.rig), "The rig before any change.")]
    if answer.problems:
        rows = [*answer.problems.items()][:SHOWN]
        parts += [heading("Runs that failed"), html_table(["why", "runs"], rows, [1])]
    charts = {
        "columns": points,
        "cases": [asdict(case) for case in answer.worst],
        "cells": CELLS,
        **_chosen(answer.influences, points),
    }
    parts.append(script_with("study-data", charts, resource("chart.js"), resource("study_page.js")))
    table = json.dumps(asdict(answer), indent=2, ensure_ascii=False, default=lambda v: v.value)
    write_together(
        {folder / "index.html": page(title, lead, parts), folder / "answer.json": table + "\n"}
    )
    return folder / "index.html"


def _scenarios(answer: Answer) -> list[str]:
    rows = [
        [name, f"{part.met:,} of {part.rigs:,}", part] for name, part in answer.scenarios.items()
    ]
    measured = [[WORDS[name], f"{answer.measures[name]:.3g}"] for name in MEASURES]
    table = html_table(["scenario", "rigs that meet it", "share"], rows)
    return [table, html_table(["mean over all runs", ""], measured, [1])]


def _needs(answer: Answer) -> str:
    rows = [
        [need.verdict.value if k == 0 else "", part, share]
        for need in answer.needs
        for k, (part, share) in enumerate(need.shares)
    ]
    return html_table(["", "where it is best", "rigs that meet it"], rows)


def _regions(answer: Answer) -> str:
    rows = [
        [region.where, region.proportion, f"{region.proportion.rigs:,}"]
        for region in answer.regions[:SHOWN]
    ]
    return html_table(["designs", "rigs that meet it", "rigs"], rows, [2])


def _influences(influences: Sequence[Influence]) -> list[str]:
    rows = [
        [
            influence.words,
            Html(f"<span class='bar' style='width:{100 * influence.index:.1f}%'></span>"),
            f"{100 * influence.index:.0f} ± {100 * influence.half:.0f} %",
        ]
        for influence in influences[:SHOWN]
    ]
    columns = ["number", "", "share of the variance of the RMS error"]
    explanation = (
        "First-order Sobol indices by RBD-FAST with their 95 % intervals: what would be gone of "
        "the variance if the number were known and held. As built: what one rig differs by from "
        "its description."
    )
    return [html_table(columns, rows, [2], "bars"), paragraph(explanation)]


def _chart(name: str, axes: Mapping[str, str]) -> list[str]:
    """Return the controls of a chart and its empty drawing, which the page's script fills.

    Args:
        axes: name of an axis in the script → its label.
    """
    options = (
        "<option value='less'>less is better</option><option value='more'>more is better</option>"
    )
    controls = ""
    for axis, label in axes.items():
        better = f"<select id='{name}-d{axis}' aria-label='better'>{options}</select>"
        controls += f"<label>{label} <select id='{name}-{axis}'></select>"
        controls += f"{better if name == 'pareto' else ''}</label>"
    return [
        f"<div class='axes'>{controls}</div>",
        f"<figure><svg class='chart' id='{name}' role='img'></svg><figcaption "
        f"id='{name}-said'></figcaption></figure>",
    ]


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
    good = np.repeat(np.all(columns["met"].reshape(-1, n_scenarios) != 0, axis=1), n_scenarios)
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


def _chosen(
    influences: Sequence[Influence], points: dict[str, dict[str, object]]
) -> dict[str, list[str]]:
    """Return which columns the charts show at first: those with the largest influence."""
    ranked = [influence.name for influence in influences if influence.name in points]
    order = [
        *ranked,
        *(name for name in points if name not in ranked and name not in WORDS),
        "within",
        "worst_deg",
    ]
    numeric = [name for name in order if "labels" not in points.get(name, {"labels": 1})]
    return {"pareto": [numeric[0], "rms_deg"], "map": [order[0], order[1], "rms_deg"]}
