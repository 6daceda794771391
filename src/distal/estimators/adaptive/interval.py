"""The data that the steps of the filter hand to each other: an interval with its sample, and the
prediction for its end.
"""

from __future__ import annotations

from dataclasses import dataclass

from distal.expressions import MatrixNode, VectorNode


@dataclass(frozen=True)
class Interval:
    """An interval that ends with a sample, all symbolic.

    Args:
        tracks: of the drives at its end, see `Tracks`.
        memory: what was remembered of the drives at its start.
        x: the sample (dt, values, mask).
        p: the model's parameters.
    """

    tracks: VectorNode
    memory: VectorNode
    x: VectorNode
    p: VectorNode


@dataclass(frozen=True)
class Prediction:
    """The prediction for the end of an interval, symbolic; the steps change it in place.

    Args:
        state: predicted mean, (n,).
        covariance: of its error, (n, n).
        transition: Φ from the start of the interval, (n, n).
    """

    state: VectorNode
    covariance: MatrixNode
    transition: MatrixNode
