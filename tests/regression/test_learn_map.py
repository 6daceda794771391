"""The pipeline of learned maps on data whose answer is known: terms, coefficients, bands, what is
known of few logs.
"""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal.errors import FitError
from distal.regression import (
    Samples,
    as_discrepancy,
    calibrate_band,
    calibrate_window,
    discrepancy_kind,
    fit_coefficients,
    inflate_band,
    learn_map,
    outside,
    predict,
    rms_beyond_noise,
    sized_by,
)
from distal.regression.affine import affine_kind
from distal.regression.band import widened_between
from distal.regression.beyond_homing import cost_beyond
from distal.regression.features import (
    beyond_homing,
    drawn_in,
    fade,
    half_ranges,
    limits,
    middles,
    squared_distances,
)
from distal.regression.learn_map import Kind, Terms, choose_terms, frame, held_out
from distal.regression.map_function import map_coefficients_of, map_function, memory_size
from distal.rig import Discrepancy

CHANNELS, NOISE = ("a", "b"), np.array([1e-3, 1e-3])


def run(
    seed: int, offset: float = 0.0, noise: float = 0.01, joints: int = 1, turning: float = 0.0
) -> Samples:
    """A log whose targets are 0.5 a − 0.2 b + offset, for each joint once more as large."""
    rng, time = np.random.default_rng(seed), np.arange(0.0, 8.0, 0.02)
    a, b = np.sin(1.3 * time + rng.uniform(0, 6)), np.cos(2.1 * time + rng.uniform(0, 6))
    line = 0.5 * a - 0.2 * b + offset + turning * np.sign(np.gradient(a))
    targets = np.column_stack([(j + 1) * line for j in range(joints)]) + noise * rng.normal(
        size=(len(time), joints)
    )
    none = np.zeros((len(time), joints))
    return Samples(
        f"log {seed}", time, np.column_stack([a, b]), np.zeros((len(time), 0)), targets, none, 0.02
    )


def kind(joints: int = 1) -> Kind:
    return affine_kind(CHANNELS, ("a",), [f"j{j}" for j in range(joints)], NOISE)


def test_each_joint_has_its_own_line() -> None:
    data = [run(seed, joints=2) for seed in range(5)]
    learned, _ = learn_map(data, kind(2), range(5), None)
    for j, joint in enumerate(learned.joints):
        slopes = np.array(joint.coefficients[1:3]) / np.array(learned.scale)
        np.testing.assert_allclose(slopes, (j + 1) * np.array([0.5, -0.2]), atol=0.01)
        assert joint.std == pytest.approx(0.01, rel=0.1)


def test_terms_are_taken_where_logs_left_out_gain() -> None:
    plain = choose_terms([run(seed) for seed in range(5)], kind(), range(5), None)
    turning = choose_terms([run(seed, turning=0.05) for seed in range(5)], kind(), range(5), None)
    assert "slip(a)" not in plain.terms
    assert "slip(a)" in turning.terms


def test_a_band_holds_what_logs_left_out_err_by() -> None:
    """Offsets that differ from log to log by 0.1: 95 % of new logs are inside, and hardly more."""
    rng = np.random.default_rng(9)
    data = [run(seed, offset=0.1 * rng.normal()) for seed in range(14)]
    learned = calibrate_band(data, kind(), kind().sets[0], range(14), None)
    shares = []
    for seed in range(100, 160):
        out = run(seed, offset=0.1 * rng.normal())
        said = predict(learned, out)
        shares.append(
            np.mean(np.abs(said.values - out.targets[:, 0]) < 1.96 * np.sqrt(said.variances))
        )
    assert 0.85 < np.mean(shares) <= 1.0
    wider = predict(inflate_band(learned, [2.0]), data[0])
    np.testing.assert_allclose(wider.variances, 4.0 * predict(learned, data[0]).variances)


@pytest.mark.parametrize(("size", "share"), [(1.0, 1.0), (4.0, 0.5)])
def test_coefficients_count_less_where_held_out_logs_show_that_they_scatter_less(
    size: float, share: float
) -> None:
    """With covariances `size`² times as large as they are the band is still as wide as 95 % of
    held-out errors need: between the second largest offset of 14 and the largest with noise.
    """
    offsets = 0.1 * np.random.default_rng(10).normal(size=14)
    data = [run(seed, offset=offset) for seed, offset in enumerate(offsets)]
    learned = fit_coefficients(data, kind(), kind().sets[0])
    held = [
        (widened_between(fold, size), log)
        for fold, log in held_out(data, kind(), kind().sets[0], range(14))
    ]
    found = sized_by(widened_between(learned, size), kind(), range(14), held)
    assert found.between == share
    second, largest = np.sort(np.abs(offsets - offsets.mean()))[-2:] * 14 / 13
    half = 1.96 * np.mean(np.sqrt(predict(found, data[0]).variances))
    assert second < half < largest + 1.96 * 0.01


def test_fewer_logs_are_less_sure_of_what_differs_between_them() -> None:
    rng = np.random.default_rng(4)
    data = [run(seed, offset=0.1 * rng.normal()) for seed in range(8)]
    spread = [
        learn_map(data[:n], kind(), range(n), 2.0)[0].joints[0].covariance[0][0] for n in (2, 8)
    ]
    assert spread[0] > 4.0 * spread[1]


def test_few_logs_widen_a_band_less_where_held_out_logs_sized_it() -> None:
    """Four logs: t(3) = 3.182 and 1.960, whose ratio stays whole before a homing window."""
    rng = np.random.default_rng(6)
    data, one = [run(seed, offset=0.1 * rng.normal()) for seed in range(4)], kind().sets[0]
    alone = np.array(fit_coefficients(data, kind(), one).joints[0].covariance)
    whole = np.array(calibrate_band(data, kind(), one, range(4), 2.0).joints[0].covariance)
    sized = np.array(calibrate_band(data, kind(), one, range(4), None).joints[0].covariance)
    np.testing.assert_allclose(whole, (3.182 / 1.960) ** 2 * alone, rtol=1e-3, atol=1e-12)
    np.testing.assert_allclose(sized, 3.182 / 1.960 * alone, rtol=1e-3, atol=1e-12)


def test_groups_of_logs_keep_the_prior_that_a_homing_window_is_weighed_against() -> None:
    """Eight logs of two groups scatter as eight draws, unless the kind counts groups, of which two
    tell hardly anything.
    """
    rng = np.random.default_rng(5)
    data, one = [run(seed, offset=0.1 * rng.normal()) for seed in range(8)], kind().sets[0]
    folds = [0] * 4 + [1] * 4
    alone = np.array(fit_coefficients(data, kind(), one).joints[0].covariance)
    of_logs = np.array(calibrate_band(data, kind(), one, folds, 2.0).joints[0].covariance)
    of_groups = np.array(
        calibrate_band(data, replace(kind(), by_group=True), one, folds, 2.0).joints[0].covariance
    )
    np.testing.assert_array_equal(of_logs, alone)
    assert discrepancy_kind(
        CHANNELS, CHANNELS, (), ("j0",), NOISE
    ).by_group  # its filter was fitted to all groups
    np.testing.assert_allclose(of_groups, (12.706 / 1.960) ** 2 * alone, rtol=1e-3, atol=1e-12)


def test_a_joint_that_one_log_knows() -> None:
    """Without that log nothing is known of it: it is not left out; a joint that none knows is
    refused by name.
    """
    data = [run(seed, joints=2) for seed in range(2)]
    blind = data[1].targets.copy()
    blind[:, 1] = np.nan
    learned, _ = learn_map([data[0], replace(data[1], targets=blind)], kind(2), range(2), None)
    assert np.isfinite(learned.joints[1].coefficients).all()
    with pytest.raises(FitError, match="'j1' is known in no log"):
        fit_coefficients([replace(data[1], targets=blind)], kind(2), kind(2).sets[0])


def test_what_is_smaller_than_the_references_noise_is_not_corrected() -> None:
    made = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE)
    data = [replace(run(seed), angles=run(seed).targets, reference_std=1.0) for seed in range(4)]
    assert not choose_terms(data, made, range(4), None).corrects
    sharp = [replace(one, reference_std=1e-4) for one in data]
    assert choose_terms(sharp, made, range(4), None).corrects


def test_a_filter_can_say_what_affine_says() -> None:
    """With its own angle and error taken off, within the learned range and beyond it."""
    rng = np.random.default_rng(2)
    data = [run(seed, turning=0.02) for seed in range(5)]
    line, _ = learn_map(data, kind(), range(5), None)
    own = [
        replace(one, angles=one.targets + 0.1 * rng.normal(size=one.targets.shape)) for one in data
    ]
    made = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE)
    frame = calibrate_band(own, made, made.sets[0], range(5), None)
    both = as_discrepancy(line, frame)
    assert not both.tracked  # it reads as the line does, not where the filter has the drives
    seen = replace(own[2], variances=np.ones((400, 1)))
    known, said = predict(line, data[2]), predict(both, seen)
    inside = np.abs(own[2].angles[:, 0] - np.mean([frame.low[2], frame.high[2]])) < 0.5 * (
        frame.high[2] - frame.low[2]
    )
    np.testing.assert_allclose(
        (said.values + own[2].angles[:, 0])[inside], known.values[inside], atol=1e-12
    )
    np.testing.assert_allclose(said.variances[inside], known.variances[inside], rtol=1e-9)
    np.testing.assert_allclose(said.filter_variances[inside], 0.0, atol=1e-20)
    far = replace(seen, angles=seen.angles + 50.0)
    beyond = replace(far, readings=3.0 * far.readings)
    assert outside(both, beyond).min() > 0.0
    going_on = predict(both, beyond)
    np.testing.assert_allclose(
        going_on.values + beyond.angles[:, 0], predict(line, beyond).values, atol=1e-9
    )
    np.testing.assert_allclose(going_on.filter_variances, 0.0, atol=1e-20)


@given(st.floats(1.0, 20.0), st.floats(-1.0, 1.0), st.booleans())
def test_coefficients_that_cancel_inside_the_range_cancel_beyond_it(
    far: float, turn: float, negative: bool
) -> None:
    """Two readings of one motion with opposite coefficients say nothing together, also where one
    range ends earlier.
    """
    learned = fit_coefficients([run(0)], kind(), kind().sets[0])
    at = [learned.terms.index(name) for name in CHANNELS]
    coefficients = np.zeros(len(learned.terms))
    coefficients[at] = (50.0, -50.0)
    own = learned.joints[0].model_copy(update={"coefficients": tuple(coefficients)})
    raw = {
        **learned.model_dump(),
        "centre": (0.0, 0.0),
        "scale": (1.0, 1.0),
        "low": (-1.0, -0.6),
        "high": (1.0, 0.6),
    }
    held = Discrepancy.model_validate({**raw, "joints": (own.model_dump(),)})
    motion = far * (-1.0 if negative else 1.0)
    readings, none = np.array([[motion, motion], [motion, turn * motion]]), np.zeros((2, 1))
    one = replace(
        run(0),
        time=np.arange(2.0),
        readings=readings,
        angles=none[:, :0],
        targets=none,
        variances=none,
    )
    values = predict(held, one).values
    assert values[0] == pytest.approx(0.0, abs=1e-9)
    # 1.5 halves of a range beyond its middle a point stays where the way to the middle leaves
    share = min(1.0, 1.5 / far, 0.9 / max(abs(turn) * far, 1e-12))
    assert values[1] == pytest.approx(50.0 * share * (motion - turn * motion), abs=1e-9)


def lacking(seed: int, slope: float) -> Samples:
    """A log of a filter whose angle covers ±1 rad, and that errs by a slope of its own beyond 0,
    where it was not homed.
    """
    one = run(seed)
    angle = -np.sin(0.9 * one.time)[:, None]
    error = 0.001 * np.random.default_rng(seed).normal(size=angle.shape) + slope * np.maximum(
        angle, 0.0
    )
    usable = angle[:, 0] < 0.0 if slope else None
    return replace(
        one, angles=angle, targets=error, variances=np.full(angle.shape, 1e-6), usable=usable
    )


def test_a_motion_beyond_the_homing_move_widens_the_band_by_what_logs_left_out_erred_by() -> None:
    """Slopes of ±0.1 rad/rad beyond the move are κ = 0.1; within what it covered the band stays as
    it was.
    """
    made = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE)
    data = [lacking(seed, 0.0) for seed in range(5)]
    partly = {i: lacking(10 + i, 0.1 * (-1) ** i) for i in range(5)}
    learned, _ = learn_map(data, made, range(5), 4.0, partly)
    assert learned.extrapolation[0] == pytest.approx(0.1, rel=0.1)
    assert learn_map(data, made, range(5), 4.0)[0].extrapolation == ()
    after, _ = calibrate_window(learned, partly[0], partly[0].window(4.0))
    without = predict(after.model_copy(update={"extrapolation": ()}), partly[0])
    said = predict(after, partly[0])
    h = np.maximum(0.0, partly[0].angles[:, 0] + said.values - after.homed[0][1])
    np.testing.assert_allclose(
        said.variances - without.variances, (learned.extrapolation[0] * h) ** 2, atol=1e-12
    )
    assert np.mean(h == 0.0) > 0.4
    mirrored = replace(
        partly[0], angles=-partly[0].angles, targets=-partly[0].targets
    )  # goes beyond the other end
    below, _ = calibrate_window(learned, mirrored, mirrored.window(4.0))
    for one, after_move in ((partly[0], after), (mirrored, below)):
        function, identified = map_function(after_move, 2, [False, False]), predict(after_move, one)
        memory = np.concatenate([one.readings[0], np.zeros(2), np.zeros(len(after_move.played))])
        assert beyond_homing(after_move, one, 0, identified.values).max() > 0.5
        for k in range(0, 400, 40):
            x = np.concatenate([[0.02], one.readings[k], np.ones(2)])
            *_, variance, _, _ = function(
                memory, x, np.zeros(2), one.angles[k], map_coefficients_of(after_move)
            )
            assert float(variance) == pytest.approx(identified.variances[k], rel=1e-9)


def test_what_the_band_holds_already_is_no_cost_of_extrapolation() -> None:
    """κ² = (mean e² − mean v)/mean h²: a filter that is less sure of its own angle leaves less to
    κ.
    """
    made, out = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE), lacking(10, 0.1)
    learned = fit_coefficients([lacking(seed, 0.0) for seed in range(5)], made, made.sets[1])
    after, _ = calibrate_window(learned, out, out.window(4.0))
    unsure = replace(out, variances=np.full(out.variances.shape, 0.03**2))
    sure, less = (cost_beyond(after, one, 0, 4.0) for one in (out, unsure))
    assert sure is not None
    assert less is not None
    wider = cost_beyond(inflate_band(after, [5.0]), out, 0, 4.0)
    assert wider is not None
    assert wider < sure
    h = beyond_homing(after, out, 0, predict(after, out).values)[(out.time >= 4.0)]
    assert sure**2 - less**2 == pytest.approx((0.03**2 - 1e-6) / np.mean(h[h > 0.0] ** 2), rel=1e-9)


def test_logs_in_which_one_drive_moves_are_taken_together() -> None:
    """A drive that rests says nothing of its coefficient there, and the log's own zero hides what
    it holds.
    """
    rng, data = np.random.default_rng(3), []
    for seed, moving in enumerate([(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1)]):
        time = run(seed).time
        a, b, c = (
            rng.uniform(-0.2, 0.2) + own * np.sin(rate * time + rng.uniform(0, 6))
            for own, rate in zip(moving, (1.3, 2.1, 0.7))
        )
        forces = 0.3 * b - 0.1 * np.sign(np.gradient(a)) * moving[0]
        readings = np.column_stack([a, b, c, forces]) + 1e-3 * rng.normal(size=(len(time), 4))
        targets = (0.5 * a - 0.2 * b + 0.4 * c + 0.05 * forces)[:, None] + 1e-3 * rng.normal(
            size=(len(time), 1)
        )
        none = np.zeros((len(time), 1))
        data.append(
            Samples(f"log {seed}", time, readings, np.zeros((len(time), 0)), targets, none, 0.02)
        )
    made = affine_kind(("a", "b", "c", "u"), ("a", "b", "c"), ["j0"], np.full(4, 1e-3))
    learned, terms = learn_map(data[:4], made, range(4), None)
    assert terms.pooled
    slopes = np.array(learned.joints[0].coefficients[1:4]) / np.array(learned.scale)[:3]
    np.testing.assert_allclose(slopes, [0.5, -0.2, 0.4], atol=0.02)


def test_a_wide_play_is_found() -> None:
    """The angle follows a play of 0.4 of the reading's half travel: directions alone do not tell
    where it turns.
    """
    data = []
    for seed in range(4):
        one = run(seed)
        at, played = one.readings[0, 0], []
        for value in one.readings[:, 0]:
            at = min(max(at, value - 0.2), value + 0.2)
            played.append(0.5 * at)
        targets = np.array(played)[:, None] + 1e-3 * np.random.default_rng(seed).normal(
            size=(len(played), 1)
        )
        data.append(replace(one, targets=targets))
    learned, terms = learn_map(data, kind(), range(4), None)
    assert "play(a)" in terms.terms
    out = predict(learned, data[0])
    assert np.sqrt(np.mean((out.values - data[0].targets[:, 0]) ** 2)) < 0.01


def test_the_usual_speed_is_that_of_the_readings() -> None:
    """RMS over all logs of changes within 0.1 s: it says by how much a held reading grows old."""
    time = np.arange(0.0, 4.0, 0.02)
    data = [
        replace(run(seed), time=time, readings=np.column_stack([rate * time, np.sin(time)]))
        for seed, rate in enumerate((2.0, -1.0))
    ]
    data = [
        replace(
            one,
            targets=one.targets[: len(time)],
            variances=one.variances[: len(time)],
            angles=one.angles[: len(time)],
        )
        for one in data
    ]
    assert fit_coefficients(data, kind(), kind().sets[0]).rate[0] == pytest.approx(
        np.sqrt((4.0 + 1.0) / 2.0)
    )


@pytest.mark.parametrize(("beyond", "share"), [(0.0, 1.0), (0.25, 0.5), (0.5, 0.2)])
def test_a_correction_fades_to_its_constant_outside_the_learned_range(
    beyond: float, share: float
) -> None:
    """1 / (1 + (d/0.25)²), d in halves of the learned range; the kernel says the same."""
    made = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE)
    data = [replace(one, angles=one.targets) for one in map(run, range(3))]
    learned = fit_coefficients(data, made, Terms("a curve", ("1", "a", "a*b")))
    assert fit_coefficients(data, made, made.sets[2]).fades_over == np.inf  # a line goes on
    half = 0.5 * (learned.high[0] - learned.low[0])
    learned = learned.model_copy(update={"reach": 1e3})  # only the single reading is outside
    readings = np.array([[learned.high[0] + beyond * half, learned.centre[1]]])
    at = replace(
        data[0].part(np.arange(400) < 1), readings=readings, angles=np.array([[learned.centre[2]]])
    )
    constant, slope = learned.joints[0].coefficients[:2]
    reached = (readings[0, 0] - learned.centre[0]) / learned.scale[0]
    expected = constant + share * slope * reached  # b is in its middle
    assert abs(slope * reached) > 1e-3
    np.testing.assert_allclose(predict(learned, at).values, expected, rtol=1e-9)
    function = map_function(learned, 2, [False, False])
    memory, x = np.zeros(memory_size(learned)), np.array([0.01, *readings[0], 1.0, 1.0])
    values, _, variances, far, _ = function(
        memory, x, np.zeros(2), at.angles[0], map_coefficients_of(learned)
    )
    np.testing.assert_allclose(float(values), expected, rtol=1e-9)
    np.testing.assert_allclose(float(far), beyond, atol=1e-12)
    np.testing.assert_allclose(float(variances), predict(learned, at).variances[0], rtol=1e-9)


def test_the_references_noise_hides_no_gain() -> None:
    """A line takes the error from 0.011 to 0.010 rad, of which the reference's noise is 0.010: all
    there is to gain.
    """
    made = discrepancy_kind(CHANNELS, CHANNELS, (), ("j0",), NOISE)
    rng = np.random.default_rng(5)
    plain = [run(seed, noise=0.0) for seed in range(5)]
    data = [replace(one, targets=0.012 * one.targets, angles=one.targets) for one in plain]
    data = [
        replace(one, targets=one.targets + 0.01 * rng.normal(size=one.targets.shape))
        for one in data
    ]
    least = rms_beyond_noise([[(one.targets[:, 0], one.time, one.time)] for one in data])
    assert 0.0105 < least < 0.0115
    assert not choose_terms(
        data, made, range(5), None
    ).corrects  # as it seems where nothing is known of the reference
    assert choose_terms(
        [replace(one, reference_std=0.0098) for one in data], made, range(5), None
    ).corrects


def test_errors_beyond_the_references_noise() -> None:
    """√(mean e² − σ²) of each log and joint, then their mean; none below 0.3 σ, and of no error
    NaN.
    """
    errors = [
        [(np.array([3.0, -3.0]), np.ones(2), np.ones(2))],
        [(np.array([1.0, 1.0]), np.ones(2), np.ones(2))],
    ]
    assert rms_beyond_noise(errors) == pytest.approx(2.0)
    assert rms_beyond_noise(errors, 2.0) == pytest.approx((np.sqrt(5.0) + 0.3 * 2.0) / 2)
    assert np.isnan(rms_beyond_noise([[(np.zeros(0), np.zeros(0), np.zeros(0))]]))


def ranged(margin: float) -> SimpleNamespace:
    """Return of a map of two readings and an angle, learned in [−1, 3], [2, 2.5] and [−0.5, 0.5],
    what says its range.
    """
    return SimpleNamespace(
        low=(-1.0, 2.0, -0.5),
        high=(3.0, 2.5, 0.5),
        centre=(0.8, 2.3, 0.1),
        scale=(0.5, 0.1, 0.2),
        used=(0, 2),
        margin=margin,
        channels=("a", "b"),
        distance=((2.0, 0.5), (0.5, 1.0)),
        reach=1.5,
        fades_over=0.5,
    )


def at(a: float, b: float, angle: float) -> Samples:
    one = np.zeros((1, 1))
    return Samples("log", np.zeros(1), np.array([[a, b]]), np.array([[angle]]), one, one, 0.01)


def test_terms_go_on_to_a_share_of_half_the_range_beyond_its_ends() -> None:
    """Just within the limits a reading enters as it is, just beyond it is drawn in; one that no
    term uses never is.
    """
    learned: Any = ranged(0.25)
    low, high = limits(learned)
    half, middle = np.array([2.0, 0.25, 0.5]), np.array([1.0, 2.25, 0.0])
    np.testing.assert_allclose(half_ranges(learned), half)
    np.testing.assert_allclose(middles(learned), middle)
    np.testing.assert_allclose(low, middle - 1.25 * half)
    np.testing.assert_allclose(high, middle + 1.25 * half)
    for end, side in ((low, -1.0), (high, 1.0)):
        for i in (0, 2):
            inside, beyond = middle.copy(), middle.copy()
            inside[i], beyond[i] = end[i] - side * 1e-6, end[i] + side * half[i]
            assert drawn_in(learned, at(*inside))[0] == 1.0
            (share,) = drawn_in(learned, at(*beyond))
            assert middle[i] + share * (beyond[i] - middle[i]) == pytest.approx(end[i])
    assert drawn_in(learned, at(1.0, 99.0, 0.0))[0] == 1.0
    assert drawn_in(cast(Any, ranged(np.inf)), at(99.0, 0.0, 0.0))[0] == 1.0
    assert half_ranges(cast(Any, SimpleNamespace(low=(1.0,), high=(1.0,))))[0] > 0.0


def test_how_far_a_log_is_outside_is_the_largest_excess() -> None:
    """One for half a range beyond an end; of a new combination of readings that of its distance zᵀ
    M z over the largest.
    """
    learned: Any = ranged(0.25)
    assert outside(learned, at(0.8, 2.3, 0.1))[0] == 0.0
    # the Mahalanobis distance is in the way of no angle
    assert outside(learned, at(0.8, 2.3, 0.5 + 0.5 * 0.7))[0] == pytest.approx(0.7)
    assert outside(learned, at(0.8, 2.3, -0.5 - 0.5 * 0.3))[0] == pytest.approx(0.3)
    z = np.array([(2.3 - 0.8) / 0.5, (2.5 - 2.3) / 0.1])
    squared = 2.0 * z[0] ** 2 + 2 * 0.5 * z[0] * z[1] + z[1] ** 2
    assert squared_distances(learned, at(2.3, 2.5, 0.0))[0] == pytest.approx(squared)
    assert outside(learned, at(2.3, 2.5, 0.0))[0] == pytest.approx(np.sqrt(squared) / 1.5 - 1.0)
    # so far beyond its range that a term counts half, and three times as far
    assert [float(fade(learned, far)) for far in (0.0, 0.5, 1.5)] == pytest.approx([1.0, 0.5, 0.1])  # type: ignore[type-var]


def test_the_frame_of_a_map_is_that_of_its_logs() -> None:
    """Mean, std (1 of what stands still), smallest and largest of each reading; one that tells
    nothing has its noise.
    """
    data = [run(0), run(1)]
    still = [
        replace(each, readings=np.column_stack([each.readings[:, 0], np.full(len(each.time), 0.4)]))
        for each in data
    ]
    learned, columns = frame(still, kind(), Terms("lines", ("1", "a", "b")))
    a = np.concatenate([each.readings[:, 0] for each in still])
    np.testing.assert_allclose(learned.centre, [a.mean(), 0.4])
    np.testing.assert_allclose(learned.scale, [a.std(), 1.0])
    np.testing.assert_allclose(learned.low, [a.min(), 0.4 - 3 * NOISE[1]])
    np.testing.assert_allclose(learned.high, [a.max(), 0.4 + 3 * NOISE[1]])
    np.testing.assert_allclose(learned.distance, [[1.0, 0.0], [0.0, 0.0]], atol=1e-9)
    assert learned.reach == pytest.approx(np.abs(a - a.mean()).max() / a.std())
    assert columns == [0, 1]


def test_of_one_log_each_half_judges_what_the_other_teaches() -> None:
    """A direction that comes again in both halves is taken, a line where there is nothing more."""
    assert "slip(a)" in choose_terms([run(0, turning=0.05)], kind(), [0], None).terms
    assert "slip(a)" not in choose_terms([run(0)], kind(), [0], None).terms
