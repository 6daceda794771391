"""The table of constants: what stands under a constant is its unit and where it comes from."""

from pathlib import Path

from tools.constants import constants, inside_functions, settings

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


def test_defaults_and_numbers_inside_functions_count(tmp_path: Path) -> None:
    module = tmp_path / "module.py"
    module.write_text(
        "@dataclass(frozen=True)\n"
        "class Limits:\n"
        '    """Limits (1) of what."""\n'
        "    short: float = 0.1\n"
        '    """docs/results/guards.md"""\n'
        "    long: float = 2.5\n"
        "    none: float = 0.0\n"
        "    name: str = 'word'\n"
        "@dataclass\n"
        "class Search:\n"
        '    """A search. Source: benchmark (benchmarks.searches)."""\n'
        "    steps: int = 30\n"
        "class Other:\n"
        "    steps: int = 30\n"
        "def f(x):\n"
        "    return 0.5 * x + 0.3 * max(x, 1e-12) + 2.0\n"
    )
    found = [(c.name, c.value, c.source) for c in settings(tmp_path)]
    assert found == [
        ("Limits.short", "0.1", "benchmark"),
        ("Limits.long", "2.5", ""),
        ("Search.steps", "30", "benchmark"),
    ]
    assert inside_functions(tmp_path) == 1


def test_constants_without_a_source_become_no_more() -> None:
    assert sum(1 for constant in constants() if not constant.source) <= MOST_WITHOUT
