"""A position that is wrong for a while: the angle stays, and its band says how sure that is."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, estimate, fit
from distal.logs import true_angles
from tests.support.hands_plants import bowden_log, bowden_rig

DURATION = 10.0


@pytest.fixture(scope="module")
def learned() -> Rig:
    """A sheathed joint with plays inside, learned from logs of a plant of its own."""
    return fit([bowden_log(seed, "ramps", DURATION) for seed in (71, 72, 73)], bowden_rig()).rig


@pytest.fixture(scope="module")
def good() -> Log:
    return bowden_log(74, "ramps", DURATION)


def spoiled(log: Log, rig: Rig, kind: str) -> Log:
    """Return a log whose first position has single wrong readings, or jumps for two seconds, or
    comes from two sources in turn for half a second.
    """
    name = rig.sensors_of("position")[0].name
    values = log.channels[name].copy()
    off = 1.5 * float(np.ptp(values))
    since = log.time - log.time[0]
    rows = {
        "single": np.arange(len(values)) % 97 == 50,
        "jump": (since > 4.0) & (since < 6.0),
        "two sources": (since > 4.0) & (since < 4.5) & (np.arange(len(values)) % 2 == 0),
    }[kind]
    values[rows] += off
    return Log(log.time, {**log.channels, name: values}, log.truth, log.source, log.truth_source)


@pytest.mark.parametrize(
    ("kind", "estimator"),
    [
        ("single", "adaptive"),
        ("jump", "adaptive"),
        ("two sources", "adaptive"),
        ("single", "regression"),
        ("two sources", "regression"),
    ],
)
def test_the_band_holds_while_a_position_is_wrong(
    learned: Rig, good: Log, kind: str, estimator: str
) -> None:
    """Readings alone cannot tell a jump that stays from a motion; a filter with forces can."""
    log = spoiled(good, learned, kind)
    truth = true_angles(good, learned.joint_names)
    assert truth is not None
    usual, result = (estimate(each, learned, estimator) for each in (good, log))
    rms = [np.sqrt(np.mean((each.angles - truth) ** 2)) for each in (usual, result)]
    inside = np.mean(np.abs(result.angles - truth) <= 1.96 * result.angle_stds)
    assert inside > 0.9
    ends = good.time - good.time[0] > 9.0  # three seconds after the last of it
    later = [np.sqrt(np.mean((each.angles - truth)[ends] ** 2)) for each in (usual, result)]
    assert kind == "single" or later[1] < 1.5 * later[0] + np.deg2rad(0.05)
    assert rms[1] < np.deg2rad(4.0)
