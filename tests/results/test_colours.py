"""Colours stand once, in results/plots.py."""

from __future__ import annotations

import re
from pathlib import Path

SOURCES = Path(__file__).parents[2] / "src" / "distal"
COLOUR = re.compile(
    r"""["'](#[0-9a-fA-F]{3,8}|black|white|gr[ae]y|red|blue|green)["']|:\s*#[0-9a-fA-F]{3,6}\b"""
)


def test_no_other_module_names_a_colour() -> None:
    named = {
        path.name
        for folder in ("results", "reports", "fitting", "cli")
        for path in (SOURCES / folder).rglob("*.py")
        if COLOUR.search(path.read_text(encoding="utf-8"))
    }
    assert "plots.py" in named
    assert named <= {"plots.py"}
