"""Fits for a simulator: nothing but the positions of the drives is read, and the joints go as in
logs that the fit has not seen.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, fit, load_rig
from distal.errors import FitError
from distal.fitting.likelihood import Problem
from distal.fitting.parameter_search import problem_of
from distal.fitting.parameters_and_priors import Options
from distal.kernels.layout import COMPARED_ONLY, READ
from tests.support.foreign_plants import hand_log, hand_rig

# the model is wrong
pytestmark = pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")


def problem(log: Log, rig: Rig) -> Problem:
    return replace(problem_of([log], rig.bare(), Options(noise=False)), open_loop=True)


def error(log: Log, rig: Rig) -> float:
    """Return the RMS error of a rig in an open loop, after half a second [rad]."""
    at = problem(log, rig)
    (run,) = at.at(np.zeros(at.size))
    return float(np.sqrt(np.nanmean(run.values[log.time > log.time[0] + 0.5] ** 2)))


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [hand_log(seed, 6.0) for seed in (60, 61, 63)]


def test_forces_are_not_read_and_the_reference_alone_counts(logs: list[Log]) -> None:
    asked = problem(logs[0], hand_rig())
    channels = asked.filter.channels
    masks = dict(zip(channels, asked._rows[0][:, 1 + len(channels) :].T))
    references = {sensor.name for sensor in asked.filter.references}
    positions = {sensor.name for sensor in hand_rig().sensors_of("position")}
    for name, mask in masks.items():
        expected = READ if name in positions else COMPARED_ONLY
        assert set(mask) == {expected}, name
    (run,) = asked.at(np.zeros(asked.size))
    for name, values in zip(asked.measured, run.values.T):
        assert np.isfinite(values).any() == (name in references)


@pytest.mark.slow
def test_a_simulator_goes_as_a_log_that_was_left_out(logs: list[Log], tmp_path: Path) -> None:
    """Better than with the numbers for an estimator, and what is said is so. Of the first half
    second nothing counts: nobody knows then where the joint is, and it errs by degrees.
    """
    usual, found = (fit(logs[:2], hand_rig(), open_loop=way) for way in (False, True))
    left_out = error(logs[2], found.rig)
    assert left_out < error(logs[2], usual.rig)
    assert found.open_loop == pytest.approx(left_out, rel=0.5)
    assert "with drives as recorded, joints err by" in found.answer()
    assert found.rig.map is None
    found.save(tmp_path / "simulator.toml")
    assert load_rig(tmp_path / "simulator.toml") == found.rig


@pytest.mark.slow
def test_of_one_log_nothing_is_said_of_others(logs: list[Log]) -> None:
    assert fit(logs[:1], hand_rig(), open_loop=True).answer() == ""


def test_it_needs_an_angle(logs: list[Log]) -> None:
    blind = [Log(log.time, log.channels, {}, log.source) for log in logs[:2]]
    with pytest.raises(FitError, match="no log has them; log them too, by a camera"):
        fit(blind, hand_rig(), open_loop=True)
