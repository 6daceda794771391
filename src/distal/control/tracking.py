"""How well a controlled joint keeps to its reference: in numbers, and as a figure that compares
several feedbacks.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from math import inf, nan
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.control.closed_loop import ClosedLoop
from distal.results import (
    BAND_ALPHA,
    BLACK,
    SOFT,
    curve_style,
    figure,
    legend_above,
    save_figure,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure


SETTLED_ERROR = float(np.deg2rad(2.0))
"""Largest deviation of a joint that has settled from its reference [rad]: 5 % of a step of 40°.
Source: judgement.
"""

LONG_ENOUGH = 1.0
"""Shortest time for which a reference must be constant to say how a joint settles [s]. Source:
judgement.
"""


@dataclass(frozen=True)
class Tracking:
    """How one joint keeps to its reference.

    Args:
        rms: of the true angle's deviation from the reference [rad].
        overshoot: largest motion beyond a reference that has become constant, in the direction in
            which the reference came [rad]; NaN where no reference has.
        settling: longest time until the angle stays within 2° of a constant reference [s]; infinite
            where it does not, NaN where no reference is constant.
        effort: RMS of all commands [N or N m].
        estimate_rms: RMS error of the angle that the controller was told [rad].
        at_rest: largest motion in the second half of a time in which all references are constant,
            by which a limit cycle shows [rad]; NaN where they never are.
    """

    joint: str
    rms: float
    overshoot: float
    settling: float
    effort: float
    estimate_rms: float
    at_rest: float


def trackings_of(run: ClosedLoop) -> tuple[Tracking, ...]:
    """Return how each controlled joint that has a reference keeps to it."""
    names = run.rig.joint_names
    effort = float(np.sqrt(np.mean([np.mean(commands**2) for commands in run.commands.values()])))
    # where a reference changes, it shakes the other joints too: that is no limit cycle
    still = constant_parts(run.time, *run.references.values())
    trackings = []
    for name, reference in run.references.items():
        j = names.index(name)
        angle = run.angles[:, j]
        errors = run.estimates[:, j] - run.angles[:, j]
        steps = [
            _step(run.time, reference, angle, *part) for part in constant_parts(run.time, reference)
        ]
        errors = errors[np.isfinite(errors)]
        tracking = Tracking(
            name,
            rms=float(np.sqrt(np.mean((angle - reference) ** 2))),
            overshoot=max((over for over, _ in steps), default=nan),
            settling=max((time for _, time in steps), default=nan),
            effort=effort,
            estimate_rms=float(np.sqrt(np.mean(errors**2))) if len(errors) else nan,
            at_rest=max((float(np.ptp(angle[(a + b) // 2 : b])) for a, b in still), default=nan),
        )
        trackings.append(tracking)
    return tuple(trackings)


def constant_parts(time: Floats, *references: Floats) -> list[tuple[int, int]]:
    """Return (begin, end), indices with the end excluded, of the parts of `time` in which all
    `references` are constant for at least `LONG_ENOUGH`.
    """
    moves = [np.abs(np.diff(reference)) > 1e-9 for reference in references]
    changes = np.flatnonzero(np.any(moves, axis=0)) + 1
    edges = [0, *changes.tolist(), len(time)]
    return [(a, b) for a, b in pairwise(edges) if b > a and time[b - 1] - time[a] >= LONG_ENOUGH]


def _step(
    time: Floats, reference: Floats, angle: Floats, begin: int, end: int
) -> tuple[float, float]:
    """Return overshoot [rad] and settling time [s] at a constant reference; the time is infinite
    where the joint does not settle.
    """
    error = angle[begin:end] - reference[begin]
    way = np.sign(reference[begin] - (reference[begin - 1] if begin else angle[0]))
    away = np.flatnonzero(np.abs(error) > SETTLED_ERROR)
    over = max(float(np.max(way * error)), 0.0)
    if not len(away):
        return over, 0.0
    last = begin + int(away[-1]) + 1
    return over, inf if last == end else float(time[last] - time[begin])


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
                label=f"error of {estimated.feedback} and its 95 % band",
            )
            axes[1].fill_between(
                time, error - half, error + half, color=SOFT, alpha=BAND_ALPHA, lw=0
            )
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
