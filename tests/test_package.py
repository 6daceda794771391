"""What is built: the description that an index of packages shows."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]


def test_the_description_for_an_index_has_no_link_that_leads_nowhere() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    target = re.compile(r"\]\((?!https?:)")
    assert target.search(text)
    for change in settings["tool"]["hatch"]["metadata"]["hooks"]["fancy-pypi-readme"][
        "substitutions"
    ]:
        text = re.sub(change["pattern"], change["replacement"], text)
    assert not target.search(text)
    assert "![" not in text
    # captions go with their figures, and all else stays
    assert not re.search(r"(?m)^\*[^*\s]", text)
    kept = re.findall(r"(?m)^(?:#|```).*", (ROOT / "README.md").read_text(encoding="utf-8"))
    assert re.findall(r"(?m)^(?:#|```).*", text) == kept
