"""`distal.learn`: from logs to a fit, without a rig file."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest

import distal

LOGS = sorted((Path(__file__).parents[2] / "examples" / "finger_logs").glob("run_*.csv"))


@pytest.fixture(scope="module")
def learned() -> distal.Fit:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return distal.learn(LOGS)


def test_what_is_learned_estimates_a_log_that_nothing_has_seen(
    learned: distal.Fit, tmp_path: Path
) -> None:
    """The file reads as the rig, and keeps the marks of guesses."""
    path = tmp_path / "finger.toml"
    learned.save(path)
    assert "not in the logs" in path.read_text(encoding="utf-8")
    rig = distal.load_rig(path)
    assert rig == learned.rig
    unseen = distal.estimate(LOGS[0].with_name("unseen.csv"), rig)
    assert unseen.rms_error() < np.deg2rad(0.1)
    assert unseen.inside_band() > 0.9
