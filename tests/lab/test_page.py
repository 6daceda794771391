"""The lab of the paper's rig that the site and the demo show is what the package writes now."""

from __future__ import annotations

import json
import re
from importlib import resources
from pathlib import Path

from distal.reports.moving_chain import chain_script

SHOWN = Path(__file__).parents[2] / "docs" / "lab.html"


def test_the_page_that_is_shown_is_of_now() -> None:
    """`make lab` writes it; what ziglang makes of the same C may differ from version to version."""
    text = SHOWN.read_text(encoding="utf-8")
    for name in ("lab.js", "lab.css"):
        assert resources.files("distal.lab").joinpath(name).read_text(encoding="utf-8") in text
    assert chain_script() in text
    found = re.search(r"id='lab-data'>(.*?)</script>", text)
    assert found is not None
    data = json.loads(found[1])
    assert data["joints"] == ["link"]
    assert len(data["code"]) > 40_000
