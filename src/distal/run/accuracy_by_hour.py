"""The accuracy of an estimate hour after hour."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.confidence import BAND, COVERED
from distal.results import COLOURS, DASHES, figure, legend_above, save_figure
from distal.run.long_logs import PieceEstimate
from distal.simulation.drifting_plant import HOUR

if TYPE_CHECKING:
    from matplotlib.figure import Figure


@dataclass(frozen=True)
class Hour:
    """The accuracy in one hour, all joints together.

    Args:
        index: of the hour, from 0.
        rms: RMS error [rad].
        inside: share of the samples inside the 95 % band.
        half_band: mean half-width of the band [rad].
    """

    index: int
    rms: float
    inside: float
    half_band: float


def by_hour(pieces: Iterable[PieceEstimate]) -> tuple[Hour, ...]:
    """Return the accuracy in each hour; the pieces are taken one by one, so that they may be a
    generator.
    """
    sums = defaultdict[int, np.ndarray](lambda: np.zeros(4))
    for piece in pieces:
        errors = piece.angles - piece.truths
        half = BAND * piece.angle_stds
        of_hour = (piece.log.time / HOUR).astype(int)
        for index in np.unique(of_hour):
            rows = of_hour == index
            error = errors[rows]
            half_band = half[rows]
            is_inside = np.abs(error) <= half_band
            sums[int(index)] += [error.size, np.sum(error**2), np.sum(is_inside), np.sum(half_band)]
    return tuple(
        Hour(index, float(np.sqrt(square / count)), float(inside / count), float(half / count))
        for index, (count, square, inside, half) in sorted(sums.items())
    )


def plot_hours(hours_of: Mapping[str, Sequence[Hour]], path: str | Path | None = None) -> Figure:
    """Draw RMS error, half-width of the band and coverage over the hours, one curve for each
    estimate, and return the figure.

    Args:
        hours_of: name of an estimate → its hours.
        path: where to save the figure; None does not save it.
    """
    with figure(2, 1, (6.5, 4.4), sharex=True, height_ratios=(3, 2)) as (drawing, (errors, shares)):
        for k, (name, hours) in enumerate(hours_of.items()):
            at = [hour.index + 1 for hour in hours]
            look = {"color": COLOURS[k], "marker": "o", "markersize": 3}
            errors.plot(
                at,
                np.rad2deg([hour.rms for hour in hours]),
                ls=DASHES[0],
                label=f"{name}: RMS error",
                **look,
            )
            band = np.rad2deg([hour.half_band for hour in hours])
            errors.plot(at, band, ls=DASHES[1], label=f"{name}: half of the band", **look)
            shares.plot(at, [100 * hour.inside for hour in hours], ls=DASHES[k], **look)
        errors.set_ylim(0.0, None)
        errors.set_ylabel("angle [°]")
        shares.axhline(100 * COVERED, color="black", lw=0.8)
        shares.set_ylim(
            min(80.0, 100 * min(hour.inside for hours in hours_of.values() for hour in hours) - 2),
            101.0,
        )
        shares.set_ylabel("inside the band [%]")
        shares.set_xlabel("hour")
        legend_above(errors, most=2)
    if path is not None:
        save_figure(drawing, path)
    return drawing
