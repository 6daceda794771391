"""A position that is wrong for a while: the angle stays, and its band says how sure that is."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, estimate, fit
from tests.helpers import rms_degrees
from tests.support.hands_plants import bowden_log, bowden_rig

DURATION = 10.0


@pytest.fixture(scope="module")
def learned() -> Rig:
    """A sheathed joint with plays inside, learned from logs of a plant of its own."""
    return fit([bowden_log(seed, "ramps", DURATION) for seed in (71, 72, 73)], bowden_rig()).rig


@pytest.fixture(scope="module")
def good() -> Log:
    return bowden_log(74, "ramps", DURATION)


def spoiled(log: Log, name: str, kind: str) -> Log:
    """Return a log in which a position has single wrong readings, or jumps for two seconds, or
    comes from two sources in turn for half a second.
    """
    values = log.channels[name]
    since, row = log.time - log.time[0], np.arange(len(log))
    wrong = {
        "single": row % 97 == 50,
        "jump": (since > 4.0) & (since < 6.0),
        "two sources": (since > 4.0) & (since < 4.5) & (row % 2 == 0),
    }[kind]
    return replace(log, channels={**log.channels, name: values + 1.5 * np.ptp(values) * wrong})


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
    log = spoiled(good, learned.sensors_of("position")[0].name, kind)
    usual, result = (estimate(each, learned, estimator) for each in (good, log))
    assert result.inside_band() > 0.9
    ends = good.time - good.time[0] > 9.0  # three seconds after the last of it
    before, later = (rms_degrees(each.errors()[ends]) for each in (usual, result))
    assert kind == "single" or later < 1.5 * before + 0.05
    assert np.rad2deg(result.rms_error()) < 4.0
