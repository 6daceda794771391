"""The reproduction of the 2008 paper."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from distal.errors import OutputError
from distal.reports.paper_2008 import FIGURES, GROUPS, reproduce, steps


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
    assert list(FIGURES) == [f"figure-{i}" for i in range(2, 6)]
    for name in FIGURES:
        assert (folder / f"{name}.png").stat().st_size > 10_000
        assert (folder / f"{name}.svg").read_text().startswith("<?xml")


def test_a_folder_that_cannot_be_made_is_said(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("a file")
    with pytest.raises(OutputError):
        reproduce(tmp_path / "out", lambda: None)
