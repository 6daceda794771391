"""Which tests a change touches."""

from __future__ import annotations

from pathlib import Path

from tools.changed import module_of, touched_tests
from tools.slow_tests import listed


def touched(module: str) -> set[str]:
    return {path.name for path in touched_tests({module})}


def test_a_module_touches_the_tests_that_import_it() -> None:
    found = touched("distal.homing")
    assert "test_home.py" in found
    assert "test_csv.py" not in found


def test_a_public_name_stands_for_the_module_that_it_comes_from() -> None:
    """`from distal.run import smooth` is an import of `distal.run.offline`."""
    assert "test_smoothing.py" in touched("distal.run.offline")


def test_a_test_touches_itself() -> None:
    assert "test_csv.py" in touched("tests.logs.test_csv")


def test_files_are_modules() -> None:
    assert module_of(Path("src/distal/rig/__init__.py")) == "distal.rig"
    assert module_of(Path("tests/logs/test_csv.py")) == "tests.logs.test_csv"


def test_the_list_of_slow_tests_names_tests_that_are_there() -> None:
    """`python -m tools.slow_tests` drops none: a line of a test that is gone is removed by hand."""
    root = Path(__file__).parents[1]
    assert listed()
    for function in listed():
        path, *_, name = function.split("::")
        assert f"def {name}(" in (root / path).read_text(encoding="utf-8"), function
