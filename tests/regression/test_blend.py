"""Blends of a filter's angle and the affine map: weights, mixture, what they may not see."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal.regression import (
    Blend,
    Samples,
    Terms,
    design,
    discrepancy_kind,
    errors_of,
    predict,
    sized_by,
)
from distal.regression.affine import less_the_angle
from distal.regression.learn_map import fit_coefficients
from distal.rig import CONSTANT

KIND = discrepancy_kind(["x"], ["x"], [], ["j"], np.array([1e-3]))
LINE = Terms("a straight line", (CONSTANT, "x"), pooled=True)
FOLDS = [0, 1, 2, 3]
BLEND = Blend(KIND, Terms("a constant", (CONSTANT,)), LINE, False)


def log_of(
    seed: int, of_filter: float = 0.03, of_reading: float = 0.04, count: int = 600
) -> Samples:
    """Return a log whose filter and whose reading err independently, with these stds [rad]."""
    rng = np.random.default_rng(seed)
    time = 0.01 * np.arange(count)
    angle = 0.5 * np.sin(2 * np.pi * rng.uniform(0.3, 0.6) * time + rng.uniform(0, 6))
    filtered = angle + of_filter * rng.standard_normal(count)
    return Samples(
        f"log {seed}",
        time,
        (angle + of_reading * rng.standard_normal(count))[:, None],
        filtered[:, None],
        (angle - filtered)[:, None],
        np.full((count, 1), 1e-6),
        0.01,
    )


LOGS = [log_of(seed) for seed in FOLDS]


def rms(samples: Samples, values: np.ndarray) -> float:
    """Return the RMS error of a map of the filter's error [rad]."""
    return float(np.sqrt(np.mean((values - samples.targets[:, 0]) ** 2)))


def test_the_weight_is_that_of_independent_errors_and_both_members_err_more() -> None:
    """With e₁ and e₂ independent the least mean square has w = σ₁²/(σ₁² + σ₂²) = 0.36."""
    (weight,) = BLEND.weights(LOGS, FOLDS)
    assert weight == pytest.approx(0.03**2 / (0.03**2 + 0.04**2), abs=0.04)
    new = log_of(99)
    alone = [rms(new, predict(member, new).values) for member in BLEND._members(LOGS)]
    together = rms(new, predict(BLEND.learned(LOGS, FOLDS), new).values)
    assert together == pytest.approx(0.03 * 0.04 / 0.05, rel=0.06)
    assert together < 0.85 * min(alone)


@pytest.mark.parametrize(
    ("of_filter", "of_reading", "weight"), [(1e-4, 0.05, 0.0), (0.05, 1e-4, 1.0)]
)
def test_a_member_that_errs_by_far_more_has_no_weight(
    of_filter: float, of_reading: float, weight: float
) -> None:
    logs = [log_of(seed, of_filter, of_reading) for seed in FOLDS]
    weights = BLEND.weights(logs, FOLDS)
    assert weights == pytest.approx([weight], abs=0.01)


def test_values_and_variances_are_those_of_a_mixture() -> None:
    """(1 − w) v₁ + w v₂ + w (1 − w) (value₁ − value₂)², written out."""
    first, second = (predict(member, LOGS[0]) for member in BLEND._members(LOGS))
    (w,) = BLEND.weights(LOGS, FOLDS)
    both = predict(BLEND.learned(LOGS, FOLDS), LOGS[0])
    np.testing.assert_allclose(both.values, (1 - w) * first.values + w * second.values, atol=1e-12)
    apart = first.values - second.values
    expected = (1 - w) * first.variances + w * second.variances + w * (1 - w) * apart**2
    np.testing.assert_allclose(both.variances, expected, rtol=1e-9)
    learned = BLEND.learned(LOGS, FOLDS)
    np.testing.assert_allclose(design(learned, LOGS[0]) @ learned.apart[0], apart, atol=1e-12)
    assert np.std(np.sqrt(both.variances)) > 0.1 * np.mean(np.sqrt(both.variances))


def test_a_line_less_the_angle_reports_the_line() -> None:
    straight = [replace(log, targets=log.targets + log.angles) for log in LOGS]
    line = fit_coefficients(straight, KIND, LINE)
    values = predict(less_the_angle(line), LOGS[1]).values
    expected = predict(line, LOGS[1]).values - LOGS[1].angles[:, 0]
    np.testing.assert_allclose(values, expected, atol=1e-12)


def test_errors_of_a_held_out_log_do_not_change_what_it_is_judged_by() -> None:
    """The errors on a log are those of a blend, weights included, that has not seen it."""
    first = errors_on_first(LOGS)
    alone = predict(BLEND.learned(LOGS[1:], FOLDS[1:]), LOGS[0]).values
    np.testing.assert_allclose(first, alone - LOGS[0].targets[:, 0])
    wild = [replace(LOGS[0], targets=LOGS[0].targets + 1.0), *LOGS[1:]]
    np.testing.assert_allclose(errors_on_first(wild), first - 1.0)


def errors_on_first(logs: list[Samples]) -> np.ndarray:
    learned, log = BLEND.held_out(logs, FOLDS)[0]
    ((errors, _, _),) = errors_of(learned, log, KIND, None)
    return errors


def test_the_band_holds_what_it_says_on_new_logs() -> None:
    held = BLEND.held_out(LOGS, FOLDS)
    learned = sized_by(BLEND.learned(LOGS, FOLDS), KIND, FOLDS, held)
    new = log_of(98)
    predicted = predict(learned, new)
    std = np.sqrt(predicted.variances + predicted.filter_variances)
    inside = np.mean(np.abs(predicted.values - new.targets[:, 0]) <= 1.96 * std)
    assert 0.92 <= inside <= 0.99


def test_one_log_tells_no_weight() -> None:
    assert BLEND.weights(LOGS[:1], [0]) == [0.5]


def test_the_correction_is_linear_and_the_line_goes_on_where_it_errs_less() -> None:
    """The last log goes twice as far as the others, and there its filter errs by 0.3 rad."""
    last = LOGS[3]
    angle = 2.0 * (last.angles + last.targets)
    wrong = angle + np.where(np.abs(angle) > 0.8, 0.3, 0.0)
    wide = replace(last, readings=angle.copy(), angles=wrong, targets=angle - wrong)
    blend = Blend.of([*LOGS[:3], wide], KIND, LINE, FOLDS)
    assert blend.follows
    assert not any("play" in term or "slip" in term for term in blend.correction.terms)
    right = replace(wide, angles=angle, targets=0.0 * angle, readings=np.tanh(angle))
    assert not Blend.of([*LOGS[:3], right], KIND, LINE, FOLDS).follows
