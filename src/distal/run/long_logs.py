"""The filter over a long log that comes in pieces, so that only one piece is in memory; its
accuracy hour after hour.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import tee
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.estimators import AdaptiveFilter
from distal.homing import added_reference
from distal.logs import Log
from distal.results import BLACK, COLOURS, DASHES, figure, legend_above
from distal.rig import Rig, angle_names
from distal.simulation import Piece, Rezero
from distal.simulation.drifting_plant import HOUR


@dataclass(frozen=True)
class PieceEstimate:
    """The estimate over one piece of a log.

    Args:
        log: the piece.
        angles: estimated angles of the joints [rad], (k, n_joints).
        angle_stds: standard deviations of their errors [rad], (k, n_joints).
        truths: true angles [rad], (k, n_joints).
    """

    log: Log
    angles: Floats
    angle_stds: Floats
    truths: Floats


def estimate_pieces(
    pieces: Iterable[Piece], rig: Rig, rezero: Rezero | None = None
) -> Iterator[PieceEstimate]:
    """Estimate the joints' angles by `adaptive` piece after piece; the belief goes on from one
    piece to the next.

    Args:
        pieces: of a log in time order.
        rezero: of the scenario, whose known angles are then read; None: they are not.
    """
    estimator = AdaptiveFilter(rig)
    known = ""
    if rezero is not None:
        rate = max(sensor.rate for sensor in rig.sensors)
        reading, sensor = added_reference(rig, rate, rezero.joint)
        known = sensor.name
        offset = {"value": 0.0, "std": rezero.std}
        reading = reading.with_values({f"sensors.{known}.bias": offset})
        estimator = AdaptiveFilter(reading, references=reading.sensors[-1:])
    joints = len(rig.joints)

    def read(piece: Piece) -> tuple[Floats, Floats]:
        columns = {**piece.log.channels, known: piece.known}
        return piece.log.time, np.column_stack([columns[name] for name in estimator.channels])

    pieces, again = tee(pieces)
    estimates = estimator.pieces(None, map(read, again))
    for piece, (means, variances, *_) in zip(pieces, estimates):
        log = piece.log
        truths = np.column_stack([log.truth[name] for name in angle_names(rig.joint_names)])
        stds = np.sqrt(np.maximum(variances[:, :joints], 0.0))
        yield PieceEstimate(log, means[:, :joints], stds, truths)


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
    generator. A piece counts for the hour in which it begins.
    """
    sums = defaultdict[int, np.ndarray](lambda: np.zeros(4))
    for piece in pieces:
        errors = np.abs(piece.angles - piece.truths)
        half = BAND * piece.angle_stds
        counted = [errors.size, np.sum(errors**2), np.sum(errors <= half), np.sum(half)]
        sums[int(piece.log.time[0] / HOUR)] += counted
    return tuple(
        Hour(index, float(np.sqrt(square / count)), float(inside / count), float(half / count))
        for index, (count, square, inside, half) in sorted(sums.items())
    )


def plot_hours(hours_of: Mapping[str, Sequence[Hour]]) -> Figure:
    """Return a figure of RMS error, half-width of the band and coverage over the hours, one curve
    for each estimate.

    Args:
        hours_of: name of an estimate → its hours.
    """
    with figure(2, 1, (6.5, 4.4), sharex=True, height_ratios=(3, 2)) as (drawing, (errors, shares)):
        for k, (name, hours) in enumerate(hours_of.items()):
            at = [hour.index + 1 for hour in hours]
            look = {"color": COLOURS[k], "marker": "o", "markersize": 3}
            for label, sizes, dash in (
                ("RMS error", [hour.rms for hour in hours], DASHES[0]),
                ("half of the band", [hour.half_band for hour in hours], DASHES[1]),
            ):
                errors.plot(at, np.rad2deg(sizes), ls=dash, label=f"{name}: {label}", **look)
            shares.plot(at, [100 * hour.inside for hour in hours], ls=DASHES[k], **look)
        errors.set_ylim(0.0, None)
        errors.set_ylabel("angle [°]")
        shares.axhline(100 * COVERED, color=BLACK, lw=0.8)
        least = min(hour.inside for hours in hours_of.values() for hour in hours)
        shares.set_ylim(min(80.0, 100 * least - 2), 101.0)
        shares.set_ylabel("inside the band [%]")
        shares.set_xlabel("hour")
        legend_above(errors, most=2)
    return drawing
