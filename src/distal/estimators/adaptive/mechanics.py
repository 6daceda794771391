"""What the rig's equations say at given places of its bodies, as one function that several steps of the filter share."""

from __future__ import annotations

import casadi as ca

from distal.estimators.adaptive.setup import Setup


def mechanics_function(setup: Setup) -> ca.Function:
    """Return (q, v, p) → tensions, pulls on the bodies, their dampings, friction limits and asymmetries, slopes by q.

    Args:
        setup: the rig.
    """
    mechanism = setup.mechanism
    q, v, p = ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("v", mechanism.n_bodies), mechanism.parameters.symbols
    tensions = mechanism.tensions(q, v)
    pulls = ca.mtimes(mechanism.length_jacobian(q).T, tensions) + mechanism.dampings() * v
    friction = mechanism.friction_limits(q, v, tensions)
    limits = ca.vertcat(*(limit.mean for limit in friction))
    asymmetries = ca.vertcat(*(limit.asymmetry for limit in friction))
    slopes = [ca.jacobian(tensions, q), ca.jacobian(pulls, q)]
    return ca.Function("mechanics", [q, v, p], [tensions, pulls, mechanism.dampings(), limits, asymmetries, *slopes])
