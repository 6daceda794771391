"""Many logs at once: the numbers of one by one, in order, and no more in memory than is in work."""

from __future__ import annotations

import tracemalloc
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import (
    Log,
    Rig,
    estimate,
    estimate_batch,
    load_scenario,
    make_estimator,
    scenario_rig,
    simulate,
)
from distal.errors import DistalError, EstimationError
from distal.kernels import find_compiler, lanes_here
from distal.logs import write_log
from distal.simulation import build_scenario
from tests.helpers import PULLEYS

SEEDS = 11


@pytest.fixture(scope="module")
def logs(rig: Rig) -> list[Log]:
    """Return logs of different lengths; one with gaps, one with missing values."""
    made = [simulate(rig, load_scenario("series-2"), seed) for seed in range(SEEDS)]
    made = [log.select(slice(0, 150 + 37 * i)) for i, log in enumerate(made)]
    made[3] = made[3].select(np.r_[0:60, 90:200])
    gone = np.arange(len(made[5])) % 7 == 2
    spoiled = {name: np.where(gone, np.nan, v) for name, v in made[5].channels.items()}
    made[5] = replace(made[5], channels=spoiled)
    return made


def same(one, other) -> None:
    for part in ("means", "variances", "innovations", "innovation_variances"):
        np.testing.assert_array_equal(getattr(one, part), getattr(other, part))


# runs lie side by side in compiled kernels only; those of adaptive take seconds to compile
@pytest.mark.parametrize(
    "name",
    [
        pytest.param("adaptive", marks=pytest.mark.slow),
        "elastic",
        "ekf",
        "ekf-2008",
    ],
)
def test_the_numbers_are_those_of_one_by_one(rig: Rig, logs: list[Log], name: str) -> None:
    """To the last bit, with runs of different lengths side by side."""
    together = list(estimate_batch(logs, rig, name, workers=2))
    assert len(together) == SEEDS
    for log, result in zip(logs, together):
        same(estimate(log, rig, name), result)
        assert result.covariances is None
    if not isinstance(find_compiler(), str):  # and they did run side by side
        lanes = make_estimator(name, rig).kernel.lanes()
        assert lanes is not None
        assert lanes.lanes == lanes_here()


@pytest.mark.parametrize(
    "name", ["capstan-joint", pytest.param("da-vinci-grasper", marks=pytest.mark.more)]
)
def test_other_rigs_and_homing(name: str) -> None:
    servo = {"angle": {"amplitude": 0.5, "frequency": 0.4}, "stiffness": 20.0, "damping": 0.3}
    scenario = build_scenario({"rig": name, "duration": 1.5, "drives": {"motor": {"servo": servo}}})
    known = scenario_rig(scenario)
    moved = [simulate(known, scenario, seed) for seed in range(3)]
    for homing in (None, 0.3):
        for log, result in zip(moved, estimate_batch(moved, known, homing=homing)):
            same(estimate(log, known, homing=homing), result)


@pytest.mark.usefixtures("as_users_compile")
@pytest.mark.parametrize("name", [pytest.param("adaptive", marks=pytest.mark.slow), "elastic"])
def test_without_a_compiler_the_same(rig: Rig, logs: list[Log], name: str) -> None:
    for log, result in zip(logs[:3], estimate_batch(logs[:3], rig, name, compiled=False)):
        np.testing.assert_allclose(result.means, estimate(log, rig, name).means, atol=1e-9)


def test_a_bad_log_is_named_or_left_out(rig: Rig, logs: list[Log], tmp_path: Path) -> None:
    good = tmp_path / "good.csv"
    write_log(logs[0], rig, good)
    lacks = Log(logs[1].time, {"x1": logs[1].channels["x1"]}, {}, "lacks.csv")
    far = np.where(np.arange(len(logs[2])) > 5, 9e6, 0.0)
    wild = replace(logs[2], channels={**logs[2].channels, "x1": far}, source="wild.csv")
    mixed = [tmp_path / "absent.csv", good, lacks, wild, logs[4]]
    failed: dict[str, DistalError] = {}
    rig = rig.with_values(PULLEYS)
    results = list(estimate_batch(mixed, rig, "inextensible", skip=failed.__setitem__))
    assert [len(result) for result in results] == [len(logs[0]), len(logs[4])]
    assert set(failed) == {str(mixed[0]), "lacks.csv", "wild.csv"}
    for rest, said in ((mixed, "absent"), (mixed[1:], r"lacks\.csv")):
        with pytest.raises(DistalError, match=said):
            list(estimate_batch(rest, rig, "inextensible"))
    for one, workers, said in (
        (logs[0], 1, "for one there is estimate"),
        (logs, 0, "whole number from 1"),
        (None, 1, "takes several logs"),
    ):
        with pytest.raises(EstimationError, match=said):
            estimate_batch(one, rig, workers=workers)
    assert list(estimate_batch([], rig)) == []


@pytest.mark.slow
def test_what_came_before_an_error_is_yielded(rig: Rig, logs: list[Log]) -> None:
    """Whatever the number of cores: an iterable that raises, a log that cannot be homed."""

    def breaks() -> Iterator[Log]:
        yield from [logs[0]] * 30
        raise KeyError("the disk went away")

    got: list[object] = []
    with pytest.raises(KeyError):
        got.extend(estimate_batch(breaks(), rig, workers=2))
    assert len(got) == 30
    blind = Log(logs[1].time, logs[1].channels, {}, "blind")
    failed: dict[str, DistalError] = {}
    for order in ([blind, logs[1]], [logs[1], blind]):
        failed.clear()
        assert len(list(estimate_batch(order, rig, homing=0.3, skip=failed.__setitem__))) == 1
        assert set(failed) == {"blind"}


@pytest.mark.parametrize("name", [pytest.param("adaptive", marks=pytest.mark.slow), "elastic"])
def test_no_more_in_memory_than_is_in_work(rig: Rig, logs: list[Log], name: str) -> None:
    """Logs are asked for when their turn comes, and 400 runs need no more than 40."""
    asked = 0

    def endless(count: int) -> Iterator[Log]:
        nonlocal asked
        for i in range(count):
            asked += 1
            yield logs[i % 2]

    peaks = []
    for count in (80, 400):
        tracemalloc.start()
        asked = 0
        for taken, _ in enumerate(estimate_batch(endless(count), rig, name, workers=2), 1):
            assert asked <= taken + 5 * lanes_here()
        assert taken == count
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    # five times the runs, and threads that are not always equally far
    assert peaks[1] < 2.0 * peaks[0]
