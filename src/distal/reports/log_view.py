"""An interactive page on a log: the moving chain, and curves of angle, error, innovations, forces
and health to zoom into.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import in_percent
from distal.errors import OutputError
from distal.logs import Log, shown, write_whole
from distal.reports.moving_chain import moving_chain
from distal.reports.page import page, paragraph, picture
from distal.reports.rig_drawing import rig_svg
from distal.results import (
    BLACK,
    COLOURS,
    HEALTH_COLOURS,
    SOFT,
    Estimate,
    band_colour,
    colour,
    from_start,
    in_order,
    pulls_of,
    time_label,
)
from distal.rig import Rig
from distal.run import log_health

if TYPE_CHECKING:
    from plotly.graph_objects import Figure as PlotlyFigure


MOST_POINTS = 60_000
"""Number of points drawn of a curve at most; of a longer log every second, third, … sample is
drawn, so that a browser stays quick. Source: layout.
"""

HEIGHTS = (320, 170, 135, 135, 85)
"""Heights of the curves of angle and error for each joint, then of innovations, forces and health
[pixels]. Source: layout.
"""

CURVE_GAP = 28
"""Height of the gaps between the curves [pixels]. Source: layout."""

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
    percent = in_percent(estimate.level)
    below = "error [°]" if estimate.truths is not None else f"{percent} band ± [°]"
    names = list[str]()
    for name in estimate.joint_names:
        names += ["joint angle [°]" if joints == 1 else f"{_text(name)} [°]", below]
    names += ["innovation [σ]", "measured", "health"]
    heights = [*(HEIGHTS[:2] * joints), *HEIGHTS[2:]]
    total = sum(heights) + CURVE_GAP * (len(heights) - 1)
    figure = make_subplots(
        rows=len(names), shared_xaxes="all", vertical_spacing=CURVE_GAP / total, row_heights=heights
    )
    last = len(names)
    curves = _Curves(figure, from_start(estimate.time)[rows])
    for joint in range(joints):
        _draw_angle(curves, estimate, joint, rows)
    ratios = (estimate.innovations / np.sqrt(estimate.innovation_variances))[rows]
    for i, name in enumerate(estimate.measured):
        curves.line(last - 2, ratios[:, i], f"innovation {name}", colour(i + 1), width=1.0)
    for edge in (-2.0, 2.0):
        line = {"color": SOFT, "width": 1, "dash": "dash"}
        figure.add_hline(y=edge, row=last - 2, col=1, line=line)
    for i, sensor in enumerate(pulls_of(log, rig)):
        name = f"{sensor.name} [{sensor.si}]"
        curves.line(last - 1, log.channels[sensor.name][rows], name, colour(i + 1), width=1.0)
    for word in in_order(words):
        held = [word if current == word else None for current in words]
        curves.line(last, held, word, HEALTH_COLOURS.get(word, COLOURS[1]), False, width=9)
    for row, name in enumerate(names, 1):
        figure.update_yaxes(title_text=name, row=row, col=1)
    for row in (*range(2, 2 * joints + 1, 2), last):
        figure.update_xaxes(showticklabels=True, row=row, col=1)
    figure.update_xaxes(title_text=time_label(estimate.time), row=last)
    figure.update_xaxes(
        showspikes=True, spikemode="across", spikethickness=1, spikecolor=SOFT, spikedash="dot"
    )
    figure.update_yaxes(type="category", range=[-0.7, len(set(words)) - 0.3], row=last, col=1)
    # the toolbar has the room above; the legend stands below, where it may take as many rows as a
    # narrow page needs
    legend = {"orientation": "h", "yanchor": "top", "y": -60 / total, "x": 0.0}
    figure.update_layout(
        template="plotly_white",
        hovermode="x unified",
        height=total + 180,
        margin={"l": 70, "r": 30, "t": 50, "b": 50},
        legend=legend | {"traceorder": "normal"},
    )
    drawn = figure.to_html(include_plotlyjs=True, full_html=False, config=PAGE)
    moving, script = moving_chain(estimate, log, rig)
    parts = [
        *map(paragraph, sentences),
        paragraph(f"Drawn is one sample of {step}.") if step > 1 else "",
        estimate.table() if joints > 1 else "",
        f"<div class='beside'>{moving}<div>{drawn}</div></div>",
        script,
        picture(rig_svg(rig), "The rig: drives, tendons, joints and sensors."),
    ]
    lead = estimate.in_words() if joints == 1 else f"{estimate.estimator}: {joints} joints"
    write_whole(path, page(shown(Path(log.source).name), lead, parts))
    return Path(path)


def check_plotly() -> None:
    """Raise an `OutputError` where plotly is not installed."""
    try:
        import plotly  # noqa: F401
    except ImportError:
        raise OutputError("an interactive page needs plotly; pip install '.[view]'") from None


def _text(text: str) -> str:
    """Return a text in which plotly sees no markup."""
    return text.replace("&", "&amp;").replace("<", "&lt;")


@dataclass(frozen=True)
class _Curves:
    """Curves over the same times [s], (k,), in the rows of a figure of plotly."""

    figure: PlotlyFigure
    time: Floats

    def line(
        self,
        row: int,
        values: Floats | Sequence[str | None],
        name: str,
        colour: str,
        in_legend: bool = True,
        width: float = 1.5,
        **more: object,
    ) -> None:
        self.figure.add_scatter(
            x=self.time,
            y=values,
            name=_text(name),
            mode="lines",
            line={"color": colour, "width": width},
            showlegend=in_legend,
            **{"hovertemplate": "%{y:.4g}", **more},
            row=row,
            col=1,
        )

    def band(self, row: int, low: Floats, high: Floats, name: str, in_legend: bool) -> None:
        silent: dict[str, object] = {"hoverinfo": "skip", "hovertemplate": None}
        filled = silent | {"fill": "tonexty", "fillcolor": band_colour()}
        self.line(row, low, name, COLOURS[0], False, 0.5, **silent)
        self.line(row, high, name, COLOURS[0], in_legend, 0.5, **filled)


def _draw_angle(curves: _Curves, estimate: Estimate, joint: int, rows: slice) -> None:
    """Draw a joint's angle in a row, and below it its error, or its band where the truth is not
    known.
    """
    row = 2 * joint + 1
    first = joint == 0
    angle = np.rad2deg(estimate.angles[rows, joint])
    half = np.rad2deg(estimate.stds_of_band * estimate.angle_stds[rows, joint])
    name = f"{in_percent(estimate.level)} band"
    curves.band(row, angle - half, angle + half, name, first)
    if estimate.truths is None:
        curves.line(row, angle, estimate.estimator, COLOURS[0], first)
        curves.line(row + 1, half, "band ±", COLOURS[0], False)
        return
    truth = np.rad2deg(estimate.truths[rows, joint])
    curves.line(row, truth, "truth", BLACK, first, width=2.5)
    curves.line(row, angle, estimate.estimator, COLOURS[0], first)
    curves.band(row + 1, -half, half, name, False)
    curves.line(row + 1, angle - truth, "error", COLOURS[0], False)
