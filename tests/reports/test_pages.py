"""Pages and figures of reports: they hold what they should, and nothing from elsewhere."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import Fit, Log, Rig, estimate, fit, load_scenario, scenario_rig, simulate
from distal.reports import fit_report
from distal.reports.fitting import draw_traces
from distal.reports.page import page, paragraph, picture
from distal.results import Html, html_table
from tests.results.test_plots import legends_lie_beside


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("template"))


@pytest.fixture(scope="module")
def logs(rig: Rig) -> list[Log]:
    made = [simulate(rig, load_scenario("template"), seed) for seed in (1, 2)]
    return [
        replace(log.select(slice(0, 700)), source=f"logs/<{i}> & co.csv")
        for i, log in enumerate(made)
    ]


@pytest.fixture(scope="module")
def fitted(logs: list[Log], rig: Rig) -> Fit:
    return fit(logs, rig, free=["joints.0.friction.coefficient"], noise=False)


def test_text_is_never_markup() -> None:
    text = page(
        "a <b> & c",
        "<i>",
        [
            paragraph("<p>"),
            html_table(["<x>"], [[Html("<em>cell</em>")], ["<td>"]]),
            picture("<svg/>", "<c>"),
        ],
    )
    for escaped in (
        "a &lt;b&gt; &amp; c",
        "&lt;i&gt;",
        "<p>&lt;p&gt;</p>",
        "<th>&lt;x&gt;</th>",
        "<figcaption>&lt;c&gt;",
        "<td>&lt;td&gt;</td>",
    ):
        assert escaped in text
    assert "<em>cell</em>" in text  # a cell that is HTML


def test_the_figures_of_a_fit(logs: list[Log], rig: Rig) -> None:
    results = [estimate(log, rig) for log in logs]
    traces = draw_traces(logs[0], results[0], rig)
    labels = ["joint angle θ [°]", "error [°]", "innovation [σ]", "measured [N]", "health"]
    assert [axes.get_ylabel() for axes in traces.axes] == labels
    legend = [text.get_text() for text in traces.axes[0].get_legend().get_texts()]
    assert legend == ["truth", "adaptive, 95 % band"]
    assert legends_lie_beside(traces)
    blind = [replace(log, truth={}) for log in logs]
    unknown = [replace(result, truths=None) for result in results]
    assert [a.get_ylabel() for a in draw_traces(blind[0], unknown[0], rig).axes][
        1
    ] == "95 % band ± [°]"


@pytest.mark.slow
def test_the_page_of_a_fit(fitted: Fit, logs: list[Log], tmp_path: Path) -> None:
    path = fit_report(fitted, logs, tmp_path / "report")
    text = path.read_text(encoding="utf-8")
    assert [file.name for file in path.parent.iterdir()] == ["index.html"]
    assert text.count("<figure>") == len(logs) + 1
    for said in (
        "What was found",
        "joints.link.friction.coefficient",
        "Along the logs",
    ):
        assert said in text
    assert "&lt;0&gt; &amp; co.csv" in text
    assert "<0>" not in text
    assert not re.search(r"(src|href)\s*=\s*['\"]?http", text)
    part = fitted.fitted[0]
    assert part.sizes[1] in text
    assert np.isfinite(part.value)
