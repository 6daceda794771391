"""An estimator over a long log that comes in pieces, so that only one piece is in memory."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.errors import EstimationError
from distal.estimators import DEFAULT, AdaptiveFilter, Belief, KernelEstimator, make_estimator
from distal.homing import added_reference
from distal.kernels import mean_of, variances_of
from distal.logs import Log, frozen
from distal.rig import Rig, angle_names
from distal.simulation import Piece


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
