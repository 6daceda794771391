"""Plots of estimates: what they show, and that they change no settings of the user."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from distal import Estimate, Log, Rig, log_health, plot_estimates
from distal.confidence import BAND
from distal.errors import OutputError


def legend(axes: Axes) -> list[str]:
    return [text.get_text() for text in axes.get_legend().get_texts()]


def labels(figure: Figure) -> list[str]:
    return [axes.get_ylabel() for axes in figure.axes]


@pytest.mark.parametrize("kind", ["png", "svg", "pdf"])
def test_plots(result: Estimate, tmp_path: Path, kind: str) -> None:
    one, two = tmp_path / f"one.{kind}", tmp_path / f"two.{kind}"
    figure = result.plot(one)
    assert labels(figure) == ["joint angle θ [°]", "error [°]"]
    assert figure.axes[-1].get_xlabel() == "time [s]"
    assert legend(figure.axes[0]) == ["truth", "adaptive, 95 % band"]
    plot_estimates([result], two)
    assert one.read_bytes() == two.read_bytes()
    with pytest.raises(OutputError, match="a plot cannot be 'txt'"):
        result.plot(tmp_path / "plot.txt")


def test_plotting_leaves_the_users_settings_alone(result: Estimate) -> None:
    before = dict(matplotlib.rcParams)
    result.plot()
    assert dict(matplotlib.rcParams) == before


def legends_lie_beside(figure: Figure) -> bool:
    """Return whether no legend covers a part of any axes."""
    figure.draw_without_rendering()
    frames = [axes.get_window_extent() for axes in figure.axes]
    legends = [axes.get_legend() for axes in figure.axes]
    boxes = [each.get_window_extent() for each in legends if each is not None]
    return not any(box.overlaps(frame) for box in boxes for frame in frames)


def test_every_panel(result: Estimate, log: Log, rig: Rig) -> None:
    other = replace(result, estimator="another one with a long name")
    health, panels = log_health(log, rig), ["innovations", "forces", "health"]
    figure = plot_estimates([result, other], panels=panels, log=log, rig=rig, health=health)
    angles = ["joint angle θ [°]", "error [°]"]
    assert labels(figure) == [*angles, "innovation [σ]", "measured [N]", "health"]
    assert legends_lie_beside(figure)
    innovations, forces, words = figure.axes[2:]
    assert legend(innovations) == list(result.measured)
    lines = [set(line.get_ydata()) for line in innovations.lines]
    assert [line for line in lines if len(line) == 1] == [{-2.0}, {2.0}]
    np.testing.assert_array_equal(forces.lines[0].get_ydata(), log.channels["u1"])
    assert [text.get_text() for text in words.get_yticklabels()] == sorted(set(health))
    drawn = sum(path.get_extents().width for bars in words.collections for path in bars.get_paths())
    assert drawn == pytest.approx(log.time[-1] - log.time[0] + 0.01)


@pytest.mark.parametrize(
    ("panel", "said"),
    [("forces", "log="), ("health", "log_health"), ("forcse", "did you mean 'forces'")],
)
def test_what_a_panel_needs_is_said(result: Estimate, panel: str, said: str) -> None:
    with pytest.raises(OutputError, match=said):
        plot_estimates([result], panels=[panel])


def test_time_counts_from_the_first_sample(result: Estimate) -> None:
    late = replace(result, time=result.time + 1e6)
    figure = late.plot()
    said = "time [s] from the first sample on, which has t = 1000000 s"
    assert figure.axes[-1].get_xlabel() == said
    times = figure.axes[0].lines[0].get_xdata()
    assert times[[0, -1]] == pytest.approx([0.0, 7.99])


def test_a_short_event_does_not_flatten_the_errors(result: Estimate) -> None:
    """An error of 40° for 5 of 800 samples: the axis shows the rest."""
    means = np.array(result.means)
    means[400:405, 0] += np.deg2rad(40.0)
    usual = result.plot().axes[1].get_ylim()[1]
    axes = replace(result, means=means).plot().axes[1]
    assert axes.get_ylim()[1] < 1.5 * usual < 10.0


def test_bands_are_seen_at_any_width(result: Estimate) -> None:
    """A narrow band has edges and its own scale below; the axis of errors holds a wide one."""
    half = np.rad2deg(BAND * result.theta_std)
    blind = replace(result, truths=None).plot()
    assert labels(blind) == ["joint angle θ [°]", "95 % band ± [°]"]
    np.testing.assert_allclose(blind.axes[1].lines[0].get_ydata(), half)
    edges = result.plot().axes[0].lines[1:3]
    np.testing.assert_allclose(edges[1].get_ydata() - edges[0].get_ydata(), 2 * half)
    wide = replace(result, variances=result.variances * 1e6).plot().axes[1]
    assert wide.get_ylim()[1] > 1000.0 * np.median(half)


def test_an_estimate_in_words_and_as_a_table(result: Estimate) -> None:
    text = repr(result)
    assert text.startswith(
        "800 samples of 'Nylon-tendon disk (k = 806 N/m)', 0 to 7.99 s; adaptive: angle from "
    )
    assert len(text) < 250
    assert str(result) == text
    (row,) = result.summary()
    angles = {
        "RMS error [deg]": result.rms_error(),
        "largest error [deg]": result.max_error(),
        "greatest [deg]": result.theta.max(),
        "median band [deg]": BAND * np.median(result.theta_std),
    }
    assert {name: row[name] for name in angles} == pytest.approx(
        {name: np.rad2deg(angle) for name, angle in angles.items()}
    )
    assert row["inside band"] == result.inside_band()
    blind = replace(result, truths=None)
    assert blind.summary()[0]["RMS error [deg]"] is None
    assert "RMS" not in repr(blind)


def test_an_angles_axis_holds_the_curves_and_not_a_band_that_is_much_wider(
    result: Estimate,
) -> None:
    """It ends 0.3 of the curves' range beyond them where the band would take it further, else where
    matplotlib ends it.
    """
    angles, truth = np.rad2deg(result.theta), np.rad2deg(result.truth)
    lowest, highest = min(angles.min(), truth.min()), max(angles.max(), truth.max())
    wide = replace(result, variances=result.variances * 1e8).plot().axes[0]
    room = 0.3 * (highest - lowest)
    assert wide.get_ylim() == pytest.approx((lowest - room, highest + room))
    low, high = result.plot().axes[0].get_ylim()
    assert lowest - room < low < lowest
    assert highest < high < highest + room


def test_an_axis_of_innovations_holds_98_percent_of_them(result: Estimate) -> None:
    """Five standard deviations at least, and 1.2 times the 98 % quantile of those that are
    larger.
    """
    small = replace(result, innovation_variances=result.innovation_variances * 100.0)
    large = replace(result, innovation_variances=result.innovation_variances / 100.0)
    assert small.plot(panels=["innovations"]).axes[-1].get_ylim() == pytest.approx((-5.0, 5.0))
    low, high = large.plot(panels=["innovations"]).axes[-1].get_ylim()
    sizes = np.abs(large.innovations / np.sqrt(large.innovation_variances)).ravel()
    assert np.mean(sizes[np.isfinite(sizes)] <= high / 1.2) == pytest.approx(0.98, abs=0.001)
    assert low == -high
