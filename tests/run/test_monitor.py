"""In a stream: each health word is said where it belongs, and nothing that comes is a crash."""

from __future__ import annotations

import numpy as np
import pytest

from distal import LiveEstimator, Log, Monitor, Rig, estimate, load_scenario, scenario_rig, simulate
from distal.estimators import first_values
from distal.rig import build_rig
from distal.run import HealthLimits, Reading, samples_of
from tests.helpers import PULLEYS

GOOD = "untested"
"""The word for good readings of a rig that no log taught."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return simulate(rig, load_scenario("series-2"), 5)


def take(monitor: Monitor, log: Log, rows: range | list[int], shift: float = 0.0) -> list[Reading]:
    samples = samples_of(log, monitor.channels)
    return [monitor.take(float(log.time[k]) + shift, samples[k]) for k in rows]


class TestHealth:
    """Each word is said where it belongs, and the estimate beside it is right or not there."""

    def test_a_good_stream_is_ok(self, rig: Rig, log: Log) -> None:
        readings = take(Monitor(LiveEstimator(rig)), log, range(len(log)))
        assert {one.health for one in readings} == {GOOD}
        np.testing.assert_allclose(
            [one.angle for one in readings], estimate(log, rig).theta, atol=1e-14
        )

    def test_late_and_repeated_samples_are_skipped(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
        readings = take(monitor, log, [*range(50), 49, 30, *range(50, 100)])
        assert [one.health for one in readings[50:52]] == ["duplicate", "late"]
        assert np.isnan([one.angle for one in readings[50:52]]).all()
        good = [one.angle for one in readings if np.isfinite(one.angle)]
        np.testing.assert_allclose(good, estimate(log, rig).theta[:100], atol=1e-14)

    def test_gaps_are_bridged_and_long_ones_begin_anew(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
        readings = take(monitor, log, [*range(100), *range(120, 200)])
        assert readings[100].health == "gap"
        assert readings[100].detail.startswith("0.21 s")
        assert {one.health for one in readings[101:]} == {GOOD}
        far = take(monitor, log, range(200, 260), shift=1e6)
        assert far[0].health == "restarted"
        assert {one.health for one in far[1:]} == {GOOD}
        assert far[0].angle_std > 2 * readings[-1].angle_std  # it says that it knows less

    @pytest.mark.parametrize(("samples", "goes_on"), [(100, True), (200, False)])
    def test_samples_without_values_are_as_samples_that_do_not_come(
        self, rig: Rig, log: Log, samples: int, goes_on: bool
    ) -> None:
        """Until the gap is too long: then the filter has wandered with its drives."""
        after = range(100 + samples, 400)
        silent = {name: values.copy() for name, values in log.channels.items()}
        for values in silent.values():
            values[100 : after[0]] = np.nan
        empty = take(Monitor(LiveEstimator(rig)), Log(log.time, silent), range(400))
        limits = HealthLimits(longest_gap=1.5)
        bridged = take(Monitor(LiveEstimator(rig), limits), log, [*range(100), *after])
        assert empty[after[0] - 1].angle_std > 3 * bridged[99].angle_std  # meanwhile it knows less
        same = [one.angle == other.angle for one, other in zip(empty[after[0] :], bridged[100:])]
        assert all(same) if goes_on else not any(same)

    def test_the_drive_of_a_dead_sensor_is_in_doubt(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
        samples = samples_of(log, monitor.channels)
        sensor = rig.sensors_of("position")[0]
        samples[100:, monitor.channels.index(sensor.name)] = np.nan
        readings = [monitor.take(float(log.time[k]), samples[k]) for k in range(200)]
        assert readings[99].doubted == ()
        first = next(one for one in readings if one.health == "dead")
        assert first.doubted == (sensor.of,)

    def test_limits_are_those_that_are_given(self, rig: Rig, log: Log) -> None:
        patient = Monitor(LiveEstimator(rig), HealthLimits(waiting=50.0))
        readings = take(patient, log, [*range(100), *range(120, 200)])
        assert "gap" not in {one.health for one in readings}
        assert patient.clone(LiveEstimator(rig))._limits.waiting == 50.0

    def test_stamps_of_another_rate_are_no_gaps(self, rig: Rig, log: Log) -> None:
        """Three times as slow as the rig says; four of these missing are a gap all the same."""
        rows = [*range(0, 300, 3), *range(312, 600, 3)]
        words = [one.health for one in take(Monitor(LiveEstimator(rig)), log, rows)]
        assert words[100] == "gap"
        assert {*words[:100], *words[101:]} == {GOOD}

    def test_a_clock_that_was_set_back(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
        take(monitor, log, range(200))
        readings = take(monitor, log, range(200, 260), shift=-1e3)
        assert [one.health for one in readings[:4]] == ["late", "late", "restarted", GOOD]

    def test_one_late_sample_now_and_then_is_no_clock(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
        rows = [k for i in range(50) for k in (i + 10, i)]
        words = [one.health for one in take(monitor, log, [*range(10), *rows])]
        assert "restarted" not in words
        assert words.count("late") == 50

    def test_a_sensor_that_dies_and_returns(self, rig: Rig, log: Log) -> None:
        u1 = log.channels["u1"].copy()
        u1[300:400] = np.nan
        broken = Log(log.time, {**log.channels, "u1": u1}, log.truth, "dead", log.truth_source)
        readings = take(Monitor(LiveEstimator(rig)), broken, range(len(log)))
        words = [one.health for one in readings]
        assert words[299] == words[400] == GOOD
        assert words[303:340] == ["missing"] * 37
        assert words[351:400] == ["dead"] * 49
        assert readings[360].detail.startswith("u1 for 0.6")
        errors = np.abs([one.angle for one in readings] - log.truth["theta"])
        assert np.mean(errors <= 1.96 * np.array([one.angle_std for one in readings])) > 0.9

    def test_a_sensor_that_lies_disagrees(self, rig: Rig, log: Log) -> None:
        u1 = log.channels["u1"] + np.where(log.time > 4.0, 8.0, 0.0)
        broken = Log(log.time, {**log.channels, "u1": u1}, log.truth, "lie", log.truth_source)
        readings = take(Monitor(LiveEstimator(rig)), broken, range(len(log)))
        first = next(one for one in readings if one.health == "disagrees")
        assert 4.0 < first.time < 4.5
        assert "u1" in first.detail

    def test_a_number_that_left_its_prior_is_said(self, rig: Rig, log: Log) -> None:
        """A stiffness three times too large in the rig, ± 10 %: the filter walks away from it, and
        the stream says so.
        """
        path = "tendons.{}.stiffness"
        three = {
            path.format(i): {"value": 3 * rig.tendons[i].stiffness.value, "std": 240.0}
            for i in range(2)
        }
        readings = take(Monitor(LiveEstimator(rig.with_values(three))), log, range(len(log)))
        said = [one for one in readings if one.health == "disagrees" and "stiffness" in one.detail]
        assert said
        assert "further from the rig's value" in said[-1].detail

    def test_where_nothing_is_compared_it_is_untested(self, rig: Rig, log: Log) -> None:
        """Without force sensors nothing can disagree: that is not "ok"."""
        raw = rig.model_dump()
        raw["sensors"] = [sensor for sensor in raw["sensors"] if sensor["measures"] == "position"]
        readings = take(Monitor(LiveEstimator(build_rig(raw, "no forces"))), log, range(100))
        assert {one.health for one in readings} == {"untested"}
        assert readings[-1].detail == "no sensor is compared"

    def test_a_sensor_that_always_says_the_same_is_dead(self, rig: Rig, log: Log) -> None:
        x1 = np.where(log.time < 2.0, log.channels["x1"], log.channels["x1"][200])
        frozen = Log(log.time, {**log.channels, "x1": x1}, log.truth, "frozen", log.truth_source)
        readings = take(Monitor(LiveEstimator(rig)), frozen, range(400))
        assert readings[240].health == GOOD
        assert {one.health for one in readings[255:]} == {"dead"}
        assert readings[-1].detail == "x1 does not change"

    def test_wrong_units_and_sides_are_said(self, rig: Rig, log: Log) -> None:
        """What `estimate` warns of, a stream says too."""
        x1, x2, u1, u2 = (log.channels[name] for name in ("x1", "x2", "u1", "u2"))
        for wrong in (
            {"x1": 1e3 * x1, "x2": 1e3 * x2},
            {"x2": 1e3 * x2},
            {"x1": x2, "x2": x1, "u1": u2, "u2": u1},
            {
                "u1": 0 * u1,
                "u2": 0 * u2,
            },  # an amplifier that is off: slack tendons, but no noise either
        ):
            odd = Log(log.time, {**log.channels, **wrong}, log.truth, "odd", log.truth_source)
            words = [one.health for one in take(Monitor(LiveEstimator(rig)), odd, range(len(log)))]
            assert words.count("disagrees") + words.count("dead") > 300, list(wrong)
        monitor, samples = Monitor(LiveEstimator(rig)), samples_of(log, ("x1", "x2", "u1", "u2"))
        readings = [monitor.take(1e-3 * float(log.time[k]), samples[k]) for k in range(400)]
        assert readings[-1].health == "disagrees"
        assert "unit of time" in readings[-1].detail

    def test_what_is_no_sample_changes_nothing(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig))
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
        rest = take(monitor, log, range(100, 200))
        np.testing.assert_allclose(
            [one.angle for one in rest], estimate(log, rig).theta[100:200], atol=1e-14
        )

    def test_a_sensor_that_never_came_is_missing_at_once(self, rig: Rig, log: Log) -> None:
        lacks = Log(
            log.time, {**log.channels, "u2": np.where(log.time < 9.0, np.nan, 0.0)}, {}, "lacks"
        )
        monitor = Monitor(LiveEstimator(rig))
        samples = np.column_stack([lacks.channels[name] for name in monitor.channels])
        readings = [monitor.take(float(log.time[k]), samples[k]) for k in range(100)]
        assert readings[0].health == "missing"
        assert readings[0].detail == "u2"
        assert readings[-1].health == "dead"
        assert monitor.take(1.0, np.full(4, np.nan)).health in ("missing", "dead")

    def test_a_filter_that_was_lost_says_so_afterwards(self, rig: Rig, log: Log) -> None:
        monitor = Monitor(LiveEstimator(rig.with_values(PULLEYS), "inextensible"))
        take(monitor, log, range(50))
        samples = samples_of(log, monitor.channels)
        assert monitor.take(0.5, np.array([9e6, -9e6, 1.0, 1.0])).health in (
            "bad",
            "restarted",
            "disagrees",
        )
        assert monitor.take(0.51, samples[51]).health != GOOD
        assert monitor.take(0.5, samples[50]).health == "late"  # the order of time is not forgotten


def test_the_first_sample_may_lack_sensors(rig: Rig, log: Log) -> None:
    monitor = Monitor(LiveEstimator(rig))
    samples = samples_of(log, monitor.channels)
    assert monitor.take(0.0, np.full(4, np.nan)).health == "bad"
    part = samples[0].copy()
    part[3] = np.nan
    assert np.isfinite(monitor.take(0.01, part).angle)
    assert first_values(samples).shape == (4,)
