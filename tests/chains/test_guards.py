"""What guards the filter of a chain: standing forces, walking angles, drives that are lost, drives
that jump.
"""

from __future__ import annotations

from math import radians

import casadi as ca
import numpy as np
import pytest

from distal import load_rig
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive import Robustness
from distal.estimators.adaptive.drive_tracking import MEMORY, REMEMBERED, TRACKED, Drive
from distal.estimators.adaptive.guard_settings import followed_share
from distal.estimators.adaptive.prediction import followed_variance
from distal.estimators.adaptive.update import Residual, compared
from tests.helpers import at_parameters


def test_a_chain_has_guards_of_its_own() -> None:
    one, three = Robustness.usual(1), Robustness.usual(3)
    assert one == Robustness()
    assert (three.sticking_time, three.turning_time, three.learning_time, three.beyond_time) == (
        0.1,
        0.05,
        0.05,
        0.2,
    )
    assert three.reference_time == 0.5
    assert three.angle_walk == pytest.approx(radians(0.3))


def test_a_force_beyond_friction_counts_once_in_a_while() -> None:
    """At 200 Hz 0.2 s are 40 samples: each has 40 times its variance."""
    rig = load_rig("wrist-instrument")
    context = AdaptiveFilter(
        rig, compiled=False, robustness=Robustness(beyond_time=0.2)
    ).states.context
    still = Drive(*ca.vertsplit(ca.SX([0, 0, 0, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1e-9])))
    residual = Residual(*(ca.SX(x) for x in (0.5, 0.01, 0.0, 1e-6, 0.0, 1e-3, 0.5, 1.0)))
    found = compared(context, 0, still, residual, ca.SX(0.005))
    assert at_parameters(context, found.variance) == pytest.approx(40.0 * 1e-6, rel=1e-9)
    assert at_parameters(context, found.innovation) == pytest.approx(0.49, rel=1e-9)


def test_angles_walk() -> None:
    """An interval of 5 ms adds (0.3°)² · 5 ms to the variance of each angle."""
    rig = load_rig("finger-2n")
    sample = np.array([5e-3, 1e-3, 7e-3, -1e-3, np.nan, np.nan, np.nan, np.nan])
    variances = []
    for walk in (0.0, radians(0.3)):
        estimator = AdaptiveFilter(rig, compiled=False, robustness=Robustness(angle_walk=walk))
        belief = estimator.initial(0.0, sample)
        times = np.array([0.0, 0.005])
        _, covariances, *_ = estimator.scan(belief, times, np.array([sample, sample]))
        variances.append(np.diag(covariances[-1])[:2])
    np.testing.assert_allclose(variances[1] - variances[0], radians(0.3) ** 2 * 0.005, rtol=1e-6)


def test_a_joint_follows_a_lost_drive_by_its_share_of_the_arms() -> None:
    """Of all motions that follow the drive the smallest: δθ_j = r_j δx/Σ r²."""
    context = AdaptiveFilter(load_rig("finger-n-plus-1"), compiled=False).states.context
    tracks, memory = ca.SX.zeros(len(TRACKED), 4), ca.SX.zeros(MEMORY, 4)
    lost, grown = 0.1, 4e-8
    tracks[REMEMBERED.index("lost"), 0], tracks[REMEMBERED.index("unknown"), 0] = lost, grown
    arms = np.array([8e-3, 7e-3, 6e-3])
    share = float(followed_share(context.robustness, lost))
    for j in range(3):
        found = at_parameters(context, followed_variance(context, j, tracks, memory))
        assert found == pytest.approx(share * grown * (arms[j] / np.sum(arms**2)) ** 2, rel=1e-9)


def test_a_reference_teaches_slowly_in_a_chain() -> None:
    """At 200 Hz half a second is 100 samples: arms and curves take a hundredth of the gain, angles
    all of it.
    """
    states = AdaptiveFilter(load_rig("finger-2n"), compiled=False).states
    shares = states.gain_shares(None, reference=True, interval=0.005)
    names = {states.names[i] for i in shares}
    assert {
        "radius of tendon mcp_f at mcp",
        "common factor of rope",
        "linearity_x_mcp_f_0",
    } <= names
    assert set(shares.values()) == {0.005 / 0.5}
    assert not names & {"theta_mcp", "theta_pip", "theta_mcp_dot"}
    assert (
        AdaptiveFilter(load_rig("paper-2008"), compiled=False).states.gain_shares(
            None, reference=True, interval=0.01
        )
        == {}
    )
