"""What is learned of the model's error: the correction and its band against a naive copy, its
range, homing, refusals.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from distal import (
    LiveEstimator,
    Log,
    Monitor,
    Rig,
    estimate,
    estimate_batch,
    load_rig,
    make_estimator,
    smooth,
)
from distal.errors import EstimationError, RigError
from distal.estimators import AdaptiveFilter
from distal.export.source import c_filter
from distal.fitting.fitted_file import fitted_text
from distal.fitting.fitted_file import plain_value as table_of
from distal.logs import write_log
from distal.regression import Samples, calibrate_window, design
from distal.rig import Discrepancy, JointMap, build_rig, parse_toml
from distal.run import samples_of
from tests.export.test_export import build, needs_compiler, replayed

Floats = NDArray[np.float64]

TERMS = (
    "1",
    "motor_angle",
    "motor_angle*motor_torque",
    "play(motor_torque)",
    "motor_torque*abs(motor_torque)",
    "angle(jaw)",
)


@pytest.mark.parametrize(
    ("terms", "used"),
    [
        (("1", "motor_angle"), (0,)),
        (("1", "motor_torque"), (1,)),
        (("1", "play(motor_angle)*motor_torque"), (0, 1)),
        (("1",), ()),
        (("1", "motor_torque", "angle(jaw)"), (1, 2)),
    ],
)
def test_a_reading_counts_as_used_where_it_stands_in_a_term(
    terms: tuple[str, ...], used: tuple[int, ...]
) -> None:
    """Only what stands in a term is held within its range: each reading by its own name."""
    assert made().model_copy(update={"terms": terms}).used == used


@pytest.fixture(scope="module")
def plain() -> Rig:
    return load_rig("capstan-joint")


def made(own: float = 0.5) -> Discrepancy:
    """Return a discrepancy with all kinds of terms, its numbers drawn."""
    rng = np.random.default_rng(8)
    root = 0.004 * rng.normal(size=(6, 6))
    covariance = root @ root.T
    return Discrepancy(
        terms=TERMS,
        channels=("motor_angle", "motor_torque"),
        centre=(0.05, 0.01, 0.02),
        scale=(0.3, 0.04, 0.2),
        low=(-0.5, -0.1, -0.4),
        high=(0.6, 0.12, 0.5),
        rate=(0.8, 0.3, 0.5),
        width=(0.4, 0.4),
        band=(1.0,),
        distance=((1.2, 0.3), (0.3, 0.9)),
        reach=2.2,
        correlation_time=0.1,
        own=own,
        between=0.7,
        spread=(0.03,),
        stays=(0.02,),
        moves=("motor_angle",),
        apart=((0.5, 1.0, 0.0, -1.0, 0.0, 3.0),),
        logs=7,
        joints=(
            JointMap(
                joint="jaw",
                coefficients=(0.01, -0.02, 0.015, 0.02, -0.01, -0.3),
                covariance=tuple(tuple(map(float, row)) for row in covariance),
                std=0.006,
            ),
        ),
    )


@pytest.fixture(scope="module")
def rig(plain: Rig) -> Rig:
    return plain.with_values({"discrepancy": made().model_dump()})


@pytest.fixture(scope="module")
def log() -> Log:
    """A motion beyond the learned range, with torques missing for a while."""
    time = np.arange(0.0, 2.0, 0.005)
    angle = 0.9 * np.sin(2 * np.pi * 0.7 * time)
    torque = 0.08 * np.sin(2 * np.pi * 0.7 * time + 0.4) + 0.02 * np.sin(15 * time)
    torque[100:130] = np.nan
    return Log(time, {"motor_angle": angle, "motor_torque": torque}, {"theta": 0.6 * angle})


def naive(
    d: Discrepancy, position: Floats, torque: Floats, angle: Floats, own: Floats, dt: float
) -> tuple[Floats, Floats]:
    """Return δ and the variance of the corrected angle, sample by sample, from
    docs/explanation/discrepancy.md.
    """
    b, covariance, std = (
        np.array(d.joints[0].coefficients),
        np.array(d.joints[0].covariance),
        d.joints[0].std,
    )
    low, high, centre, scale = (np.array(x) for x in (d.low, d.high, d.centre, d.scale))
    half = (high - low) / 2
    held, age, play = d.centre[1], 1e6, None
    trail, kept = None, 0.0
    deltas, variances = [], []
    for s, u, theta, variance in zip(position, torque, angle, own):
        held, age = (u, 0.0) if np.isfinite(u) else (held, age + dt)
        raw = np.array([s, held, theta])
        middle = (low + high) / 2
        drawn = 1.5 / max(1.5, *(np.abs(raw - middle) / half))
        x, y, a = (middle + drawn * (raw - middle) - centre) / scale
        play = y if play is None else min(max(play, y - d.width[1]), y + d.width[1])
        phi = np.array([1.0, x, x * y, play, y * abs(y), a])
        z = (raw[:2] - centre[:2]) / scale[:2]
        far = max(
            0.0,
            np.sqrt(z @ np.array(d.distance) @ z) / d.reach - 1.0,
            *((low - raw) / half),
            *((raw - high) / half),
        )
        faded = 1.0 / (1.0 + (4.0 * far) ** 2)
        inner = min(max(s, low[0]), high[0])
        before = inner if trail is None else trail
        trail = min(max(before, inner - 0.1 * half[0]), inner + 0.1 * half[0])
        way = min(abs(trail - before), d.rate[0] * dt) / (2.0 * half[0])
        kept = max(far, kept * np.exp(-way))
        phi[1:] *= faded
        total = (
            d.between**2 * (phi @ covariance @ phi) + std**2 + far**2 * (std**2 + d.spread[0] ** 2)
        )
        total += (kept * d.stays[0]) ** 2
        inside = low[2] - 0.5 * half[2] < theta < high[2] + 0.5 * half[2]
        total += (
            d.own * (1.0 + (faded * drawn * b[5] / scale[2] if inside else 0.0))
        ) ** 2 * variance
        if age > 0.0 and low[1] - 0.5 * half[1] < held < high[1] + 0.5 * half[1]:
            step = 1e-6
            ends = []
            for moved in (held - step, held + step):
                m = (middle[1] + drawn * (moved - middle[1]) - centre[1]) / scale[1]
                p = (
                    min(max(play, m - d.width[1]), m + d.width[1])
                    if abs(abs(y - play) - d.width[1]) < 1e-12
                    else play
                )
                ends.append(b[2] * x * m + b[3] * p + b[4] * m * abs(m))
            total += (
                faded * (ends[1] - ends[0]) / (2 * step) * min(d.rate[1] * age, 2 * half[1])
            ) ** 2
        deltas.append(float(phi @ b))
        variances.append(float(total))
    return np.array(deltas), np.array(variances)


def test_the_correction_and_its_band(plain: Rig, rig: Rig, log: Log) -> None:
    """Against a naive copy: inside the range and beyond it, with readings there and missing."""
    bare, corrected = estimate(log, plain, compiled=False), estimate(log, rig, compiled=False)
    estimator = AdaptiveFilter(plain, compiled=False)
    samples = samples_of(log, estimator.channels)
    belief = estimator.initial(log.time[0], samples[0])
    rows, last = estimator.checked_rows(belief, log.time, samples)
    position = estimator.kernel.scan(belief.kernel_state, rows, estimator.parameters)[0][last][
        :, estimator.positions[0]
    ]
    deltas, variances = naive(
        made(), position, log.channels["motor_torque"], bare.theta, bare.theta_std**2, 0.005
    )
    np.testing.assert_allclose(corrected.theta - bare.theta, deltas, rtol=0, atol=1e-12)
    there = np.ones(len(log), dtype=bool)
    # where the play turns over while the reading is missing its slope has two values
    there[100:130] = np.abs(corrected.theta_std**2 / variances - 1.0)[100:130] < 0.9
    np.testing.assert_allclose(corrected.theta_std[there] ** 2, variances[there], rtol=1e-6)
    whole = {**log.channels, "motor_torque": np.nan_to_num(log.channels["motor_torque"], nan=0.05)}
    known = estimate(Log(log.time, whole, log.truth), rig, compiled=False)
    assert (
        corrected.theta_std[128] > 1.2 * known.theta_std[128]
    )  # a torque that is missing is not told as known


def test_a_reading_that_is_missing_loses_its_worth_with_time(plain: Rig) -> None:
    """At rest, with nothing of the filter's own doubt: what is added to the variance is
    (∂δ/∂reading · rate · age)².
    """
    rig = plain.with_values({"discrepancy": made(own=0.0).model_dump()})
    time = np.arange(0.0, 1.0, 0.005)
    torque = np.full(len(time), 0.03)
    torque[50:] = np.nan
    log = Log(time, {"motor_angle": np.full(len(time), 0.2), "motor_torque": torque})
    variance = estimate(log, rig, compiled=False).theta_std ** 2
    added = np.sqrt(variance[50:] - variance[49])
    age = 0.005 * np.arange(1, len(added) + 1)
    b, d = made().joints[0].coefficients, made()
    x, y = (0.2 - d.centre[0]) / d.scale[0], (0.03 - d.centre[1]) / d.scale[1]
    slope = abs(b[2] * x + 2 * b[4] * y) / d.scale[1]  # the play rests
    np.testing.assert_allclose(added[:60], slope * d.rate[1] * age[:60], rtol=0.02)
    assert (
        added[-1] <= slope * 2 * 0.5 * (d.high[1] - d.low[1]) * 1.02
    )  # never more than the whole range


def test_members_that_are_far_apart_are_no_good_health(rig: Rig) -> None:
    """Mean squares over a second: of 2² after a second 4 (1 − 1/e) = 2.53, above 2.5."""
    assert rig.discrepancy is not None
    time = np.arange(0.0, 3.0, 0.005)
    noise = np.random.default_rng(3).normal(size=(2, len(time)))
    position, torque = 0.05 + 4e-4 * noise[0], 0.01 + 2e-3 * noise[1]
    log = Log(time, {"motor_angle": position, "motor_torque": torque})
    for constant, is_wrong in ((2.0, True), (1.5, False)):
        row = (constant, 0.0, 0.0, 0.0, 0.0, 0.0)
        of_row = rig.discrepancy.model_copy(update={"apart": (row,)})
        changed = rig.with_values({"discrepancy": of_row.model_dump()})
        monitor = Monitor(LiveEstimator(changed, compiled=False))
        samples = samples_of(log, monitor.channels)
        readings = [monitor.take(float(t), sample) for t, sample in zip(time, samples)]
        said = np.array(["blend" in reading.detail for reading in readings])
        assert said[210:].all() == said.any() == is_wrong
        assert not said[:190].any()
        if is_wrong:
            assert readings[-1].health == "disagrees"


def test_the_filters_own_state_goes_on_without_it(plain: Rig, rig: Rig, log: Log) -> None:
    bare, corrected = estimate(log, plain, compiled=False), estimate(log, rig, compiled=False)
    np.testing.assert_allclose(corrected.means[:, 1:], bare.means[:, 1:], rtol=0, atol=1e-11)
    np.testing.assert_allclose(corrected.innovations, bare.innovations, rtol=0, atol=1e-11)
    assert corrected.covariances is not None
    assert bare.covariances is not None
    np.testing.assert_allclose(
        corrected.covariances[:, 1:, 1:], bare.covariances[:, 1:, 1:], rtol=0, atol=1e-11
    )


def test_sample_by_sample_live_and_in_a_batch(rig: Rig, log: Log) -> None:
    whole = estimate(log, rig, compiled=False)
    estimator = make_estimator("adaptive", rig, compiled=False)
    live, samples = LiveEstimator(rig, estimator), samples_of(log, estimator.channels)
    belief = estimator.initial(log.time[0], samples[0])
    for k, (time, sample) in enumerate(zip(log.time, samples)):
        belief, _ = estimator.step(belief, time, sample)
        assert live.step(time, sample) == whole.theta[k]
        assert live.angle_std == pytest.approx(whole.theta_std[k], rel=1e-14)
    np.testing.assert_array_equal(belief.mean, whole.means[-1])
    both = list(estimate_batch([log, log], rig, compiled=False))
    np.testing.assert_allclose(both[1].theta, whole.theta, rtol=0, atol=1e-12)


@needs_compiler
@pytest.mark.parametrize("single", [False, pytest.param(True, marks=pytest.mark.slow)])
def test_in_c(rig: Rig, log: Log, single: bool, tmp_path: Path) -> None:
    """The exported filter has the correction too."""
    write_log(log, rig, tmp_path / "log.csv")
    rows = replayed(build(c_filter(rig, "adaptive", single), tmp_path, "-O2"), tmp_path / "log.csv")
    known = estimate(log, rig, compiled=False)
    tolerance = np.deg2rad(0.02) if single else 1e-9
    np.testing.assert_allclose(rows[:, 1], known.theta, atol=tolerance)
    np.testing.assert_allclose(rows[:, 2], known.theta_std, atol=tolerance)


def test_the_smoother_adds_the_same(plain: Rig, rig: Rig, log: Log) -> None:
    bare, corrected = (smooth(log, each, compiled=False) for each in (plain, rig))
    filtered = estimate(log, rig, compiled=False).theta - estimate(log, plain, compiled=False).theta
    np.testing.assert_allclose(corrected.theta - bare.theta, filtered, rtol=0, atol=1e-10)


def drawn(rng: np.random.Generator, b: Floats, d: Discrepancy) -> Samples:
    """Return a run whose angle errs by the terms with coefficients b, and white noise."""
    time = np.arange(0.0, 4.0, 0.01)
    readings = np.column_stack([0.4 * np.sin(3 * time), 0.08 * np.cos(5 * time)])
    angles = (0.3 * np.sin(3 * time + 0.2))[:, None]
    none, own = np.zeros_like(angles), np.full_like(angles, 1e-6)
    run = Samples("run", time, readings, angles, none, own, 0.01)
    left = design(d, run) @ b + d.joints[0].std * rng.normal(size=len(time))
    return Samples("run", time, readings, angles, left[:, None], own, 0.01)


def test_homing_is_bayes_rule() -> None:
    """The posterior of a linear Gaussian model, by its normal equations."""
    d = made().model_copy(update={"correlation_time": 0.03})  # three samples count as one
    rng = np.random.default_rng(3)
    own = d.joints[0]
    b = rng.multivariate_normal(np.array(own.coefficients), np.array(own.covariance))
    run = drawn(rng, b, d)
    window = run.time < 1.0
    after, surprise = calibrate_window(d, run, window)
    x, y = design(d, run)[window], run.targets[window, 0]
    prior = np.linalg.inv(np.array(own.covariance))
    information = prior + x.T @ x / (3 * own.std**2)
    mean = np.linalg.solve(
        information, prior @ np.array(own.coefficients) + x.T @ y / (3 * own.std**2)
    )
    np.testing.assert_allclose(after.joints[0].coefficients, mean, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(
        after.joints[0].covariance, np.linalg.inv(information), rtol=1e-5, atol=1e-12
    )
    assert surprise < 3.0
    # an angle that is off by far more than any log was makes the prior count less
    far = Samples(**{**run.__dict__, "targets": run.targets + 0.5})
    widened, surprise = calibrate_window(d, far, window)
    assert surprise > 3.0
    left = design(d, far) @ np.array(widened.joints[0].coefficients) - far.targets[:, 0]
    assert np.sqrt(np.mean(left[window] ** 2)) < 2 * own.std


def test_it_is_written_and_read(plain: Rig, rig: Rig) -> None:
    text = fitted_text(rig, plain, {"discrepancy": table_of(made().model_dump())}, "", None)
    assert build_rig(parse_toml(text, "again", RigError), "again") == rig


def test_refusals(plain: Rig, rig: Rig) -> None:
    raw = made().model_dump()
    for change, said in (
        ({"terms": ("1", "motor_angel")}, "'motor_angel' is no variable"),
        ({"low": (0.0, 0.0)}, "low must have 3 entries"),
        ({"low": (9.0, 9.0, 9.0)}, "low must not be above high"),
        ({"scale": (1.0, 0.0, 1.0)}, "every scale, width and band must be positive"),
        (
            {"channels": ("motor_angle", "torque"), "terms": (*TERMS[:2], *["torque"] * 4)},
            "no sensor is called 'torque'",
        ),
        ({"spread": (0.1, 0.1)}, "spread must have 1 entries"),
        ({"terms": ("1",)}, "1 coefficients are needed"),
    ):
        with pytest.raises(RigError, match=said):
            plain.with_values({"discrepancy": {**raw, **change}})
    swapped = rig.model_dump()
    swapped["sensors"] = [one for one in swapped["sensors"] if one["name"] != "motor_torque"]
    with pytest.raises(RigError, match="no sensor is called 'motor_torque'"):
        build_rig(swapped, "swapped")
    fewer = {**raw, "channels": ("motor_torque", "motor_angle")}
    with pytest.raises(
        EstimationError,
        match=r"was learned from the sensors motor_torque, motor_angle.*learn it again",
    ):
        make_estimator(
            "adaptive",
            plain.with_values({"discrepancy": {**fewer, "terms": TERMS}}),
            compiled=False,
        )
