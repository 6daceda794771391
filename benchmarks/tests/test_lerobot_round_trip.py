"""A dataset that LeRobot wrote is read by LeRobot with joint angles, where LeRobot is installed."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]


def test_a_drawn_dataset_is_as_it_should_be() -> None:
    pytest.importorskip("lerobot")
    command = [sys.executable, "-m", "benchmarks.lerobot_round_trip", "--sets", "1"]
    done = subprocess.run(
        [*command, "--first-seed", "901"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.stdout.endswith(": 1 of 1 as they should be\n"), done.stdout + done.stderr
