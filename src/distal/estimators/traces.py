"""Plots of estimates over time: truth, estimates and bands, for print and for colour-blind readers."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.errors import OutputError
from distal.estimators.result import BAND, Estimate

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette, which colour-blind readers can tell apart; each curve has its own dash as well
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
DASHES: tuple[object, ...] = (
    "-",
    (0, (5, 1.5)),
    (0, (1.5, 1)),
    (0, (5, 1, 1, 1)),
    (0, (8, 2)),
    (0, (3, 1, 1, 1, 1, 1)),
)
STYLE = {
    "font.size": 9,
    "axes.grid": True,
    "grid.alpha": 0.25,
    "grid.linewidth": 0.5,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "svg.hashsalt": "distal",
    "figure.constrained_layout.use": True,
}


@contextmanager
def figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.5, 3.6), **options: object
) -> Iterator[tuple[Figure, list[Axes]]]:
    """Make a figure in distal's style without touching the user's backend or settings.

    Args:
        rows: of axes.
        columns: of axes.
        size: in inches.
        options: of matplotlib's `Figure.subplots`.
    """
    import matplotlib
    from matplotlib.figure import Figure

    with matplotlib.rc_context(STYLE):
        made = Figure(figsize=size)
        axes = made.subplots(rows, columns, squeeze=False, **options)
        yield made, list(np.ravel(axes))


def plain(text: str) -> str:
    """Return text as matplotlib shows it letter by letter: a $ begins no formula."""
    return text.replace("$", r"\$")


def plot_kind(path: str | Path) -> str:
    """Return the format that a plot's file name asks for.

    Raises:
        OutputError: it is none of png, svg and pdf.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in ("png", "svg", "pdf"):
        raise OutputError(f"{path}: a plot cannot be '{kind}'; .png, .svg and .pdf are allowed")
    return kind


def save_figure(made: Figure, path: str | Path) -> None:
    """Write a figure whole or not at all, in the format of its suffix.

    Args:
        made: the figure.
        path: where.

    Raises:
        OutputError: the format is unknown or the file cannot be written.
    """
    import io

    from distal.logs import write_whole

    path = Path(path)
    kind = plot_kind(path)
    import matplotlib

    with matplotlib.rc_context(STYLE):
        buffer = io.BytesIO()
        # no dates inside, so that the same results give the same file
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        with warnings.catch_warnings():
            # a title may hold characters that the font lacks, or be too long: the plot is made all the same
            warnings.simplefilter("ignore", UserWarning)
            made.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    write_whole(path, buffer.getvalue())


def plot_estimates(
    estimates: Sequence[Estimate],
    path: str | Path | None = None,
    title: str | None = None,
    bands: bool = True,
    errors: bool | None = None,
) -> Figure:
    """Draw truth, estimates and their 95 % bands over time; below, their errors.

    Args:
        estimates: of the same log.
        path: where to save; None only returns the figure.
        title: above the axes; default the rig's name.
        bands: draw the 95 % bands.
        errors: draw the errors too; default where the truth is known.

    Raises:
        OutputError: the file cannot be written.
    """
    truth = estimates[0].truth
    with_errors = (truth is not None) if errors is None else errors
    rows = 2 if with_errors else 1
    size = (6.5, 5.2) if with_errors else (6.5, 3.4)
    with figure(rows, 1, size, sharex=True, height_ratios=[2, 1][:rows]) as (made, axes):
        top = axes[0]
        if truth is not None:
            top.plot(estimates[0].time, np.rad2deg(truth), color="black", linewidth=1.6, label="truth")
        for i, result in enumerate(estimates):
            draw_estimate(top, result, i, bands)
        _limit_angles(top, estimates)
        top.set_ylabel("joint angle θ [°]")
        top.set_title(plain((title or estimates[0].rig)[:90]), fontsize=9, loc="left")
        top.legend(loc="best", fontsize=8, ncols=2)
        if with_errors:
            for i, result in enumerate(estimates):
                colour, dash = COLOURS[i % len(COLOURS)], DASHES[i % len(DASHES)]
                axes[1].plot(result.time, np.rad2deg(result.errors()), color=colour, linestyle=dash, linewidth=1.0)
                if bands:
                    half = np.rad2deg(BAND * result.theta_std)
                    axes[1].fill_between(result.time, -half, half, color=colour, alpha=0.15, linewidth=0)
            axes[1].axhline(0.0, color="black", linewidth=0.6)
            _limit_errors(axes[1], estimates)
            axes[1].set_ylabel("error [°]")
        axes[-1].set_xlabel("time [s]")
    if path is not None:
        save_figure(made, path)
    return made


def draw_estimate(axes: Axes, result: Estimate, index: int, band: bool = True, label: str | None = None) -> None:
    """Draw one estimate and its 95 % band [°].

    Args:
        axes: where.
        result: the estimate.
        index: of its colour and dash.
        band: draw the 95 % band.
        label: in the legend; default the estimator's name.
    """
    colour, dash = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
    theta, half = np.rad2deg(result.theta), np.rad2deg(BAND * result.theta_std)
    name = label or result.estimator
    axes.plot(result.time, theta, color=colour, linestyle=dash, linewidth=1.2, label=name)
    if band:
        shade = {"color": colour, "alpha": 0.18, "linewidth": 0}
        axes.fill_between(result.time, theta - half, theta + half, label=f"{name}, 95 % band", **shade)


def _limit_angles(axes: Axes, estimates: Sequence[Estimate]) -> None:
    """Keep the curves readable where a band is much wider than they are: it then runs out of the picture."""
    curves = [np.rad2deg(result.theta) for result in estimates]
    curves += [np.rad2deg(result.truth) for result in estimates[:1] if result.truth is not None]
    lowest, highest = (float(f([f(curve) for curve in curves])) for f in (np.nanmin, np.nanmax))
    low, high = axes.get_ylim()
    room = 0.3 * max(highest - lowest, 1.0)
    axes.set_ylim(max(low, lowest - room), min(high, highest + room))


def _limit_errors(axes: Axes, estimates: Sequence[Estimate]) -> None:
    """Keep the errors readable where a band is much wider than they are."""
    largest = max(float(np.nanmax(np.abs(np.rad2deg(result.errors())))) for result in estimates)
    low, high = axes.get_ylim()
    bound = 2.0 * max(largest, 0.05)
    axes.set_ylim(max(low, -bound), min(high, bound))
