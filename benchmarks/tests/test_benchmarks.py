"""Each benchmark can start: nothing that it names is gone, and its smallest case runs."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from mypy import api

ROOT = Path(__file__).parents[2]
BENCHMARKS = sorted(
    [
        *(
            path.stem
            for path in (ROOT / "benchmarks").glob("*.py")
            if "__main__" in path.read_text(encoding="utf-8")
        ),
        "real",
    ]
)

GONE = ("attr-defined", "call-arg", "name-defined")
"""Errors of mypy on what is not there."""


@pytest.mark.more
def test_nothing_that_a_benchmark_names_is_gone() -> None:
    arguments = [
        "--config-file",
        str(ROOT / "pyproject.toml"),
        str(ROOT / "benchmarks"),
        str(ROOT / "tools"),
    ]
    identified, _, _ = api.run(arguments)
    errors = [
        line for line in identified.splitlines() if line.endswith(tuple(f"[{k}]" for k in GONE))
    ]
    assert errors == []


def of_a_newcomer(home: Path) -> dict[str, str]:
    return {
        "PYTHONPATH": os.pathsep.join((str(ROOT), str(ROOT / "src"))),
        "PATH": "/usr/bin:/bin",
        "HOME": str(home),
    }


IMPORTS = """
import importlib, sys
for name in sys.argv[1:]:
    try:
        importlib.import_module("benchmarks." + name)
    except ModuleNotFoundError as lacking:
        assert not (lacking.name or "").startswith(("benchmarks", "distal", "tests")), name
"""


def test_all_can_be_imported(tmp_path: Path) -> None:
    """One may lack a package of others."""
    done = subprocess.run(
        [sys.executable, "-c", IMPORTS, *BENCHMARKS],
        cwd=tmp_path,
        env=of_a_newcomer(tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr[-2000:]


CHANGED = """
import importlib
from benchmarks import ablation, guards
changed = [(place, name) for place, name, _ in ablation.RULES.values()]
changed += [(place, name) for name, (place, _) in guards.CONSTANTS.items()]
for place, name in changed:
    module, _, of_class = place.partition(".")
    found = importlib.import_module("distal.estimators.adaptive." + module)
    assert hasattr(getattr(found, of_class) if of_class else found, name), (place, name)
"""


def test_rules_that_are_left_out_exist(tmp_path: Path) -> None:
    """A benchmark that changes a constant under an old name would change nothing."""
    done = subprocess.run(
        [sys.executable, "-c", CHANGED],
        cwd=tmp_path,
        env=of_a_newcomer(tmp_path),
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
