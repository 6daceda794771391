"""Touches: how a force on a link turns the joints of a chain together."""

from __future__ import annotations

import numpy as np

from distal.arrays import Floats
from distal.rig.rig import Rig

ALONE = 0.1
"""Std of a torque that acts on one joint alone, as a share of the largest torque that forces on
links make [1]: such a force acts near an axis, or along the chain. Source: benchmark
(docs/results/touch.md).
"""


def contact_shape(rig: Rig) -> Floats:
    """Return the covariance of the external torques on all joints that contacts make, (n_joints,
    n_joints), over a common scale [1].

    With as many drives as joints the measured forces tell the torques apart, so that each torque is
    taken as independent and equally likely: the unit matrix. With fewer drives a contact is a force
    at the end of a link, each direction and link being equally likely, on the chain at θ = 0: Σ Jᵀ
    J of the links' ends over its largest variance, with `ALONE`² added to each variance, or 1 for a
    joint that no such force turns.
    """
    n = len(rig.joints)
    if len(rig.drives) >= n:
        return np.eye(n)
    before = [rig.parent_of(j) for j in range(n)]
    at = list[Floats]()
    chains = list[list[int]]()
    for j, (joint, parent) in enumerate(zip(rig.joints, before)):
        at.append(np.array(joint.offset) + (0.0 if parent is None else at[parent]))
        chains.append([j, *([] if parent is None else chains[parent])])
    shape = np.zeros((n, n))
    for j, joint in enumerate(rig.joints):
        ends = [at[k] for k in range(n) if before[k] == j]
        if not ends and joint.link is not None:
            ends = [at[j] + 2 * np.array(joint.link.centre)]
        for end in ends:
            moves = np.zeros((3, n))
            for k in chains[j]:
                moves[:, k] = np.cross(rig.joints[k].axis, end - at[k])
            shape += moves.T @ moves
    largest = float(np.max(np.diag(shape)))
    if largest <= 0.0:
        return np.eye(n)
    reached = np.diag(shape) > 0.0
    alone = np.where(reached, ALONE**2, 1.0)
    covariance: Floats = shape / largest + np.diag(alone)
    return covariance
