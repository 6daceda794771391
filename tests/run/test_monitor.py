"""In a stream: each health word is said where it belongs, the estimate beside it is right or not
there, and nothing that comes is a crash.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
import pytest

from distal import LiveEstimator, Log, Monitor, Rig, estimate
from distal.run import Reading, samples_of
from tests.helpers import PULLEYS, changed

GOOD = "untested"
"""The word for good readings of a rig that no log taught."""


@pytest.fixture
def monitor(rig: Rig) -> Monitor:
    return Monitor(LiveEstimator(rig))


def take(monitor: Monitor, log: Log, rows: Iterable[int], shift: float = 0.0) -> list[Reading]:
    samples = samples_of(log, monitor.channels)
    return [monitor.take(float(log.time[k]) + shift, samples[k]) for k in rows]


def words_of(readings: list[Reading]) -> list[str]:
    return [reading.health for reading in readings]


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (range(200), {}),
        ([*range(50), 49, 30, *range(50, 100)], {50: "duplicate", 51: "late"}),
        ([*range(100), *range(120, 200)], {100: "gap"}),
        # three times as slow as the rig says; four of these missing are a gap all the same
        ([*range(0, 300, 3), *range(312, 600, 3)], {100: "gap"}),
        # one late sample now and then is no clock that was set back
        (
            [*range(10), *(k for i in range(50) for k in (i + 10, i))],
            dict.fromkeys(range(11, 110, 2), "late"),
        ),
    ],
)
def test_samples_that_are_late_or_repeated_are_skipped_and_gaps_are_bridged(
    monitor: Monitor, rig: Rig, log: Log, rows: list[int], words: dict[int, str]
) -> None:
    readings = take(monitor, log, rows)
    assert words_of(readings) == [words.get(k, GOOD) for k in range(len(rows))]
    angles = np.array([one.angle for one in readings])
    skipped = np.array([one.health in ("late", "duplicate") for one in readings])
    np.testing.assert_array_equal(np.isnan(angles), skipped)
    expected = estimate(log.select(np.array(rows)[~skipped]), rig).theta
    np.testing.assert_allclose(angles[~skipped], expected, atol=1e-14)


def test_after_a_long_gap_it_begins_anew(monitor: Monitor, log: Log) -> None:
    readings = take(monitor, log, [*range(100), *range(120, 200)])
    assert readings[100].detail.startswith("0.21 s")
    far = take(monitor, log, range(200, 260), shift=1e6)
    assert words_of(far) == ["restarted", *[GOOD] * 59]
    assert far[0].angle_std > 2 * readings[-1].angle_std  # it says that it knows less


@pytest.mark.parametrize(("samples", "goes_on"), [(100, True), (200, False)])
def test_samples_without_values_are_as_samples_that_do_not_come(
    monitor: Monitor, rig: Rig, log: Log, samples: int, goes_on: bool
) -> None:
    """Until the gap is too long: then the filter has wandered with its drives."""
    k = np.arange(len(log))
    after = range(100 + samples, 400)
    is_silent = (k >= 100) & (k < after[0])
    silent = {name: np.where(is_silent, np.nan, v) for name, v in log.channels.items()}
    empty = take(monitor, changed(log, **silent), range(400))
    bridged = take(Monitor(LiveEstimator(rig)), log, [*range(100), *after])
    assert empty[after[0] - 1].angle_std > 3 * bridged[99].angle_std  # meanwhile it knows less
    same = [one.angle == other.angle for one, other in zip(empty[after[0] :], bridged[100:])]
    assert all(same) if goes_on else not any(same)


def test_a_clock_that_was_set_back(monitor: Monitor, log: Log) -> None:
    take(monitor, log, range(200))
    readings = take(monitor, log, range(200, 260), shift=-1e3)
    assert words_of(readings[:4]) == ["late", "late", "restarted", GOOD]


def test_a_sensor_that_dies_and_returns(monitor: Monitor, log: Log) -> None:
    k = np.arange(len(log))
    dead = np.where((k >= 300) & (k < 400), np.nan, log.channels["x1"])
    readings = take(monitor, changed(log, x1=dead), k)
    words = words_of(readings)
    assert words[299] == words[400] == GOOD
    assert words[303:340] == ["missing"] * 37
    assert words[351:400] == ["dead"] * 49
    assert readings[360].detail.startswith("x1 for 0.6")
    assert (readings[299].doubted, readings[360].doubted) == ((), ("left",))
    errors = np.abs([one.angle for one in readings] - log.truth["theta"])
    assert np.mean(errors <= 1.96 * np.array([one.angle_std for one in readings])) > 0.9


def test_a_sensor_that_lies_disagrees(monitor: Monitor, log: Log) -> None:
    lies = log.channels["u1"] + np.where(log.time > 4.0, 8.0, 0.0)
    readings = take(monitor, changed(log, u1=lies), range(len(log)))
    first = next(one for one in readings if one.health == "disagrees")
    assert 4.0 < first.time < 4.5
    assert "u1" in first.detail


def test_a_number_that_left_its_prior_is_said(rig: Rig, log: Log) -> None:
    """A stiffness three times too large in the rig, ± 10 %: the filter walks away from it, and the
    stream says so.
    """
    three = {"value": 3 * rig.tendons[0].stiffness.value, "std": 240.0}
    live = LiveEstimator(rig.with_values({f"tendons.{i}.stiffness": three for i in range(2)}))
    readings = take(Monitor(live), log, range(len(log)))
    said = [one for one in readings if one.health == "disagrees" and "stiffness" in one.detail]
    assert "further from the rig's value" in said[-1].detail


def test_where_nothing_is_compared_it_is_untested(rig: Rig, log: Log) -> None:
    """Without force sensors nothing can disagree: that is not "ok"."""
    blind = rig.model_copy(update={"sensors": rig.sensors_of("position")})
    readings = take(Monitor(LiveEstimator(blind)), log, range(100))
    assert {*words_of(readings)} == {"untested"}
    assert readings[-1].detail == "no sensor is compared"


def test_a_sensor_that_always_says_the_same_is_dead(monitor: Monitor, log: Log) -> None:
    held = np.where(log.time < 2.0, log.channels["x1"], log.channels["x1"][200])
    readings = take(monitor, changed(log, x1=held), range(400))
    assert readings[240].health == GOOD
    assert {*words_of(readings[255:])} == {"dead"}
    assert readings[-1].detail == "x1 does not change"


def test_wrong_units_and_sides_are_said(rig: Rig, log: Log) -> None:
    """What `estimate` warns of, a stream says too."""
    x1, x2, u1, u2 = (log.channels[name] for name in ("x1", "x2", "u1", "u2"))
    for wrong in (
        {"x1": 1e3 * x1, "x2": 1e3 * x2},
        {"x2": 1e3 * x2},
        {"x1": x2, "x2": x1, "u1": u2, "u2": u1},
        # an amplifier that is off: slack tendons, but no noise either
        {"u1": 0 * u1, "u2": 0 * u2},
    ):
        monitor = Monitor(LiveEstimator(rig))
        words = words_of(take(monitor, changed(log, **wrong), range(len(log))))
        assert words.count("disagrees") + words.count("dead") > 300, list(wrong)
    seconds = replace(log, time=1e-3 * log.time)
    last = take(Monitor(LiveEstimator(rig)), seconds, range(400))[-1]
    assert last.health == "disagrees"
    assert "unit of time" in last.detail


def test_what_is_no_sample_changes_nothing(monitor: Monitor, rig: Rig, log: Log) -> None:
    take(monitor, log, range(100))
    samples = samples_of(log, monitor.channels)
    for time, sample in (
        (1.0, [0.0, 0.0, 1.0, 1.0]),
        (1.0, samples[0][:2]),
        (1.0, samples[:2]),
        (1.0, samples[0].astype(complex)),
        (1.0, None),
        ("soon", samples[0]),
        (None, samples[0]),
    ):
        assert monitor.take(time, sample).health == "bad"  # type: ignore[arg-type]
    rest = [one.angle for one in take(monitor, log, range(100, 200))]
    np.testing.assert_allclose(rest, estimate(log, rig).theta[100:200], atol=1e-14)


def test_a_sensor_that_never_came_is_missing_at_once(monitor: Monitor, log: Log) -> None:
    assert monitor.take(-1.0, np.full(4, np.nan)).health == "bad"
    lacks = changed(log, u2=np.where(log.time < log.time[-1], np.nan, 0.0))
    readings = take(monitor, lacks, range(100))
    assert np.isfinite(readings[0].angle)
    assert (readings[0].health, readings[0].detail) == ("missing", "u2")
    assert readings[-1].health == "dead"
    assert monitor.take(1.0, np.full(4, np.nan)).health in ("missing", "dead")


def test_a_filter_that_was_lost_says_so_afterwards(rig: Rig, log: Log) -> None:
    monitor = Monitor(LiveEstimator(rig.with_values(PULLEYS), "inextensible"))
    take(monitor, log, range(50))
    lost = monitor.take(0.5, np.array([9e6, -9e6, 1.0, 1.0]))
    assert lost.health in ("bad", "restarted", "disagrees")
    assert take(monitor, log, [51])[0].health != GOOD
    # the order of time is not forgotten
    assert take(monitor, log, [50])[0].health == "late"
