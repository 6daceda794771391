"""Estimators with learned maps: `regression` on readings alone, `adaptive` that maps correct."""

from __future__ import annotations

from dataclasses import replace

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
    smooth,
)
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter, channels_of, of_part, parts_of
from distal.regression import Samples
from distal.rig import independent_parts
from distal.run import samples_of
from tests.hand_rigs import hand
from tests.learned_maps import along, drawn_map, predict, resting, with_drawn


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


def advanced(made: AdaptiveFilter, log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Return the filter's own memory after each sample, before its maps, and what it reports."""
    samples = samples_of(log, made.channels)
    run = made.advanced(made.initial(0.0, samples[0]), log.time, samples)
    return run.kernel_states, run.ys


def changed(log: Log, name: str, rows: object, value: float) -> Log:
    values = log.channels[name].copy()
    values[rows] += value
    return replace(log, channels={**log.channels, name: values})


def test_the_reported_angle_is_the_filters_and_the_maps(plain: Rig, log: Log) -> None:
    """θ + φᵀ m, its variance (share)² P and that of the map, at positions as the filter tracks
    them.
    """
    learned = resting(drawn_map())
    bare, ours = AdaptiveFilter(plain, False), plain.with_map(filter=[learned])
    states, _ = advanced(bare, log)
    n = len(bare.state_names)
    torques = log.channels["motor_torque"]
    readings = np.column_stack([states[:, bare.positions[0] or 0], torques, states[:, 0]])
    values, _ = predict(learned, along(learned, log.time, readings), 0)
    found = estimate(log, ours, compiled=False)
    late = slice(100, None)  # both memories have forgotten where they began
    np.testing.assert_allclose(found.theta[late], (states[:, 0] + values)[late], atol=2e-3)
    arrays = learned.arrays
    least = arrays["filter"][0] ** 2 * states[:, n] + arrays["noise"][0]
    assert np.all(found.variances[late, 0] >= least[late])
    np.testing.assert_allclose(found.means[:, 1:], states[:, 1:n], atol=1e-12)


def test_sample_by_sample_live_and_in_a_batch(rig: Rig, log: Log) -> None:
    whole, live, said = estimate(log, rig), LiveEstimator(rig), []
    for time, sample in zip(log.time, samples_of(log, live.channels)):
        live.step(time, sample)
        said.append((live.angle, live.angle_stds[0]))
    expected = np.column_stack([whole.angles, whole.angle_stds])
    np.testing.assert_allclose(said, expected, rtol=1e-9, atol=1e-12)
    (other, *_) = estimate_batch([log, log, log], rig)
    np.testing.assert_allclose(other.angles, whole.angles, atol=1e-12)


def test_the_smoother_puts_the_same_map_on_its_own_angle(plain: Rig, rig: Rig, log: Log) -> None:
    added = estimate(log, rig).angles - advanced(AdaptiveFilter(rig, False), log)[0][:, :1]
    smoothed = smooth(log, rig).angles - smooth(log, plain).angles
    np.testing.assert_allclose(smoothed[200:], added[200:], atol=2e-3)


def test_while_a_jump_is_in_doubt_the_filters_own_error_counts_whole(rig: Rig, log: Log) -> None:
    """What the logs taught of it does not hold: the gain goes towards 1 by 4 p (1 − p), and the
    variance has that of both positions.
    """
    made = AdaptiveFilter(rig, compiled=False)
    (gains, variances), (doubted, wider) = (
        (ys[:, made.report.gains], ys[:, made.report.variances])
        for _, ys in (advanced(made, each) for each in (log, changed(log, "motor_angle", 300, 0.1)))
    )
    np.testing.assert_array_equal(doubted[:300], gains[:300])
    assert gains[300] < 0.9
    assert doubted[300] > gains[300] + 0.2 * (1.0 - gains[300])
    assert wider[300] > variances[300] + 0.01**2
    np.testing.assert_allclose(doubted[301], gains[301])


def test_regression_needs_a_map_or_a_homing_move_with_an_angle(plain: Rig, log: Log) -> None:
    with pytest.raises(EstimationError, match=r"has no map .* needs \[map\]"):
        estimate(log, plain, "regression")
    found = estimate(log, plain, "regression", homing=2.0)
    late = log.time >= 2.0
    errors = found.theta[late] - log.truth["theta"][late]
    assert np.sqrt(np.mean(errors**2)) < 0.02
    assert np.mean(np.abs(errors) < 1.96 * found.theta_std[late]) > 0.8
    unknown = replace(log, truth={"theta": np.where(late, 0.1, np.nan)})
    with pytest.raises(EstimationError, match="homing"):
        estimate(unknown, plain, "regression", homing=1.0)


def test_a_hand_has_a_map_for_each_finger() -> None:
    """Joints that share nothing have maps of their own, which read their own sensors."""
    rig = hand(["finger-underactuated", "capstan-joint"], {"sensors.*.rate": 200.0})
    parts = parts_of(rig, channels_of(rig, "regression"))
    joints = [part["joints"] for part in parts]
    assert joints == [tuple(part.rig.joint_names) for part in independent_parts(rig)]
    maps = [drawn_map(part["joints"], part["channels"], False) for part in parts]
    made = make_estimator("regression", rig.with_map(readings=maps), compiled=False)
    sample = np.full(len(made.channels), 0.01)
    other = np.where([name in parts[1]["channels"] for name in made.channels], 0.02, sample)
    one, moved = (
        made.scan(made.initial(0.0, s), np.zeros(1), s[None])[0][0] for s in (sample, other)
    )
    assert list((one != moved)[:4]) == [False, False, False, True]
    # and learn from these alone
    readings, angles = np.arange(len(made.channels))[None], np.arange(4)[None]
    every = Samples(np.zeros(1), readings, angles, angles, angles)
    own = of_part(every, rig, made.channels, joints[1], parts[1]["channels"])
    assert [made.channels[k] for k in own.readings[0]] == list(parts[1]["channels"])
    assert own.angles == own.targets == own.variances == 3


def test_a_filter_begins_where_the_readings_map_says(plain: Rig) -> None:
    """Where the map is surer than the rig's own start."""
    rig, first = plain.with_map(readings=[drawn_map(beside_filter=False)]), np.array([0.1, 0.01])

    def begun(std: float) -> float:
        start = {"joints.jaw.initial": {"value": 0.0, "std": std}}
        return float(AdaptiveFilter(rig.with_values(start), False).initial(0.0, first).mean[0])

    alone = make_estimator("regression", rig)
    means, *_ = alone.scan(alone.initial(0.0, first), np.zeros(1), first[None])
    assert begun(2.0) == pytest.approx(means[0, 0], abs=1e-9)
    assert begun(1e-5) == 0.0
