"""The table of constants: what stands under a constant is its unit and where it comes from."""

from pathlib import Path

from tools.constants import constants

MOST_WITHOUT = 0
"""Number of constants that name no source."""


def test_units_and_sources_are_read(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "STEP = 2e-3\n"
        '"""Longest step [s]: docs/results/numerics.md."""\n'
        "LEAST = 1e-30\n"
        '"""So that nothing is divided by zero [1]."""\n'
        "SHARE = 1 / 3\n"
        'NAME = "no number"\n'
        "lower = 2\n"
    )
    found = [(c.name, c.value, c.unit, c.source) for c in constants(tmp_path)]
    assert found == [
        ("STEP", "0.002", "s", "benchmark"),
        ("LEAST", "1e-30", "1", "rounding"),
        ("SHARE", "1 / 3", "", ""),
    ]


def test_constants_without_a_source_become_no_more() -> None:
    assert sum(1 for constant in constants() if not constant.source) <= MOST_WITHOUT
