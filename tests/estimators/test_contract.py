"""What every estimator must do, whatever it is; exceptions are listed with their reasons."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import (
    ESTIMATORS,
    KernelEstimator,
    LiveEstimator,
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
from distal.simulation import build_scenario
from tests.helpers import rms_degrees
from tests.support.maps import with_learned_map

KINEMATIC = {"inextensible", "elastic", "regression"}
"""No innovation and a constant covariance: they have no model of what they do not know."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    described = scenario_rig(load_scenario("series-2"))
    return with_learned_map([moved(described, seed) for seed in (1, 2, 3)], described, "readings")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return moved(rig, 7)


@pytest.fixture(scope="module", params=list(ESTIMATORS))
def made(request: pytest.FixtureRequest, rig: Rig) -> KernelEstimator:
    return make_estimator(request.param, rig)


@pytest.fixture(scope="module")
def whole(made: KernelEstimator, rig: Rig, log: Log) -> np.ndarray:
    return estimate(log, rig, made).theta


def moved(rig: Rig, seed: int) -> Log:
    """The link turns by 80° while one pull rises slowly: no swinging weight, whose force few
    samples cannot follow.
    """
    rising = {
        "points": [["0 s", "2 N"], ["0.5 s", "2 N"], ["2.5 s", "6 N"]],
        "interpolation": "linear",
    }
    scenario = {
        "rig": "paper-2008-printed",
        "duration": "3.2 s",
        "drives": {"left": {"force": rising}, "right": {"force": 2.0}},
    }
    return simulate(rig, build_scenario(scenario), seed)


def test_is_an_estimator(made: KernelEstimator) -> None:
    assert isinstance(made, KernelEstimator)
    assert made.state_names[0] == "theta"
    assert set(made.measured) <= set(made.channels)
    assert "encoder" not in made.channels  # the reference is never read


def test_online_equals_offline(made: KernelEstimator, rig: Rig, log: Log) -> None:
    """Step by step gives the very same numbers as the whole log at once."""
    samples = samples_of(log, made.channels)
    samples[5, 0], samples[9, :] = np.nan, np.nan
    belief = made.initial(log.time[0], samples[0])
    found = made.scan(belief, log.time, samples)
    np.testing.assert_array_equal(found[1], np.swapaxes(found[1], 1, 2))
    live = LiveEstimator(rig, made)
    for time, sample, *expected in zip(log.time, samples, *found):
        assert live.step(time, sample) == live.angle == expected[0][0]
        said = live.mean, live.covariance, live.innovations, live.innovation_variances
        for one, other in zip(said, expected):
            np.testing.assert_array_equal(one, other)
    assert live.angle_std == np.sqrt(live.covariance[0, 0])
    assert live.samples == len(log)
    live.reset()
    assert live.step(log.time[0], samples[0]) == found[0][0, 0]


def test_inputs_are_not_modified_and_beliefs_cannot_be(made: KernelEstimator, log: Log) -> None:
    sample = samples_of(log, made.channels)[0]
    before = sample.copy()
    belief = made.initial(0.0, sample)
    kernel_state = belief.kernel_state.copy()
    made.scan(belief, np.zeros(1), sample[None])
    np.testing.assert_array_equal(sample, before)
    np.testing.assert_array_equal(belief.kernel_state, kernel_state)
    with pytest.raises(ValueError, match="read-only"):
        belief.mean[0] = 1.0


def test_a_missing_sample_is_prediction_only(made: KernelEstimator, rig: Rig, log: Log) -> None:
    """NaN for everything: no innovation, and the covariance is that of a step whose values have no
    weight.
    """
    samples = samples_of(log, made.channels)
    after = LiveEstimator(rig, made)
    for k in range(10):
        after.step(log.time[k], samples[k])
    informed = after.clone()
    after.step(log.time[10], np.full(len(made.channels), np.nan))
    assert np.all(np.isnan(after.innovations))
    assert np.all(np.isfinite(after.mean))
    informed.step(log.time[10], samples[10])
    assert after.covariance[0, 0] >= informed.covariance[0, 0] * (1 - 1e-12)


def test_missing_values_are_bridged(
    made: KernelEstimator, whole: np.ndarray, rig: Rig, log: Log
) -> None:
    rng = np.random.default_rng(0)
    holes = {
        key: np.where(rng.random(len(log)) < 0.3, np.nan, values)
        for key, values in log.channels.items()
    }
    part = estimate(replace(log, channels=holes), rig, made)
    # the kinematic ones have no model to bridge with: they hold the last value, while the link
    # turns by up to 2°
    assert rms_degrees(whole - part.theta) < (2.0 if made.name in KINEMATIC else 1.0)


def test_irregular_stamps_and_gaps(
    made: KernelEstimator, whole: np.ndarray, rig: Rig, log: Log
) -> None:
    """Every third row gone, and half a second: the estimate stays with the one from all rows."""
    keep = np.arange(len(log)) % 3 != 1
    keep[250:300] = False
    part = estimate(log.select(keep), rig, made)
    # the link turns by up to 20° in the gap; what is left of that in the first sample after it
    allowed = 3.0 if made.name in KINEMATIC else 4.0
    assert np.rad2deg(np.abs(whole[keep] - part.theta)).max() < allowed


def test_a_sensor_without_any_value_is_refused(made: KernelEstimator, rig: Rig, log: Log) -> None:
    dead = {**log.channels, "x1": np.full(len(log), np.nan)}
    with pytest.raises(EstimationError, match="sensor 'x1' has no value at all"):
        estimate(replace(log, channels=dead), rig, made)
    with pytest.raises(EstimationError, match="needs the sensor 'u2', which is not in the log"):
        estimate(Log(log.time, {k: v for k, v in log.channels.items() if k != "u2"}), rig, made)


@pytest.mark.parametrize(
    ("stamps", "said"),
    [
        ((1.0, 1.0), "stamp 1 s repeats"),
        ((1.0, 0.5), "stamp 0.5 s is late"),
        ((1.0, np.nan), "not a finite time"),
        ((0.0, 0.1, 0.1), "repeats"),
        ((0.0, 1e7), r"a gap of 1e\+07 s is too long to bridge"),
    ],
)
def test_wrong_stamps_raise(
    made: KernelEstimator, log: Log, stamps: tuple[float, ...], said: str
) -> None:
    samples = samples_of(log, made.channels)[: len(stamps)]
    with pytest.raises(EstimationError, match=said):
        made.scan(made.initial(stamps[0], samples[0]), np.array(stamps), samples)


def test_wrong_samples_raise_and_are_not_broadcast(made: KernelEstimator, log: Log) -> None:
    sample = samples_of(log, made.channels)[0]
    for wrong in (sample[:-1], sample[:, None], np.float64(1.0), np.append(sample, 0.0)):
        with pytest.raises(EstimationError, match="must have shape"):
            made.initial(0.0, wrong)
    sample[0] = np.inf
    with pytest.raises(EstimationError, match="is wild"):
        made.initial(0.0, sample)


def test_sensors_that_do_not_suffice_are_refused(made: KernelEstimator, rig: Rig) -> None:
    first, *others = rig.model_dump()["sensors"]
    again = {**first, "name": "again", "column": "again"}
    blind = [sensor for sensor in others if sensor["measures"] != "position"]
    for wrong, said in (
        ({"sensors.u1.noise": 0.0}, "sensor 'u1' has zero noise.*--set sensors.u1.noise="),
        ({"sensors": [first, *others, again]}, "'x1' and 'again' both measure .* of 'left'"),
        ({"sensors": blind}, "no sensor that measures the position of a drive"),
    ):
        with pytest.raises(EstimationError, match=said):
            make_estimator(made.name, rig.bare().with_values(wrong))


def test_unknown_estimators(paper_rig: Rig) -> None:
    said = r"unknown estimator 'elstic'; did you mean 'elastic'\?"
    with pytest.raises(EstimationError, match=said):
        make_estimator("elstic", paper_rig)
