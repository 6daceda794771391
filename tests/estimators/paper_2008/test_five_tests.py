"""All estimators on the paper's five tests, with what the logs' own rigs say of them."""

from __future__ import annotations

import pytest

from distal import Log, Rig, estimate, load_scenario, scenario_rig, simulate

WITHOUT_FILTER = ("inextensible", "elastic")
BY_HAND = ("series-1-soft", "series-1")


def logged(series: str) -> tuple[Rig, Log]:
    scenario = load_scenario(series)
    rig = scenario_rig(scenario)
    return rig, simulate(rig, scenario, 0)


@pytest.mark.parametrize("series", ["series-2", "series-2-medium", "series-2-high"])
def test_adaptive_is_better_than_no_filter_where_weights_move_the_link(series: str) -> None:
    rig, log = logged(series)
    found = estimate(log, rig)
    assert found.inside_band() >= 0.93
    others = [estimate(log, rig, name).rms_error() for name in WITHOUT_FILTER]
    assert found.rms_error() < min(others)


@pytest.mark.parametrize("series", BY_HAND)
def test_a_hand_that_is_declared_is_inside_the_band(series: str) -> None:
    """Undeclared it makes friction hold the link while its tendons stretch."""
    rig, log = logged(series)
    declared = estimate(log, rig)
    alone = estimate(log, rig.with_values({"joints.link.external_torque.std": 0.0}))
    assert declared.inside_band() >= 0.93
    assert declared.rms_error() < 0.5 * alone.rms_error()
