"""Homing with a learned map: the rig's numbers by the filter, then the rest by Bayes' rule; the run
reads no reference.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig
from distal.estimators import AdaptiveFilter, first_values
from distal.homing import Window, plain_samples, with_references
from distal.homing.apply import is_followed, torque_samples
from distal.homing.window import START_STD
from distal.kernels import covariance_of
from distal.logs import FROM_SENSOR
from distal.rig import MapArrays
from distal.run import samples_of
from tests.learned_maps import constant_map, drawn_map


@pytest.fixture(scope="module")
def log() -> Log:
    time = np.arange(0.0, 3.0, 0.005)
    angle = 0.5 * np.sin(2 * np.pi * 0.7 * time)
    torque = 0.06 * np.sin(2 * np.pi * 0.7 * time + 0.4)
    return Log(time, {"motor_angle": angle, "motor_torque": torque}, {"theta": 0.6 * angle + 0.05})


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("capstan-joint").with_map(filter=[drawn_map()])


def test_without_its_correction_a_filter_is_the_plain_one(rig: Rig, log: Log) -> None:
    truths = np.full((len(log), 1), np.nan)
    runs = []
    for each in (rig, rig.bare()):
        estimator = AdaptiveFilter(each, compiled=False)
        samples = samples_of(log, estimator.channels)
        runs.append(
            plain_samples(
                estimator, estimator.initial(0.0, first_values(samples)), log, samples, truths
            )
        )
    np.testing.assert_allclose(runs[0].angles, runs[1].angles, rtol=0, atol=1e-12)
    np.testing.assert_allclose(runs[0].variances, runs[1].variances, rtol=1e-9)
    np.testing.assert_allclose(runs[0].readings, runs[1].readings, rtol=0, atol=1e-15)


def test_a_homing_move_takes_off_what_it_shows(rig: Rig, log: Log) -> None:
    """A constant error that the prior allows is gone after the move, and the move itself is not
    judged.
    """
    wide = constant_map("jaw", ("motor_angle", "motor_torque"), 0.2, 0.01)
    arrays = dict(wide.arrays.by_name)
    arrays["covariance"] = arrays["covariance"].copy()
    arrays["covariance"][0, 0, 0] = 0.04
    wide = wide.model_copy(update={"arrays": MapArrays(**arrays)})
    described = rig.with_map(filter=[wide])
    before, after = (
        estimate(log, described, compiled=False),
        estimate(log, described, compiled=False, homing=1.0),
    )
    assert np.isnan(after.errors()[log.time < 1.0]).all()
    late = log.time >= 1.0
    assert abs(np.mean(after.errors()[late])) < 0.5 * abs(np.mean(before.errors()[late]))
    assert np.mean(after.theta_std[late]) < np.mean(before.theta_std[late])


def test_what_a_contacts_map_sees_begins_at_zero(rig: Rig) -> None:
    """The map's time is that since the log's first sample, and a gap keeps the last reading."""
    time = 5.0 + np.arange(0.0, 1.0, 0.1)
    angle = np.where(np.arange(10) == 4, np.nan, 0.1 * np.arange(10))
    log = Log(time, {"motor_angle": angle, "motor_torque": np.ones(10)})
    seen = torque_samples(log, angle[:, None], np.zeros((10, 1)))
    np.testing.assert_allclose(seen.time, time - 5.0, atol=1e-12)
    np.testing.assert_allclose(np.diff(seen.held[3:6, 0]), [0.0, 0.2], atol=1e-12)
    assert seen.interval == pytest.approx(0.1)


def window_of(rig: Rig, log: Log, **sensor: object) -> Window:
    """Return half a second of the log with its truth as the reference."""
    changed = rig.bare().with_values(
        {f"sensors.encoder.{key}": value for key, value in sensor.items()}
    )
    described, references = with_references(changed, replace(log, truth_source=FROM_SENSOR))
    estimator = AdaptiveFilter(described, compiled=False, references=references)
    truths = log.truth["theta"][:, None]
    read = samples_of(log, estimator.channels[: len(estimator.channels) - 1])
    samples = np.column_stack([read, truths])
    return Window.of(
        estimator, estimator.initial(0.0, first_values(samples)), log, samples, truths, 0.5
    )


@pytest.mark.parametrize(("mean", "used"), [(1.47, True), (1.53, False)])
def test_numbers_are_used_whose_errors_are_one_and_a_half_variances_at_most(
    mean: float, used: bool, rig: Rig, log: Log, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The mean of e²/P over the window, without the samples that have no reference."""
    window = window_of(rig, log)

    def errors(self: Window, kernel_states: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        found = np.full((len(kernel_states), 1), np.nan)
        found[::2, 0] = 0.1 * np.sqrt(mean) * np.sqrt(2.0) * (np.arange(len(found[::2])) % 2)
        return found, np.full((len(kernel_states), 1), 0.01)

    monkeypatch.setattr(Window, "errors", errors)
    assert is_followed(window) is used


def test_a_window_is_judged_by_what_its_angle_errs_beyond_its_references_offset(
    rig: Rig, log: Log
) -> None:
    """e = truth − angle − offset, its variance that of the angle and the encoder's noise; it starts
    at the first truth.
    """
    window = window_of(
        rig, log, noise="0.5 deg", resolution="0.1 deg", bias={"value": 0.0, "std": "1 deg"}
    )
    estimator, n = window.estimator, window.start.size
    bias = estimator.state_names.index("bias_encoder")
    (channel,) = window.references
    kernel_states = np.tile(window.start.kernel_state, (3, 1))
    kernel_states[:, 0], kernel_states[:, bias] = [0.1, 0.2, -0.3], [0.01, -0.02, 0.03]
    three = replace(window, truths=window.truths[:3])
    errors, variances = three.errors(kernel_states)
    np.testing.assert_allclose(
        errors[:, 0],
        window.truths[:3, 0] - kernel_states[:, 0] - kernel_states[:, bias],
        atol=1e-15,
    )
    own = covariance_of(window.start.kernel_state, n)[0, 0]
    np.testing.assert_allclose(
        variances[:, 0], own + np.deg2rad(0.5) ** 2 + np.deg2rad(0.1) ** 2 / 12, rtol=1e-9
    )
    truths = window.truths.copy()
    truths[:2] = np.nan
    begun = replace(window, truths=truths).anchored(window.start.kernel_state)
    covariance, before = covariance_of(begun, n), covariance_of(window.start.kernel_state, n)
    assert begun[0] == truths[2, 0]
    assert covariance[0, 0] == pytest.approx(START_STD**2 + np.deg2rad(1.0) ** 2)
    np.testing.assert_array_equal(covariance[0, 1:], 0.0)
    np.testing.assert_array_equal(covariance[1:, 0], 0.0)
    np.testing.assert_array_equal(covariance[1:, 1:], before[1:, 1:])
    np.testing.assert_array_equal(begun[1:n], window.start.kernel_state[1:n])
    assert np.isnan(window.unaided[:, channel]).all()
    assert len(window.time) == np.count_nonzero(log.time < 0.5)
