"""A reference that is known for a while: it is read until then, and only compared with afterwards."""

from __future__ import annotations

import numpy as np

from distal import Log, estimate
from tests.identification.helpers import logs_of, start_rig


def test_a_reference_helps_and_does_not_leak() -> None:
    """With homing the first second is known; what follows does not depend on the truth that is only compared with."""
    rig = start_rig()
    log = logs_of(rig, {"joints.0.friction.coefficient": 0.6}, 32, ("servo",), 6.0)[0]
    blind, homed = estimate(log, rig), estimate(log, rig, homing=1.0)
    first = log.time < 0.9
    assert np.max(homed.theta_std[first]) < 0.5 * np.max(blind.theta_std[first])
    assert np.isnan(homed.truth[first]).all()
    lying = {"theta": np.where(log.time < 1.0, log.truth["theta"], log.truth["theta"] + 1.0)}
    other = estimate(Log(log.time, log.channels, lying, log.source, log.truth_source), rig, homing=1.0)
    np.testing.assert_array_equal(homed.theta, other.theta)
    for name in ("inextensible", "elastic", "ekf"):
        shifted = estimate(log, rig, name, homing=1.0)
        early = estimate(log, rig, name).theta[log.time < 1.0] - log.truth["theta"][log.time < 1.0]
        np.testing.assert_allclose(shifted.theta, estimate(log, rig, name).theta - early.mean(), atol=1e-12)
