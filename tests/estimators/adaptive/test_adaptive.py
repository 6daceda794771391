"""`adaptive`: right when the model is wrong, honest about how sure it is, and what it does in the
hard places.
"""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import casadi as ca
import numpy as np
import pytest

from distal import Estimate, Log, Rig, estimate, load_rig, make_estimator, simulate
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter
from distal.rig import build_rig
from tests.helpers import rms_degrees
from tests.support.cases import (
    HARD,
    INTO_STOPS,
    MID_RANGE,
    WITHIN,
    hand_log,
    hand_rig,
    paper_log,
    paper_rig,
    spoiled,
)
from tests.support.lower_bound import lower_bound


@lru_cache(maxsize=256)
def log_of(kind: str, plant: str, seed: int) -> Log:
    return paper_log(kind, plant, seed)


@lru_cache(maxsize=256)
def result_of(kind: str, plant: str, seed: int, name: str = "adaptive") -> Estimate:
    result = estimate(log_of(kind, plant, seed), paper_rig(plant), name)
    # without covariances: those of 256 results are 0.9 GB; the variances are a view of them
    return replace(result, variances=result.variances.copy(), covariances=None)


def pooled(results: list[Estimate]) -> tuple[float, float, float]:
    """Return RMS error [°], share inside the 95 % band, and mean NEES of the joint angle."""
    errors = np.concatenate([result.errors() for result in results])
    stds = np.concatenate([result.theta_std for result in results])
    return (
        rms_degrees(errors),
        float(np.mean(np.abs(errors) <= BAND * stds)),
        float(np.mean((errors / stds) ** 2)),
    )


def changed(log: Log, **channels: np.ndarray) -> Log:
    return Log(log.time, {**log.channels, **channels}, dict(log.truth), log.source)


# ---- the goals, on few seeds; all of them run in `make accuracy`
# -------------------------------------------------------


@pytest.mark.more
@pytest.mark.slow
@pytest.mark.parametrize(
    ("kinds", "bound"), [(MID_RANGE, 0.35), (INTO_STOPS, 0.6)], ids=["mid-range", "stops"]
)
def test_plants_within_the_rigs_stds(kinds: tuple[str, ...], bound: float) -> None:
    """5 seeds give the RMS of 20 to ±10 %: their mean squares differ by 0.7 of themselves from
    start to start.
    """
    results = [
        result_of(kind, plant, seed) for kind in kinds for plant in WITHIN for seed in range(5)
    ]
    rms, inside, _ = pooled(results)
    assert rms <= 1.1 * bound
    assert inside >= 0.90
    # a wide band is no pass: the goal is 2.5, and 2.6 into the stops is what `make accuracy` shows
    assert (
        BAND * np.rad2deg(np.median(np.concatenate([result.theta_std for result in results])))
        <= 3.0 * rms
    )


@pytest.mark.slow
@pytest.mark.more
def test_plants_beyond_the_rigs_stds_are_better_than_every_baseline() -> None:
    cases = [
        (kind, plant, seed)
        for kind in (*MID_RANGE, *INTO_STOPS)
        for plant in HARD
        for seed in range(1)
    ]
    rms, inside, _ = pooled([result_of(*case) for case in cases])
    assert inside >= 0.85
    for rival in ("inextensible", "elastic"):
        assert rms < pooled([result_of(*case, rival) for case in cases])[0]
    assert (
        max(np.rad2deg(result_of(*case).max_error()) for case in cases) < 15.0
    )  # nothing diverges


@pytest.mark.slow
@pytest.mark.parametrize(("friction", "bound"), [("given", 2.2), ("unknown", 2.8)])
def test_a_hand_that_nobody_measures(friction: str, bound: float) -> None:
    """Up to 7° of the link's motion do not move the sliders at all: the bounds are a prototype's
    1.8 to 2.4° and more.
    """
    rig = hand_rig(friction)
    made = make_estimator("adaptive", rig)
    results = [estimate(hand_log(seed), rig, made) for seed in range(4)]
    rms, inside, _ = pooled(results)
    assert rms < bound
    assert inside >= 0.88
    half = np.rad2deg(np.mean([BAND * result.theta_std.mean() for result in results]))
    assert half < 4.0 * rms  # and not by width alone


def honest(results: list[Estimate], shrink: float = 1.0) -> bool:
    """Return whether band and NEES are what they should be, with the covariance divided by
    `shrink`.

    NEES of one state is χ² with mean 1; the errors of a log are correlated, so 20 logs of about 5
    independent pieces each give the mean to ±0.14: 1.4 is three of these above 1. Below 0.3 the
    band is far too wide.
    """
    errors = np.concatenate([result.errors() for result in results])
    stds = np.concatenate([result.theta_std for result in results]) / np.sqrt(shrink)
    inside, nees = np.mean(np.abs(errors) <= BAND * stds), np.mean((errors / stds) ** 2)
    return bool(inside >= 0.90 and 0.3 <= nees <= 1.4)


@pytest.mark.slow
def test_the_uncertainty_is_honest_and_a_third_of_it_would_fail() -> None:
    """The band is about plants such as the rig's stds allow, so the plants have to vary."""
    cases = [("ramps", plant, seed) for plant in WITHIN for seed in range(4)]
    results = [result_of(*case) for case in cases]
    assert honest(results)
    assert not honest(results, shrink=3.0)


@pytest.mark.slow
def test_near_the_lower_bound_when_the_model_is_right() -> None:
    """The bound holds for the mean over starts and noise, not for each log: 24 logs."""
    plant = "no linearity error"
    rms, _, _ = pooled([result_of(kind, plant, seed) for kind in MID_RANGE for seed in range(8)])
    bounds = [
        np.rad2deg(lower_bound(paper_rig(plant), log_of(k, plant, s)))
        for k in MID_RANGE
        for s in range(8)
    ]
    assert rms <= 1.2 * np.sqrt(np.mean(np.square(bounds)))


# ---- what it learns
# --------------------------------------------------------------------------------------------------


def test_it_finds_the_friction_coefficient_and_the_stiffness() -> None:
    for plant, name, true in (
        ("friction +20 %", "friction coefficient of joint link", 0.6),
        ("friction −20 %", "friction coefficient of joint link", 0.4),
        ("stiffness −10 %", "common factor of tendons.stiffness", 0.9),
    ):
        result = result_of("servo", plant, 1)
        i = result.state_names.index(name)
        std = np.sqrt(result.variances[-1, i])
        prior = np.sqrt(result.variances[0, i])
        assert abs(result.means[-1, i] - true) < 3 * std
        assert std < 0.6 * prior


def test_only_what_has_a_std_is_a_state() -> None:
    certain = paper_rig("as the rig").with_values(
        {
            "joints.0.friction.coefficient.std": 0.0,
            "joints.0.friction.preload.std": 0.0,
            "tendons.0.stiffness.shared.std": 0.0,
            "tendons.1.stiffness.shared.std": 0.0,
            "sensors.x1.linearity": 0.0,
            "sensors.x2.linearity": 0.0,
        }
    )
    assert make_estimator("adaptive", certain).state_names == (
        "theta",
        "theta_dot",
        "friction_left",
        "friction_right",
    )
    assert "external_torque" in make_estimator("adaptive", hand_rig("given")).state_names


def test_what_errs_together_is_one_state_and_what_errs_alone_another() -> None:
    rig = paper_rig("as the rig")
    assert "common factor of tendons.stiffness" in make_estimator("adaptive", rig).state_names

    def names(**changes: object) -> list[str]:
        other = rig.with_values(
            {f"tendons.{key[1:]}.stiffness": value for key, value in changes.items()}
        )
        return [
            name for name in make_estimator("adaptive", other).state_names if "stiffness" in name
        ]

    both = ["common factor of tendons.stiffness", "stiffness deviation of tendon right"]
    assert names(_1={"std": 20.0, "shared": {"name": "tendons.stiffness", "std": 0.1}}) == both
    assert names(_1={"std": 20.0}) == [
        "stiffness factor of tendon right",
        "common factor of tendons.stiffness",
    ]
    alike = {"value": 806.0, "std": "10 %"}  # alike, but nothing says that they err together
    assert names(_0=alike, _1=alike) == [
        "stiffness factor of tendon left",
        "stiffness factor of tendon right",
    ]


def test_the_prior_of_what_is_shared_is_that_of_the_equation() -> None:
    """p_i = value_i (1 + σ z) + σ_i ε_i: variances and covariance of two tendons as the state
    vector has them.
    """
    shared = {"name": "spool", "std": 0.1}
    values = {"tendons.0.stiffness": {"value": 800.0, "std": 30.0, "shared": shared}}
    values["tendons.1.stiffness"] = {"value": 500.0, "shared": shared}
    states = make_estimator(
        "adaptive", paper_rig("as the rig").with_values(values), compiled=False
    ).states
    p, state = states.context.mechanism.parameters, ca.SX.sym("x", len(states))
    slopes = ca.Function("p", [p.symbols], [ca.jacobian(states.parameters(state), state)])(
        p.values
    ).full()
    at = [p.names.index(f"tendons.{i}.stiffness") for i in (0, 1)]
    found = (slopes * states.stds**2 @ slopes.T)[np.ix_(at, at)]
    np.testing.assert_allclose(found, [[80.0**2 + 30.0**2, 80.0 * 50.0], [80.0 * 50.0, 50.0**2]])


# ---- hard places
# ------------------------------------------------------------------------------------------


def test_the_force_at_a_stop_tells_nothing() -> None:
    """While a slider touches its stop, whatever its load cell says is left out."""
    rig = paper_rig("as the rig")
    logs = [log_of("ramps into stops", "as the rig", seed) for seed in range(10)]
    log = max(logs, key=lambda one: int((one.truth["position_left"] > 15e-3).sum()))
    touching = log.truth["position_left"] > 15e-3
    assert touching.sum() > 50
    wrong = changed(log, u1=np.where(touching, log.channels["u1"] + 10.0, log.channels["u1"]))
    np.testing.assert_array_equal(estimate(wrong, rig).theta, estimate(log, rig).theta)


def test_a_stuck_link_stays_uncertain() -> None:
    """60 s of the same forces on a stuck link: the common error of both sensors is never averaged
    away.

    (θ + ε, b1 − rε, b2 + rε) changes no tension, so σ_b/(√2 r) of the sensors' linearity remains:
    more than 0.2°.
    """
    rig = paper_rig("as the rig")
    n, rng = 6000, np.random.default_rng(0)
    channels = {
        "x1": 3 / 806 + rng.normal(0, 5e-6, n),
        "x2": 3 / 806 + rng.normal(0, 5e-6, n),
        "u1": 3 + rng.normal(0, 0.3, n),
        "u2": 3 + rng.normal(0, 0.3, n),
    }
    result = estimate(Log(0.01 * np.arange(n), channels), rig)
    assert np.rad2deg(result.theta_std[-1]) > 0.2
    assert np.rad2deg(np.abs(result.theta[-1])) < 2 * np.rad2deg(result.theta_std[-1])


def test_slack_tendons_tell_nothing() -> None:
    """Both sliders pushed in until the tendons hang: the angle keeps its prior uncertainty."""
    rig = paper_rig("as the rig")
    n, rng = 300, np.random.default_rng(0)
    channels = {
        "x1": np.full(n, -4e-3) + rng.normal(0, 5e-6, n),
        "x2": np.full(n, -4e-3) + rng.normal(0, 5e-6, n),
        "u1": rng.normal(0, 0.3, n),
        "u2": rng.normal(0, 0.3, n),
    }
    result = estimate(Log(0.01 * np.arange(n), channels), rig)
    assert np.rad2deg(result.theta_std[-1]) > 2.5
    assert abs(np.rad2deg(result.theta[-1])) < 2.0


def without(rig: Rig, *names: str) -> Rig:
    dumped = rig.model_dump()
    dumped["sensors"] = [sensor for sensor in dumped["sensors"] if sensor["name"] not in names]
    return build_rig(dumped, f"without {', '.join(names)}")


def test_without_force_sensors() -> None:
    """Nominal pulls with their std instead: less sure, not wrong."""
    rig = paper_rig("as the rig").with_values(
        {f"drives.{i}.nominal_force": {"value": 3.5, "std": 1.0} for i in range(2)}
    )
    results = [
        estimate(log_of("servo", "as the rig", seed), without(rig, "u1", "u2")) for seed in range(4)
    ]
    rms, inside, _ = pooled(results)
    assert rms < 1.5
    assert inside > 0.85
    assert np.median(results[0].theta_std) > np.median(
        result_of("servo", "as the rig", 0).theta_std
    )


def test_without_one_position_sensor() -> None:
    """The place of the drive without a sensor is a state that its force tells of."""
    rig = without(paper_rig("as the rig"), "x2")
    results = [estimate(log_of("ramps", "as the rig", seed), rig) for seed in range(4)]
    assert "position_right" in results[0].state_names
    rms, inside, _ = pooled(results)
    assert rms < 4.0
    assert inside > 0.85


def test_a_missing_displacement_is_bridged_with_growing_variance() -> None:
    log, rig = log_of("servo", "as the rig", 1), paper_rig("as the rig")
    hole = (log.time >= 5.0) & (log.time < 5.3)
    result = estimate(changed(log, x1=np.where(hole, np.nan, log.channels["x1"])), rig)
    inside = np.flatnonzero(hole)
    assert result.theta_std[inside[-1]] > 2 * result.theta_std[inside[0] - 1]
    errors = np.abs(result.errors()[inside])
    assert np.mean(errors <= 3 * result.theta_std[inside]) > 0.8
    later = (log.time > 6.0) & (log.time < 7.0)
    assert rms_degrees(result.errors()[later]) < 2 * max(
        rms_degrees(result_of("servo", "as the rig", 1).errors()[later]), 0.3
    )


@pytest.mark.parametrize("size", [1e-4, 3e-4, 1e-3])
def test_a_wild_displacement_moves_nothing(size: float) -> None:
    """20 to 200 σ in one sample, which the tendon's arm would make 0.6 to 6°: the angle moves by
    less than half its std.
    """
    log, rig = log_of("ramps", "as the rig", 3), paper_rig("as the rig")
    made = AdaptiveFilter(rig)
    usual = estimate(log, rig, made)
    for row in (300, 620, 900):
        wild = np.array(log.channels["x1"])
        wild[row] += size
        change = np.abs(estimate(changed(log, x1=wild), rig, made).theta - usual.theta)
        assert np.all(change < 0.5 * usual.theta_std)


def test_a_real_jump_is_believed_at_its_second_sample() -> None:
    """2 mm, which the arm would make 12°."""
    log, rig = log_of("ramps", "as the rig", 3), paper_rig("as the rig")
    jumped = np.array(log.channels["x1"])
    jumped[500:] += 2e-3
    made = AdaptiveFilter(rig)
    usual = estimate(log, rig, made)
    change = estimate(changed(log, x1=jumped), rig, made).theta - usual.theta
    assert np.abs(change[500]) < 0.3 * usual.theta_std[500]
    assert np.rad2deg(change[520:540].max()) > 2.0


def test_a_wild_force_counts_little() -> None:
    log, rig = log_of("servo", "as the rig", 2), paper_rig("as the rig")
    wild = np.array(log.channels["u1"])
    wild[400] += 60.0
    change = np.abs(estimate(changed(log, u1=wild), rig).theta - estimate(log, rig).theta)
    assert np.rad2deg(change.max()) < 0.5


@pytest.mark.slow
def test_spoiled_logs_do_not_diverge() -> None:
    """30 % missing, 2 % wild, a gap of 0.5 s."""
    rig = paper_rig("as the rig")
    made = AdaptiveFilter(rig)
    clean = [result_of(kind, "as the rig", seed) for kind in MID_RANGE for seed in range(3)]
    spoilt = [
        estimate(spoiled(log_of(k, "as the rig", s), s), rig, made)
        for k in MID_RANGE
        for s in range(3)
    ]
    assert pooled(spoilt)[0] < 2.0 * pooled(clean)[0]
    assert pooled(spoilt)[1] > 0.9


# ---- how a rig may be written
# -----------------------------------------------------------------------------------------


def test_a_force_belongs_to_its_sensor_whatever_the_order() -> None:
    rig, log = paper_rig("as the rig"), log_of("servo", "as the rig", 0)
    log = Log(log.time[:200], {k: v[:200] for k, v in log.channels.items()})
    turned = rig.model_copy(update={"sensors": tuple(reversed(rig.sensors))})
    one, other = estimate(log, rig), estimate(log, turned)
    columns = [other.measured.index(sensor) for sensor in one.measured]
    assert set(one.measured) == {"u1", "u2"}
    # one force is compared after the other; parameters that take a share of the gain leave a little
    # to the order
    assert np.all(np.abs(one.theta - other.theta) < 0.05 * one.theta_std)
    scale = np.sqrt(one.innovation_variances)
    assert np.median(np.abs((one.innovations - other.innovations[:, columns]) / scale)) < 0.01


def test_the_force_that_is_left_is_reported_under_its_name() -> None:
    rig, log = without(paper_rig("as the rig"), "u1"), log_of("servo", "as the rig", 0)
    rig = rig.with_values({"drives.left.nominal_force.std": 1.0})
    whole = estimate(log, rig)
    broken = changed(
        log, u2=np.where(log.time > 6.0, log.channels["u2"] + 20.0, log.channels["u2"])
    )
    assert whole.measured == ("u2",)
    jump = np.abs(estimate(broken, rig).innovations[:, 0] - whole.innovations[:, 0])
    assert np.all(jump[log.time < 5.9] == 0.0)
    assert jump[log.time > 6.0][0] == pytest.approx(20.0, abs=0.5)


def test_a_force_sensors_bias_and_linearity_are_a_state() -> None:
    rig = paper_rig("as the rig").with_values(
        {"sensors.u1.bias.std": 1.0, "sensors.u2.linearity": 1.0}
    )
    made = make_estimator("adaptive", rig)
    assert {"bias_u1", "bias_u2"} <= set(made.state_names)
    log = log_of("servo", "as the rig", 0)
    shifted = changed(log, u1=log.channels["u1"] + 1.0)
    known, hidden = estimate(shifted, rig, made), estimate(shifted, paper_rig("as the rig"))
    assert known.inside_band() > 0.9
    assert rms_degrees(known.errors()) < rms_degrees(hidden.errors())


def test_half_the_rate_is_no_other_filter() -> None:
    """Every second sample left out: the error stays within the noise of half the samples, √2."""
    rig = paper_rig("as the rig")
    made = AdaptiveFilter(rig)
    logs = [log_of(kind, "as the rig", seed) for kind in ("ramps", "servo") for seed in range(4)]
    halves = [
        Log(
            log.time[::2],
            {k: v[::2] for k, v in log.channels.items()},
            {k: v[::2] for k, v in log.truth.items()},
        )
        for log in logs
    ]
    whole, half = (
        pooled([estimate(log, rig, made) for log in logs]),
        pooled([estimate(log, rig, made) for log in halves]),
    )
    assert half[0] < np.sqrt(2) * whole[0]
    assert half[1] > 0.9


def test_a_drift_of_the_rig_file_is_how_a_parameter_walks() -> None:
    """Friction that changes halfway is followed where it may walk, and kept where it may not."""

    def rig(drift: float) -> Rig:
        return paper_rig("as the rig").with_values({"joints.0.friction.coefficient.drift": drift})

    name = "friction coefficient of joint link"
    before, after = log_of("servo", "friction −20 %", 1), log_of("servo", "friction +20 %", 1)
    log = Log(
        np.concatenate([before.time, before.time[-1] + 0.01 + after.time]),
        {
            key: np.concatenate([before.channels[key], after.channels[key]])
            for key in before.channels
        },
    )
    kept, walked = (estimate(log, rig(drift)) for drift in (0.0, 0.1))
    i = kept.state_names.index(name)
    assert np.all(np.diff(kept.covariances[:, i, i]) <= 1e-12)
    assert walked.covariances[-1, i, i] > 2 * kept.covariances[-1, i, i]
    assert abs(walked.means[-1, i] - 0.6) < abs(kept.means[-1, i] - 0.6)


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
    fitted, other = (
        AdaptiveFilter(rig, False, inputs=list(changed)),
        AdaptiveFilter(rig.with_values(changed), False),
    )
    p = np.array(fitted.parameters)
    for name, value in changed.items():
        p[fitted.parameter_names.index(name)] = value
    sample = np.linspace(0.1, 0.2, len(fitted.channels))
    mean, _, memory = fitted.prior(sample, p)
    known, _, known_memory = other.prior(sample, other.parameters)
    names = list(other.state_names)
    for name in set(names) & set(fitted.state_names):
        assert mean[fitted.state_names.index(name)] == pytest.approx(
            known[names.index(name)], abs=1e-15
        )
    np.testing.assert_allclose(memory, known_memory)
    _, spread, _ = fitted.prior(sample, p)
    torque = fitted.state_names.index("external_torque")
    assert spread[torque, torque] == pytest.approx(0.02**2)


def test_a_command_is_where_the_drive_goes_and_not_where_it_is() -> None:
    """With the lag of its servo the filter errs hardly more than from measured places, without it
    by degrees.
    """
    plain = load_rig("template")
    commanded = plain.with_values({f"sensors.{name}.lag": 0.2 for name in ("x1", "x2")})
    measured, log = simulate(plain, "template", seed=3), simulate(commanded, "template", seed=3)
    least = estimate(measured, plain, compiled=False).rms_error()
    assert estimate(log, commanded, compiled=False).rms_error() < 1.5 * least
    assert estimate(log, plain, compiled=False).rms_error() > 5.0 * least
