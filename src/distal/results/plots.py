"""How tables and figures look: rows as HTML; colours and dashes that colour-blind readers can tell
apart, bands, panels of forces and of a stream's health, legends; and how figures are written.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING, TypedDict

import numpy as np

from distal.arrays import Floats
from distal.errors import OutputError, did_you_mean
from distal.logs import Log, write_whole
from distal.rig import Rig

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure


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
        from matplotlib import rc_context
        from matplotlib.figure import Figure
    except ValueError as problem:  # a setting of the user's, such as $MPLBACKEND
        raise OutputError(f"nothing can be drawn: matplotlib does not start ({problem})") from None

    with rc_context(STYLE):
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
    from matplotlib import rc_context

    kind = plot_kind(path)
    buffer = io.BytesIO()
    # no dates inside, so that the same results give the same file
    label = drawing.get_label()
    title = {"Title": label} if label else {}
    metadata = {"svg": {"Date": None, **title}, "pdf": {"CreationDate": None, **title}}.get(kind)
    with rc_context(STYLE), warnings.catch_warnings():
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


HEALTH_COLOURS = {"ok": COLOURS[2], "untested": COLOURS[5]}
"""Health word → its colour, for words that are no alarm; all other words are orange."""


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
    finish_panel(axes, "" if sensors else "no force is measured")


def finish_panel(axes: Axes, text: str) -> None:
    """Put the legend above a panel, and a text that says why it is empty into its middle."""
    legend_above(axes, most=6)
    middle = {"ha": "center", "va": "center", "transform": axes.transAxes}
    axes.text(0.5, 0.5, text, color=SOFT, **middle)


SHADED = {"touched": FAINT, "outside": PALE}
"""Health word → grey on which an angle stands while it holds. Source: layout."""


def spans_of(time: Floats, health: Sequence[str], word: str) -> list[tuple[float, float]]:
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
        look = {"color": HEALTH_COLOURS.get(word, COLOURS[1]), "linewidth": 0}
        axes.broken_barh(spans_of(time, health, word), (row - 0.35, 0.7), **look)
    axes.set_yticks(range(len(words)), words, fontsize=7)
    axes.set_ylim(len(words) - 0.4, -0.6)
    axes.set_ylabel("health")


PANELS = ("innovations", "forces", "health")
"""Names of the panels that a plot has on request; see `plot_estimates`."""


def check_panels(panels: Sequence[str]) -> tuple[str, ...]:
    """Return the names of panels as a tuple; raise an `OutputError` where one is not in
    `PANELS`.
    """
    for panel in panels:
        if panel not in PANELS:
            raise OutputError(f"a plot has no panel '{panel}'{did_you_mean(panel, PANELS)}")
    return tuple(panels)


def draw_band(axes: Axes, time: Floats, middle: Floats, half: Floats, index: int) -> Artist:
    """Shade a band and draw its edges, so that a band as narrow as a line is visible; return the
    handle for a legend.

    Args:
        time: since the first sample [s], (k,).
        middle: of the band [deg], (k,).
        half: its half-width [deg], (k,).
        index: of its colour.
    """
    edges = middle - half, middle + half
    for edge in edges:
        axes.plot(time, edge, color=colour(index), linewidth=0.4, alpha=0.6)
    return axes.fill_between(time, *edges, color=band_colour(colour(index)), linewidth=0)


class PlotOptions(TypedDict, total=False):
    """Keyword options of a plot; see `plot_estimates`."""

    title: str | None
    panels: Sequence[str]
    log: Log | None
    rig: Rig | None
    health: Sequence[str] | None
