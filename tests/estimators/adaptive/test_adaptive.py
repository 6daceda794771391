"""`adaptive` as a whole: near what can be known, honest about how sure it is, and what it does in
the hard places. Its equations are tested against the naive twin, all of its goals in
`make accuracy`.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from distal import Estimate, Log, estimate, load_rig
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter
from tests.helpers import rms_degrees
from tests.support.cases import MID_RANGE, WITHIN, paper_log, paper_rig
from tests.support.lower_bound import lower_bound


@cache
def filter_of(plant: str) -> AdaptiveFilter:
    return AdaptiveFilter(paper_rig(plant))


def result_of(log: Log, plant: str = "as the rig") -> Estimate:
    return estimate(log, paper_rig(plant), filter_of(plant), covariances=False)


def pooled(results: list[Estimate], shrink: float = 1.0) -> tuple[float, float, float]:
    """Return RMS error [°], share inside the 95 % band, and mean NEES of the joint angle, with the
    covariance divided by `shrink`.
    """
    errors = np.concatenate([result.errors() for result in results])
    stds = np.concatenate([result.theta_std for result in results]) / np.sqrt(shrink)
    inside, nees = np.mean(np.abs(errors) <= BAND * stds), np.mean((errors / stds) ** 2)
    return rms_degrees(errors), float(inside), float(nees)


@pytest.mark.slow
def test_the_uncertainty_is_honest_and_a_third_of_it_would_fail() -> None:
    """The band is about plants such as the rig's stds allow, so the plants have to vary.

    NEES of one state is χ² with mean 1; the errors of a log are correlated, so 20 logs of about 5
    independent pieces each give the mean to ±0.14: 1.4 is three of these above 1. Below 0.3 the
    band is far too wide.
    """
    cases = [(plant, seed) for plant in WITHIN for seed in range(4)]
    results = [result_of(paper_log("ramps", plant, seed), plant) for plant, seed in cases]
    for shrink, honest in ((1.0, True), (3.0, False)):
        _, inside, nees = pooled(results, shrink)
        assert (inside >= 0.90 and 0.3 <= nees <= 1.4) == honest


@pytest.mark.slow
def test_near_the_lower_bound_when_the_model_is_right() -> None:
    """The bound holds for the mean over starts and noise, not for each log: 24 logs."""
    plant = "no linearity error"
    logs = [paper_log(kind, plant, seed) for kind in MID_RANGE for seed in range(8)]
    bounds = [np.rad2deg(lower_bound(paper_rig(plant), log)) for log in logs]
    rms, _, _ = pooled([result_of(log, plant) for log in logs])
    assert rms <= 1.2 * np.sqrt(np.mean(np.square(bounds)))


@pytest.mark.parametrize(
    ("place", "force", "count", "least", "most"),
    [
        # (θ + ε, b1 − rε, b2 + rε) changes no tension, so σ_b/(√2 r) of the sensors' linearity
        # remains: the common error of both is never averaged away
        pytest.param(3 / 806, 3.0, 6000, 0.2, 3.0, id="a stuck link"),
        # both sliders pushed in until the tendons hang: the angle keeps its prior uncertainty
        pytest.param(-4e-3, 0.0, 300, 2.5, 3.5, id="slack tendons"),
    ],
)
def test_what_cannot_be_known_stays_uncertain(
    place: float, force: float, count: int, least: float, most: float
) -> None:
    """The same forces at the same places for long: the angle's std stays so many degrees."""
    rng = np.random.default_rng(0)
    noises = {"x1": (place, 5e-6), "x2": (place, 5e-6), "u1": (force, 0.3), "u2": (force, 0.3)}
    channels = {name: rng.normal(*drawn, count) for name, drawn in noises.items()}
    result = result_of(Log(0.01 * np.arange(count), channels))
    assert least < np.rad2deg(result.theta_std[-1]) < most
    assert np.abs(result.theta[-1]) < 2 * result.theta_std[-1]


@pytest.mark.parametrize("size", [1e-4, 3e-4, 1e-3, 2e-3])
def test_a_wild_displacement_moves_nothing_and_a_jump_is_believed_at_its_second_sample(
    size: float,
) -> None:
    """20 to 400 σ, which the tendon's arm would make 0.6 to 12°: in one sample the angle moves by
    less than half its std.
    """
    log = paper_log("ramps", "as the rig", 3)
    usual = result_of(log)

    def change(rows: slice) -> np.ndarray:
        x1 = log.channels["x1"].copy()
        x1[rows] += size
        other = Log(log.time, {**log.channels, "x1": x1}, dict(log.truth), log.source)
        return np.abs(result_of(other).theta - usual.theta)

    for row in (300, 620, 900):
        assert np.all(change(slice(row, row + 1)) < 0.5 * usual.theta_std)
    jumped = change(slice(500, None))
    assert jumped[500] < 0.3 * usual.theta_std[500]
    assert jumped[520:540].max() > size / 57e-3  # rad: a sixth of what the arm makes of it


def test_a_prior_follows_the_numbers_that_are_inputs() -> None:
    """A filter with numbers as inputs begins where the filter of a rig with these numbers does."""
    rig = load_rig("capstan-joint").with_values({"joints.0.external_torque.std": 0.05})
    at = next(i for i, sensor in enumerate(rig.sensors) if sensor.measures == "force")
    changed = {
        "joints.0.initial": 0.3,
        "joints.0.external_torque.std": 0.02,
        f"sensors.{at}.bias": 0.04,
        f"sensors.{at}.gain": 1.1,
        f"sensors.{at}.noise": 0.002,
    }
    fitted = AdaptiveFilter(rig, False, inputs=list(changed))
    other = AdaptiveFilter(rig.with_values(changed), False)
    p = np.array(fitted.parameters)
    p[[fitted.parameter_names.index(name) for name in changed]] = list(changed.values())
    sample = np.linspace(0.1, 0.2, len(fitted.channels))
    mean, spread, memory = fitted.prior(sample, p)
    known, _, known_memory = other.prior(sample, other.parameters)
    found, expected = (dict(zip(f.state_names, m)) for f, m in ((fitted, mean), (other, known)))
    for name in found.keys() & expected:
        assert found[name] == pytest.approx(expected[name], abs=1e-15)
    np.testing.assert_allclose(memory, known_memory)
    torque = fitted.state_names.index("external_torque")
    assert spread[torque, torque] == pytest.approx(0.02**2)
