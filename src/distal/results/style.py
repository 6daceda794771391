"""The look of every figure: colours and dashes that colour-blind readers can tell apart, legends
beside the curves.
"""

from __future__ import annotations

import io
import warnings
from collections.abc import Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.errors import OutputError
from distal.logs import write_whole

if TYPE_CHECKING:
    from matplotlib.artist import Artist
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

# Okabe and Ito's palette, which colour-blind readers can tell apart; each curve has its own dash as
# well
COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
BAND_ALPHA = 0.2
"""Opacity of a shaded band."""

_GAPS = ((5, 1.5), (1.5, 1), (5, 1, 1, 1), (8, 2), (3, 1, 1, 1, 1, 1))
DASHES: tuple[object, ...] = ("-", *((0, gaps) for gaps in _GAPS))
WHITE = "#FFFFFF"
PALE = "#EEF1F4"
FAINT = "#D0D7DE"
SOFT = "#57606A"
INK = "#1B1F24"
BLACK = "#000000"
"""From paper to ink: bodies, grids, what stands back, text; black is for what is true."""

GOOD = "#00634A"
BAD = "#A63C00"
"""Of words that say that something is well, or is not."""

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


TRUTH: Mapping[str, object] = {"color": BLACK, "linestyle": "-", "linewidth": 1.6}
"""How the truth is drawn in every figure."""


def styled() -> AbstractContextManager[None]:
    """Return the context in which axes and legends come out in distal's style."""
    import matplotlib

    context: AbstractContextManager[None] = matplotlib.rc_context(STYLE)
    return context


@contextmanager
def figure(
    rows: int = 1, columns: int = 1, size: tuple[float, float] = (6.5, 3.6), **options: object
) -> Iterator[tuple[Figure, list[Axes]]]:
    """Make a figure in distal's style without touching the user's backend or settings.

    The `size` is in inches; `options` are those of matplotlib's `Figure.subplots`.
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
    """Return the colour of a curve; after the last the first comes again."""
    return COLOURS[index % len(COLOURS)]


def curve_style(index: int) -> dict[str, object]:
    """Return colour and dash of a curve, as options of `Axes.plot`."""
    return {"color": colour(index), "linestyle": DASHES[index % len(DASHES)]}


def plain(text: str) -> str:
    """Return text as matplotlib shows it letter by letter: a $ begins no formula."""
    return text.replace("$", r"\$")


def plot_kind(path: str | Path) -> str:
    """Return the format that a plot's file name asks for: png, svg or pdf, else an
    `OutputError`.
    """
    kind = Path(path).suffix.lower().lstrip(".")
    if kind not in ("png", "svg", "pdf"):
        raise OutputError(f"{path}: a plot cannot be '{kind}'; .png, .svg and .pdf are allowed")
    return kind


def make_folder(path: str | Path) -> Path:
    """Return the folder, made if need be, or raise an `OutputError`."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as problem:
        raise OutputError(f"{folder}: cannot be made ({problem.strerror or problem})") from None
    return folder


def save_figure(drawing: Figure, path: str | Path) -> None:
    """Write a figure whole or not at all, in the format of its suffix."""
    write_whole(path, figure_bytes(drawing, path))


def figure_bytes(drawing: Figure, path: str | Path) -> bytes:
    """Return a figure as the file that `path` will hold, in the format of its suffix."""
    kind = plot_kind(path)
    buffer = io.BytesIO()
    # no dates inside, so that the same results give the same file
    metadata = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(kind)
    with styled(), warnings.catch_warnings():
        # a title may hold characters that the font lacks, or be too long: the plot is made all the
        # same
        warnings.simplefilter("ignore", UserWarning)
        drawing.savefig(buffer, format=kind, dpi=150, metadata=metadata)
    return buffer.getvalue()


def legend_above(axes: Axes, entries: Sequence[tuple[Artist, str]] = (), most: int = 4) -> None:
    """Put the legend of `entries` (default: of the axes) above the axes, where it never lies on a
    curve.
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


def title_above(drawing: Figure, title: str) -> None:
    """Put a title above everything else, to the left."""
    drawing.suptitle(plain(title[:90]), fontsize=9, x=0.01, ha="left")
