"""What an estimator made of a log, as numbers and frames."""

from __future__ import annotations

import numpy as np
import pytest

from distal import Estimate, Log, estimate, load_scenario, scenario_rig, simulate
from distal.errors import EstimationError


@pytest.fixture(scope="module")
def result() -> Estimate:
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    return estimate(simulate(rig, scenario), rig, "ekf")


def test_numbers(result: Estimate) -> None:
    error = result.theta - result.truth
    assert result.rms_error() == pytest.approx(np.sqrt(np.mean(error**2)))
    assert result.max_error() == pytest.approx(np.abs(error).max())
    assert result.inside_band() == np.mean(np.abs(error) <= 1.959963984540054 * result.theta_std)
    assert result.nis.shape == (len(result),)
    there = result.innovations
    expected = -0.5 * np.sum(there**2 / result.innovation_variances + np.log(2 * np.pi * result.innovation_variances))
    assert result.log_likelihood == pytest.approx(expected)


def test_frames(result: Estimate) -> None:
    polars, pandas = result.to_polars(), result.to_pandas()
    assert polars.columns[:3] == ["t", "theta", "theta_std"]
    assert list(pandas.columns) == polars.columns
    assert polars.columns[3:5] == ["position_left", "position_left_std"]
    np.testing.assert_array_equal(polars["theta"].to_numpy(), result.theta)


def test_no_truth() -> None:
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    log = simulate(rig, scenario)
    blind = estimate(Log(log.time, dict(log.channels)), rig)
    with pytest.raises(EstimationError, match="no truth"):
        blind.rms_error()
    assert blind.rms_error(log.truth["theta"]) > 0
    assert [axes.get_ylabel() for axes in blind.plot().axes] == ["joint angle θ [°]", "95 % band ± [°]"]
