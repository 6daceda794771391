"""What a window of known targets tells, and what it does not."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import homing_filter, load_rig
from distal.estimators import AdaptiveFilter, Belief
from distal.homing import _anchored
from distal.kernels import covariance_of
from distal.regression import Samples, Weights, from_window
from distal.regression.posterior import _noise
from tests.learned_maps import constant_map
from tests.regression.test_posterior import DESCRIBED, PRIOR, SHAPE, cost, evidence

EVERY = np.ones(300, dtype=bool)


def test_the_likeliest_share_of_a_prior_is_that_with_the_largest_density() -> None:
    weights, log = Weights.of(SHAPE, PRIOR, []), evidence(7)
    explained = log.phi @ weights.covariance @ log.phi.T
    noise = _noise(PRIOR, 0.5) * np.eye(25) + 0.3
    for share in (0.01, 0.3):
        drawn = np.linalg.cholesky(share * explained + noise) @ log.target
        shares = np.geomspace(1e-6, 1.0, 2001)
        costs = [cost(s * explained + noise, drawn) for s in shares]
        found = weights.likeliest_share(replace(log, target=drawn), 0.3)
        assert np.log(found) == pytest.approx(np.log(shares[int(np.argmin(costs))]), abs=0.05)
    nothing = log.part(np.zeros(25, dtype=bool))
    assert weights.likeliest_share(nothing, 0.0) == 0.0


def window(bend: float) -> Samples:
    """Return a log whose target bends in its second half."""
    time = 0.01 * np.arange(300)
    place = np.linspace(-1.0, 1.0, 300)
    target = place + bend * np.maximum(place, 0.0)
    none = np.zeros((300, 0))
    return Samples(time, place[:, None], none, target[:, None], np.zeros((300, 1)))


def test_a_band_is_widened_until_it_holds_each_half_given_the_other() -> None:
    described = {**DESCRIBED, "channels": ("x",)}
    straight, bent = (
        from_window(window(bend), described, EVERY, {}).arrays["noise"][0]
        / np.var(window(bend).targets)
        for bend in (0.0, 2.0)
    )
    assert bent > 4.0 * straight


def test_the_scale_of_an_effort_contains_its_mean() -> None:
    """Of a position, whose zero means nothing, it does not."""
    log = window(0.0)
    two = replace(log, readings=np.tile(log.readings + 5.0, 2))
    found = from_window(two, DESCRIBED, EVERY, {})
    spread = np.std(log.readings)
    np.testing.assert_allclose(found.arrays["scale"], [spread, np.hypot(spread, 5.0)])


def test_a_known_first_angle_counts_by_bayes_rule() -> None:
    """A mark of ± 0.3 rad and a prior of ± 0.4 rad."""
    state = np.zeros(2)
    covariance_of(state, 1)[0, 0] = 0.16
    begun = _anchored(Belief(0.0, state, 1), np.array([[np.nan], [1.0]]), ["a"], {"a": 0.3})
    assert begun.kernel_state[0] == pytest.approx(0.64, abs=0.001)
    assert begun.kernel_state[1] == pytest.approx(0.0576, abs=0.001)


def test_a_zero_that_no_log_knew_follows_a_known_angle() -> None:
    """A map that is sure of its constant to 0.002 rad, and a mark that says 0.2 rad more."""
    sure = constant_map("jaw", ("motor_angle", "motor_torque"), 0.0, 0.002)
    rig = load_rig("capstan-joint").with_map(filter=[sure])
    time = 0.005 * np.arange(300)
    samples = np.column_stack([0.2 * np.sin(4.0 * time), np.full(300, 0.01)])
    plain, homing = AdaptiveFilter(rig, compiled=False), homing_filter(rig, 0.0, False)
    usual = plain.scan(plain.initial(0.0, samples[0]), time, samples)[0][:, 0]
    marked = np.where((time > 0.5) & (time < 0.75), usual + 0.2, np.nan)
    told = np.column_stack([samples, marked])
    means, *_ = homing.scan(homing.initial(0.0, told[0]), time, told)
    assert means[-1, 0] - usual[-1] == pytest.approx(0.2, abs=0.03)
