"""The answer of a study as one self-contained page, which fetches nothing: a sentence, then its
evidence.
"""

from __future__ import annotations

import json
from dataclasses import asdict
from html import escape
from math import degrees
from pathlib import Path

from distal.logs import write_together
from distal.reports.page import heading, page, picture
from distal.reports.rig_drawing import rig_svg
from distal.results import html_table
from distal.study import Plan, Space
from distal.study.answer import Answer
from distal.units import rounded

SHOWN = 10
"""Number of regions and of problems that are listed at most. Source: layout."""

WORDS = {
    "rms_deg": "RMS error [°]",
    "worst_deg": "largest error [°]",
    "within": "share of the time within the limit",
    "inside": "share of the time inside the band",
    "half_band_deg": "half-width of the band [°]",
}
"""Name of a measure → its label."""


def study_report(plan: Plan, space: Space, answer: Answer, folder: Path) -> Path:
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
    rows = [
        [name, f"{part.met:,} of {part.rigs:,}", part] for name, part in answer.scenarios.items()
    ]
    measured = [[label, f"{answer.measures[name]:.3g}"] for name, label in WORDS.items()]
    parts = [
        f"<p class='answer'>{escape(answer.sentence)}</p>",
        html_table(["scenario", "rigs that meet it", "share"], rows),
        html_table(["mean over all runs", ""], measured, [1]),
    ]
    if answer.needs:
        needs = [
            [need.verdict if k == 0 else "", part, share]
            for need in answer.needs
            for k, (part, share) in enumerate(need.shares)
        ]
        columns = ["", "where it is best", "rigs that meet it"]
        parts += [heading("What is needed"), html_table(columns, needs)]
    if answer.regions:
        regions = [[where, part, f"{part.rigs:,}"] for where, part in answer.regions[:SHOWN]]
        columns = ["designs", "rigs that meet it", "rigs"]
        parts += [heading("Where it is met"), html_table(columns, regions, [2])]
    parts += [heading("The rig"), picture(rig_svg(plan.rig), "The rig before any change.")]
    if answer.problems:
        problems = [*answer.problems.items()][:SHOWN]
        parts += [heading("Runs that failed"), html_table(["why", "runs"], problems, [1])]
    text = json.dumps(asdict(answer), indent=2, ensure_ascii=False)
    index = folder / "index.html"
    write_together({index: page(title, lead, parts), folder / "answer.json": text + "\n"})
    return index
