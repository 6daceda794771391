"""How well a controlled joint keeps to its reference: in numbers, and as a figure that compares
several feedbacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from math import nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import BAND, COVERED_TEXT
from distal.control.closed_loop import ClosedLoop
from distal.results import (
    BLACK,
    SOFT,
    band_colour,
    curve_style,
    figure,
    legend_above,
    save_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Tracking:
    """How one joint keeps to its reference.

    Args:
        rms: of the true angle's deviation from the reference [rad].
        effort: RMS of all commands [N or N m].
        estimate_rms: RMS error of the angle that the controller was told [rad].
    """

    joint: str
    rms: float
    effort: float
    estimate_rms: float


def trackings_of(run: ClosedLoop) -> tuple[Tracking, ...]:
    """Return how each controlled joint that has a reference keeps to it."""
    names = run.rig.joint_names
    effort = float(np.sqrt(np.mean([np.mean(commands**2) for commands in run.commands.values()])))
    trackings = []
    for name, reference in run.references.items():
        j = names.index(name)
        angle = run.angles[:, j]
        errors = run.estimates[:, j] - run.angles[:, j]
        errors = errors[np.isfinite(errors)]
        tracking = Tracking(
            name,
            rms=float(np.sqrt(np.mean((angle - reference) ** 2))),
            effort=effort,
            estimate_rms=float(np.sqrt(np.mean(errors**2))) if len(errors) else nan,
        )
        trackings.append(tracking)
    return tuple(trackings)


MOST_LIMIT = 3.0
"""End of the axis of deviations, as a multiple of the best run's; a run that is lost leaves the
axis. Source: layout.
"""


def plot_control(runs: Sequence[ClosedLoop], path: str | Path | None = None) -> Figure:
    """Draw the reference and, for each feedback, the true angle, its deviation and a command; also
    the error of the first estimator with its 95 % band.

    The `runs` are of one scenario with different feedbacks; the joint is the first one that is
    controlled.
    """
    first = runs[0]
    name = next(iter(first.references))
    j = first.rig.joint_names.index(name)
    reference = np.rad2deg(first.references[name])
    time = first.time
    with figure(3, 1, (6.5, 6.2), sharex=True, height_ratios=(3, 2, 2)) as (drawing, axes):
        axes[0].plot(time, reference, color=BLACK, lw=1.0, dashes=(4, 2), label="reference")
        worst = []
        for k, run in enumerate(runs):
            angle = np.rad2deg(run.angles[:, j])
            look = {"lw": 1.2, **curve_style(k)}
            axes[0].plot(time, angle, label=f"fed back by {run.feedback}", **look)
            axes[1].plot(time, angle - reference, **look)
            worst.append(float(np.quantile(np.abs(angle - reference), 0.98)))
            effort = next(iter(run.commands))
            # a feedback that chatters stands behind the others
            axes[2].plot(time, run.commands[effort], zorder=3 - 0.1 * k, **look)
        estimated = next((run for run in runs if run.feedback not in ("encoder", "ratio")), None)
        if estimated is not None:
            error = np.rad2deg(estimated.estimates[:, j] - estimated.angles[:, j])
            half = BAND * np.rad2deg(estimated.stds[:, j])
            axes[1].plot(
                time,
                error,
                color=SOFT,
                lw=0.8,
                label=f"error of {estimated.feedback} and its {COVERED_TEXT} band",
            )
            axes[1].fill_between(time, error - half, error + half, color=band_colour(SOFT), lw=0)
            legend_above(axes[1])
        limit = MOST_LIMIT * min(worst)
        span = float(np.ptp(reference)) or 1.0
        axes[0].set_ylim(reference.min() - 0.4 * span, reference.max() + 0.4 * span)
        axes[1].set_ylim(-limit, limit)
        axes[0].set_ylabel(f"angle of {name} [°]")
        axes[1].set_ylabel("from reference [°]")
        drive = first.rig.drives[0]
        axes[2].set_ylabel(f"command {drive.name} [{'N' if drive.kind == 'slider' else 'N m'}]")
        axes[2].set_xlabel("time [s]")
        legend_above(axes[0])
    return save_figure(drawing, path)
