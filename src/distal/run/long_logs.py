"""An estimator over a long log that comes in pieces, so that only one piece is in memory.

The accuracy of an estimate hour after hour.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, COVERED
from distal.errors import EstimationError
from distal.estimators import DEFAULT, AdaptiveFilter, Belief, KernelEstimator, make_estimator
from distal.homing import added_reference
from distal.kernels import mean_of, variances_of
from distal.logs import Log, frozen
from distal.results import COLOURS, DASHES, figure, legend_above, save_figure
from distal.rig import Rig, angle_names
from distal.simulation import Piece
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
    pieces: Iterable[Piece], rig: Rig, estimator: str = DEFAULT, known_std: float | None = None
) -> Iterator[PieceEstimate]:
    """Estimate the joints' angles piece after piece; the belief goes on from one piece to the next.

    Args:
        pieces: of a log in time order, each with its true angles and those that are known to the
            estimator.
        estimator: its name.
        known_std: standard deviation of the known angles' constant offset [rad]; None: they are not
            used. Only `adaptive` reads them.

    Raises:
        EstimationError: the estimator cannot run on this rig, or does not take known angles.
    """
    chosen, references = _estimator(rig, estimator, known_std)
    belief: Belief | None = None
    for piece in pieces:
        log = piece.log
        n = len(rig.joints)
        columns = dict(log.channels) | {
            name: piece.known[:, j] for j, name in enumerate(references)
        }
        samples = np.column_stack([columns[name] for name in chosen.channels])
        if belief is None:
            belief = chosen.initial(log.time[0], samples[0])
        kernel_states, ys = chosen.advanced(belief, log.time, samples)
        size = belief.size
        means = chosen.report.means(mean_of(kernel_states, size).copy(), ys)[:, :n]
        variances = chosen.report.variances_of(variances_of(kernel_states, size), ys)[:, :n]
        samples_before = belief.samples + len(samples)
        belief = Belief(
            float(log.time[-1]),
            frozen(kernel_states[-1].copy()),
            size,
            samples_before,
            ys[-1],
            chosen.report,
        )
        truths = np.column_stack([log.truth[name] for name in angle_names(rig.joint_names)])
        yield PieceEstimate(log, means, np.sqrt(np.maximum(variances, 0.0)), truths)


def _estimator(
    rig: Rig, estimator: str, known_std: float | None
) -> tuple[KernelEstimator, list[str]]:
    """Return the estimator, and the names of the references that it reads, one for each joint or
    none.
    """
    if known_std is None:
        chosen = make_estimator(estimator, rig)
        if not isinstance(chosen, KernelEstimator) or not chosen.has_kernel:
            raise EstimationError(
                f"{estimator} reads whole logs; pieces need one with a kernel, as {DEFAULT}"
            )
        return chosen, []
    if estimator != DEFAULT:
        raise EstimationError(f"{estimator} does not take known angles; {DEFAULT} does")
    references = []
    for joint in rig.joints:
        rate = max(sensor.rate for sensor in rig.sensors)
        rig, sensor = added_reference(rig, rate, joint.name)
        rig = rig.with_values({f"sensors.{sensor.name}.bias": {"value": 0.0, "std": known_std}})
        references.append(rig.sensors[-1])
    return AdaptiveFilter(rig, references=references), [sensor.name for sensor in references]


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
