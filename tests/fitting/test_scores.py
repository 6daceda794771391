"""Scores on logs left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal.confidence import BAND
from distal.estimators import samples_of_angles
from distal.fitting.candidates import (
    REGRESSION,
    WRITTEN,
    Score,
    Training,
    comparisons,
    readings_map,
)
from distal.fitting.learned_maps import SETTLING, HeldOut
from distal.fitting.parameters_and_priors import Options
from distal.regression import yardstick_error
from tests.support.foreign_plants import finger_log, finger_rig


def test_a_score_is_of_the_errors_after_the_beginning() -> None:
    """Two joints, of which the first has one sample of four outside its band, and a beginning that
    does not count.
    """
    time = np.arange(5.0)
    first = HeldOut(time, np.array([90.0, 1.0, -1.0, 1.0, 3.0]), np.full(5, 1.0))
    second = HeldOut(time, np.array([90.0, 0.2, 0.2, 0.2, 0.2]), np.full(5, 0.04))
    score = Score.of([first, second], 1.0)
    assert score.rms == pytest.approx(((12.0 + 0.16) / 8.0) ** 0.5)
    assert score.inside == pytest.approx(7.0 / 8.0)
    assert score.joint_halves == pytest.approx((BAND, 0.2 * BAND))
    assert score.half == pytest.approx(0.6 * BAND)


def test_least_squares_of_a_log_are_solved_without_it() -> None:
    logs = [replace(finger_log(seed, 3.0), source=f"log {seed}") for seed in range(3)]
    rig = finger_rig().bare()
    training = Training.of(logs, rig, Options(workers=1))
    compared = comparisons(training, (), {"readings": readings_map(training)})
    samples = [samples_of_angles(log, rig) for log in logs]
    for i, one in enumerate(compared):
        early = (samples[i].time < SETTLING)[:, None]
        late = replace(samples[i], targets=np.where(early, np.nan, samples[i].targets))
        expected = yardstick_error("least squares", samples[:i] + samples[i + 1 :], late)
        score = one.scores["least squares"]
        assert score is not None
        assert score.rms == pytest.approx(expected)
        assert one.scores[WRITTEN] == one.scores[REGRESSION]
        assert one.scores[REGRESSION] is not None


def test_a_log_whose_angle_is_known_at_the_beginning_alone_has_no_score() -> None:
    logs = [replace(finger_log(seed, 3.0), source=f"log {seed}") for seed in range(3)]
    early = np.where(logs[0].time < 0.4, logs[0].truth["theta"], np.nan)
    logs[0] = replace(logs[0], truth={"theta": early})
    training = Training.of(logs, finger_rig().bare(), Options(workers=1))
    compared = comparisons(training, (), {"readings": readings_map(training)})
    assert [one.log for one in compared] == ["log 1", "log 2"]
    for one in compared:
        assert np.isfinite([score.rms for score in one.scores.values() if score]).all()
