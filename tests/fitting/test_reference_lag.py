"""The lag of a reference: found where there is one, none where there is none, and taken off."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig
from distal.fitting.log_checks import reference_lag, said_of_lag, without_lag
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


LOGS = [finger_log(seed, 12.0) for seed in range(4)]


@pytest.mark.parametrize("lag", [0.016, 0.04, 0.12])
def test_it_is_found_within_some_milliseconds(lag: float, rig: Rig) -> None:
    found = reference_lag([late(log, lag) for log in LOGS], rig, range(4))
    assert found == pytest.approx(lag, abs=8e-3)
    (said,) = said_of_lag(found)
    assert f"{1e3 * found:.0f} ms later" in said


def test_a_reference_on_time_has_none(rig: Rig) -> None:
    assert abs(reference_lag([late(log, 0.0) for log in LOGS], rig, range(4))) < 8e-3
    assert reference_lag(LOGS[:1], rig, [0]) == 0.0
    assert said_of_lag(0.0) == []


@pytest.mark.parametrize("constant", [0.06, 0.15])
def test_a_joint_that_follows_late_is_no_late_reference(constant: float, rig: Rig) -> None:
    logs = []
    for log in LOGS:
        share = 1.0 - np.exp(-np.median(np.diff(log.time)) / constant)
        angle = np.array(log.truth["theta"])
        for k in range(1, len(angle)):
            angle[k] = angle[k - 1] + share * (angle[k] - angle[k - 1])
        logs.append(late(replace(log, truth={"theta": angle}), 0.0))
    assert reference_lag(logs, rig, range(4)) == 0.0


def test_it_is_taken_off(rig: Rig) -> None:
    moved = without_lag([late(LOGS[0], 0.05)], rig, 0.05)[0]
    known = np.isfinite(moved.truth["theta"])
    assert 0 < known.sum() < len(moved) / 2
    np.testing.assert_allclose(
        moved.truth["theta"][known], LOGS[0].truth["theta"][known], atol=np.deg2rad(0.5)
    )
    assert without_lag(LOGS, rig, 0.0) == LOGS
