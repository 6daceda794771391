"""`affine`: least squares of what the sensors read, its covariance, its band, its range, homing,
and its refusals.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from distal import (
    LiveEstimator,
    Log,
    Rig,
    estimate,
    estimate_batch,
    export_c,
    learn_affine,
    load_rig,
    make_estimator,
)
from distal.errors import EstimationError, FitError, RigError
from distal.estimators.affine_estimator import (
    OUTSIDE,
    affine_function,
    affine_of,
    affine_samples,
    start_of,
)
from distal.regression import learn_map, map_coefficients_of, predict
from distal.rig import Affine, JointMap, build_rig, parse_toml
from distal.run import samples_of

OFFSET, SLOPE, COMPLIANCE = 0.4, 0.9, -1.5
"""[rad], [rad/rad], [rad/(N m)] of the linear rig."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    """One capstan with a torque sensor."""
    return load_rig("da-vinci-grasper").bare()


def linear_log(
    rng: np.random.Generator,
    noise: float = 0.0,
    correlation: float = 0.0,
    spread: float = 0.0,
    turning: float = 0.0,
    duration: float = 20.0,
    size: float = 1.0,
) -> Log:
    """Return a log of a joint that is linear in the drive's angle and torque, with AR(1) noise, and
    its own coefficients.

    Args:
        rng: of motion and noise.
        noise: std of the angle's error [rad].
        correlation: of that from sample to sample.
        spread: std between logs of offset [rad] and, a tenth of it relative, of the slopes.
        turning: share of the angle that follows the direction of motion [rad].
        duration: [s].
        size: of the motion.
    """
    time = np.arange(0.0, duration, 0.02)
    periods, phases = rng.uniform(1.0, 3.0, 4), rng.uniform(0.0, 2 * np.pi, 4)
    drive = (
        size
        * 0.4
        * (
            np.sin(2 * np.pi * time / periods[0] + phases[0])
            + np.sin(time / periods[1] + phases[1])
        )
    )
    torque = (
        size
        * 0.05
        * (
            np.sin(2 * np.pi * time / periods[2] + phases[2])
            + np.sin(time / periods[3] + phases[3])
        )
    )
    white = rng.normal(size=len(time) + 500) * np.sqrt(1.0 - correlation**2)
    errors = noise * lfilter([1.0], [1.0, -correlation], white)[500:]
    own = spread * rng.normal(size=3) * [1.0, 0.1, 0.1]
    angle = OFFSET + own[0] + SLOPE * (1 + own[1]) * drive + COMPLIANCE * (1 + own[2]) * torque
    angle += turning * np.where(np.gradient(drive) > 0, 1.0, -1.0)
    return Log(time, {"motor_angle": drive, "motor_torque": torque}, {"theta": angle + errors})


def logs_of(seed: int, count: int, **options: float) -> list[Log]:
    rng = np.random.default_rng(seed)
    return [replace(linear_log(rng, **options), source=f"log {i}") for i in range(count)]


def in_si(rig: Rig) -> tuple[float, float, float]:
    """Return offset, slope and compliance of the one joint for readings in SI, as the map has
    them.
    """
    affine = rig.affine
    assert affine is not None
    b = np.array(affine.joints[0].coefficients)
    slopes = b[1:3] / affine.scale
    return float(b[0] - slopes @ affine.centre), float(slopes[0]), float(slopes[1])


@pytest.mark.parametrize("count", [1, 2, 4])
def test_an_exact_linear_plant_is_recovered(rig: Rig, count: int) -> None:
    found = learn_affine(logs_of(0, count), rig)
    # nothing but rounding stands between, and the smallest std that is allowed, 1e-6 rad
    np.testing.assert_allclose(in_si(found.rig), (OFFSET, SLOPE, COMPLIANCE), rtol=1e-7)
    assert found.learned.logs == count
    log = logs_of(1, 1)[0]
    result = estimate(log, found.rig, "affine")
    assert result.max_error() < 1e-6


def test_directions_are_used_where_they_help_on_left_out_logs(rig: Rig) -> None:
    with_play = learn_affine(logs_of(6, 5, noise=0.002, turning=0.02), rig)
    assert with_play.learned.joints[0].coefficients[3] == pytest.approx(0.02, rel=0.15)
    assert any("with directions of motion" in note for note in with_play.notes)
    without = learn_affine(logs_of(6, 5, noise=0.002), rig)
    assert len(without.learned.joints[0].coefficients) == 3
    assert not any("with directions of motion" in note for note in without.notes)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("count", "inside"), [(5, (0.88, 1.0)), pytest.param(12, (0.90, 0.99), marks=pytest.mark.more)]
)
def test_the_band_holds_on_logs_that_were_not_seen(
    rig: Rig, count: int, inside: tuple[float, float]
) -> None:
    """15 made-up kinds of rig, each judged on 20 logs beyond those it learned from; errors
    correlated over 1 s.
    """
    shares, ratios = [], []
    for seed in range(15):
        logs = logs_of(100 + seed, count + 20, noise=0.01, correlation=0.98, spread=0.02)
        every = [affine_samples(log, rig) for log in logs]
        learned, _ = learn_map(every[:count], affine_of(rig), range(count), None)
        for samples in every[count:]:
            said = predict(learned, samples)
            stds = np.sqrt(said.variances)
            shares.append(np.mean(np.abs(said.values - samples.targets[:, 0]) < 1.96 * stds))
            ratios.append(1.96 * stds.mean() / 0.0245)
    # 300 logs: the mean of their shares has a standard error of about 0.01
    assert inside[0] < np.mean(shares) < inside[1]
    assert np.mean(ratios) < 3.0


@pytest.mark.slow
def test_a_homing_band_holds_with_correlated_errors(rig: Rig) -> None:
    """3 s of a log, alone: the errors of its window are worth few samples, and the band knows
    it.
    """
    shares = []
    for log in logs_of(7, 60, noise=0.01, correlation=0.95, spread=0.1):
        result = estimate(log, rig, "affine", homing=3.0, compiled=False)
        shares.append(result.inside_band())
    assert 0.90 < np.mean(shares) <= 1.0


def test_few_logs_are_said_and_widen_the_band(rig: Rig) -> None:
    logs = logs_of(8, 6, noise=0.01, correlation=0.9, spread=0.02)
    found = {count: learn_affine(logs[:count], rig) for count in (1, 2, 3, 6)}
    for count in (1, 2, 3):
        assert any(
            f"{count} log" in note and "is hardly known, and the band is widened" in note
            for note in found[count].notes
        )
    assert not any("are needed" in note for note in found[6].notes)
    assert not found[2].left_out
    assert len(found[3].left_out) == 3
    stds = {count: np.sqrt(one.learned.joints[0].covariance[0][0]) for count, one in found.items()}
    assert stds[2] > 2 * stds[6]


def test_a_map_and_a_homing_move_beat_either(rig: Rig) -> None:
    """The move finds the log's offset, the logs know the slopes: a short move alone knows neither
    range nor slopes.
    """
    logs = logs_of(9, 18, noise=0.005, correlation=0.9, spread=0.05)
    known = learn_affine(logs[:10], rig).rig
    rms = {"logs": [], "move": [], "both": []}
    for log in logs[10:]:
        rms["logs"].append(estimate(log, known, "affine").rms_error())
        rms["move"].append(estimate(log, rig, "affine", homing=1.0).rms_error())
        both = estimate(log, known, "affine", homing=1.0)
        rms["both"].append(both.rms_error())
        assert np.isnan(both.truths[log.time < 1.0]).all()
    means = {name: np.sqrt(np.mean(np.square(values))) for name, values in rms.items()}
    assert means["both"] < 0.5 * means["logs"]
    assert means["both"] < 0.5 * means["move"]
    assert means["both"] < 3 * 0.005


def test_a_homing_move_that_contradicts_the_map_wins_and_is_said(rig: Rig) -> None:
    known = learn_affine(logs_of(10, 6, noise=0.003, spread=0.01), rig).rig
    (log,) = logs_of(11, 1, noise=0.003)
    turned = Log(log.time, log.channels, {"theta": log.truth["theta"] + 1.0}, "turned")
    result = estimate(turned, known, "affine", homing=3.0)
    assert result.rms_error() < 0.02
    assert any(
        "standard deviations from the map that the rig file has" in note for note in result.notes
    )
    expected = estimate(log, known, "affine", homing=3.0).notes
    assert not any("standard deviations from the map" in note for note in expected)


def test_outside_the_learned_range_the_band_grows_and_it_is_said(rig: Rig) -> None:
    found = learn_affine(logs_of(12, 5, noise=0.005), rig)
    time = np.arange(0.0, 10.0, 0.01)
    ramp = np.linspace(0.0, 6.0, len(time))
    log = Log(time, {"motor_angle": ramp, "motor_torque": np.zeros(len(time))})
    result = estimate(log, found.rig, "affine")
    far, std = result.state(OUTSIDE), result.theta_std
    high, half = found.learned.high[0], (found.learned.high[0] - found.learned.low[0]) / 2
    inside = ramp < 0.9 * high
    assert np.all(far[inside] == 0.0)
    np.testing.assert_allclose(far[-1], (6.0 - high) / half, rtol=0.02)
    # at least linear: one residual std more for every half range
    outside = far > 1.0
    assert np.all(std[outside] >= found.learned.joints[0].std * far[outside])
    assert np.all(np.diff(std[ramp > high]) > 0.0)
    assert len(result.notes) == 1
    assert (
        "are outside the range of the 5 logs that it was learned from (motor_angle)"
        in result.notes[0]
    )


def test_a_combination_that_never_came_is_outside(rig: Rig) -> None:
    """Angle and torque rise together in the logs: each within its range, the other way round, is
    far.
    """
    rng = np.random.default_rng(13)
    time = np.arange(0.0, 10.0, 0.02)
    wave = np.sin(time)
    channels = {
        "motor_angle": wave,
        "motor_torque": 0.1 * wave + 0.005 * rng.normal(size=len(time)),
    }
    known = learn_affine(Log(time, channels, {"theta": wave}), rig).rig
    against = Log(time, {"motor_angle": wave, "motor_torque": -0.1 * wave})
    result = estimate(against, known, "affine")
    assert result.state(OUTSIDE).max() > 3.0
    assert result.notes


def test_what_tells_nothing_is_dropped_and_named(rig: Rig) -> None:
    rng = np.random.default_rng(14)
    (log,) = logs_of(14, 1)
    drive = log.channels["motor_angle"]
    still = Log(
        log.time,
        {"motor_angle": drive, "motor_torque": np.full(len(drive), 0.03)},
        {"theta": 0.9 * drive},
    )
    found = learn_affine(still, rig)
    assert found.learned.dropped == ("motor_torque: was constant",)
    assert found.learned.joints[0].coefficients[2] == 0.0
    tied = 0.1 * drive + 1e-3 * rng.normal(size=len(drive))  # half the noise of the torque sensor
    found = learn_affine(
        Log(log.time, {"motor_angle": drive, "motor_torque": tied}, {"theta": 0.9 * drive}), rig
    )
    assert found.learned.dropped == ("motor_torque: follows from the others",)
    assert in_si(found.rig)[1] == pytest.approx(0.9, rel=1e-6)
    result = estimate(still, rig, "affine", homing=3.0)
    assert "affine: not used, motor_torque: was constant" in result.notes


def test_a_missing_value_is_held_and_widens_the_band(rig: Rig) -> None:
    found = learn_affine(logs_of(15, 5, noise=0.003), rig)
    (log,) = logs_of(16, 1)
    drive = log.channels["motor_angle"].copy()
    drive[200:260] = np.nan
    whole = estimate(log, found.rig, "affine")
    part = estimate(Log(log.time, {**log.channels, "motor_angle": drive}), found.rig, "affine")
    np.testing.assert_array_equal(part.theta[:200], whole.theta[:200])
    np.testing.assert_allclose(part.theta[260:], whole.theta[260:], atol=1e-12)
    gap = part.theta_std[200:260]
    assert np.all(np.diff(gap) >= 0.0)
    assert gap[10] > 3 * whole.theta_std[199]
    errors = part.theta[200:260] - whole.theta[200:260]
    assert np.mean(np.abs(errors) < 1.96 * gap) > 0.9


def test_the_kernel_is_the_formula(rig: Rig) -> None:
    """The compiled step against numpy, directions, leverage, range and all."""
    found = learn_affine(logs_of(17, 5, noise=0.003, turning=0.02, spread=0.02), rig)
    (log,) = logs_of(18, 1, size=1.5)
    result = estimate(log, found.rig, "affine")
    assert "slip(motor_angle)" in found.learned.terms
    said = predict(found.learned, affine_samples(log, found.rig))
    np.testing.assert_allclose(result.theta, said.values, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(result.theta_std, np.sqrt(said.variances), rtol=1e-9)


def test_the_kernel_has_several_joints() -> None:
    joints = [
        {
            "joint": name,
            "coefficients": [0, slope, 0, 0, 0],
            "covariance": np.zeros((5, 5)).tolist(),
            "std": 0.1 * slope,
        }
        for name, slope in (("one", 1.0), ("two", 2.0))
    ]
    affine = Affine.model_validate(
        {
            "channels": ["a", "b", "c"],
            "centre": [0, 0, 0],
            "scale": [1, 1, 1],
            "low": [-1, -1, -1],
            "high": [1, 1, 1],
            "rate": [0, 0, 0],
            "terms": ["1", "a", "b", "c", "slip(a)"],
            "width": [0.1, 1, 1],
            "spread": [0, 0],
            "band": [1, 1],
            "distance": np.eye(3).tolist(),
            "reach": 9.0,
            "correlation_time": 0.1,
            "logs": 3,
            "joints": joints,
        }
    )
    function, n = affine_function(affine, 3), 3
    assert function.numel_in(0) == n + n * n + 2 * 3 + 1
    following, _ = function(
        np.zeros(function.numel_in(0)), [0.1, 0.5, 0, 0, 1, 1, 1], map_coefficients_of(affine)
    )
    after = np.array(following).ravel()
    np.testing.assert_allclose(after[:3], [0.5, 1.0, 0.0])
    np.testing.assert_allclose(after[3:12].reshape(3, 3), np.diag([0.01, 0.04, 0.0]))


def test_a_batch_homes_each_log_by_itself(rig: Rig) -> None:
    logs = logs_of(19, 6, noise=0.003, spread=0.3)
    alone = [estimate(log, rig, "affine", homing=2.0) for log in logs]
    for one, other in zip(alone, estimate_batch(logs, rig, "affine", homing=2.0)):
        np.testing.assert_array_equal(one.theta, other.theta)
        np.testing.assert_array_equal(one.theta_std, other.theta_std)
        assert one.notes == other.notes


def test_live_gives_the_numbers_of_the_log(rig: Rig) -> None:
    known = learn_affine(logs_of(20, 3, noise=0.003), rig).rig
    (log,) = logs_of(21, 1)
    result, live = estimate(log, known, "affine"), LiveEstimator(known, "affine")
    samples = samples_of(log, live.channels)
    for k in range(50):
        assert live.step(log.time[k], samples[k]) == result.theta[k]
        assert live.angle_std == result.theta_std[k]


def test_it_is_exported_to_c(rig: Rig, tmp_path: Path) -> None:
    known = learn_affine(logs_of(22, 3, noise=0.003), rig).rig
    made = export_c(known, tmp_path / "c", "affine")
    assert made.states == ("theta", OUTSIDE)
    with pytest.raises(EstimationError, match=r"affine: .* it needs \[affine\] in the rig file"):
        export_c(rig, tmp_path / "none", "affine")


def test_the_rig_file_comes_back(rig: Rig, tmp_path: Path) -> None:
    found = learn_affine(logs_of(23, 3, noise=0.003, spread=0.02), rig)
    found.save(tmp_path / "known.toml")
    assert load_rig(tmp_path / "known.toml") == found.rig
    assert load_rig("capstan-joint").affine is None  # files without [affine] are read


def test_a_wrong_table_is_refused(rig: Rig, tmp_path: Path) -> None:
    found = learn_affine(logs_of(24, 3, noise=0.003), rig)
    found.save(tmp_path / "known.toml")
    raw = parse_toml((tmp_path / "known.toml").read_text(), "known.toml", RigError)

    def refused(change: dict[str, object], match: str, joint: bool = False) -> None:
        table = {**raw["affine"], **({} if joint else change)}
        if joint:
            table["joints"] = [{**table["joints"][0], **change}]
        with pytest.raises(RigError, match=match):
            build_rig({**raw, "affine": table}, "known.toml")

    refused(
        {"channels": ["motor_angle", "torque"], "terms": ["1", "motor_angle", "torque"]},
        "no sensor is called",
    )
    refused({"channels": ["motor_angle", "torque"]}, "'motor_torque' is no variable")
    refused(
        {"centre": [0.0]},
        "centre must have 2 entries, one for each channel, or 3 with joints; 1 came",
    )
    refused({"scale": [0.0, 1.0]}, "every scale, width and band must be positive")
    refused({"low": [9.0, 9.0]}, "low must not be above high")
    refused({"coefficients": [1.0]}, "covariance must be 1 rows of 1 numbers", joint=True)
    refused({"std": 0.0}, "std: must be positive", joint=True)
    refused({"joint": "wrist"}, r"one for each joint is needed \(jaw\)", joint=True)
    wrong = np.array(raw["affine"]["joints"][0]["covariance"])
    wrong[0, 0] = -1.0
    refused(
        {"covariance": wrong.tolist()}, "must be symmetric and positive semidefinite", joint=True
    )


def test_without_a_map_it_is_refused_by_name(rig: Rig) -> None:
    (log,) = logs_of(25, 1)
    for ask in (lambda: make_estimator("affine", rig), lambda: estimate(log, rig, "affine")):
        with pytest.raises(
            EstimationError, match=r"affine: .*it needs \[affine\] in the rig file .*--homing 3s"
        ):
            ask()


def test_a_map_of_other_sensors_is_refused(rig: Rig) -> None:
    known = learn_affine(logs_of(26, 3), rig).rig
    raw = known.model_dump()
    kept = [sensor for sensor in raw["sensors"] if sensor["name"] != "encoder"]
    added = {
        **kept[1],
        "name": "second",
        "column": "second",
        "measures": "tension",
        "of": "opening",
        "unit": "N",
    }
    for key in ("torque_constant", "torque_constant_motor", "gear", "lever", "si"):
        added.pop(key)
    with pytest.raises(
        EstimationError,
        match=r"was learned from the sensors motor_angle, motor_torque, the rig now has",
    ):
        make_estimator("affine", build_rig({**raw, "sensors": [*kept, added]}, "more"))


def test_logs_without_truth_teach_nothing(rig: Rig) -> None:
    (log,) = logs_of(27, 1)
    blind = Log(log.time, log.channels)
    with pytest.raises(FitError, match="none of the 1 logs has the joint's angle"):
        learn_affine(blind, rig)
    with pytest.raises(EstimationError, match="homing needs the joint's angle"):
        estimate(blind, rig, "affine", homing=3.0)
    short = Log(
        log.time, log.channels, {"theta": np.where(log.time < 0.05, log.truth["theta"], np.nan)}
    )
    with pytest.raises(
        EstimationError, match=r"has 3 samples with a reference, affine needs 5 or more"
    ):
        estimate(short, rig, "affine", homing=3.0)


def test_a_filter_begins_where_the_map_says() -> None:
    """b0 + Σ b z with its variance, where that is surer than the rig; not without a reading, nor
    far outside.
    """
    rig = load_rig("capstan-joint").with_values({"joints.0.initial": {"value": 0.3, "std": 0.2}})
    joint = {"joint": "jaw", "coefficients": [0.1, 0.4, -0.05, 0.01], "std": 0.004}
    covariance = np.diag([1e-6, 4e-6, 9e-6, 0.0])
    affine = {
        "channels": ["motor_angle", "motor_torque"],
        "centre": [0.2, 0.05],
        "scale": [0.5, 0.1],
        "low": [-0.6, -0.2],
        "high": [0.8, 0.2],
        "rate": [0.5, 0.1],
        "terms": ["1", "motor_angle", "motor_torque", "slip(motor_angle)"],
        "width": [0.002, 1.0],
        "spread": [0.0],
        "band": [1.0],
        "distance": [[1.0, 0.0], [0.0, 1.0]],
        "reach": 3.0,
        "correlation_time": 0.2,
        "logs": 3,
        "joints": [{**joint, "covariance": covariance.tolist()}],
    }
    estimator = make_estimator("adaptive", rig.with_values({"affine": affine}), compiled=False)
    n = len(estimator.state_names)
    z = np.array([1.0, 0.4, -1.5])
    first = estimator.initial(0.0, np.array([0.4, -0.1]))
    assert first.kernel_state[0] == pytest.approx(0.1 + 0.4 * 0.4 + 0.05 * 1.5, abs=1e-12)
    expected = z @ covariance[:3, :3] @ z + 0.004**2 + 0.01**2
    assert first.kernel_state[n] == pytest.approx(expected, rel=1e-9)
    further = estimator.initial(
        0.0, np.array([0.8 + 0.7 * 0.5, -0.1])
    )  # half of half the range beyond its end
    assert further.kernel_state[n] > 20 * expected
    for sample in ([0.4, np.nan], [0.8 + 0.7 * 1.5, -0.1]):
        plain = estimator.initial(0.0, np.array(sample))
        assert (plain.kernel_state[0], plain.kernel_state[n]) == pytest.approx((0.3, 0.2**2))
    surer = rig.with_values({"affine": affine, "joints.0.initial.std": 0.001})
    begun = make_estimator("adaptive", surer, compiled=False).initial(0.0, np.array([0.4, -0.1]))
    assert begun.kernel_state[0] == pytest.approx(0.3)


def test_a_filter_begins_where_a_play_may_be(rig: Rig) -> None:
    """At the first reading a play is there, give or take its half-width: its coefficient counts,
    and its room is doubt.
    """
    made = learn_affine(logs_of(6, 5, noise=0.002), rig).learned
    joint = made.joints[0]
    size = len(joint.coefficients)
    whole = replace_terms(made, joint, size)
    readings = {
        name: (made.centre[i] + 0.5 * made.scale[i], 1.0) for i, name in enumerate(made.channels)
    }
    before, after = (start_of(each, 0, readings) for each in (made, whole))
    assert float(after[0]) == pytest.approx(float(before[0]) + 0.3 * 0.5)
    assert float(after[1]) == pytest.approx(float(before[1]) + (0.3 * 0.2) ** 2 / 3.0)


def test_a_filter_begins_with_products_in_doubt_and_the_share_of_the_scatter(rig: Rig) -> None:
    """A product adds its squared coefficient to the variance; of φᵀ C φ the share g² counts."""
    made = learn_affine(logs_of(6, 5, noise=0.002, spread=0.02), rig).learned
    joint = made.joints[0]
    first, second = made.channels
    whole = replace_terms(made, joint, len(joint.coefficients), f"{first}*{second}")
    readings = {
        name: (made.centre[i] + 0.5 * made.scale[i], 1.0) for i, name in enumerate(made.channels)
    }
    before, after = (start_of(each, 0, readings) for each in (made, whole))
    assert float(after[0]) == pytest.approx(float(before[0]))
    assert float(after[1]) == pytest.approx(float(before[1]) + 0.3**2)
    all_of_it = made.model_copy(update={"between": 1.0})
    half = made.model_copy(update={"between": 0.5})
    phi = np.array([1.0, 0.5, 0.5])
    scatter = made.band[0] ** 2 * (phi @ np.array(joint.covariance) @ phi)
    difference = float(start_of(all_of_it, 0, readings)[1]) - float(start_of(half, 0, readings)[1])
    assert difference == pytest.approx(0.75 * scatter)


def replace_terms(made: Affine, joint: JointMap, size: int, term: str = "") -> Affine:
    """Return the map with another term, else a play of its first channel, half-width 0.2, whose
    coefficient is 0.3 for certain.
    """
    covariance = np.zeros((size + 1, size + 1))
    covariance[:size, :size] = joint.covariance
    rows = tuple(tuple(float(value) for value in row) for row in covariance)
    wider = joint.model_copy(
        update={"coefficients": (*joint.coefficients, 0.3), "covariance": rows}
    )
    terms = (*made.terms, term or f"play({made.channels[0]})")
    width = (0.2,) * len(made.channels)
    return made.model_copy(update={"terms": terms, "width": width, "joints": (wider,)})
