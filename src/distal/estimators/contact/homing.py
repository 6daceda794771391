"""The torque from outside after a homing move: this run's coefficients, by Bayes' rule."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from distal.estimators.affine import after_window
from distal.estimators.contact.terms import design
from distal.rig import Contact

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]


def homed(contact: Contact, readings: Floats, torques: Floats, window: Bools, interval: float) -> Contact:
    """Return a contact's map after a window in which the torque was read.

    Mean and covariance are the prior of this run's coefficients, the window their likelihood, with as many samples
    counting as one as what is left is correlated (`after_window`).

    Args:
        contact: as learned from logs.
        readings: of the run's channels, whole, (k, m).
        torques: true torques [N m], NaN where not known, (k, n_joints).
        window: where they may be used, (k,).
        interval: between samples [s].
    """
    phi, joints = design(contact, readings), []
    for j, joint in enumerate(contact.joints):
        there = window & np.isfinite(torques[:, j])
        if there.any():
            count = max(contact.correlation_time / interval, 1.0)
            joint, _ = after_window(joint, phi[there], torques[there, j], count, contact.logs)
        joints.append(joint)
    return contact.model_copy(update={"joints": tuple(joints)})
