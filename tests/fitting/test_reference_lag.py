"""The lag of a reference: found where there is one, none where there is none, and taken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.signal import lfilter

from distal import Log, Rig
from distal.fitting.usable_logs import reference_lag, said_of_lag, without_lag
from tests.support.foreign_plants import finger_log, finger_rig


@pytest.fixture(scope="module")
def rig() -> Rig:
    return finger_rig().bare()


def late(log: Log, lag: float, every: float = 1 / 30) -> Log:
    """Return a log whose reference is a camera: at t it has the angle of t − lag, with gaps."""
    time = log.time
    seen = np.zeros(len(time), dtype=bool)
    seen[np.unique(np.searchsorted(time, np.arange(time[0], time[-1], every)))] = True
    seen[len(time) // 3 : len(time) // 3 + 60] = False
    angles = np.interp(time - lag, time, log.truth["theta"])
    return replace(log, truth={"theta": np.where(seen, angles, np.nan)})


@pytest.fixture(scope="module")
def logs() -> list[Log]:
    return [finger_log(seed, 8.0) for seed in range(3)]


@pytest.mark.parametrize("lag", [0.016, 0.12])
def test_it_is_found_within_some_milliseconds(lag: float, logs: list[Log], rig: Rig) -> None:
    found = reference_lag([late(log, lag) for log in logs], rig, range(3))
    assert found == pytest.approx(lag, abs=8e-3)
    (said,) = said_of_lag(found)
    assert f"{1e3 * found:.0f} ms later" in said


def test_a_reference_on_time_has_none(logs: list[Log], rig: Rig) -> None:
    assert abs(reference_lag([late(log, 0.0) for log in logs], rig, range(3))) < 8e-3
    assert reference_lag(logs[:1], rig, [0]) == 0.0
    assert said_of_lag(0.0) == []


def test_a_joint_that_follows_late_is_no_late_reference(logs: list[Log], rig: Rig) -> None:
    """By a lag of first order with the time constant 0.06 s."""
    pole = np.exp(-np.median(np.diff(logs[0].time)) / 0.06)
    following = []
    for log in logs:
        theta = log.truth["theta"]
        angle, _ = lfilter([1 - pole], [1, -pole], theta, zi=pole * theta[:1])
        following.append(late(replace(log, truth={"theta": angle}), 0.0))
    assert reference_lag(following, rig, range(3)) == 0.0


def test_it_is_taken_off(logs: list[Log], rig: Rig) -> None:
    theta = np.cos(2.0 * logs[0].time)
    on_time = replace(logs[0], truth={"theta": theta})
    moved = without_lag([late(on_time, 0.05)], rig, 0.05)[0].truth["theta"]
    known = np.isfinite(moved)
    assert 0 < known.sum() < len(moved) / 2
    np.testing.assert_allclose(moved[known], theta[known], atol=1e-3)
    assert without_lag(logs, rig, 0.0) == logs
