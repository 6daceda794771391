"""One estimate for all tests of what is said and shown of it."""

from __future__ import annotations

import pytest

from distal import Estimate, Log, Rig, estimate, load_scenario, scenario_rig, simulate


@pytest.fixture(scope="package")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="package")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"))


@pytest.fixture(scope="package")
def result(log: Log, rig: Rig) -> Estimate:
    return estimate(log, rig)
