"""The rivals of the benchmarks: estimators like any other, on the model of `adaptive`."""

from __future__ import annotations

import subprocess
from collections.abc import Callable

import numpy as np
import pytest
from tests.helpers import rms_degrees

from benchmarks import limits
from benchmarks.rivals import PARTICLES, RIVALS, IteratedFilter, ParticleFilter, UnscentedFilter
from distal import (
    ESTIMATORS,
    LiveEstimator,
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    make_estimator,
    scenario_rig,
    simulate,
)
from distal.errors import EstimationError
from distal.estimators import KernelEstimator
from distal.kernels import find_compiler
from distal.run import samples_of

QUICK: dict[str, Callable[[Rig], KernelEstimator]] = {
    "iterated": lambda rig: IteratedFilter(rig, compiled=False),
    "unscented": UnscentedFilter,
    "particle": lambda rig: ParticleFilter(rig, 60),
}
"""The same with few particles and nothing compiled, for what does not depend on that."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return scenario_rig(load_scenario("series-2"))


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    """The first second and a half, in which the link turns by 60°."""
    return simulate(rig, load_scenario("series-2"), 7).select(slice(0, 150))


def test_they_are_no_choices_of_the_package() -> None:
    assert not RIVALS.keys() & ESTIMATORS.keys()
    assert RIVALS.keys() == QUICK.keys()


@pytest.mark.parametrize("name", RIVALS)
def test_the_contract(name: str, rig: Rig, log: Log) -> None:
    """A part of a log gives the numbers of the whole log, missing values and a gap included; inputs
    stay as they are.
    """
    made = QUICK[name](rig)
    assert made.name == name
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
    # 60 particles span the 19 states, and rounding is far below what an eigenvalue may lack
    assert np.linalg.eigvalsh(covariances / np.outer(scale, scale)).min() > -1e-9
    with pytest.raises(EstimationError, match="repeats"):
        made.scan(belief, times[[0, 0]], samples[:2])
    with pytest.raises(ValueError, match="read-only"):
        belief.mean[0] = 1.0


@pytest.mark.parametrize("name", RIVALS)
@pytest.mark.parametrize("which", ["pulley-antagonist", "capstan-joint", "da-vinci-grasper"])
def test_they_run_on_other_rigs(name: str, which: str) -> None:
    made = QUICK[name](load_rig(which))
    samples = np.column_stack(
        [np.full(5, 5e-3 if c.startswith("x") else 1e-3) for c in made.channels]
    )
    means, *_ = made.scan(made.initial(0.0, samples[0]), 0.01 * np.arange(5), samples)
    assert np.all(np.isfinite(means))


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


def test_the_sigma_points_have_the_moments_they_stand_for(rig: Rig) -> None:
    made = UnscentedFilter(rig)
    n, rng = len(made.state_names), np.random.default_rng(0)
    stds = make_estimator("adaptive", rig).initial(0.0, np.zeros(4)).covariance.diagonal() ** 0.5
    root, mean = rng.normal(size=(n, n)), rng.normal(size=n)
    points = made._points(stds * mean, np.outer(stds, stds) * (root @ root.T)) / stds[:, None]
    np.testing.assert_allclose(points.mean(axis=1), mean, atol=1e-12)
    np.testing.assert_allclose(np.cov(points, bias=True), root @ root.T, atol=1e-11)


def test_the_seed_is_all_that_a_particle_filter_draws_from(rig: Rig, log: Log) -> None:
    short = log.select(slice(0, 20))
    one, same, other = (estimate(short, rig, ParticleFilter(rig, 60, seed)) for seed in (3, 3, 4))
    np.testing.assert_array_equal(one.theta, same.theta)
    assert np.all(one.theta != other.theta)


def test_an_ensemble_is_for_logs(rig: Rig) -> None:
    with pytest.raises(EstimationError, match="unscented is for logs; live, use adaptive"):
        LiveEstimator(rig, UnscentedFilter(rig))
    with pytest.raises(EstimationError, match="particle cannot be exported"):
        ParticleFilter(rig, 10).prior_function()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["unscented", "particle"])
def test_they_see_what_adaptive_sees(name: str, rig: Rig, log: Log) -> None:
    """With the model right, other treatments of one model differ by less than it is sure of: 2 of 3
    of its stds.
    """
    known, rival = estimate(log, rig), estimate(log, rig, RIVALS[name](rig))
    assert rms_degrees(known.theta - rival.theta) < 0.67 * np.rad2deg(
        np.sqrt(np.mean(known.theta_std**2))
    )


@pytest.mark.slow
def test_a_missing_sample_is_prediction_only_for_particles(rig: Rig, log: Log) -> None:
    """A covariance of N particles is known to √(2/N) of itself; 4 of these."""
    made = RIVALS["particle"](rig)
    samples = samples_of(log, made.channels)
    belief = made.initial(log.time[0], samples[0])
    _, informed, *_ = made.scan(belief, log.time[:11], samples[:11])
    samples[10] = np.nan
    _, after, innovations, _ = made.scan(belief, log.time[:11], samples[:11])
    assert np.isnan(innovations[10]).all()
    assert after[10, 0, 0] >= informed[10, 0, 0] * (1 - 4 * np.sqrt(2 / PARTICLES))


@pytest.mark.skipif(isinstance(find_compiler(), str), reason="no C compiler")
def test_rivals_in_c_are_optimised(rig: Rig, log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without an optimisation a compiler's code is ten times as slow as what a person would run."""
    commands: list[list[str]] = []
    run = subprocess.run

    def recorded(command: list[str], **options: bool) -> None:
        commands.append(command)
        run(command, **options)  # type: ignore[call-overload]

    make_estimator("ekf", rig)  # its own kernel is not one of the rivals'
    monkeypatch.setattr(limits, "REPEATS", 1)
    monkeypatch.setattr(subprocess, "run", recorded)
    limits.handwritten_time(rig, log)
    limits.casadi_time(make_estimator("ekf", rig, compiled=False), log)
    assert len(commands) == 2
    assert all("-O3" in command and "-march=native" in command for command in commands)
