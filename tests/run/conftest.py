"""The rig and a log of the second series of the paper."""

from __future__ import annotations

import pytest

from distal import Log, Rig, load_scenario, scenario_rig, simulate


@pytest.fixture(scope="package")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="package")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5)
