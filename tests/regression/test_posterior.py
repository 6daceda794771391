"""What logs tell of a map's weights, against a normal distribution that is written out."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from distal.confidence import BAND
from distal.fitting.learned_maps import Task, _share, density, learned_map
from distal.regression import Prior, Samples, Shape, features_along, given, rates_of
from distal.regression.posterior import Evidence, Weights, _noise, _variances
from distal.rig import LearnedMap
from tests.learned_maps import predict

Floats = NDArray[np.float64]

SHAPE = Shape(2, 0, (0,), 3)
PRIOR = Prior(log=-2.0, log_readings=-2.5, log_slips=-3.0, slips=-1.0, radial=-1.0, noise=-2.0)


def evidence(seed: int, samples: int = 25) -> Evidence:
    rng = np.random.default_rng(seed)
    phi = rng.normal(size=(samples, SHAPE.features.size))
    phi[:, 0] = 1.0
    return Evidence(
        phi,
        np.zeros((samples, SHAPE.count * 4)),
        np.zeros(samples),
        rng.normal(size=samples),
        np.zeros(samples),
        0.5 * np.arange(samples),
        np.zeros(samples, dtype=bool),
    )


def written_out(logs: list[Evidence], at: Evidence) -> tuple[Floats, Floats]:
    """Return mean and covariance of φᵀ(b + b_l) in a new log, by the joint distribution of all
    targets.
    """
    shared, own = _variances(SHAPE, PRIOR)
    n = len(own)
    phi = np.vstack([log.phi for log in logs])
    of = np.repeat(np.arange(len(logs)), [len(log.target) for log in logs])
    known = phi @ np.diag(shared) @ phi.T
    known += (of[:, None] == of[None]) * (phi[:, :n] @ np.diag(own) @ phi[:, :n].T)
    known += _noise(PRIOR, 0.5) * np.eye(len(phi))
    cross = at.phi @ np.diag(shared) @ phi.T
    prior = at.phi @ np.diag(shared) @ at.phi.T + at.phi[:, :n] @ np.diag(own) @ at.phi[:, :n].T
    gain = np.linalg.solve(known, cross.T).T
    return gain @ np.concatenate([log.target for log in logs]), prior - gain @ cross.T


def test_weights_are_those_of_the_joint_distribution() -> None:
    logs = [evidence(1), evidence(2), evidence(3, 10)]
    at = evidence(4)
    weights = Weights.of(SHAPE, PRIOR, logs)
    mean, covariance = written_out(logs, at)
    np.testing.assert_allclose(at.phi @ weights.mean, mean, atol=1e-9)
    np.testing.assert_allclose(at.phi @ weights.covariance @ at.phi.T, covariance, atol=1e-9)


def test_a_log_of_which_something_is_known_is_conditioned_with_its_own_part() -> None:
    """What is known in a log tells its own part too: as one more log, of which all is asked."""
    logs, at = [evidence(1), evidence(2)], evidence(5, 40)
    known = at.rows(np.arange(40) < 15)
    shared, own = _variances(SHAPE, PRIOR)
    before = with_zero(Weights.of(SHAPE, PRIOR, logs), 100.0)  # so that none is a surprise
    after = before.given(known)
    inner = known.phi @ before.covariance @ known.phi.T + _noise(PRIOR, 0.5) * np.eye(15)
    gain = before.covariance @ known.phi.T @ np.linalg.inv(inner)
    expected = before.mean + gain @ (known.target - known.phi @ before.mean)
    np.testing.assert_allclose(after.mean, expected, atol=1e-9)
    spread = np.einsum("ij,jk,ik->i", at.phi, after.covariance, at.phi)
    assert np.all(spread <= np.einsum("ij,jk,ik->i", at.phi, before.covariance, at.phi) + 1e-12)
    assert len(own) < len(shared)


def with_zero(weights: Weights, variance: float) -> Weights:
    """Return weights whose constant has a variance more."""
    covariance = weights.covariance.copy()
    covariance[0, 0] += variance
    return replace(weights, covariance=covariance)


@pytest.mark.parametrize(("zero", "offset"), [(0.0, 0.0), (5.0, 0.0), (-5.0, 1.0)])
def test_a_zero_that_moved_as_never_before_has_the_likeliest_variance(
    zero: float, offset: float
) -> None:
    before = Weights.of(SHAPE, PRIOR, [evidence(1), evidence(2), evidence(3)])
    log = evidence(6)
    spread = log.phi @ before.covariance @ log.phi.T + _noise(PRIOR, 0.5) * np.eye(25) + offset
    told = log.phi @ before.mean + np.linalg.cholesky(spread) @ log.target + zero
    known = replace(log, target=told)
    residual = told - log.phi @ before.mean
    variances = np.r_[0.0, np.geomspace(1e-3, 1e3, 4001)]
    costs = [
        np.linalg.slogdet(spread + v)[1] + residual @ np.linalg.solve(spread + v, residual)
        for v in variances
    ]
    likeliest = variances[int(np.argmin(costs))]
    after = before.given(known, offset)
    inner = spread + likeliest
    wider = with_zero(before, likeliest).covariance
    gain = np.linalg.solve(inner, log.phi @ wider).T
    np.testing.assert_allclose(after.mean, before.mean + gain @ residual, rtol=0.01, atol=0.01)
    if zero:
        assert likeliest > 4.0
        assert after.mean[0] - before.mean[0] == pytest.approx(zero, abs=1.5)


def test_a_log_is_held_out_with_its_group() -> None:
    logs = tuple(evidence(seed) for seed in range(4))
    together = Task(SHAPE, logs, (0, 0, 1, 2)).held_out(PRIOR)
    apart = Weights.of(SHAPE, PRIOR, [logs[2], logs[3]]).errors(logs[0])
    np.testing.assert_allclose(together[0][0], apart[0], atol=1e-12)
    np.testing.assert_allclose(together[0][1], apart[1], atol=1e-12)


def test_density_is_that_of_the_normal_distribution() -> None:
    assert density(np.zeros(3), np.ones(3)) == pytest.approx(-0.5 * np.log(2 * np.pi))
    assert density(np.array([2.0]), np.array([4.0])) == pytest.approx(
        -0.5 * np.log(2 * np.pi * 4.0) - 0.5
    )


def moved(seed: int, samples: int = 1500, spread: float = 1.0, zero: float = 0.0) -> Samples:
    """Return a log of a joint with a play of 0.1, a curve, and a zero that each log draws."""
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(samples)
    place = np.zeros(samples)
    for _ in range(4):
        place += rng.normal() * np.sin(2 * np.pi * rng.uniform(0.1, 0.6) * time + 6 * rng.uniform())
    place *= spread / np.std(place)
    held, angle = place[0], np.empty(samples)
    for k, now in enumerate(place):
        held = min(max(held, now - 0.1), now + 0.1)
        angle[k] = 0.5 * held + 0.03 * held**2 + zero
    force = 0.2 * np.gradient(place, time) + 0.01 * rng.normal(size=samples)
    readings = np.column_stack([place + 1e-4 * rng.normal(size=samples), force])
    nothing = np.zeros((samples, 0))
    targets = (angle + 1e-3 * rng.normal(size=samples))[:, None]
    return Samples(f"log {seed}", time, readings, nothing, targets, np.zeros((samples, 1)))


DESCRIBED = {"joints": ("a",), "channels": ("x", "f"), "positions": ("x",)}


def taught(logs: list[Samples], homing: float | None = None) -> LearnedMap:
    return learned_map(logs, DESCRIBED, range(len(logs)), homing)[0]


def judged(learned: LearnedMap, log: Samples) -> tuple[float, float]:
    """Return RMS error and share inside the band on a log."""
    shape = Shape.of(learned)
    arrays = learned.arrays
    frame = np.concatenate([arrays[name].ravel(order="F") for name in shape.frame.names])
    along = features_along(shape, frame, log.time, log.every)
    values, variances = predict(learned, along, 0)
    slips = np.abs(arrays["mean"][0][shape.features["slips"]])
    variances = variances + (along["doubt"] @ slips) ** 2 / 3
    error = values - log.targets[:, 0]
    known = np.isfinite(error)
    rms = float(np.sqrt(np.mean(error[known] ** 2)))
    return rms, float(np.mean(np.abs(error) <= BAND * np.sqrt(variances)))


@pytest.fixture(scope="module")
def learned() -> LearnedMap:
    return taught([moved(seed) for seed in range(4)])


def test_it_errs_far_less_than_a_line_and_its_band_holds(learned: LearnedMap) -> None:
    scores = np.array([judged(learned, moved(seed)) for seed in range(10, 16)])
    lines = []
    training = [moved(seed) for seed in range(4)]
    phi = np.vstack([np.column_stack([np.ones(len(s.time)), s.readings]) for s in training])
    line = np.linalg.lstsq(phi, np.concatenate([s.targets[:, 0] for s in training]))[0]
    for seed in range(10, 16):
        log = moved(seed)
        phi = np.column_stack([np.ones(len(log.time)), log.readings])
        lines.append(np.sqrt(np.mean((phi @ line - log.targets[:, 0]) ** 2)))
    assert scores[:, 0].mean() < 0.25 * np.mean(lines)
    assert scores[:, 1].mean() > 0.93
    assert scores[:, 1].min() > 0.85


def test_beyond_the_logs_the_band_still_holds(learned: LearnedMap) -> None:
    for spread in (1.3, 2.0):
        assert judged(learned, moved(20, spread=spread))[1] > 0.8


@pytest.mark.parametrize("count", [1, 2])
def test_few_logs_give_a_band_that_holds_on_the_next(count: int) -> None:
    found = taught([moved(seed) for seed in range(count)])
    assert np.mean([judged(found, moved(seed))[1] for seed in range(10, 16)]) > 0.85


def test_the_rate_of_the_logs_hardly_matters(learned: LearnedMap) -> None:
    every = np.arange(1500) % 2 == 0
    half = taught([moved(seed).part(every) for seed in range(4)])
    ratios = [judged(half, moved(s))[0] / judged(learned, moved(s))[0] for s in range(10, 16)]
    assert np.mean(ratios) < 1.1


def test_a_zero_that_moved_is_told_by_one_pose() -> None:
    logs = [moved(seed, zero=0.02 * seed - 0.03) for seed in range(4)]
    found = taught(logs, homing=2.0)
    log, usual = moved(30, zero=0.09), moved(30)
    after = given(found, log, log.time < 2.0, {})
    assert judged(found, log)[0] > 0.05
    assert judged(after, log)[0] < 1.5 * judged(found, usual)[0]
    assert judged(after, log)[1] > 0.88


def test_it_is_the_same_each_time_and_holds_its_scores(learned: LearnedMap) -> None:
    again = taught([moved(seed) for seed in range(4)])
    assert again == learned
    assert learned.logs == 4
    assert learned.arrays["play"] == 1.0  # the plants' plays are among the widest
    assert 0.0 < learned.rms[0] < 0.01
    assert 0.9 < learned.inside[0] <= 1.0


@pytest.mark.slow
def test_scores_of_logs_left_out_are_those_of_maps_that_never_saw_them() -> None:
    """Scaling, points and hyperparameters of the scores come from all logs: learned without the
    log that is scored, they give the same error to a tenth.
    """
    logs = [moved(seed) for seed in range(5)]
    unseen = [judged(taught(logs[:i] + logs[i + 1 :]), log)[0] for i, log in enumerate(logs)]
    assert taught(logs).rms[0] == pytest.approx(np.sqrt(np.mean(np.square(unseen))), rel=0.1)


def test_readings_that_are_missing_or_never_moved_are_no_trouble() -> None:
    logs = []
    for seed in range(3):
        log = moved(seed)
        readings = np.column_stack([log.readings, np.full(len(log.time), 7.0)])
        readings[::3, 1] = np.nan
        logs.append(replace(log, readings=readings))
    described = {**DESCRIBED, "channels": ("x", "f", "still")}
    found = learned_map(logs, described, range(3))[0]
    log = moved(12)
    with_still = np.column_stack([log.readings, np.full(len(log.time), 7.0)])
    assert judged(found, replace(log, readings=with_still))[0] < 0.01


def test_joints_that_err_together_are_said_to() -> None:
    """Two references share an error that no reading shows, with opposite signs, and each has one
    of its own, half as large: the correlation is −1/(1 + 1/4).
    """
    logs = []
    for seed in range(4):
        log = moved(seed, 3000)
        rng = np.random.default_rng(60 + seed)
        shared, first, second = rng.normal(size=(3, len(log.time))) * ((0.05,), (0.025,), (0.025,))
        targets = log.targets + np.column_stack([shared + first, second - shared])
        logs.append(replace(log, targets=targets, variances=np.zeros_like(targets)))
    both = learned_map(logs, {**DESCRIBED, "joints": ("a", "b")}, range(4))[0]
    correlation = both.arrays["correlation"]
    # of n samples it has the standard error (1 − ρ²)/√n
    count = sum(len(log.targets[:: len(log.time) // 300]) for log in logs)
    assert correlation[0, 1] == pytest.approx(-0.8, abs=4 * 0.36 / count**0.5)
    np.testing.assert_array_equal(np.diag(correlation), 1.0)


def test_beside_a_filter_that_is_right_a_map_adds_nothing() -> None:
    """Errors that have nothing to do with the readings: the map's values count with a share of
    almost none, and what is said of logs left out is the error with that share.
    """
    logs = []
    for seed in range(4):
        log = moved(seed)
        rng = np.random.default_rng(40 + seed)
        wander = np.interp(log.time, log.time[::100], rng.normal(size=len(log.time[::100])))
        beside = {"angles": log.targets, "targets": 0.01 * wander[:, None]}
        logs.append(replace(log, **beside, variances=np.full((len(log.time), 1), 1e-4)))
    found = learned_map(logs, DESCRIBED, range(4))[0]
    shown = [row for log in logs for row in log.targets[:: len(log.time) // 300, 0]]
    assert found.rms[0] == pytest.approx(np.sqrt(np.mean(np.square(shown))), rel=0.02)
    assert np.abs(found.arrays["mean"]).max() < 0.003


def test_a_share_is_that_of_least_squares_on_held_out_logs() -> None:
    logs = (evidence(1), evidence(2))
    values = [np.sin(log.target) for log in logs]
    pairs = [(log.target - value, np.ones(len(value))) for log, value in zip(logs, values)]
    target, mapped = np.concatenate([log.target for log in logs]), np.concatenate(values)
    expected = min(float(target @ mapped / (mapped @ mapped)), 1.0)
    assert _share(list(zip(logs, pairs))) == pytest.approx(expected)
    against = [(log.target + value, v) for log, value, (_, v) in zip(logs, values, pairs)]
    assert _share(list(zip(logs, against))) == 0.0


def test_beside_a_filter_that_lacks_something_the_error_left_out_is_what_the_map_leaves() -> None:
    logs = []
    for seed in range(4):
        log = moved(seed)
        beside = {"angles": 0.9 * log.targets, "targets": 0.1 * log.targets}
        logs.append(replace(log, **beside, variances=np.full((len(log.time), 1), 1e-4)))
    found = learned_map(logs, DESCRIBED, range(4))[0]
    assert found.rms[0] < 0.2 * np.std(np.vstack([log.targets for log in logs]))


def test_a_slip_that_lies_anywhere_in_an_interval_has_a_third_of_its_square() -> None:
    """A uniform distribution over ± d has the variance d²/3; those of several plays stand at one
    end together.
    """
    log = evidence(5)
    weights = Weights.of(SHAPE, PRIOR, [log])
    slips = weights.mean[SHAPE.features["slips"]]
    doubt = np.random.default_rng(0).uniform(0.0, 2.0, (len(log.target), len(slips)))
    beside = weights._variance_beside(replace(log, doubt=doubt)) - weights._variance_beside(log)
    np.testing.assert_allclose(beside, (doubt @ np.abs(slips)) ** 2 / 3)


def test_the_fastest_motion_lasts_for_two_samples() -> None:
    """A wild reading goes there and back in one; a step within one sample is none either."""
    time = 0.01 * np.arange(50)
    ramp = np.where(time < 0.25, 2.0 * time, 0.5)
    wild = ramp.copy()
    wild[10] += 3.0
    expected = 2.0 / 0.5 / BAND
    for values in (ramp, wild):
        log: Any = SimpleNamespace(time=time, every=np.column_stack([values, -values]))
        assert rates_of([log], np.array([0.5, 0.25])) == pytest.approx([expected, 2 * expected])
