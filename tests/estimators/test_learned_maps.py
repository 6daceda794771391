"""Estimators with learned maps: `regression` on readings alone, `adaptive` that maps correct."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from distal import (
    LiveEstimator,
    Log,
    Rig,
    estimate,
    estimate_batch,
    load_rig,
    make_estimator,
    simulate,
    smooth,
)
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter
from distal.export.c_source import c_filter
from distal.logs import write_log
from distal.regression import Shape, features_along
from distal.rig import independent_parts
from distal.simulation import Scenario
from tests.export.test_export import build, needs_compiler, replayed
from tests.hand_rigs import hand
from tests.learned_maps import drawn_map, predict, resting, with_drawn
from tests.support.maps import with_learned_map


@pytest.fixture(scope="module")
def plain() -> Rig:
    return load_rig("capstan-joint")


@pytest.fixture(scope="module")
def rig(plain: Rig) -> Rig:
    return with_drawn(plain)


@pytest.fixture(scope="module")
def log() -> Log:
    time = np.arange(0.0, 3.0, 0.005)
    rng = np.random.default_rng(4)
    angle = 0.4 * np.sin(1.5 * time)
    channels = {
        "motor_angle": 1.6 * angle + 4e-4 * rng.normal(size=len(time)),
        "motor_torque": 0.03 * np.cos(1.5 * time) + 2e-3 * rng.normal(size=len(time)),
    }
    return Log(time, channels, {"theta": angle}, "log")


def test_the_reported_angle_is_the_filters_and_the_maps(plain: Rig, rig: Rig, log: Log) -> None:
    """θ + φᵀ m, its variance (share)² P and that of the map, at positions as the filter tracks
    them.
    """
    only = plain.with_map(filter=[resting(drawn_map())])
    learned = only.map.filter[0] if only.map else None
    assert learned is not None
    bare, ours = AdaptiveFilter(plain, False), AdaptiveFilter(only, False)
    samples = np.column_stack([log.channels[name] for name in bare.channels])
    begun = bare.initial(0.0, samples[0])
    states = bare.advanced(begun, log.time, samples).kernel_states
    n = begun.size
    angles, variances = states[:, 0], states[:, n]
    readings = np.column_stack([states[:, bare.positions[0] or 0], samples[:, 1], angles])
    shape = Shape.of(learned)
    numbers = learned.arrays
    frame = np.concatenate([numbers[name].ravel(order="F") for name in shape.frame.names])
    values, _ = predict(learned, features_along(shape, frame, log.time, readings), 0)
    means, covariances, _, _ = ours.scan(ours.initial(0.0, samples[0]), log.time, samples)
    late = slice(100, None)  # both memories have forgotten where they began
    np.testing.assert_allclose(means[late, 0], (angles + values)[late], atol=2e-3)
    least = (numbers["filter"][0] ** 2 * variances + numbers["noise"][0])[late]
    assert np.all(covariances[late, 0, 0] >= least)
    np.testing.assert_allclose(means[:, 1:], states[:, 1:n], atol=1e-12)


def test_sample_by_sample_live_and_in_a_batch(rig: Rig, log: Log) -> None:
    for name in ("adaptive", "regression"):
        whole = estimate(log, rig, name)
        live = LiveEstimator(rig, make_estimator(name, rig))
        said = []
        for k, time in enumerate(log.time):
            live.step(float(time), np.array([log.channels[c][k] for c in live.channels]))
            said.append((live.angle, live.angle_stds[0]))
        found = np.array(said)
        np.testing.assert_allclose(found[:, 0], whole.angles[:, 0], atol=1e-12)
        np.testing.assert_allclose(found[:, 1], whole.angle_stds[:, 0], rtol=1e-9)
        (other, *_) = estimate_batch([log, log, log], rig, name)
        np.testing.assert_allclose(other.angles, whole.angles, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("single", [False, True])
def test_in_c(rig: Rig, log: Log, single: bool, tmp_path: Path) -> None:
    write_log(log, rig, tmp_path / "log.csv")
    rows = replayed(build(c_filter(rig, "adaptive", single), tmp_path, "-O2"), tmp_path / "log.csv")
    known = estimate(log, rig, compiled=False)
    tolerance = np.deg2rad(0.02) if single else 1e-9
    np.testing.assert_allclose(rows[:, 1], known.theta, atol=tolerance)
    np.testing.assert_allclose(rows[:, 2], known.theta_std, atol=tolerance)


def test_the_smoother_puts_the_same_map_on_its_own_angle(plain: Rig, rig: Rig, log: Log) -> None:
    added = estimate(log, rig).angles - AdaptiveEstimate.of(log, plain, rig)
    smoothed = smooth(log, rig).angles - smooth(log, plain).angles
    np.testing.assert_allclose(smoothed[200:], added[200:], atol=2e-3)


class AdaptiveEstimate:
    """The filter's own angles in a run whose start is that of another rig's map."""

    @staticmethod
    def of(log: Log, plain: Rig, rig: Rig) -> np.ndarray:
        ours = AdaptiveFilter(rig, False)
        samples = np.column_stack([log.channels[name] for name in ours.channels])
        states = ours.advanced(ours.initial(0.0, samples[0]), log.time, samples).kernel_states
        return np.array(states[:, :1])


def test_while_a_jump_is_in_doubt_the_filters_own_error_counts_whole(rig: Rig, log: Log) -> None:
    """What the logs taught of it does not hold: the gain goes towards 1 by 4 p (1 − p), and the
    variance has that of both positions.
    """
    filtered = AdaptiveFilter(rig, compiled=False)
    values = np.column_stack([log.channels[name] for name in filtered.channels])
    jumped = values.copy()
    jumped[300, filtered.channels.index("motor_angle")] += 0.1
    reports = []
    for samples in (values, jumped):
        belief = filtered.initial(log.time[0], samples[0])
        _, ys = filtered.advanced(belief, log.time, samples)
        reports.append((ys[:, filtered.report.gains], ys[:, filtered.report.variances]))
    (gains, variances), (doubted, wider) = reports
    np.testing.assert_array_equal(doubted[:300], gains[:300])
    assert gains[300] < 0.9
    assert doubted[300] > gains[300] + 0.2 * (1.0 - gains[300])
    assert wider[300] > variances[300] + 0.01**2
    np.testing.assert_allclose(doubted[301], gains[301])


def test_a_sensor_that_is_lost_widens_the_band(rig: Rig, log: Log) -> None:
    gone = np.where((log.time > 1.0) & (log.time < 2.0), np.nan, log.channels["motor_torque"])
    lost = replace(log, channels={**log.channels, "motor_torque": gone})
    before, after = estimate(log, rig, "regression"), estimate(lost, rig, "regression")
    late = (log.time > 1.6) & (log.time < 2.0)
    assert np.mean(after.angle_stds[late]) > 1.05 * np.mean(before.angle_stds[late])


class TestRegression:
    def test_it_needs_a_map_or_a_homing_move(self, plain: Rig, log: Log) -> None:
        with pytest.raises(EstimationError, match=r"has no map .* needs \[map\]"):
            estimate(log, plain, "regression")
        found = estimate(log, plain, "regression", homing=2.0)
        late = log.time >= 2.0
        errors = found.angles[late, 0] - log.truth["theta"][late]
        assert np.sqrt(np.mean(errors**2)) < 0.02
        assert np.mean(np.abs(errors) < 1.96 * found.angle_stds[late, 0]) > 0.8

    def test_a_homing_move_without_an_angle_is_refused(self, rig: Rig, log: Log) -> None:
        late = replace(log, truth={"theta": np.where(log.time < 2.0, np.nan, 0.1)})
        with pytest.raises(EstimationError, match="homing"):
            estimate(late, rig, "regression", homing=1.0)

    def test_a_hand_has_a_map_for_each_finger(self) -> None:
        """Joints that share nothing have maps of their own, which read their own sensors."""
        rig = hand(["finger-underactuated", "capstan-joint"], {"sensors.*.rate": 200.0})
        moved = {
            drive.name: {"torque": [["0 s", "10 mN m"], ["1 s", "60 mN m"], ["2 s", "20 mN m"]]}
            for drive in rig.drives
        }
        scenario = Scenario(rig="hand", name="hand", duration=2.0, drives=moved)
        logs = [simulate(rig, scenario, seed) for seed in range(2)]
        learned = with_learned_map(logs, rig, "readings")
        assert learned.map is not None
        first, second = learned.map.readings
        assert [each.joints for each in (first, second)] == [
            tuple(part.rig.joint_names) for part in independent_parts(rig)
        ]
        assert not set(first.channels) & set(second.channels)
        assert estimate(logs[0], learned, "regression").rms_error() < np.deg2rad(5.0)


def test_a_filter_begins_where_the_readings_map_says(plain: Rig, log: Log) -> None:
    """Where the map is surer than the rig's own start."""
    learned = drawn_map(beside_filter=False)
    rig = plain.with_map(readings=[learned])
    unsure = rig.with_values({"joints.jaw.initial": {"value": 0.0, "std": 2.0}})
    sure = rig.with_values({"joints.jaw.initial": {"value": 0.0, "std": 1e-5}})
    first = np.array([0.1, 0.01])
    begun = AdaptiveFilter(unsure, False).initial(0.0, first)
    alone = make_estimator("regression", rig)
    means, *_ = alone.scan(alone.initial(0.0, first), np.zeros(1), first[None])
    assert begun.mean[0] == pytest.approx(means[0, 0], abs=1e-9)
    assert AdaptiveFilter(sure, False).initial(0.0, first).mean[0] == 0.0
