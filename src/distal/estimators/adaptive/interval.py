"""What the steps of the algorithm hand to each other: an interval with its sample, and what is predicted for its end."""

from __future__ import annotations

from dataclasses import dataclass

from distal.expressions import MatrixNode, VectorNode


@dataclass(frozen=True)
class Interval:
    """An interval that ends with a sample, symbolic.

    Args:
        tracks: of the drives at its end, see `Tracks`.
        memory: what is remembered of the drives' motion, from its start.
        x: the sample (dt, values, mask).
        p: the model's parameters.
    """

    tracks: VectorNode
    memory: VectorNode
    x: VectorNode
    p: VectorNode


@dataclass(frozen=True)
class Prediction:
    """What is predicted for the end of an interval, symbolic; the steps change it in place.

    Args:
        state: its mean, (n,).
        covariance: of its error, (n, n).
        transition: Φ, from the start of the interval, (n, n).
    """

    state: VectorNode
    covariance: MatrixNode
    transition: MatrixNode
