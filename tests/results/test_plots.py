"""Plots of estimates: what they show, and that they change no settings of the user."""

from __future__ import annotations

from pathlib import Path

import pytest

from distal import Estimate, estimate, load_scenario, plot_estimates, scenario_rig, simulate
from distal.errors import OutputError


@pytest.fixture(scope="module")
def result() -> Estimate:
    scenario = load_scenario("series-2")
    rig = scenario_rig(scenario)
    return estimate(simulate(rig, scenario), rig, "ekf")


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_plots(result: Estimate, tmp_path: Path, kind: str) -> None:
    one, two = tmp_path / f"one.{kind}", tmp_path / f"two.{kind}"
    figure = result.plot(one)
    assert [axes.get_ylabel() for axes in figure.axes] == ["joint angle θ [°]", "error [°]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    labels = figure.axes[0].get_legend_handles_labels()[1]
    assert labels == ["truth", "ekf", "ekf, 95 % band"]
    plot_estimates([result], two)
    assert one.read_bytes() == two.read_bytes()
    with pytest.raises(OutputError, match="a plot cannot be 'txt'"):
        result.plot(tmp_path / "plot.txt")


def test_plotting_leaves_the_users_settings_alone(result: Estimate) -> None:
    import matplotlib

    before = dict(matplotlib.rcParams)
    result.plot()
    assert dict(matplotlib.rcParams) == before
