"""Numbers of a rig at their maximum a posteriori over a homing move."""

from __future__ import annotations

import sys

import numpy as np
import pytest
from numpy.typing import NDArray

from distal import Log, Rig, estimate, load_rig, simulate
from distal.estimators import AdaptiveFilter, Belief, first_values
from distal.homing import with_references
from distal.homing.apply import homing_prior, is_followed
from distal.homing.most_likely import EVALUATIONS, INDEPENDENT, KEPT, most_likely_start
from distal.homing.window import Window
from distal.logs import frozen
from distal.regression import correlated_samples
from distal.run import samples_of
from distal.simulation import build_scenario
from tests.estimators.adaptive.rigs import CERTAIN

Floats = NDArray[np.float64]
HOMING = 2.0


def wide(rig: Rig) -> Rig:
    """A stranger's rig: radius known to 40 %, each stiffness to 60 %, each place to 3 mm, and no
    force sensors.
    """
    radius = {
        "value": rig.tendons[0].insertion.radius.value,
        "shared": {"name": "disk", "std": "40 %"},
    }
    described = rig.with_values(
        {
            **{f"tendons.{i}.insertion.radius": radius for i in (0, 1)},
            **{f"tendons.{i}.stiffness": {"value": 806.0, "std": "60 %"} for i in (0, 1)},
            **{f"sensors.{name}.bias.std": "3 mm" for name in ("x1", "x2")},
        }
    )
    raw = described.model_dump()["sensors"]
    return described.with_values(
        {"sensors": [sensor for sensor in raw if sensor["measures"] != "force"]}
    )


@pytest.fixture(scope="module")
def log() -> Log:
    """A plant whose radius is half as much again, one tendon twice as stiff, the other twice as
    soft.
    """
    rig = load_rig("pulley-antagonist")
    radius = 1.5 * rig.tendons[0].insertion.radius.value
    plant = {f"tendons.{i}.insertion.radius": radius for i in (0, 1)}
    plant |= {"tendons.0.stiffness": 1450.0, "tendons.1.stiffness": 320.0}
    left = {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "0.5 Hz"}}
    drives = {"left": left, "right": {"weight": "3 N"}}
    raw = {"rig": "pulley-antagonist", "duration": 4.0, "drives": drives, "plant": plant}
    return simulate(rig, build_scenario(raw, "stranger"), 1)


def window_of(log: Log, rig: Rig, homing: float = HOMING) -> Window:
    described, references = with_references(rig, log)
    estimator = AdaptiveFilter(described, compiled=False, references=references)
    proximal = samples_of(log, estimator.channels[:-1])
    samples = np.column_stack([proximal, np.where(log.time < homing, log.truth["theta"], np.nan)])
    start = estimator.initial(log.time[0], first_values(samples))
    return Window.of(estimator, start, log, samples, log.truth["theta"][:, None], homing)


@pytest.fixture(scope="module")
def found(log: Log) -> tuple[Window, Belief]:
    window = window_of(log, wide(load_rig("pulley-antagonist")))
    return window, most_likely_start(window)


def errors_after(log: Log, rig: Rig) -> tuple[float, float]:
    result = estimate(log, rig, homing=HOMING, compiled=False)
    late = log.time >= HOMING
    errors = (result.theta - log.truth["theta"])[late]
    return float(np.rad2deg(np.sqrt(np.mean(errors**2)))), float(
        np.mean(np.abs(errors) < 1.96 * result.theta_std[late])
    )


@pytest.mark.slow  # many runs of the filter
def test_wide_priors_do_not_lead_it_astray(log: Log, monkeypatch: pytest.MonkeyPatch) -> None:
    rig, home = wide(load_rig("pulley-antagonist")), sys.modules["distal.homing.home"]
    rms, inside = errors_after(log, rig)
    assert rms < 0.5
    assert inside > 0.9
    monkeypatch.setattr(home, "homing_prior", lambda window: window.start)
    # the filter alone, with the same stds: what it learns from the reference on the way is less
    assert errors_after(log, rig)[0] > 2.0 * rms


def test_the_numbers_are_those_of_the_plant(found: tuple[Window, Belief]) -> None:
    """What only products show stays uncertain: each number within three stds of the whole
    posterior.
    """
    window, belief = found
    names = list(window.estimator.state_parts)
    radius, first, second = (
        names.index(name)
        for name in (
            "disk.factor",
            "tendons.left.stiffness.factor",
            "tendons.right.stiffness.factor",
        )
    )
    for at, true in ((radius, 1.5), (first, 1450 / 806), (second, 320 / 806)):
        std = np.sqrt(belief.covariance[at, at] / KEPT)
        assert abs(belief.mean[at] - true) < 3 * std
    assert np.sqrt(belief.covariance[radius, radius] / KEPT) < 0.05  # against 0.4 before


def test_it_is_a_minimum_of_its_criterion(log: Log, found: tuple[Window, Belief]) -> None:
    """The naive twin: the criterion written as a loop over samples; no step along a number makes it
    smaller.
    """
    window, belief = found
    estimator, n = window.estimator, window.start.size
    lasting = [i for i in np.flatnonzero(estimator.states.lasting) if estimator.states.stds[i] > 0]
    means, stds = estimator.states.means[lasting], estimator.states.stds[lasting]
    unaided = window.samples.copy()
    unaided[:, -1] = np.nan

    def run(parameters: Floats) -> tuple[Floats, Floats]:
        kernel_state = window.start.kernel_state.copy()
        kernel_state[lasting], kernel_state[0] = parameters, log.truth["theta"][0]
        covariance = kernel_state[n : n + n * n].reshape(n, n)
        for i in (*lasting, 0):
            covariance[i, :] = covariance[:, i] = 0.0
        covariance[0, 0] = np.deg2rad(0.2) ** 2
        belief = Belief(window.start.time, frozen(kernel_state), n)
        angles, variances = [], []
        for time, sample in zip(window.time, unaided):
            belief, _ = estimator.step(belief, time, sample)
            angles.append(belief.mean[0])
            variances.append(belief.covariance[0, 0])
        return np.array(angles), np.array(variances)

    base = np.mean(run(means)[1]) + np.deg2rad(0.1) ** 2
    true = window.truths[:, 0]
    ratios = (true - run(belief.mean[lasting])[0]) / np.sqrt(base)
    # one sample in `INDEPENDENT` s is independent, or fewer where the errors are correlated for
    # longer
    weight = max(1.0, float(np.mean(ratios**2))) * max(
        INDEPENDENT * log.rate, correlated_samples(ratios)
    )

    def criterion(parameters: Floats) -> float:
        angles, _ = run(parameters)
        return (
            float(
                np.sum((true - angles) ** 2) / base / weight
                + np.sum(((parameters - means) / stds) ** 2)
            )
            / 2
        )

    least = criterion(belief.mean[lasting])
    assert least < 0.01 * criterion(means)
    for k in range(len(lasting)):
        for step in (-0.3, 0.3):
            other = belief.mean[lasting].copy()
            other[k] += step * stds[k]
            if other[k] > estimator.states.lowest[lasting[k]]:
                assert criterion(other) > least - 1e-3
    # three tenths of the covariance are the inverse of its curvature, here along each number that
    # the move tells most of
    precision = np.linalg.inv(belief.covariance[np.ix_(lasting, lasting)])
    scaled = np.diagonal(precision) * stds**2
    identified = [k for k in range(len(lasting)) if scaled[k] > 30.0]
    assert identified
    for k in identified:
        step = 0.3 / np.sqrt(scaled[k])
        around = []
        for sign in (1.0, -1.0):
            other = belief.mean[lasting].copy()
            other[k] += sign * step * stds[k]
            around.append(criterion(other))
        curvature = (sum(around) - 2 * least) / step**2
        assert 0.3 * scaled[k] == pytest.approx(curvature, rel=0.2)


def test_where_the_filter_keeps_to_its_band_it_goes_on_from_its_prior(log: Log) -> None:
    rig = load_rig("pulley-antagonist")
    servo = simulate(
        rig,
        build_scenario(
            {
                "rig": "pulley-antagonist",
                "duration": 1.0,
                "drives": {
                    "left": {"weight": {"mean": "3 N", "amplitude": "1 N", "frequency": "1 Hz"}},
                    "right": {"weight": "3 N"},
                },
            },
            "right",
        ),
        3,
    )
    window = window_of(servo, rig, 0.6)
    assert is_followed(window)
    assert homing_prior(window) is window.start


def test_the_covariance_goes_on_with_the_run(found: tuple[Window, Belief]) -> None:
    window, belief = found
    lasting = np.flatnonzero(window.estimator.states.lasting)
    others = np.setdiff1d(np.arange(window.start.size), [0, *lasting])
    np.testing.assert_array_equal(
        belief.covariance[np.ix_(others, others)], window.start.covariance[np.ix_(others, others)]
    )
    assert np.linalg.eigvalsh(belief.covariance).min() >= 0.0
    priors = window.estimator.states.stds[lasting]
    assert np.all(
        np.sqrt(np.diagonal(belief.covariance)[lasting]) <= np.sqrt(KEPT) * priors * (1 + 1e-6)
    )
    assert belief.mean[0] == pytest.approx(window.truths[0, 0])


def test_a_window_in_which_the_filter_leaves_all_bounds(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Numbers for which the filter has no answer are as bad as can be, and no reason to stop."""
    window = window_of(log, wide(load_rig("pulley-antagonist")), 0.3)
    scan, calls = Window.scan, [0]

    def sometimes(
        self: Window, kernel_state: Floats, samples: Floats
    ) -> tuple[Floats, Floats] | None:
        calls[0] += 1
        return None if calls[0] % 7 == 0 else scan(self, kernel_state, samples)

    monkeypatch.setattr(Window, "scan", sometimes)
    assert np.isfinite(most_likely_start(window).kernel_state).all()
    assert calls[0] < 3 * EVALUATIONS * 20


def test_a_prior_with_which_the_filter_leaves_all_bounds_is_left_as_it_was(
    log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    window = window_of(log, wide(load_rig("pulley-antagonist")), 0.3)
    monkeypatch.setattr(Window, "scan", lambda *arguments: None)
    assert most_likely_start(window) is window.start


def test_a_rig_in_which_nothing_is_uncertain() -> None:
    """There is nothing to find, and the run goes on: a frictionless joint whose every number is
    known.
    """
    rig = load_rig("pulley-antagonist").with_values(CERTAIN)
    drives = {"left": {"weight": "4 N"}, "right": {"weight": "2 N"}}
    certain = simulate(
        rig,
        build_scenario({"rig": "pulley-antagonist", "duration": 1.0, "drives": drives}, "certain"),
        0,
    )
    window = window_of(certain, rig, 0.3)
    assert not window.estimator.states.lasting.any()
    assert most_likely_start(window) is window.start
    assert np.isfinite(estimate(certain, rig, homing=0.3, compiled=False).theta).all()
