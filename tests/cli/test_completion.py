"""What a shell completes: commands, options, shipped rigs and scenarios, estimators; without
importing what they need.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

from distal import ESTIMATORS, shipped_rigs, shipped_scenarios
from distal.cli.shared_options import ESTIMATOR_NAMES

START = "import sys; sys.argv = ['distal']; from distal_command import main\nmain()"


def completed(line: str, folder: Path) -> list[str]:
    words = line.split(" ")
    environment = {
        **os.environ,
        "_DISTAL_COMPLETE": "complete_bash",
        "COMP_WORDS": line,
        "COMP_CWORD": str(len(words) - 1),
    }
    made = [sys.executable, "-c", START]
    ran = subprocess.run(
        made, env=environment, cwd=folder, capture_output=True, text=True, check=True
    )
    return ran.stdout.split()


@pytest.mark.parametrize(
    ("line", "expected"),
    [
        ("distal est", ["estimate"]),
        ("distal estimate --smo", ["--smooth"]),
        ("distal estimate log.csv --rig ", [*shipped_rigs(), "mine.toml"]),
        ("distal estimate log.csv --rig paper-2008-p", ["paper-2008-printed"]),
        ("distal rig show mi", ["mine.toml"]),
        ("distal simulate ", [*shipped_scenarios(), "mine.toml"]),
        ("distal estimate log.csv -e e", ["ekf", "ekf-2008", "elastic"]),
    ],
)
def test_words_are_completed(tmp_path: Path, line: str, expected: list[str]) -> None:
    (tmp_path / "mine.toml").touch()
    (tmp_path / "log.csv").touch()
    assert completed(line, tmp_path) == expected


def test_the_estimators_are_those_that_there_are() -> None:
    assert sorted(ESTIMATORS) == list(ESTIMATOR_NAMES)
