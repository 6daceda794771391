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
    code = "import sys; sys.argv = ['distal']; from distal_command import main; main()"
    asked = {"COMP_WORDS": line, "COMP_CWORD": str(line.count(" "))}
    ran = subprocess.run(
        [sys.executable, "-c", code],
        env={**os.environ, "_DISTAL_COMPLETE": "complete_bash", **asked},
        cwd=tmp_path,
        capture_output=True,
        text=True,
        check=True,
    )
    assert ran.stdout.split() == expected


def test_the_estimators_are_those_that_there_are() -> None:
    assert sorted(ESTIMATORS) == list(ESTIMATOR_NAMES)
