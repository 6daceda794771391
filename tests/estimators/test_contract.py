"""What every estimator must do, whatever it is; exceptions are listed with their reasons."""

from __future__ import annotations

import numpy as np
import pytest

from distal import (
    ESTIMATORS,
    KernelEstimator,
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
from distal.run import samples_of
from distal.simulation import build_scenario
from tests.support.maps import with_learned_map

NAMES = tuple(ESTIMATORS)
KINEMATIC = {"inextensible", "elastic", "regression"}
"""No innovation and a constant covariance: they have no model of what they do not know."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    described = scenario_rig(load_scenario("series-2"))
    return with_learned_map([moved(described, seed) for seed in (1, 2, 3)], described, "readings")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    return moved(rig, 7)


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


def with_channels(log: Log, **channels: np.ndarray) -> Log:
    return Log(log.time, {**log.channels, **channels}, dict(log.truth), log.source)


@pytest.mark.parametrize("name", NAMES)
def test_is_an_estimator(name: str, rig: Rig) -> None:
    made = make_estimator(name, rig)
    assert isinstance(made, KernelEstimator)
    assert made.state_names[0] == "theta"
    assert set(made.measured) <= set(made.channels)
    assert "encoder" not in made.channels  # the reference is never read


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_online_equals_offline(name: str, rig: Rig, log: Log) -> None:
    """Step by step gives the very same numbers as the whole log at once."""
    made = make_estimator(name, rig)
    samples = samples_of(log, made.channels)
    samples[5, 0], samples[9, :] = np.nan, np.nan
    belief = made.initial(log.time[0], samples[0])
    means, covariances, innovations, variances = made.scan(belief, log.time, samples)
    live = LiveEstimator(rig, made)
    for k, (time, sample) in enumerate(zip(log.time, samples)):
        assert live.step(time, sample) == live.angle == means[k, 0]
        np.testing.assert_array_equal(live.mean, means[k])
        np.testing.assert_array_equal(live.covariance, covariances[k])
        np.testing.assert_array_equal(live.innovations, innovations[k])
        np.testing.assert_array_equal(live.innovation_variances, variances[k])
    assert live.angle_std == np.sqrt(covariances[-1, 0, 0])
    assert live.samples == len(log)
    live.reset()
    assert live.step(log.time[0], samples[0]) == means[0, 0]


@pytest.mark.parametrize("name", NAMES)
def test_inputs_are_not_modified_and_beliefs_cannot_be(name: str, rig: Rig, log: Log) -> None:
    made = make_estimator(name, rig)
    sample = samples_of(log, made.channels)[0]
    before = sample.copy()
    belief = made.initial(0.0, sample)
    kernel_state = belief.kernel_state.copy()
    made.scan(belief, np.zeros(1), sample[None])
    np.testing.assert_array_equal(sample, before)
    np.testing.assert_array_equal(belief.kernel_state, kernel_state)
    with pytest.raises(ValueError, match="read-only"):
        belief.mean[0] = 1.0


@pytest.mark.parametrize("name", NAMES)
def test_covariance_stays_symmetric_and_positive_semidefinite(
    name: str, rig: Rig, log: Log
) -> None:
    result = estimate(log, rig, name)
    np.testing.assert_array_equal(result.covariances, np.swapaxes(result.covariances, 1, 2))
    scale = np.sqrt(
        np.maximum(np.diagonal(result.covariances, axis1=1, axis2=2).max(axis=0), 1e-300)
    )
    smallest = np.linalg.eigvalsh(result.covariances / np.outer(scale, scale)).min()
    assert smallest > -1e-9


@pytest.mark.parametrize("name", NAMES)
def test_a_missing_sample_is_prediction_only(name: str, rig: Rig, log: Log) -> None:
    """NaN for everything: no innovation, and the covariance is that of a step whose values have no
    weight.
    """
    made = make_estimator(name, rig)
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


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_missing_values_are_bridged(name: str, rig: Rig, log: Log) -> None:
    rng = np.random.default_rng(0)
    holes = {
        key: np.where(rng.random(len(log)) < 0.3, np.nan, values)
        for key, values in log.channels.items()
    }
    whole, part = estimate(log, rig, name), estimate(with_channels(log, **holes), rig, name)
    # the kinematic ones have no model to bridge with: they hold the last value, while the link
    # turns by up to 2°
    allowed = 2.0 if name in KINEMATIC else 1.0
    assert np.rad2deg(np.sqrt(np.mean((whole.theta - part.theta) ** 2))) < allowed


@pytest.mark.parametrize("name", NAMES)
def test_a_sensor_without_any_value_is_refused(name: str, rig: Rig, log: Log) -> None:
    with pytest.raises(EstimationError, match="sensor 'x1' has no value at all"):
        estimate(with_channels(log, x1=np.full(len(log), np.nan)), rig, name)
    with pytest.raises(EstimationError, match="needs the sensor 'u2', which is not in the log"):
        estimate(Log(log.time, {k: v for k, v in log.channels.items() if k != "u2"}), rig, name)


@pytest.mark.parametrize("name", NAMES)
def test_late_and_repeated_stamps_raise(name: str, rig: Rig, log: Log) -> None:
    made = make_estimator(name, rig)
    samples = samples_of(log, made.channels)
    begun = made.initial(1.0, samples[0])
    with pytest.raises(EstimationError, match=r"stamp 1 s repeats"):
        made.scan(begun, np.array([1.0, 1.0]), samples[:2])
    with pytest.raises(EstimationError, match=r"stamp 0.5 s is late"):
        made.scan(begun, np.array([1.0, 0.5]), samples[:2])
    with pytest.raises(EstimationError, match="not a finite time"):
        made.scan(begun, np.array([1.0, np.nan]), samples[:2])
    with pytest.raises(EstimationError, match="repeats"):
        made.scan(made.initial(0.0, samples[0]), np.array([0.0, 0.1, 0.1]), samples[:3])


@pytest.mark.parametrize("name", NAMES)
def test_wrong_samples_raise_and_are_not_broadcast(name: str, rig: Rig, log: Log) -> None:
    made = make_estimator(name, rig)
    sample = samples_of(log, made.channels)[0]
    for wrong in (sample[:-1], sample[:, None], np.float64(1.0), np.append(sample, 0.0)):
        with pytest.raises(EstimationError, match="must have shape"):
            made.initial(0.0, wrong)
    sample = sample.copy()
    sample[0] = np.inf
    with pytest.raises(EstimationError, match="is wild"):
        made.initial(0.0, sample)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_irregular_stamps_and_gaps(name: str, rig: Rig, log: Log) -> None:
    """Every third row gone, and half a second: the estimate stays with the one from all rows."""
    keep = np.ones(len(log), dtype=bool)
    keep[1::3] = False
    keep[250:300] = False
    whole, part = estimate(log, rig, name), estimate(log.select(keep), rig, name)
    # the link turns by up to 20° in the gap; what is left of that in the first sample after it
    allowed = 3.0 if name in KINEMATIC else 4.0
    assert np.rad2deg(np.abs(whole.theta[keep] - part.theta)).max() < allowed


@pytest.mark.parametrize("name", NAMES)
def test_an_endless_gap_is_refused(name: str, rig: Rig, log: Log) -> None:
    made = make_estimator(name, rig)
    samples = samples_of(log, made.channels)[:2]
    with pytest.raises(EstimationError, match=r"a gap of 1e\+07 s is too long to bridge"):
        made.scan(made.initial(0.0, samples[0]), np.array([0.0, 1e7]), samples)


@pytest.mark.parametrize("name", NAMES)
def test_zero_noise_is_refused(name: str, rig: Rig) -> None:
    with pytest.raises(
        EstimationError, match=r"sensor 'u1' has zero noise.*--set sensors.u1.noise="
    ):
        make_estimator(name, rig.with_values({"sensors.u1.noise": 0.0}))


def drawn(rig: Rig) -> Log:
    """A log of any rig's sensors that is white noise: enough for a map that is not used for its
    angles.
    """
    rng = np.random.default_rng(0)
    channels = {s.name: 1e-3 * rng.normal(size=200) for s in rig.sensors if s.measures != "angle"}
    return Log(0.01 * np.arange(200), channels, {"theta": 0.1 * rng.normal(size=200)})


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize(
    "which",
    [
        "paper-2008-printed",
        "paper-2008-soft",
        "paper-2008-observed",
        "pulley-antagonist",
        "capstan-joint",
    ],
)
def test_runs_on_every_shipped_rig(name: str, which: str) -> None:
    described = load_rig(which)
    if name == "regression":
        described = with_learned_map([drawn(described)], described, "readings")
    made = make_estimator(name, described, compiled=False)
    n = len(made.channels)
    samples = np.column_stack(
        [np.full(20, 5e-3 if c.startswith("x") else 1e-3) for c in made.channels]
    )
    means, *_ = made.scan(made.initial(0.0, samples[0]), 0.01 * np.arange(20), samples)
    assert means.shape == (20, len(made.state_names))
    assert np.all(np.isfinite(means))
    assert n == len(samples[0])


@pytest.mark.parametrize("name", NAMES)
def test_one_sensor_per_thing(name: str, rig: Rig) -> None:
    dumped = rig.model_dump()
    dumped["map"] = None
    dumped["sensors"] = [
        *dumped["sensors"],
        {**dumped["sensors"][0], "name": "again", "column": "again"},
    ]
    from distal.rig import build_rig

    with pytest.raises(
        EstimationError, match="'x1' and 'again' both measure the position of 'left'"
    ):
        make_estimator(name, build_rig(dumped, "double"))
    dumped["sensors"] = [
        sensor for sensor in rig.model_dump()["sensors"] if sensor["measures"] != "position"
    ]
    with pytest.raises(EstimationError, match="no sensor that measures the position of a drive"):
        make_estimator(name, build_rig(dumped, "blind"))


def test_unknown_estimators() -> None:
    with pytest.raises(
        EstimationError, match=r"unknown estimator 'elstic'; did you mean 'elastic'\?"
    ):
        make_estimator("elstic", load_rig("paper-2008-printed"))
