"""Scores on logs left out."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log
from distal.confidence import BAND
from distal.estimators import samples_of_angles
from distal.fitting.candidates import (
    REGRESSION,
    WRITTEN,
    Training,
    comparisons,
    readings_map,
)
from distal.fitting.learned_maps import SETTLING, HeldOut, Score
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


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [replace(finger_log(k, 3.0), source=f"unit_{k // 2} {k}") for k in range(4)]


def test_least_squares_of_a_log_are_solved_without_its_group(logs: list[Log]) -> None:
    """Two logs of each of two units."""
    rig = finger_rig().bare()
    training = Training.of(logs, rig, Options(workers=1, groups=r"unit_(\d)"))
    compared = comparisons(training, (), {"readings": readings_map(training)})
    assert [one.log for one in compared] == [log.source for log in logs]
    samples = [samples_of_angles(log, rig) for log in logs]
    for i, one in enumerate(compared):
        early = (samples[i].time < SETTLING)[:, None]
        late = replace(samples[i], targets=np.where(early, np.nan, samples[i].targets))
        others = samples[2:] if i < 2 else samples[:2]
        score = one.scores["least squares"]
        assert score is not None
        assert score.rms == pytest.approx(yardstick_error("least squares", others, late))
        assert one.scores[WRITTEN] == one.scores[REGRESSION]
        assert one.scores[REGRESSION] is not None


def test_a_log_whose_angle_is_known_at_the_beginning_alone_has_no_score(logs: list[Log]) -> None:
    early = np.where(logs[0].time < 0.4, logs[0].truth["theta"], np.nan)
    told = [replace(logs[0], truth={"theta": early}), *logs[1:3]]
    training = Training.of(told, finger_rig().bare(), Options(workers=1))
    compared = comparisons(training, (), {"readings": readings_map(training)})
    assert [one.log for one in compared] == [log.source for log in logs[1:3]]
    for one in compared:
        assert np.isfinite([score.rms for score in one.scores.values() if score]).all()
