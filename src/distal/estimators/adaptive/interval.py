"""What the steps of the filter share: an interval with its sample, the prediction for its end, and
the rig's equations at given positions of its bodies.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from distal.estimators.adaptive.filter_context import FilterContext
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


def mechanics_function(context: FilterContext) -> ca.Function:
    """Return the function (q, v, p) → tensions, pulls on the bodies, their dampings, friction
    limits and asymmetries, slopes of tensions and of pulls by q.
    """
    mechanism = context.mechanism
    q = ca.SX.sym("q", mechanism.n_bodies)
    v = ca.SX.sym("v", mechanism.n_bodies)
    p = mechanism.parameters.symbols
    tendons = mechanism.pulls(q, v, settled=True)
    nj = mechanism.n_joints
    tensions = tendons.drive
    # cogging is among the passive forces; those of the joints are compared with nothing
    cogging = ca.vertcat(ca.SX.zeros(nj), mechanism.passive_forces(q)[nj:])
    pulls = mechanism.dampings() * v - tendons.forces - cogging
    friction = mechanism.friction_limits(q, v, tendons.joint, tendons.drive)
    limits = ca.vertcat(*(limit.mean for limit in friction))
    asymmetries = ca.vertcat(*(limit.asymmetry for limit in friction))
    slopes = [ca.jacobian(tensions, q), ca.jacobian(pulls, q)]
    return ca.Function(
        "mechanics",
        [q, v, p],
        [tensions, pulls, mechanism.dampings(), limits, asymmetries, *slopes],
    )
