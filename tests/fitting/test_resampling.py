"""Displacements between samples: when straight lines are enough, and the cubic where they are
not.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, load_rig
from distal.fitting.fit_filter import FINEST, FitFilter, refined, steps_per_sample
from distal.homing import with_references

TIME = np.arange(0.0, 2.0, 0.01)


@pytest.mark.parametrize(("missed", "steps"), [(0.3, 1), (1.0, 2), (1.9, 2), (4.0, FINEST)])
def test_steps_follow_what_a_straight_line_leaves_out(missed: float, steps: int) -> None:
    """A x sin ωt: a chord leaves out ẍ dt²/8, in the mean A ω² dt²/(8 √2); here `missed` times the
    noise.
    """
    w, noise = 2 * np.pi * 2.0, 1e-5
    amplitude = missed * noise * 8 * np.sqrt(2) / (w * 0.01) ** 2
    positions = np.column_stack([amplitude * np.sin(w * TIME), np.zeros(len(TIME))])
    # the second difference of noise has a variance of 6 σ², which is taken off
    expected = np.sqrt(max(missed**2 - 6 / 64, 0.0))
    assert (expected < 0.5, expected < 2.0) == (steps == 1, steps <= 2)
    assert steps_per_sample(positions, np.array([noise, noise])) == steps
    assert steps_per_sample(positions[:, ::-1], np.array([noise, noise])) == steps


def test_noise_alone_asks_for_no_steps() -> None:
    positions = 1e-5 * np.random.default_rng(1).normal(size=(len(TIME), 2))
    assert steps_per_sample(positions, np.array([1e-5, 1e-5])) == 1
    assert steps_per_sample(np.full((9, 1), np.nan), np.array([1e-5])) == 1


def test_a_quadratic_is_met_exactly_between_samples() -> None:
    """Catmull and Rom's cubic is exact for quadratics inside; the other channels are missing
    there.
    """
    samples = np.column_stack([3.0 * TIME**2 - TIME, np.cos(TIME)])
    times, fine, kept = refined(TIME, samples, 1, 4)
    assert len(times) == 4 * (len(TIME) - 1) + 1
    np.testing.assert_allclose(times[kept], TIME, atol=1e-15)
    np.testing.assert_array_equal(fine[kept], samples)
    inside = (times > TIME[1]) & (times < TIME[-2])
    np.testing.assert_allclose(
        fine[inside, 0], 3.0 * times[inside] ** 2 - times[inside], atol=1e-12
    )
    between = np.setdiff1d(np.arange(len(times)), kept)
    assert np.isnan(fine[between, 1]).all()


def test_a_straight_line_where_a_neighbour_is_missing() -> None:
    """The slope at both ends of such an interval is that of its chord, so a step stays between its
    ends.
    """
    x = np.array([0.0, 0.0, 1.0, 1.0, np.nan, 5.0, 5.0, 6.0])
    times, fine, kept = refined(np.arange(8.0), x[:, None], 1, 2)
    between = {float(t): v for t, v in zip(times, fine[:, 0]) if t % 1}
    assert between[2.5] == pytest.approx(1.0)  # its neighbour to the right is missing
    assert between[1.5] == pytest.approx(0.5)
    assert 3.5 not in between
    assert 4.5 not in between
    assert between[5.5] == pytest.approx(5.0)
    assert len(kept) == 8


def test_gaps_are_left_to_the_filter() -> None:
    time = np.array([0.0, 0.1, 0.2, 0.3, 5.0, 5.1, 5.2, 5.3])
    times, _, kept = refined(time, np.arange(8.0)[:, None], 1, 4)
    assert not np.any((times > 0.3) & (times < 5.0))
    np.testing.assert_allclose(times[kept], time)


@pytest.mark.parametrize("steps", [1, 3])
def test_a_fits_rows_are_a_logs_samples_with_their_intervals(steps: int) -> None:
    """The first row has no interval before it; intervals add up to the stamps, and each sample's
    own row has its values.
    """
    rig = load_rig("capstan-joint")
    time = 5.0 + np.arange(40) / 200.0
    angle = 0.3 * np.sin(9.0 * time)
    log = Log(time, {"motor_angle": angle, "motor_torque": np.cos(time)}, {"theta": 0.6 * angle})
    described, references = with_references(rig, log)
    fit = FitFilter(described, references, (), steps, compiled=False)
    data = fit.data_of(log)
    assert data.rows[0, 0] == 0.0
    assert (data.rows[1:, 0] > 0.0).all()
    np.testing.assert_allclose(np.cumsum(data.rows[:, 0])[data.last], time - time[0], atol=1e-12)
    width = len(fit.estimator.channels)
    at = fit.estimator.channels.index("motor_torque")
    np.testing.assert_allclose(data.rows[data.last, 1 + at], np.cos(time))
    assert (data.rows[data.last, 1 + width + at] == 1.0).all()
    np.testing.assert_allclose(data.rows[data.last, width], 0.6 * angle)
    assert len(data.rows) == 39 * steps + 1
    begun = data.beginning(10)
    np.testing.assert_array_equal(begun.rows, data.rows[: data.last[9] + 1])
    assert len(begun.log) == len(begun.samples) == len(begun.last) == 10
