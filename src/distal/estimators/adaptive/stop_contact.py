"""Whether a stop holds a joint, by the filter's mean; within a time step, `distal.model.stops` says
it.
"""

from __future__ import annotations

import casadi as ca

from distal.estimators.adaptive.states import StateVector
from distal.expressions import MatrixNode, ScalarNode, VectorNode

UNSURE = 2.0
"""Distance of a joint before a stop, in stds of its angle, below which the stop may hold it, (24b)
[1]. Source: judgement.
"""


def depths_in_stops(states: StateVector, mean: VectorNode, p: VectorNode) -> dict[int, ScalarNode]:
    """Return joint → depth of its angle in its stop, negative before it [rad]; joints without stops
    are left out.

    It is at a `mean`, (n,), with the kernel's parameters p.
    """
    mechanism = states.context.mechanism
    names = mechanism.parameters.names
    depths = dict[int, ScalarNode]()
    for j, joint in enumerate(mechanism.rig.joints):
        if joint.stops is not None:
            low, high = (p[names.index(f"joints.{j}.stops.{end}")] for end in ("low", "high"))
            depths[j] = ca.fmax(mean[j] - high, low - mean[j])
    return depths


def sure_of_stops(
    states: StateVector, mean: VectorNode, covariance: MatrixNode, p: VectorNode
) -> list[ScalarNode]:
    """Return for each drive 0 where it is uncertain whether a stop holds a joint that the drive
    moves, else 1.

    It is uncertain where a joint is before its stop by less than `UNSURE` stds. With a single joint
    it is always 1. It is at a `mean`, (n,), and `covariance`, (n, n), with the kernel's parameters
    p.
    """
    rig = states.context.mechanism.rig
    sure = [ca.MX(1.0) for _ in rig.joints]
    for j, depth in depths_in_stops(states, mean, p).items():
        if len(rig.joints) > 1:
            sure[j] = 1 - ca.logic_and(-depth > 0, -depth < UNSURE * ca.sqrt(covariance[j, j]))
    products = list[ScalarNode]()
    for drive in rig.drives:
        moved = {
            name for tendon in rig.tendons if tendon.drive == drive.name for name in tendon.joints
        }
        product = ca.MX(1.0)
        for joint, is_sure in zip(rig.joints, sure):
            product = product * is_sure if joint.name in moved else product
        products.append(product)
    return products
