"""The fast part of the fuzzers, with fixed seeds; `python -m benchmarks.reliability` is the long
one.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import Rig, load_rig, load_scenario, scenario_rig
from tests.fuzzing.logs import Logs, good_log
from tests.fuzzing.rigs import attempt
from tests.fuzzing.streams import Stream


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("template"))


@pytest.mark.parametrize("part", range(2))
def test_rigs(tmp_path: Path, part: int) -> None:
    outcomes = [attempt(seed, tmp_path) for seed in range(40 * part, 40 * part + 40)]
    assert [one.why for one in outcomes if not one.kept] == []
    assert {one.kind for one in outcomes} == {"taken", "refused"}


@pytest.mark.filterwarnings("ignore::distal.errors.DistalWarning")
def test_logs(tmp_path: Path, rig: Rig) -> None:
    logs = Logs(good_log(rig, load_scenario("template")), rig, tmp_path)
    outcomes = [logs.attempt(seed) for seed in range(500)]
    assert [one.why for one in outcomes if not one.kept] == []
    assert {one.kind for one in outcomes} == {"taken", "refused"}


@pytest.mark.parametrize("csv", [True, False])
def test_streams(csv: bool) -> None:
    stream = Stream(load_rig("paper-2008-printed"), csv)
    outcomes = [stream.attempt(seed) for seed in range(300)]
    assert [one.why for one in outcomes if not one.kept] == []
    assert {one.kind for one in outcomes} == {"taken", "refused"}
