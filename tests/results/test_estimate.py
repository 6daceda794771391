"""What an estimator made of a log, as numbers and frames."""

from __future__ import annotations

import numpy as np
import pandas
import polars as pl
import pytest

from distal import Estimate, Log, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.errors import EstimationError


@pytest.fixture(scope="module")
def result() -> Estimate:
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    return estimate(simulate(rig, scenario), rig, "adaptive")


def test_numbers(result: Estimate) -> None:
    error = result.theta - result.truth
    assert result.rms_error() == pytest.approx(np.sqrt(np.mean(error**2)))
    assert result.max_error() == pytest.approx(np.abs(error).max())
    assert result.inside_band() == np.mean(np.abs(error) <= 1.959963984540054 * result.theta_std)


def test_frames(result: Estimate) -> None:
    frame = pl.DataFrame(result.columns())
    assert frame.columns == ["t [s]", "theta [rad]", "theta_std [rad]"]
    assert list(pandas.DataFrame(result.columns()).columns) == frame.columns
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


def test_no_truth() -> None:
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    blind = estimate(Log(log.time, dict(log.channels)), rig)
    with pytest.raises(EstimationError, match="no truth"):
        blind.rms_error()
    assert [axes.get_ylabel() for axes in blind.plot().axes] == [
        "joint angle θ [°]",
        "95 % band ± [°]",
    ]


def test_a_number_of_the_rig_is_a_state_by_its_words_and_by_its_path() -> None:
    rig = load_rig("lab-bench")
    found = estimate(simulate(rig, "lab-bench", 0).select(slice(0, 60)), rig, compiled=False)
    words = "friction coefficient of joint finger"
    np.testing.assert_array_equal(
        found.state(words), found.state("joints.finger.friction.coefficient")
    )
    every = found.columns(every=True)
    np.testing.assert_array_equal(every[f"{words} [1]"], found.state(words))
    at = found.state_names.index("damping of drive motor")
    np.testing.assert_array_equal(
        every["std of damping of drive motor [N m s/rad]"], found.stds[:, at]
    )
    assert not any(".0." in name or ".1." in name for name in every)
    with pytest.raises(EstimationError, match="did you mean 'inertia of joint finger'"):
        found.state("joints.finger")
