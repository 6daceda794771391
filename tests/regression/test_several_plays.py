"""Sums of play operators (Prandtl–Ishlinskii) as maps: learned, and the same sample by sample."""

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from numpy.typing import NDArray

from distal.regression import (
    Samples,
    affine_kind,
    first_memory,
    fit_coefficients,
    left_out_errors,
    map_coefficients_of,
    map_function,
    memory_size,
    predict,
)
from distal.regression.learn_map import Terms, choose_terms
from distal.rig import CONSTANT, LAGS, PLAYS

Floats = NDArray[np.float64]
NOISE = np.array([1e-4, 1e-3])


def naive_play(values: Floats, half: float) -> Floats:
    """Return what a play of a half-width makes of values, one after the other."""
    out = np.empty(len(values))
    z = values[0]
    for k, value in enumerate(values):
        z = min(max(z, value - half), value + half)
        out[k] = z
    return out


def hysteretic(seed: int) -> Samples:
    """Return a log in which the angle is a line of a motor's position and of three plays of it."""
    rng = np.random.default_rng(seed)
    time = np.arange(0.0, 30.0, 0.02)
    knots = np.concatenate([[0.0], np.cumsum(rng.uniform(0.4, 1.4, 60))])
    position = np.interp(time, knots, rng.uniform(-1.0, 1.0, 61))
    angle = 0.5 * position
    for weight, half in ((0.2, 0.04), (0.15, 0.12), (0.1, 0.35)):
        angle = angle + weight * naive_play(position, half)
    effort = rng.normal(0.0, 1.0, len(time))
    readings = np.column_stack([position + rng.normal(0.0, 1e-4, len(time)), effort])
    empty = np.zeros((len(time), 0))
    return Samples(f"{seed}", time, readings, empty, angle[:, None], np.zeros((len(time), 1)), 0.02)


LOGS = [hysteretic(seed) for seed in range(3)]
KIND = affine_kind(("motor", "current"), ("motor",), ("joint",), NOISE)


def rms(name: str) -> float:
    terms = next(terms for terms in KIND.sets if name in terms.name)
    errors = left_out_errors(LOGS, KIND, terms, range(3), None)
    return float(np.sqrt(np.mean([np.mean(of_log[0][0] ** 2) for of_log in errors])))


def test_several_widths_describe_what_one_cannot() -> None:
    chosen = choose_terms(LOGS, KIND, range(3), None)
    assert "plays of 4 widths" in chosen.name
    assert rms("4 widths of positions") < 0.4 * rms("a play of 0.3 std")
    assert rms("4 widths of positions") < 0.2 * rms("a straight line of what")


@pytest.mark.parametrize(
    "which", ["of positions, all", "of all readings, all", "positions and lags", "products"]
)
def test_sample_by_sample_it_is_the_same_as_over_a_log(which: str) -> None:
    terms = next(terms for terms in KIND.sets if terms.name.count(which))
    learned = fit_coefficients(LOGS[:2], KIND, terms)
    log = LOGS[2].part(np.arange(len(LOGS[2].time)) < 300)
    log.readings[100:150] *= 1.5  # beyond the range, which friction remembers
    assert len(learned.played) == len(PLAYS) * (
        2 if which in ("of all readings, all", "products") else 1
    )
    assert len(learned.lagged) == len(LAGS) * (2 if "lags" in which else 0)
    function = map_function(learned, 2, [False, False])
    first = first_memory(learned, ca.DM(log.readings[0]), ca.DM.ones(2))
    memory = np.array(ca.DM(first)).ravel()
    assert len(memory) == memory_size(learned)
    expected = predict(learned, log)
    for k, reading in enumerate(log.readings):
        x = np.concatenate([[0.02], reading, np.ones(2)])
        value, _, variance, _, after = function(
            memory, x, np.zeros(2), np.zeros(1), map_coefficients_of(learned)
        )
        memory = np.array(after).ravel()
        assert float(value) == pytest.approx(expected.values[k], abs=1e-12)
        assert float(variance) == pytest.approx(expected.variances[k], rel=1e-9)


def delayed(seed: int) -> Samples:
    """Return a log in which the angle follows a motor late, by two lags of other speeds."""
    log = hysteretic(seed)
    position = log.readings[:, 0]
    angle = np.zeros(len(position))
    for weight, constant in ((0.5, 0.05), (0.4, 0.8)):
        z = position[0]
        for k, value in enumerate(position):
            z += (1.0 - np.exp(-(0.02 if k else 0.0) / constant)) * (value - z)
            angle[k] += weight * z
    return replace(log, targets=angle[:, None])


def test_lags_describe_a_joint_that_follows_late() -> None:
    """A naive loop over the samples gives the angle; the map finds its two weights."""
    logs = [delayed(seed) for seed in range(3)]
    chosen = choose_terms(logs, KIND, range(3), None)
    assert "lags" in chosen.name
    terms = next(
        terms for terms in KIND.sets if terms.name.startswith("a straight line, with lags")
    )
    learned = fit_coefficients(logs, KIND, terms)
    weights = np.array(learned.joints[0].coefficients) / np.asarray(learned.scale)[0]
    by_name = dict(zip(terms.terms, weights))
    assert by_name["lag(motor)"] == pytest.approx(0.5, abs=0.01)
    assert by_name["lag16(motor)"] == pytest.approx(0.4, abs=0.01)
    assert by_name["lag4(motor)"] == pytest.approx(0.0, abs=0.01)
    assert {round(constant, 6) for _, constant in learned.lagged} == {0.05, 0.2, 0.8}


def test_the_widths_are_those_of_their_names() -> None:
    terms = next(terms for terms in KIND.sets if "4 widths of positions" in terms.name)
    learned = fit_coefficients(LOGS, KIND, terms)
    assert learned.played == tuple((0, ratio) for ratio in (1.0, 3.0, 9.0, 27.0))


def bent(seed: int) -> Samples:
    """Return a log in which the angle is a line of a motor's position and of three plays of it, and
    bends with the position squared and under load.
    """
    log = hysteretic(seed)
    position, current = log.readings.T
    bend = 0.1 * position**2 + 0.02 * position * current
    return replace(log, targets=log.targets + bend[:, None])


def test_products_describe_an_arm_that_changes_with_angle_and_load() -> None:
    logs = [bent(seed) for seed in range(3)]
    chosen = choose_terms(logs, KIND, range(3), None)
    assert "products" in chosen.name
    learned = fit_coefficients(logs, KIND, chosen)
    b = dict(zip(learned.terms, learned.joints[0].coefficients))
    scale = dict(zip(learned.channels, learned.scale))
    assert b["motor*motor"] / scale["motor"] ** 2 == pytest.approx(0.1, rel=0.05)
    load = b["motor*current"] / (scale["motor"] * scale["current"])
    assert load == pytest.approx(0.02, rel=0.05)


def test_beyond_the_logs_the_line_goes_on_and_its_products_fade() -> None:
    """1 / (1 + (d/0.25)²), d in halves of the learned range, for products alone."""
    terms = Terms("with a product", (CONSTANT, "motor", "motor*motor"))
    learned = fit_coefficients([bent(0)], KIND, terms).model_copy(update={"reach": 1e3})
    half = 0.5 * (learned.high[0] - learned.low[0])
    log = LOGS[0].part(np.arange(len(LOGS[0].time)) < 1)
    beyond = replace(log, readings=np.array([[learned.high[0] + 0.5 * half, learned.centre[1]]]))
    z = (beyond.readings[0, 0] - learned.centre[0]) / learned.scale[0]
    constant, slope, square = learned.joints[0].coefficients
    expected = constant + slope * z + 0.2 * square * z**2
    assert predict(learned, beyond).values == pytest.approx([expected], rel=1e-9)
    function = map_function(learned, 2, [False, False])
    x = np.concatenate([[0.02], beyond.readings[0], np.ones(2)])
    memory = np.zeros(memory_size(learned))
    value, *_ = function(memory, x, np.zeros(2), np.zeros(1), map_coefficients_of(learned))
    assert float(value) == pytest.approx(expected, rel=1e-9)


def test_what_left_the_range_stays_until_a_slow_motion_within_it() -> None:
    """A current of half a range too much adds its std; rest and a fast motion keep it, and half a
    range of slow motion leaves e^−½ of it.
    """
    terms = next(terms for terms in KIND.sets if "4 widths of positions" in terms.name)
    learned = fit_coefficients(LOGS, KIND, terms).model_copy(update={"reach": 1e3})
    (low, high), rest = (learned.low[0], learned.high[0]), learned.centre[1]
    half = 0.5 * (high - low)
    seconds = np.array([0.0, 1.0, 2.0, 2.001, 102.001])
    much = learned.high[1] + 0.5 * (learned.high[1] - learned.low[1])
    positions = np.array([low, low, low, high, high - 1.1 * half])  # 0.1 of them is play
    currents = np.array([rest, much, rest, rest, rest])
    one = LOGS[0].part(np.arange(len(LOGS[0].time)) < len(seconds))
    log = replace(one, time=seconds, readings=np.column_stack([positions, currents]))
    only_line = learned.model_copy(update={"stays": ()})
    added = predict(learned, log).variances - predict(only_line, log).variances
    passed = np.exp(-0.001 * learned.rate[0] / (2.0 * half))
    expected = np.array([0.0, 1.0, 1.0, passed, passed * np.exp(-0.45)])
    assert np.sqrt(added) == pytest.approx(learned.stays[0] * expected, rel=1e-6)


def test_what_stays_is_what_bends_the_angle_in_the_logs() -> None:
    """Plays of 0.2, 0.15 and 0.1: the std is that of the straight line's errors."""
    terms = next(terms for terms in KIND.sets if "4 widths of positions" in terms.name)
    learned = fit_coefficients(LOGS, KIND, terms)
    readings = np.vstack([log.readings for log in LOGS])
    angles = np.concatenate([log.targets[:, 0] for log in LOGS])
    line = np.column_stack([np.ones(len(readings)), readings])
    errors = angles - line @ np.linalg.lstsq(line, angles, rcond=None)[0]
    assert learned.moves == ("motor",)
    assert learned.stays[0] == pytest.approx(float(np.sqrt(np.mean(errors**2))), rel=0.02)
