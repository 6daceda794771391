"""What logs tell of a map's weights, against a normal distribution that is written out."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.stats import norm

from distal.confidence import BAND
from distal.fitting.learned_maps import (
    HeldOut,
    Task,
    _correlation,
    _share,
    density,
    learned_map,
)
from distal.regression import Prior, Samples, Shape, given, rates_of, yardstick_error
from distal.regression.posterior import Evidence, Weights, _noise, _variances
from distal.rig import LearnedMap
from tests.learned_maps import along, predict

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


def with_zero(weights: Weights, variance: float) -> Weights:
    """Return weights whose constant has a variance more."""
    covariance = weights.covariance.copy()
    covariance[0, 0] += variance
    return replace(weights, covariance=covariance)


def cost(spread: Floats, residual: Floats) -> float:
    """Return −2 log of a normal density, but for a constant."""
    return float(np.linalg.slogdet(spread)[1] + residual @ np.linalg.solve(spread, residual))


@pytest.mark.parametrize(
    ("zero", "offset", "known_to"), [(0.0, 0.0, 100.0), (5.0, 0.0, 0.0), (-5.0, 1.0, 0.0)]
)
def test_a_log_is_conditioned_and_a_zero_as_never_before_has_the_likeliest_variance(
    zero: float, offset: float, known_to: float
) -> None:
    """Where none was known before, none is a surprise."""
    before = Weights.of(SHAPE, PRIOR, [evidence(1), evidence(2), evidence(3)])
    before = with_zero(before, known_to)
    log = evidence(6)
    spread = log.phi @ before.covariance @ log.phi.T + _noise(PRIOR, 0.5) * np.eye(25) + offset
    drawn = log.target if known_to else np.linalg.cholesky(spread) @ log.target
    residual = drawn + zero
    likeliest = 0.0
    if zero:
        variances = np.geomspace(1e-3, 1e3, 4001)
        likeliest = variances[int(np.argmin([cost(spread + v, residual) for v in variances]))]
        assert likeliest > 4.0
    after = before.given(replace(log, target=log.phi @ before.mean + residual), offset)
    wider = with_zero(before, likeliest).covariance
    expected = before.mean + wider @ log.phi.T @ np.linalg.solve(spread + likeliest, residual)
    near = 0.01 if zero else 1e-9  # the likeliest one is looked for on a grid
    np.testing.assert_allclose(after.mean, expected, rtol=near, atol=near)
    if zero:
        assert after.mean[0] - before.mean[0] == pytest.approx(zero, abs=1.5)


def test_a_log_is_held_out_with_its_group() -> None:
    logs = tuple(evidence(seed) for seed in range(4))
    together = Task(SHAPE, logs, (0, 0, 1, 2)).held_out(PRIOR)
    apart = Weights.of(SHAPE, PRIOR, [logs[2], logs[3]]).errors(logs[0])
    np.testing.assert_allclose(together[0], apart, atol=1e-12)


def test_density_is_that_of_the_normal_distribution() -> None:
    assert density(np.array([0.0, 2.0]), np.array([1.0, 4.0])) == pytest.approx(
        np.mean(norm.logpdf([0.0, 2.0], scale=[1.0, 2.0]))
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
    return Samples(time, readings, nothing, targets, np.zeros((samples, 1)))


DESCRIBED = {"joints": ("a",), "channels": ("x", "f"), "positions": ("x",)}


def taught(logs: list[Samples], homing: float | None = None, **fields: object) -> LearnedMap:
    return learned_map(logs, {**DESCRIBED, **fields}, range(len(logs)), homing)[0]


def judged(learned: LearnedMap, log: Samples) -> tuple[float, float]:
    """Return RMS error and share inside the band on a log."""
    seen = along(learned, log.time, log.every)
    values, variances = predict(learned, seen, 0)
    slips = np.abs(learned.arrays["mean"][0][Shape.of(learned).features["slips"]])
    variances = variances + (seen["doubt"] @ slips) ** 2 / 3
    error = values - log.targets[:, 0]
    known = np.isfinite(error)
    rms = float(np.sqrt(np.mean(error[known] ** 2)))
    return rms, float(np.mean(np.abs(error) <= BAND * np.sqrt(variances)))


def scores(learned: LearnedMap, seeds: range = range(10, 16), **how: float) -> Floats:
    """Return RMS error and share inside the band on logs that nothing has seen."""
    return np.array([judged(learned, moved(seed, **how)) for seed in seeds]).T


@pytest.fixture(scope="module")
def logs() -> list[Samples]:
    return [moved(seed) for seed in range(4)]


@pytest.fixture(scope="module")
def learned(logs: list[Samples]) -> LearnedMap:
    return taught(logs)


def test_it_errs_far_less_than_a_line_and_its_band_holds(
    logs: list[Samples], learned: LearnedMap
) -> None:
    rms, inside = scores(learned)
    line = [yardstick_error("least squares", logs, moved(seed)) for seed in range(10, 16)]
    assert rms.mean() < 0.25 * np.mean(line)
    assert inside.mean() > 0.93
    assert inside.min() > 0.85
    assert learned.logs == 4
    assert learned.rms[0] == pytest.approx(rms.mean(), rel=0.2)
    assert 0.9 < learned.inside[0] <= 1.0
    assert learned.arrays["play"] == 1.0  # the plants' plays are among the widest
    for spread in (1.3, 2.0):  # beyond the logs
        assert scores(learned, range(20, 21), spread=spread)[1] > 0.8


def test_one_log_gives_a_band_that_holds_on_the_next(logs: list[Samples]) -> None:
    assert np.mean(scores(taught(logs[:1]))[1]) > 0.85


def test_a_zero_that_moved_is_told_by_one_pose() -> None:
    found = taught([moved(seed, zero=0.02 * seed - 0.03) for seed in range(4)], homing=2.0)
    log, usual = moved(30, zero=0.09), moved(30)
    after = given(found, log, log.time < 2.0, {})
    assert judged(found, log)[0] > 0.05
    rms, inside = judged(after, log)
    assert rms < 1.5 * judged(found, usual)[0]
    assert inside > 0.88


def test_readings_that_are_missing_or_never_moved_are_no_trouble(logs: list[Samples]) -> None:
    def with_still(log: Samples) -> Samples:
        still = np.full(len(log.time), 7.0)
        return replace(log, readings=np.column_stack([log.readings, still]))

    holed = [with_still(log) for log in logs[:2]]
    for log in holed:
        log.readings[::3, 1] = np.nan
    found = taught(holed, channels=("x", "f", "still"))
    assert judged(found, with_still(moved(12)))[0] < 0.01


def test_joints_that_err_together_are_said_to() -> None:
    """The cosine of their errors in stds on all logs; those known at other samples are alone."""
    time, errors = np.arange(30.0), np.random.default_rng(6).normal(size=(2, 3, 30))
    variances = np.array([1.0, 4.0, 9.0])[:, None] * np.ones(30)
    errors[1] -= 0.8 * errors[0]
    joints = [[HeldOut(time, *pair) for pair in zip(joint, variances)] for joint in errors]
    a, b = (errors / np.sqrt(variances)).reshape(2, -1)
    cosine = a @ b / np.sqrt(a @ a * (b @ b))
    assert cosine < -0.4
    np.testing.assert_allclose(_correlation(joints), [[1.0, cosine], [cosine, 1.0]])
    np.testing.assert_array_equal(_correlation([joints[0], joints[1][:2]]), np.eye(2))


def test_beside_a_filter_that_lacks_something_the_error_left_out_is_what_the_map_leaves(
    logs: list[Samples],
) -> None:
    variances = np.full((len(logs[0].time), 1), 1e-4)
    lacking = [
        replace(log, angles=0.9 * log.targets, targets=0.1 * log.targets, variances=variances)
        for log in logs
    ]
    found = taught(lacking)
    assert found.rms[0] < 0.2 * 0.1 * np.std(np.vstack([log.targets for log in logs]))


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_share_is_that_of_least_squares_on_held_out_logs(way: float) -> None:
    """And never less than none."""
    logs = (evidence(1), evidence(2))
    values = [way * np.sin(log.target) for log in logs]
    pairs = [(log.target, log.target - value) for log, value in zip(logs, values)]
    target, mapped = np.concatenate([log.target for log in logs]), np.concatenate(values)
    expected = np.clip(target @ mapped / (mapped @ mapped), 0.0, 1.0)
    assert _share(pairs) == pytest.approx(expected)


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
        log, slow = (
            SimpleNamespace(time=time, every=np.outer(values, (share, -share)))
            for share in (1.0, 0.1)
        )
        rates = rates_of([log, slow], np.array([0.5, 0.25]))  # of all logs
        assert rates == pytest.approx([expected, 2 * expected])
