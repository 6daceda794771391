"""What the steps of the algorithm hand to each other: an interval with its sample, and what is
predicted for its end.
"""

from __future__ import annotations

from dataclasses import dataclass

from distal.expressions import MatrixNode, VectorNode


@dataclass(frozen=True)
class Interval:
    """An interval that ends with a sample x = (dt, values, mask), symbolic, with the model's
    parameters p.

    There are the tracks of the drives at its end, see `Tracks`, and the memory of their motion from
    its start.
    """

    tracks: VectorNode
    memory: VectorNode
    x: VectorNode
    p: VectorNode


@dataclass(frozen=True)
class Prediction:
    """What is predicted for the end of an interval, symbolic; the steps change it in place.

    It is the mean of the state, (n,), the covariance of its error, (n, n), and Φ, the transition
    from the start, (n, n).
    """

    state: VectorNode
    covariance: MatrixNode
    transition: MatrixNode
