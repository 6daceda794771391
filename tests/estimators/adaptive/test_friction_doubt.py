"""A joint whose friction is known to a factor only may move although the model, at its mean, says
that it sticks.
"""

from __future__ import annotations

import numpy as np

from distal import Log, estimate, load_rig
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.joint_motion import doubted_frictions
from distal.rig import build_rig
from tests.support.rough_plants import FITTED, described, log_of


def rms(log: Log, angles: np.ndarray) -> np.ndarray:
    """Return the RMS error of each joint [deg]."""
    return np.rad2deg(
        np.sqrt(np.mean((angles - np.column_stack(list(log.truth.values()))) ** 2, axis=0))
    )


def test_readings_of_a_joint_that_seems_to_stick_do_not_spoil_its_stiffness() -> None:
    """A wrist whose first joint rubs three times less than its user thinks: without doubt of the
    friction 10 to 14°.
    """
    raw, truth = described("held", 0)
    frictions = {path: value for path, value in truth.items() if ".friction." not in path}
    rig, log = build_rig(raw, "held").with_values(frictions), log_of("held", 0, FITTED)
    found = estimate(log, rig, compiled=False)
    assert np.all(rms(log, found.angles) < 3.0)
    factors = [i for i, name in enumerate(found.state_names) if name.startswith("stiffness factor")]
    assert len(factors) == 6
    assert np.all(found.means[:, factors] > 0.7)


def test_which_joints_friction_is_in_doubt() -> None:
    """Above half of its value; the joint's own only, not what is certain, nor a drive's."""
    rig = load_rig("pulley-antagonist")
    for std, joints in ((0.14, []), (0.16, [0])):
        values = {
            "joints.0.friction.coefficient": {"value": 0.3, "std": std},
            "drives.0.friction.load.std": 1.0,
        }
        states = AdaptiveFilter(rig.with_values(values), False).states
        found = doubted_frictions(states)
        assert list(found) == joints
        assert [states.names[i] for own in found.values() for i in own] == [
            "friction coefficient of joint link"
        ] * len(joints)
