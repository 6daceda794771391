"""What a discrepancy is learned from: the filter's own angle over a log, what it read, and the true angle."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from distal.estimators.discrepancy.terms import columns, limits, played, variables
from distal.rig import Discrepancy

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Samples:
    """A log as the discrepancy sees it.

    Args:
        source: name of the log.
        time: since its first sample [s], (k,).
        readings: places of the drives and readings of the other sensors, missing ones held, (k, m).
        angles: of the joints by the filter, without a correction [rad], (k, n_joints).
        variances: of these, (k, n_joints).
        truths: true angles [rad], NaN where not known, (k, n_joints).
        interval: between samples [s].
        reference_std: what the reference of the true angle itself errs by [rad]; 0 where that is not known.
    """

    source: str
    time: Floats
    readings: Floats
    angles: Floats
    variances: Floats
    truths: Floats
    interval: float
    reference_std: float = 0.0

    def part(self, rows: NDArray[np.bool_]) -> Samples:
        """Return some of the samples.

        Args:
            rows: which, (k,).
        """
        names = ("time", "readings", "angles", "variances", "truths")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def design(discrepancy: Discrepancy, samples: Samples) -> Floats:
    """Return the terms over a log, (k, n_terms).

    Args:
        discrepancy: terms, scales and ranges.
        samples: of the log, whole, since plays remember.
    """
    d, every = discrepancy, np.column_stack([samples.readings, samples.angles])
    scaled = (np.clip(every, *limits(d)) - np.asarray(d.centre)) / np.asarray(d.scale)
    after = {i: played(scaled[:, i], d.play) for i in d.played}
    joints = [joint.joint for joint in d.joints]
    return np.column_stack(columns(d.terms, variables(d.channels, joints, list(scaled.T), after), np.ones(len(every))))


def outside(discrepancy: Discrepancy, samples: Samples) -> Floats:
    """Return how far a log is outside the learned range, 0 within; 1 is half a range beyond its end, (k,).

    Args:
        discrepancy: with the range.
        samples: of the log.
    """
    d, m = discrepancy, len(discrepancy.channels)
    every = np.column_stack([samples.readings, samples.angles])
    half = np.maximum((np.asarray(d.high) - np.asarray(d.low)) / 2.0, 1e-12)
    beyond = (np.maximum(np.asarray(d.low) - every, every - np.asarray(d.high)) / half).max(axis=1)
    z = (samples.readings - np.asarray(d.centre)[:m]) / np.asarray(d.scale)[:m]
    far = np.sqrt(np.maximum(np.sum(z @ np.asarray(d.distance) * z, axis=1), 0.0)) / d.reach - 1.0
    excess: Floats = np.maximum(0.0, np.maximum(beyond, far))
    return excess


def corrected(discrepancy: Discrepancy, samples: Samples, joint: int = 0) -> tuple[Floats, Floats, Floats]:
    """Return the corrected angle of a joint over a log, the correction's variance, and what is left of the filter's own.

    Args:
        discrepancy: as learned.
        samples: of the log.
        joint: its index.
    """
    own, phi, far = discrepancy.joints[joint], design(discrepancy, samples), outside(discrepancy, samples)
    leverage = np.sum(phi @ np.asarray(own.covariance) * phi, axis=1)
    variance = leverage + own.std**2 + far**2 * (own.std**2 + discrepancy.spread[joint] ** 2)
    weight = discrepancy.own * (1.0 + _own_slope(discrepancy, samples, joint))
    return (
        samples.angles[:, joint] + phi @ np.asarray(own.coefficients),
        variance,
        weight**2 * samples.variances[:, joint],
    )


def _own_slope(discrepancy: Discrepancy, samples: Samples, joint: int) -> Floats:
    """Return ∂δ/∂θ over a log: how much the correction takes of the filter's own angle, (k,)."""
    d, name = discrepancy, f"angle({discrepancy.joints[joint].joint})"
    at = d.terms.index(name) if name in d.terms else None
    column = len(d.channels) + joint
    low, high = (limit[column] for limit in limits(d))
    angles = samples.angles[:, joint]
    slope = 0.0 if at is None else d.joints[joint].coefficients[at] / d.scale[column]
    return np.where((angles > low) & (angles < high), slope, 0.0)
