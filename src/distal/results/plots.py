"""The style of all tables and figures: rows as HTML; colours and dashes that colour-blind readers
can tell apart, legends above the axes, and what a figure needs of an estimate.

Plots of truth, estimates and bands over time, for print and for colour-blind readers; and panels
below the angle: innovations, measured forces, and the health of a stream.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, TypedDict

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED_TEXT
from distal.errors import OutputError, did_you_mean
from distal.logs import Log, write_whole
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


SummaryRow = TypedDict(
    "SummaryRow",
    {
        "joint": str,
        "least [deg]": float,
        "greatest [deg]": float,
        "median band [deg]": float,
        "RMS error [deg]": float | None,
        "largest error [deg]": float | None,
        "inside band": float | None,
    },
)
"""The row of `Estimate.summary` on one joint."""


class Html(str):
    """A cell of a table that is HTML already."""


def verdict(word: str, good: bool) -> Html:
    """Return a word as a cell, in the colour of what is well or is not."""
    return Html(f"<span class='{'yes' if good else 'no'}'>{escape(word)}</span>")


def html_table(
    columns: Iterable[str], rows: Iterable[Sequence[object]], values: Sequence[int] = ()
) -> str:
    """Return the HTML of a table.

    Args:
        rows: cells, text or HTML; other numbers are written to four digits.
        values: indices of the columns that hold numbers.
    """
    names = [escape(column) for column in columns]
    mark = [" class='n'" if i in values else "" for i in range(len(names))]
    # on a narrow screen each row is a block of lines, and each cell tells its column
    label = [f" data-of='{text}'" if text and i else "" for i, text in enumerate(names)]
    head = "".join(f"<th{mark[i]}>{text}</th>" for i, text in enumerate(names))
    body = "".join(
        f"<tr>{''.join(f'<td{mark[i]}{label[i]}>{_cell(cell)}</td>' for i, cell in enumerate(row))}"
        "</tr>\n"
        for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f"<div class='scroll'>{table}</div>"


def _cell(cell: object) -> str:
    if isinstance(cell, Html):
        return cell
    return escape(f"{cell:.4g}" if isinstance(cell, float) else str(cell))


# Okabe and Ito's palette, which colour-blind readers can tell apart; each curve has its own dash as
# well
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Colours of curves in their order: Okabe and Ito's palette, which colour-blind readers can tell
apart.
"""

BAND_ALPHA = 0.2
"""Opacity of a shaded band. Source: layout."""


def band_colour(curve: str = COLOURS[0]) -> str:
    """Return the colour of the band of a curve, with its opacity as the last two hexadecimal
    digits.

    Args:
        curve: colour of the curve.
    """
    return f"{curve}{round(255 * BAND_ALPHA):02x}"


_GAPS = ((5, 1.5), (1.5, 1), (5, 1, 1, 1), (8, 2), (3, 1, 1, 1, 1, 1))
"""Lengths of dashes and gaps of curves after the first one, which is solid [line widths]. Source:
layout.
"""

DASHES: tuple[object, ...] = ("-", *((0, gaps) for gaps in _GAPS))
"""Dashes of curves in their order, so that curves differ in print without colours."""

WHITE = "#FFFFFF"
"""Colour of paper."""

PALE = "#EEF1F4"
"""Colour of bodies."""

FAINT = "#D0D7DE"
"""Colour of grids."""

SOFT = "#57606A"
"""Colour of text and lines in the background."""

INK = "#1B1F24"
"""Colour of text and outlines."""

BLACK = "#000000"
"""Colour of what is true."""

GOOD = "#00634A"
"""Colour of words that say that something is well."""

BAD = "#A63C00"
"""Colour of words that say that something is not well."""

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
"""Settings of matplotlib for all figures."""


TRUTH: Mapping[str, object] = {"color": BLACK, "linestyle": "-", "linewidth": 1.6}
"""Style of the true curve in every figure."""


class Curves(Protocol):
    """An object with the curves of an estimate that a plot draws, such as `distal.Estimate`."""

    @property
    def estimator(self) -> str:
        """Name of the estimator."""

    @property
    def rig(self) -> str:
        """Title of the rig."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        """Names of the joints."""

    @property
    def time(self) -> Floats:
        """Stamps [s], (k,)."""

    @property
    def angles(self) -> Floats:
        """Angles of the joints [rad], (k, n_joints)."""

    @property
    def angle_stds(self) -> Floats:
        """Standard deviations of the errors of the joint angles [rad], (k, n_joints)."""

    @property
    def truths(self) -> Floats | None:
        """True joint angles [rad], (k, n_joints), or None where none is known."""

    @property
    def measured(self) -> tuple[str, ...]:
        """Names of the m channels with an innovation."""

    @property
    def innovations(self) -> Floats:
        """Innovations ν, measured minus predicted, in SI, (k, m)."""

    @property
    def innovation_variances(self) -> Floats:
        """Variances S of the innovations, (k, m)."""


@contextmanager
def styled() -> Iterator[None]:
    """Let matplotlib draw axes and legends in this style."""
    import matplotlib

    with matplotlib.rc_context(STYLE):
        yield


@contextmanager
def figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.5, 3.6), **options: object
) -> Iterator[tuple[Figure, list[Axes]]]:
    """Make a figure and its axes in this style, without touching the user's backend or settings.

    Args:
        rows: rows of axes.
        columns: columns of axes.
        size: width and height [in].
        options: those of matplotlib's `Figure.subplots`.

    Raises:
        OutputError: matplotlib does not start.
    """
    try:
        from matplotlib.figure import Figure
    except ValueError as problem:  # a setting of the user's, such as $MPLBACKEND
        raise OutputError(f"nothing can be drawn: matplotlib does not start ({problem})") from None

    with styled():
        drawing = Figure(figsize=size)
        axes = drawing.subplots(rows, columns, squeeze=False, **options)
        yield drawing, list(np.ravel(axes))


def colour(index: int) -> str:
    """Return the colour of the curve with an index; after the last colour the first one is used
    again.
    """
    return COLOURS[index % len(COLOURS)]


def curve_style(index: int) -> dict[str, object]:
    """Return colour and dash of the curve with an index, as options of `Axes.plot`."""
    return {"color": colour(index), "linestyle": DASHES[index % len(DASHES)]}


def from_start(time: Floats) -> Floats:
    """Return the time since the first sample [s], (k,).

    Args:
        time: stamps [s], (k,).
    """
    since: Floats = time - time[0]
    return since


def time_label(time: Floats) -> str:
    """Return the label of the time axis for the stamps `time` [s], (k,)."""
    return (
        "time [s]"
        if abs(time[0]) < 1e-9
        else f"time [s] from the first sample on, which has t = {time[0]:.10g} s"
    )


def plain(text: str) -> str:
    """Return a text that matplotlib shows letter by letter, so that $ begins no formula."""
    return text.replace("$", r"\$")


def plot_kind(path: str | Path) -> str:
    """Return the format by the ending of a plot's path: png, svg or pdf.

    Raises:
        OutputError: the path ends otherwise.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in ("png", "svg", "pdf"):
        raise OutputError(f"{path}: a plot cannot be '{kind}'; .png, .svg and .pdf are allowed")
    return kind


def make_folder(path: str | Path) -> Path:
    """Return the folder at a path, which is made where it does not exist.

    Raises:
        OutputError: the folder cannot be made.
    """
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror or problem})") from None
    return folder


def save_figure(drawing: Figure, path: str | Path | None) -> Figure:
    """Write a figure completely or not at all, in the format of the path's ending, where there is a
    path; return the figure.

    Raises:
        OutputError: the file cannot be written.
    """
    if path is not None:
        write_whole(path, figure_bytes(drawing, path))
    return drawing


def figure_bytes(drawing: Figure, path: str | Path) -> bytes:
    """Return the content of a figure's file, in the format of the path's ending; see `plot_kind`.

    The figure's label, where it has one, is the title of an SVG or PDF, for readers who cannot see
    it.
    """
    kind = plot_kind(path)
    buffer = io.BytesIO()
    # no dates inside, so that the same results give the same file
    label = drawing.get_label()
    title = {"Title": label} if label else {}
    metadata = {"svg": {"Date": None, **title}, "pdf": {"CreationDate": None, **title}}.get(kind)
    with styled(), warnings.catch_warnings():
        # a title may hold characters that the font lacks, or be too long: the plot is made all the
        # same
        warnings.simplefilter("ignore", UserWarning)
        drawing.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()


def legend_above(axes: Axes, entries: Sequence[tuple[Artist, str]] = (), most: int = 4) -> None:
    """Put a legend above the axes, where it covers no curve.

    Args:
        entries: handles and their texts; by default those of the axes.
        most: columns of the legend at most.
    """
    handles, labels = zip(*entries) if entries else axes.get_legend_handles_labels()
    if handles:
        axes.legend(
            handles,
            labels,
            loc="lower left",
            bbox_to_anchor=(0.0, 1.0),
            borderaxespad=0.1,
            ncols=min(most, len(handles)),
            fontsize=8,
            columnspacing=1.2,
            handlelength=2.2,
        )


HEALTH_COLOURS = {"ok": COLOURS[2], "untested": COLOURS[5]}
"""Health word → its colour, for words that are no alarm; all other words are orange."""

WIDEST = 5.0
"""Least limit of the axis of innovations [standard deviations]. Source: layout."""


def draw_innovations(axes: Axes, result: Curves) -> None:
    """Draw a result's innovations in standard deviations, with lines at ±2, between which 95 %
    should be.
    """
    ratios = result.innovations / np.sqrt(result.innovation_variances)
    axes.axhspan(-2.0, 2.0, color=PALE, linewidth=0)
    for edge in (-2.0, 2.0):
        axes.axhline(edge, color=SOFT, linewidth=0.7, linestyle=(0, (4, 2)))
    for i, name in enumerate(result.measured):
        style = {"color": colour(i), "linewidth": 0.7, "alpha": 0.8}
        axes.plot(from_start(result.time), ratios[:, i], label=plain(name), **style)
    sizes = np.abs(ratios[np.isfinite(ratios)])
    limit = max(WIDEST, 1.2 * float(np.quantile(sizes, 0.98))) if len(sizes) else WIDEST
    axes.set_ylim(-limit, limit)
    axes.set_ylabel("innovation [σ]")
    _finish(axes, "" if len(sizes) else "nothing is compared")


def draw_forces(axes: Axes, log: Log, rig: Rig) -> None:
    """Draw the forces and motor torques at the drives and the tensions that a log has."""
    sensors = [
        sensor
        for sensor in rig.sensors
        if sensor.measures in ("force", "tension") and sensor.name in log.channels
    ]
    for i, sensor in enumerate(sensors):
        force = log.channels[sensor.name]
        style = curve_style(i)
        axes.plot(from_start(log.time), force, linewidth=0.9, label=plain(sensor.name), **style)
    units = ", ".join(sorted({sensor.si for sensor in sensors}))
    assumed = "\nassumed scale" if "force" in rig.taken else ""
    axes.set_ylabel(f"measured [{units}]{assumed}")
    _finish(axes, "" if sensors else "no force is measured")


def _finish(axes: Axes, text: str) -> None:
    """Put the legend above a panel, and a text that says why it is empty into its middle."""
    legend_above(axes, most=6)
    middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
    axes.text(0.5, 0.5, text, color=SOFT, **middle)


SHADED = {"touched": FAINT, "outside": PALE}
"""Health word → grey on which an angle stands while it holds. Source: layout."""


def _spans(time: Floats, health: Sequence[str], word: str) -> list[tuple[float, float]]:
    """Return begin and length of each time in which a health word holds [s]."""
    step = float(np.median(np.diff(time))) if len(time) > 1 else 1.0
    edges = np.flatnonzero(np.diff(np.array(health) == word, prepend=False, append=False))
    return [(time[a], time[b - 1] - time[a] + step) for a, b in zip(edges[::2], edges[1::2])]


def draw_health(axes: Axes, time: Floats, health: Sequence[str]) -> None:
    """Draw as bars, in one row for each health word, "ok" first, when the word held.

    Args:
        time: time since the first sample [s], (k,).
        health: the health word of each sample, (k,).
    """
    words = sorted(set(health), key=lambda word: (word != "ok", word))
    for row, word in enumerate(words):
        spans = _spans(time, health, word)
        axes.broken_barh(
            spans, (row - 0.35, 0.7), color=HEALTH_COLOURS.get(word, COLOURS[1]), linewidth=0
        )
    axes.set_yticks(range(len(words)), words, fontsize=7)
    axes.set_ylim(len(words) - 0.4, -0.6)
    axes.set_ylabel("health")


PANELS = ("innovations", "forces", "health")
"""Names of the panels that a plot has on request; see `plot_estimates`."""

SHARE = 0.98
"""Share of the errors and bands that an error axis shows. Source: layout."""


class PlotOptions(TypedDict, total=False):
    """Keyword options of a plot; see `plot_estimates`."""

    title: str | None
    panels: Sequence[str]
    log: Log | None
    rig: Rig | None
    health: Sequence[str] | None


def plot_estimates(
    estimates: Sequence[Curves],
    path: str | Path | None = None,
    *,
    title: str | None = None,
    panels: Sequence[str] = (),
    log: Log | None = None,
    rig: Rig | None = None,
    health: Sequence[str] | None = None,
) -> Figure:
    """Draw truth, estimates and their bands over time, with the errors below; each joint has
    its own column of axes.

    Where the truth is not known, the half-width of the band stands below instead of the errors.

    Args:
        path: where to save the figure; with None it is only returned.
        title: title of the figure; by default it is the rig's name.
        panels: names of further panels, from `PANELS`: the first estimate's innovations in standard
            deviations, with lines at ±2; measured forces, tensions and torques; and the stream's
            health.
        log: log whose forces the panel ``forces`` shows.
        rig: rig that gives the units of these forces.
        health: a health word for each sample (`distal.log_health`), for the panel ``health``; where
            it is one of `SHADED`, the angle stands on grey.

    Raises:
        OutputError: the file cannot be written, a panel is unknown, or a panel lacks the data that
            it draws.
    """
    first = estimates[0]
    joints = len(first.joint_names)
    check_panels(panels)
    heights = [2.2, 1.1, *(0.8 if panel == "health" else 1.1 for panel in panels)]
    size = (6.5 if joints == 1 else 4.0 * joints, 0.9 + 1.25 * sum(heights))
    with figure(len(heights), joints, size, sharex=True, height_ratios=heights) as (drawing, axes):
        for joint, name in enumerate(first.joint_names):
            column = axes[joint::joints]
            _draw_joint(column[:2], estimates, joint, health)
            if joints > 1:
                column[0].set_ylabel(f"{plain(name[:40])} [°]")
            if not panels:
                column[1].set_xlabel(time_label(first.time))
            column[1].tick_params(labelbottom=not panels or joints > 1)
        for row, panel in enumerate(panels, start=2):
            position = axes[row * joints] if joints == 1 else _across(drawing, axes, row, joints)
            if panel == "innovations":
                draw_innovations(position, first)
            elif panel == "forces":
                if log is None or rig is None:
                    raise OutputError(
                        "the panel 'forces' draws what was measured; give log=… and rig=…"
                    )
                draw_forces(position, log, rig)
            else:
                if health is None:
                    raise OutputError(
                        "the panel 'health' draws a word for each sample; give "
                        "health=distal.log_health(log, rig)"
                    )
                draw_health(position, from_start(first.time), health)
            if row == len(heights) - 1:
                position.set_xlabel(time_label(first.time))
        drawing.align_ylabels()
        drawing.suptitle(plain((title or first.rig)[:90]), fontsize=9, x=0.01, ha="left")
    return save_figure(drawing, path)


def _across(drawing: Figure, axes: Sequence[Axes], row: int, columns: int) -> Axes:
    """Return axes that reach over all columns of a row and replace the axes of its columns."""
    for cell in axes[row * columns : (row + 1) * columns]:
        cell.remove()
    grid = axes[0].get_gridspec()
    assert grid is not None
    across: Axes = drawing.add_subplot(grid[row, :], sharex=axes[0])
    return across


def check_panels(panels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of panels as a tuple; raise an `OutputError` where one is not in
    `PANELS`.
    """
    for panel in panels:
        if panel not in PANELS:
            raise OutputError(f"a plot has no panel '{panel}'{did_you_mean(panel, PANELS)}")
    return tuple(panels)


def _draw_joint(
    axes: Sequence[Axes], estimates: Sequence[Curves], joint: int, health: Sequence[str] | None
) -> None:
    """Draw one joint: its angle in the upper axes, its error in the lower ones, or the width of its
    band where no truth is known. Of several joints only the first has a legend.
    """
    top, below = axes
    first = estimates[0]
    truth = _truth_of(first, joint)
    since = from_start(first.time)
    entries: list[tuple[Artist, str]] = []
    if truth is not None:
        (line,) = top.plot(since, np.rad2deg(truth), **TRUTH)
        entries.append((line, "truth"))
    for i, estimate in enumerate(estimates):
        theta = np.rad2deg(estimate.angles[:, joint])
        half = _half_width(estimate, joint)
        time = from_start(estimate.time)
        band = _shade(top, time, theta - half, theta + half, i)
        handle = band, *top.plot(time, theta, linewidth=1.2, **curve_style(i))
        entries.append((handle, f"{estimate.estimator}, {COVERED_TEXT} band"))
    _limit_angles(top, estimates, joint)
    for word, grey in SHADED.items():
        spans = _spans(since, health or (), word)
        if spans:
            bars = top.broken_barh(
                spans,
                (0, 1),
                transform=top.get_xaxis_transform(),
                color=grey,
                linewidth=0,
                zorder=0,
            )
            entries.append((bars, word))
    top.set_ylabel("joint angle θ [°]")
    if joint == 0:
        legend_above(top, entries, most=4 if len(first.joint_names) == 1 else 2)
    if first.truths is not None:
        _draw_errors(below, estimates, joint)
        return
    for i, estimate in enumerate(estimates):
        half = _half_width(estimate, joint)
        below.plot(from_start(estimate.time), half, linewidth=1.0, **curve_style(i))
    below.set_ylim(bottom=0.0)
    below.set_ylabel(f"{COVERED_TEXT} band ± [°]")


def _draw_errors(axes: Axes, estimates: Sequence[Curves], joint: int) -> None:
    """Draw a joint's errors with the bands about zero, on an axis that a short large error does not
    stretch.
    """
    drawn = []
    for i, estimate in enumerate(estimates):
        time = from_start(estimate.time)
        truth = _truth_of(estimate, joint)
        error = np.rad2deg(estimate.angles[:, joint] - (np.nan if truth is None else truth))
        half = _half_width(estimate, joint)
        _shade(axes, time, -half, half, i)
        axes.plot(time, error, linewidth=1.0, **curve_style(i))
        drawn += [np.abs(error), half]
    axes.axhline(0.0, color=BLACK, linewidth=0.6)
    axes.set_ylabel("error [°]")
    limit = 1.3 * float(np.nanquantile(drawn, SHARE))
    axes.set_ylim(-limit, limit)


def _truth_of(estimate: Curves, joint: int) -> Floats | None:
    """Return a joint's true angle [rad], (k,), or None where it is known at no sample."""
    if estimate.truths is None or not np.isfinite(estimate.truths[:, joint]).any():
        return None
    return estimate.truths[:, joint]


def _half_width(estimate: Curves, joint: int) -> Floats:
    """Return the half-width of a joint's band [°]."""
    return np.rad2deg(BAND * estimate.angle_stds[:, joint])


def _shade(axes: Axes, time: Floats, low: Floats, high: Floats, index: int) -> Artist:
    """Shade a band and draw its edges, so that a band as narrow as a line is visible; return the
    handle for a legend.
    """
    for edge in (low, high):
        axes.plot(time, edge, color=colour(index), linewidth=0.4, alpha=0.6)
    return axes.fill_between(time, low, high, color=band_colour(colour(index)), linewidth=0)


def _limit_angles(axes: Axes, estimates: Sequence[Curves], joint: int) -> None:
    """Keep the limits of an angle axis near the curves; a much wider band is cut off at the
    limits.
    """
    curves = [np.rad2deg(estimate.angles[:, joint]) for estimate in estimates]
    truth = _truth_of(estimates[0], joint)
    curves += [] if truth is None else [np.rad2deg(truth)]
    every = np.concatenate(curves)
    lowest = np.nanmin(every)
    highest = np.nanmax(every)
    low, high = axes.get_ylim()
    room = 0.3 * max(highest - lowest, 1.0)
    axes.set_ylim(max(low, lowest - room), min(high, highest + room))
