"""An angle that is known while a filter runs: it conditions the map, as in a homing move."""

from __future__ import annotations

import pickle

import numpy as np
import pytest

from distal import LiveEstimator, Log, Rig, homing_filter, load_rig
from distal.errors import EstimationError
from distal.estimators import AdaptiveFilter
from distal.homing import plain_samples
from distal.regression import Shape, given
from distal.rig import MapArrays
from tests.learned_maps import constant_map, drawn_map, with_drawn


@pytest.fixture(scope="module")
def rig() -> Rig:
    """Return a rig whose map knows its constant to 0.1 rad."""
    learned = constant_map("jaw", ("motor_angle", "motor_torque"), 0.0, 0.002)
    arrays = dict(learned.arrays.by_name)
    arrays["covariance"] = arrays["covariance"].copy()
    arrays["covariance"][0, 0, 0] = 0.1**2
    wide = learned.model_copy(update={"arrays": MapArrays(**arrays)})
    return load_rig("capstan-joint").with_map(filter=[wide])


def moved(live: LiveEstimator, begin: int = 0, count: int = 40) -> float:
    """Take in samples, and return the last angle."""
    for k in range(begin, begin + count):
        live.step(0.005 * k, np.array([0.2 * np.sin(0.05 * k), 0.01]))
    return live.angle


@pytest.mark.parametrize("compiled", [False, True])
def test_the_next_sample_shows_it_until_a_reset(compiled: bool, rig: Rig) -> None:
    live, plain = LiveEstimator(rig, compiled=compiled), LiveEstimator(rig, compiled=compiled)
    before = moved(live)
    moved(plain)
    wide = live.angle_std
    off = live.known(before + 0.05, std=0.001)
    assert off == pytest.approx(0.05 / wide, rel=0.1)
    after, usual = moved(live, 40, 1), moved(plain, 40, 1)
    assert after - usual == pytest.approx(0.05, abs=0.003)
    assert live.angle_std < 0.4 * wide
    live.reset()
    assert moved(live) == pytest.approx(before, abs=1e-12)


def test_it_is_bayes_rule_on_the_reported_angle(rig: Rig) -> None:
    """One number known: mean and variance of the angle there are those of two measurements."""
    live = LiveEstimator(with_drawn(load_rig("capstan-joint")), "regression", compiled=False)
    moved(live)
    mean, variance = live.angle, float(live.covariance[0, 0])
    live.known(mean + 0.01, std=0.004)
    live.step(0.005 * 40, np.array([0.2 * np.sin(0.05 * 39), 0.01]))
    share = variance / (variance + 0.004**2)
    assert live.angle - mean < 0.01
    assert live.angle - mean == pytest.approx(share * 0.01, abs=0.006)


def test_again_and_again_counts_as_less(rig: Rig) -> None:
    once, often = LiveEstimator(rig, compiled=False), LiveEstimator(rig, compiled=False)
    truth = moved(once) + 0.05
    moved(often)
    once.known(truth, std=0.02)
    for _ in range(20):
        often.known(truth, std=0.02)
    moved(once, 40, 1)
    moved(often, 40, 1)
    assert 0.6 * once.angle_std < often.angle_std < once.angle_std


def test_a_clone_and_a_pickle_keep_it(rig: Rig) -> None:
    live = LiveEstimator(rig, compiled=False)
    live.known(moved(live) + 0.05, std=0.001)
    copies = [live.clone(), pickle.loads(pickle.dumps(live))]
    expected = moved(live, 40, 5)
    for copy in copies:
        assert moved(copy, 40, 5) == pytest.approx(expected, abs=1e-12)


def test_what_cannot_be_known_is_refused(rig: Rig) -> None:
    live = LiveEstimator(rig, compiled=False)
    with pytest.raises(EstimationError, match="no sample was taken in yet"):
        live.known(0.1)
    moved(live)
    for angle, std, joint in ((np.nan, 0.0, None), (0.1, -1.0, None), (0.1, 0.0, "elbow")):
        with pytest.raises(EstimationError, match="known takes an angle and its std of one of jaw"):
            live.known(angle, std, joint)
    bare = LiveEstimator(rig.bare(), compiled=False)
    moved(bare)
    with pytest.raises(EstimationError, match="has no learned map of jaw"):
        bare.known(0.1)


@pytest.mark.parametrize("std", [0.0, 0.02])
def test_a_filter_that_homes_conditions_its_map_as_a_whole_move_does(std: float) -> None:
    """Sample by sample and all at once are the same, with the constant error of the mark, where the
    weights of slips, on which the variance of their intervals depends, are certain.
    """
    drawn = drawn_map()
    slips = Shape.of(drawn).features["slips"]
    arrays = {name: array.copy() for name, array in drawn.arrays.by_name.items()}
    arrays["mean"][:, slips] = 0.0
    arrays["covariance"][:, slips, :] = arrays["covariance"][:, :, slips] = 0.0
    arrays["covariance"][:, 0, 0] += 1.0  # so that no zero is a surprise
    drawn = drawn.model_copy(update={"arrays": MapArrays(**arrays)})
    rig = load_rig("capstan-joint").with_map(filter=[drawn])
    homing = homing_filter(rig, std, compiled=False)
    time = 0.005 * np.arange(200)
    readings = np.column_stack([0.3 * np.sin(5 * time), 0.02 * np.cos(3 * time)])
    angles = np.where(time < 0.6, 0.1, np.nan)[:, None]
    samples = np.column_stack([readings, angles])
    start = homing.initial(0.0, samples[0])
    means, covariances, *_ = homing.scan(start, time, samples)
    log = Log(time, dict(zip(homing.channels, readings.T)))
    plain = AdaptiveFilter(rig, compiled=False)
    unaided = plain_samples(plain, plain.initial(0.0, readings[0]), log, readings, angles)
    # the first sample has no interval, and tells nothing
    known = (time > 0.0) & (time < 0.6)
    after = given(rig.map.filter[0], unaided, known, {"jaw": std})
    with_it = plain.with_maps(rig.map.model_copy(update={"filter": (after,)}))
    expected, spreads, *_ = with_it.scan(with_it.initial(0.0, readings[0]), time, readings)
    late = time > 0.6
    np.testing.assert_allclose(means[late, 0], expected[late, 0], atol=1e-6)
    np.testing.assert_allclose(covariances[late, 0, 0], spreads[late, 0, 0], rtol=1e-4)
    usual = plain.scan(plain.initial(0.0, readings[0]), time, readings)[0]
    assert np.abs(usual[late, 0] - expected[late, 0]).max() > 1e-3
