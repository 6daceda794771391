"""An interactive page on a log: the moving chain, and curves of angle, error, innovations, forces
and health to zoom into.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from html import escape
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import in_percent
from distal.errors import OutputError
from distal.logs import Log, shown, write_whole
from distal.reports.moving_chain import moving_chain
from distal.reports.page import html_table, page, paragraph, picture
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    BAND_ALPHA,
    BLACK,
    COLOURS,
    HEALTH_COLOURS,
    SOFT,
    Estimate,
    from_start,
    time_label,
)
from distal.rig import Rig
from distal.run import log_health

if TYPE_CHECKING:
    from plotly.graph_objects import Scatter


MOST_POINTS = 60_000
"""Number of points drawn of a curve at most; of a longer log every second, third, … sample is
drawn, so that a browser stays quick. Source: layout.
"""

HEIGHTS = (320, 170, 135, 135, 85)
"""Heights of the curves of angle and error for each joint, then of innovations, forces and health
[pixels]. Source: layout.
"""

GAP = 28
"""Height of the gaps between the curves [pixels]. Source: layout."""

FILL = "rgba({}, {}, {}, {})".format(
    *(int(COLOURS[0][k : k + 2], 16) for k in (1, 3, 5)), BAND_ALPHA
)
"""Colour of the band."""

PAGE = {"scrollZoom": True, "displaylogo": False, "responsive": True}
"""Settings of plotly: the mouse wheel zooms, plotly's logo is hidden, and the curves follow the
page's width.
"""


def view_page(
    estimate: Estimate, log: Log, rig: Rig, path: str | Path, sentences: Sequence[str] = ()
) -> Path:
    """Write one self-contained HTML file on an estimate, and return its path.

    Args:
        sentences: text above the curves.

    Raises:
        OutputError: plotly is not installed, or the file cannot be written.
    """
    check_plotly()
    from plotly.subplots import make_subplots

    step = max(1, -(-len(log) // MOST_POINTS))
    rows = slice(None, None, step)
    joints = len(estimate.joint_names)
    words = log_health(log, rig)[rows]
    below = (
        "error [°]" if estimate.truths is not None else f"{in_percent(estimate.level)} band ± [°]"
    )
    angles = (
        ["joint angle [°]"]
        if joints == 1
        else [f"{_text(name)} [°]" for name in estimate.joint_names]
    )
    names = [
        *(name for angle in angles for name in (angle, below)),
        "innovation [σ]",
        "measured",
        "health",
    ]
    heights = [*(HEIGHTS[:2] * joints), *HEIGHTS[2:]]
    total = sum(heights) + GAP * (len(heights) - 1)
    figure = make_subplots(
        rows=len(names), shared_xaxes="all", vertical_spacing=GAP / total, row_heights=heights
    )
    time = from_start(estimate.time)[rows]
    for joint in range(joints):
        for row, trace in _angle(estimate, joint, time, rows):
            figure.add_trace(trace, row=2 * joint + row, col=1)
    last = len(names)
    for row, trace in [
        *_compared(estimate, time, rows),
        *_measured(log, rig, time, rows),
        *_health(time, words),
    ]:
        figure.add_trace(trace, row=last + row, col=1)
    for edge in (-2.0, 2.0):
        figure.add_hline(
            y=edge, row=last - 2, col=1, line={"color": SOFT, "width": 1, "dash": "dash"}
        )
    for row, name in enumerate(names, 1):
        figure.update_yaxes(title_text=name, row=row, col=1)
    for row in (*range(2, 2 * joints + 1, 2), last):
        figure.update_xaxes(showticklabels=True, row=row, col=1)
    figure.update_xaxes(title_text=time_label(estimate.time), row=last)
    figure.update_xaxes(
        showspikes=True, spikemode="across", spikethickness=1, spikecolor=SOFT, spikedash="dot"
    )
    figure.update_layout(
        template="plotly_white",
        hovermode="x unified",
        height=total + 180,
        # the toolbar has the room above; the legend stands below, where it may take as many rows as
        # a narrow page needs
        margin={"l": 70, "r": 30, "t": 50, "b": 50},
        legend={
            "orientation": "h",
            "yanchor": "top",
            "y": -60 / total,
            "x": 0.0,
            "traceorder": "normal",
        },
    )
    figure.update_yaxes(type="category", range=[-0.7, len(set(words)) - 0.3], row=last, col=1)
    curves = figure.to_html(include_plotlyjs=True, full_html=False, config=PAGE)
    moving, script = moving_chain(estimate, log, rig)
    parts = [
        *map(paragraph, sentences),
        *([paragraph(f"Drawn is one sample of {step}.")] if step > 1 else []),
        *([_summary(estimate)] if joints > 1 else []),
        f"<div class='beside'>{moving}<div>{curves}</div></div>",
        script,
        picture(rig_svg(rig), "The rig: drives, tendons, joints and sensors."),
    ]
    lead = estimate.in_words() if joints == 1 else f"{estimate.estimator}: {joints} joints"
    write_whole(path, page(shown(Path(log.source).name), lead, parts))
    return Path(path)


def _summary(estimate: Estimate) -> str:
    """Return a table with a row for each joint: range, band, and error where the truth is known."""
    rows = [
        [
            escape(row["joint"]),
            f"{row['least [deg]']:.2f}° to {row['greatest [deg]']:.2f}°",
            f"±{row['median band [deg]']:.2f}°",
            "" if row["RMS error [deg]"] is None else f"{row['RMS error [deg]']:.2f}°",
            "" if row["inside band"] is None else f"{100 * row['inside band']:.0f} %",
        ]
        for row in estimate.summary()
    ]
    return html_table(
        ["joint", "angle", f"{in_percent(estimate.level)} band, median", "RMS error", "inside"],
        rows,
        range(1, 5),
    )


def check_plotly() -> None:
    """Raise an `OutputError` where plotly is not installed."""
    try:
        import plotly  # noqa: F401
    except ImportError:
        raise OutputError("an interactive page needs plotly; pip install '.[view]'") from None


def _text(text: str) -> str:
    """Return a text in which plotly sees no markup."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


def _angle(
    estimate: Estimate, joint: int, time: Floats, rows: slice
) -> Iterator[tuple[int, Scatter]]:
    """Return the traces of a joint: row 1 has its angle, row 2 its error, or its band where the
    truth is not known.
    """
    first = joint == 0
    angle = np.rad2deg(estimate.angles[rows, joint])
    half = np.rad2deg(estimate.stds_of_band * estimate.angle_stds[rows, joint])
    name = f"{in_percent(estimate.level)} band"
    yield from ((1, trace) for trace in _band(time, angle - half, angle + half, name, first))
    line = _line(time, angle, estimate.estimator, COLOURS[0], first)
    if estimate.truths is None:
        yield 1, line
        yield 2, _line(time, half, "band ±", COLOURS[0], False)
        return
    truth = np.rad2deg(estimate.truths[rows, joint])
    yield 1, _line(time, truth, "truth", BLACK, first, width=2.5)
    yield 1, line
    yield from ((2, trace) for trace in _band(time, -half, half, name, False))
    yield 2, _line(time, angle - truth, "error", COLOURS[0], False)


def _compared(estimate: Estimate, time: Floats, rows: slice) -> Iterator[tuple[int, Scatter]]:
    ratios = (estimate.innovations / np.sqrt(estimate.innovation_variances))[rows]
    for i, name in enumerate(estimate.measured):
        yield (
            -2,
            _line(
                time,
                ratios[:, i],
                f"innovation {name}",
                COLOURS[(i + 1) % len(COLOURS)],
                True,
                width=1.0,
            ),
        )


def _measured(log: Log, rig: Rig, time: Floats, rows: slice) -> Iterator[tuple[int, Scatter]]:
    sensors = [
        s for s in rig.sensors if s.measures in ("force", "tension") and s.name in log.channels
    ]
    for i, sensor in enumerate(sensors):
        name = f"{sensor.name} [{sensor.si}]"
        yield (
            -1,
            _line(
                time,
                log.channels[sensor.name][rows],
                name,
                COLOURS[(i + 1) % len(COLOURS)],
                True,
                width=1.0,
            ),
        )


def _health(time: Floats, words: Sequence[str]) -> Iterator[tuple[int, Scatter]]:
    """Return a trace for each health word that occurs: a thick line where it holds."""
    for word in sorted(set(words), key=lambda word: (word != "ok", word)):
        heights = [word if current == word else None for current in words]
        trace = _line(time, heights, word, HEALTH_COLOURS.get(word, COLOURS[1]), False, width=9)
        trace.update(hovertemplate=f"{word}<extra></extra>")
        yield 0, trace


def _line(
    time: Floats,
    values: Floats | Sequence[str | None],
    name: str,
    colour: str,
    in_legend: bool,
    width: float = 1.5,
) -> Scatter:
    from plotly.graph_objects import Scatter

    return Scatter(
        x=time,
        y=values,
        name=_text(name),
        mode="lines",
        line={"color": colour, "width": width},
        showlegend=in_legend,
        hovertemplate="%{y:.4g}",
    )


def _band(
    time: Floats, low: Floats, high: Floats, name: str, in_legend: bool
) -> tuple[Scatter, Scatter]:
    """Return the lower and the upper edge of a band, with the area between them filled."""
    from plotly.graph_objects import Scatter

    edge = {
        "x": time,
        "mode": "lines",
        "line": {"color": COLOURS[0], "width": 0.5},
        "hoverinfo": "skip",
    }
    lower = Scatter(y=low, showlegend=False, name=name, **edge)
    upper = Scatter(y=high, fill="tonexty", fillcolor=FILL, name=name, showlegend=in_legend, **edge)
    return lower, upper
