"""What an estimator made of a log, as numbers and frames."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pandas
import polars as pl
import pytest

from distal import Estimate, estimate, load_rig, simulate
from distal.errors import EstimationError


def test_numbers(result: Estimate) -> None:
    error = result.theta - result.truth
    assert result.rms_error() == pytest.approx(np.sqrt(np.mean(error**2)))
    assert result.max_error() == pytest.approx(np.abs(error).max())
    assert result.inside_band() == np.mean(np.abs(error) <= 1.959963984540054 * result.theta_std)


def test_frames(result: Estimate) -> None:
    for frame in (pl.DataFrame(result.columns()), pandas.DataFrame(result.columns())):
        assert list(frame.columns) == ["t [s]", "theta [rad]", "theta_std [rad]"]
        np.testing.assert_array_equal(frame["theta [rad]"].to_numpy(), result.theta)
    every = result.columns("deg", every=True)
    assert list(every)[:5] == [
        "t [s]",
        "theta [deg]",
        "theta_std [deg]",
        "theta_dot [deg/s]",
        "theta_dot_std [deg/s]",
    ]
    np.testing.assert_allclose(every["theta [deg]"], np.rad2deg(result.theta))
    np.testing.assert_array_equal(every["friction_left [N]"], result.state("friction_left"))
    with pytest.raises(EstimationError, match="unit 'grad': angles are written in rad or deg"):
        result.columns("grad")


def test_no_truth(result: Estimate) -> None:
    with pytest.raises(EstimationError, match="no truth"):
        replace(result, truths=None).rms_error()


def test_a_number_of_the_rig_is_a_state_by_its_words_and_by_its_path() -> None:
    rig = load_rig("lab-bench")
    found = estimate(simulate(rig, "lab-bench", 0).select(slice(0, 60)), rig, compiled=False)
    words = "friction coefficient of joint finger"
    every = found.columns(every=True)
    for same in (found.state("joints.finger.friction.coefficient"), every[f"{words} [1]"]):
        np.testing.assert_array_equal(found.state(words), same)
    damping = "damping of drive motor"
    stds = found.stds[:, found.state_names.index(damping)]
    np.testing.assert_array_equal(every[f"std of {damping} [N m s/rad]"], stds)
    assert not any(".0." in name or ".1." in name for name in every)
    with pytest.raises(EstimationError, match="did you mean 'inertia of joint finger'"):
        found.state("joints.finger")
