"""Plots of estimates over time: truth, estimates and bands, for print and for colour-blind readers."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numpy.typing import NDArray

from distal.errors import OutputError
from distal.logs import write_whole

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Floats = NDArray[np.float64]

BAND = 1.959963984540054
"""Half-width of a 95 % band in standard deviations."""


class Curves(Protocol):
    """What is drawn of an estimate: see `distal.Estimate`."""

    @property
    def estimator(self) -> str:
        """Its name."""
        ...

    @property
    def rig(self) -> str:
        """Title of the rig."""
        ...

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""
        ...

    @property
    def time(self) -> Floats:
        """Stamps [s], (k,)."""
        ...

    @property
    def angles(self) -> Floats:
        """Angles of the joints [rad], (k, n_joints)."""
        ...

    @property
    def angle_stds(self) -> Floats:
        """Standard deviations of their errors [rad], (k, n_joints)."""
        ...

    @property
    def truths(self) -> Floats | None:
        """True angles [rad], (k, n_joints), or None."""
        ...


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
    write_whole(path, figure_bytes(made, path))


def figure_bytes(made: Figure, path: str | Path) -> bytes:
    """Return a figure as the file that `path` will hold.

    Args:
        made: the figure.
        path: where it will be written; its suffix gives the format.

    Raises:
        OutputError: the format is unknown.
    """
    import io

    import matplotlib

    kind = plot_kind(path)

    with matplotlib.rc_context(STYLE):
        buffer = io.BytesIO()
        # no dates inside, so that the same results give the same file
        metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
        with warnings.catch_warnings():
            # a title may hold characters that the font lacks, or be too long: the plot is made all the same
            warnings.simplefilter("ignore", UserWarning)
            made.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()


def plot_estimates(
    estimates: Sequence[Curves],
    path: str | Path | None = None,
    title: str | None = None,
    bands: bool = True,
    errors: bool | None = None,
) -> Figure:
    """Draw truth, estimates and their 95 % bands over time; below, their errors. One column of axes for each joint.

    Args:
        estimates: of the same log.
        path: where to save; None only returns the figure.
        title: above the axes; default the rig's name.
        bands: draw the 95 % bands.
        errors: draw the errors too; default where the truth is known.

    Raises:
        OutputError: the file cannot be written.
    """
    first = estimates[0]
    with_errors = (first.truths is not None) if errors is None else errors
    rows, columns = (2 if with_errors else 1), len(first.joint_names)
    size = (6.5 if columns == 1 else 4.0 * columns, 5.2 if with_errors else 3.4)
    with figure(rows, columns, size, sharex=True, height_ratios=[2, 1][:rows]) as (made, axes):
        for joint, name in enumerate(first.joint_names):
            _draw_joint(axes[joint::columns], estimates, joint, bands)
            if columns > 1:
                axes[joint].set_title(plain(name[:90]), fontsize=9)
        if columns == 1:
            axes[0].set_title(plain((title or first.rig)[:90]), fontsize=9, loc="left")
        else:
            made.suptitle(plain((title or first.rig)[:90]), fontsize=9)
    if path is not None:
        save_figure(made, path)
    return made


def _draw_joint(axes: Sequence[Axes], estimates: Sequence[Curves], joint: int, bands: bool) -> None:
    """Draw one joint: angles above, errors below where there are axes for them."""
    top, truth = axes[0], _truth(estimates[0], joint)
    if truth is not None:
        top.plot(estimates[0].time, np.rad2deg(truth), color="black", linewidth=1.6, label="truth")
    for i, result in enumerate(estimates):
        draw_estimate(top, result, i, bands, joint=joint)
    _limit_angles(top, estimates, joint)
    top.set_ylabel("joint angle θ [°]")
    top.legend(loc="best", fontsize=8, ncols=2)
    if len(axes) > 1:
        errors = [np.rad2deg(_error(result, joint)) for result in estimates]
        for i, (result, error) in enumerate(zip(estimates, errors)):
            colour, dash = COLOURS[i % len(COLOURS)], DASHES[i % len(DASHES)]
            axes[1].plot(result.time, error, color=colour, linestyle=dash, linewidth=1.0)
            if bands:
                half = np.rad2deg(BAND * result.angle_stds[:, joint])
                axes[1].fill_between(result.time, -half, half, color=colour, alpha=0.15, linewidth=0)
        axes[1].axhline(0.0, color="black", linewidth=0.6)
        _limit_errors(axes[1], errors)
        axes[1].set_ylabel("error [°]")
    axes[-1].set_xlabel("time [s]")


def _truth(result: Curves, joint: int) -> Floats | None:
    """Return a joint's true angle [rad], None where it is nowhere known."""
    if result.truths is None or not np.isfinite(result.truths[:, joint]).any():
        return None
    return result.truths[:, joint]


def _error(result: Curves, joint: int) -> Floats:
    """Return a joint's error [rad], NaN where its truth is not known."""
    truth = _truth(result, joint)
    return result.angles[:, joint] - (np.nan if truth is None else truth)


def draw_estimate(
    axes: Axes, result: Curves, index: int, band: bool = True, label: str | None = None, joint: int = 0
) -> None:
    """Draw one estimate of a joint and its 95 % band [°].

    Args:
        axes: where.
        result: the estimate.
        index: of its colour and dash.
        band: draw the 95 % band.
        label: in the legend; default the estimator's name.
        joint: index of the joint.
    """
    colour, dash = COLOURS[index % len(COLOURS)], DASHES[index % len(DASHES)]
    theta, half = np.rad2deg(result.angles[:, joint]), np.rad2deg(BAND * result.angle_stds[:, joint])
    name = label or result.estimator
    axes.plot(result.time, theta, color=colour, linestyle=dash, linewidth=1.2, label=name)
    if band:
        shade = {"color": colour, "alpha": 0.18, "linewidth": 0}
        axes.fill_between(result.time, theta - half, theta + half, label=f"{name}, 95 % band", **shade)


def _limit_angles(axes: Axes, estimates: Sequence[Curves], joint: int) -> None:
    """Keep the curves readable where a band is much wider than they are: it then runs out of the picture."""
    curves = [np.rad2deg(result.angles[:, joint]) for result in estimates]
    truth = _truth(estimates[0], joint)
    curves += [] if truth is None else [np.rad2deg(truth)]
    lowest, highest = (float(f([f(curve) for curve in curves])) for f in (np.nanmin, np.nanmax))
    low, high = axes.get_ylim()
    room = 0.3 * max(highest - lowest, 1.0)
    axes.set_ylim(max(low, lowest - room), min(high, highest + room))


def _limit_errors(axes: Axes, errors: Sequence[Floats]) -> None:
    """Keep the errors readable where a band is much wider than they are."""
    known = np.abs(np.concatenate(errors))
    largest = float(np.max(known[np.isfinite(known)], initial=0.0))
    low, high = axes.get_ylim()
    bound = 2.0 * max(largest, 0.05)
    axes.set_ylim(max(low, -bound), min(high, bound))
