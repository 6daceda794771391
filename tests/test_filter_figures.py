"""The figures of the adaptive filter: each is drawn by the code of today, has units at its axes and
stands on a page.
"""

from __future__ import annotations

from pathlib import Path

import pytest
from tools.filter_figures import FIGURES, FOLDER

ROOT = Path(__file__).parents[1]
PAGES = [ROOT / "docs" / "explanation" / f"{name}.md" for name in ("adaptive", "adaptive-guards")]


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_stands_on_a_page(name: str) -> None:
    assert (ROOT / FOLDER / f"filter-{name}.svg").exists()
    assert sum(page.read_text(encoding="utf-8").count(f"filter-{name}.svg") for page in PAGES) == 1


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[pytest.mark.more] if name in ("outlier", "learning") else [])
        for name in FIGURES
    ],
)
def test_a_figure_is_drawn_with_units_at_its_axes(name: str) -> None:
    axes = FIGURES[name]().axes
    for one in axes:
        assert one.get_ylabel().endswith("]"), one.get_ylabel()
    assert any(one.get_xlabel().endswith("]") for one in axes)
