"""The rival of the benchmarks: an estimator like any other, on the model of `adaptive`."""

from __future__ import annotations

import numpy as np
import pytest
from tests.support.cases import MID_RANGE

from benchmarks import accuracy
from benchmarks.rivals import IteratedFilter
from distal import (
    Log,
    Rig,
    estimate,
    load_scenario,
    make_estimator,
    scenario_rig,
    simulate,
)
from distal.errors import EstimationError
from distal.run import samples_of


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    """The first second and a half, in which the link turns by 60°."""
    return simulate(rig, load_scenario("series-2"), 7).select(slice(0, 150))


def test_the_contract(rig: Rig, log: Log) -> None:
    """A part of a log gives the numbers of the whole log, missing values and a gap included; inputs
    stay as they are.
    """
    made = IteratedFilter(rig, compiled=False)
    assert made.name == "iterated"
    assert made.state_names == make_estimator("adaptive", rig).state_names
    samples, times = samples_of(log, made.channels)[:40], np.array(log.time[:40])
    samples[5, 0], samples[9, :] = np.nan, np.nan
    times[20:] += 0.1
    before = samples.copy()
    belief = made.initial(times[0], samples[0])
    means, covariances, innovations, variances = made.scan(belief, times, samples)
    part = made.scan(belief, times[:30], samples[:30])
    for values, found in zip((means, covariances, innovations, variances), part):
        np.testing.assert_array_equal(found, values[:30])
    np.testing.assert_array_equal(samples, before)
    np.testing.assert_array_equal(covariances, np.swapaxes(covariances, 1, 2))
    scale = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2).max(axis=0))
    # rounding is far below what an eigenvalue may lack
    assert np.linalg.eigvalsh(covariances / np.outer(scale, scale)).min() > -1e-9
    with pytest.raises(EstimationError, match="repeats"):
        made.scan(belief, times[[0, 0]], samples[:2])
    with pytest.raises(ValueError, match="read-only"):
        belief.mean[0] = 1.0


def test_once_linearised_the_iterated_filter_is_adaptive(rig: Rig, log: Log) -> None:
    """Only the order of operations differs; twice more it is another filter, close by."""
    known = estimate(log, rig)
    once = estimate(log, rig, IteratedFilter(rig, compiled=False, updates=1))
    np.testing.assert_allclose(once.means, known.means, rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(once.variances, known.variances, rtol=1e-9, atol=1e-15)
    thrice = estimate(log, rig, IteratedFilter(rig, compiled=False))
    apart = np.abs(thrice.theta - known.theta)
    assert apart.max() > 1e-9
    assert np.all(apart < 0.5 * known.theta_std)


def test_every_estimator_that_is_compared_gives_an_angle() -> None:
    """A run that is refused counts as an error of 90°: one that asks wrongly would end too."""
    scores = accuracy.run((MID_RANGE[0], "as the rig", 0))
    assert {score.estimator for score in scores} >= set(accuracy.COMPARED)
    assert max(score.rms for score in scores) < 45.0
