"""The reproduction of the 2008 paper."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from distal.errors import OutputError
from distal.reports.paper_2008 import GROUPS, reproduce, steps
from distal.reports.paper_2008.page import FIGURES


def test_the_figures_of_the_paper_have_names() -> None:
    assert list(FIGURES) == ["figure-2", "figure-3", "figure-4", "figure-5"]


@pytest.mark.slow
def test_reproduce(tmp_path: Path) -> None:
    folder = tmp_path / "out" / "reproduce"
    advanced = list[None]()
    claims = reproduce(folder, lambda: advanced.append(None))
    assert len(advanced) == steps()
    assert len(claims) == 12
    held = json.loads((folder / "results.json").read_text())
    for i in range(1, 13):
        claim = held[f"C{i}"]
        assert claim["group"] in GROUPS
        assert all(
            np.isfinite(list(measure["values"].values())).all() for measure in claim["measures"]
        )
    # what physics says must come out, whatever the seeds
    assert held["C2"]["group"] == "contradicted"
    for key in ("C1", "C3", "C4"):
        assert held[key]["group"] == "only with friction that the paper did not know of"
    assert sum(held[f"C{i}"]["group"] != "contradicted" for i in range(1, 13)) >= 10
    errors = held["rms_error_deg"]["friction of Table 1"]["series-2"]
    assert errors["ekf-2008"] <= 0.8
    assert errors["ekf"] <= 0.45
    page = (folder / "index.html").read_text()
    assert page.count("<svg") == 5
    text = re.sub(r"<(script|style|svg).*?</\1>|<[^>]*>", " ", page, flags=re.DOTALL)
    assert not re.search(r"\bC1?[0-9]\b|as printed|as observed", text)
    assert "http" not in page.replace("http://www.w3.org", "").replace(
        "http://purl.org", ""
    ).replace("http://creativecommons.org", "").replace("https://matplotlib.org", "")
    for i in range(2, 6):
        assert (folder / f"figure-{i}.png").stat().st_size > 10_000
        assert (folder / f"figure-{i}.svg").read_text().startswith("<?xml")


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError):
        reproduce(tmp_path / "out", lambda: None)
