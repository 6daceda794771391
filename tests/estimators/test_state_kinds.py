"""What each state is: said by the state vector, so that nobody has to read it from a name."""

from __future__ import annotations

import pytest

from distal import load_rig, make_estimator, shipped_rigs
from distal.estimators import AdaptiveFilter, StateKind, external_torques_of, state_units
from distal.rig import in_words

STEMS = {
    StateKind.LINEARITY: "linearity_{}_",
    StateKind.POSITION: "position_{}",
    StateKind.FRICTION: "friction_{}",
    StateKind.TRANSMITTED: "transmitted_{}",
    StateKind.TRANSMISSION_ERROR: "transmission_error_{}",
    StateKind.BACKLASH: "backlash_{}",
    StateKind.SHEATH: "sheath_{}_",
    StateKind.CREEP: "creep_{}",
    StateKind.SENSOR_BIAS: "bias_{}",
    StateKind.SENSOR_GAIN: "gain_{}",
}
"""How the names of a kind begin, with the part that they are of."""


@pytest.mark.parametrize("name", [name for name in shipped_rigs() if name != "template"])
def test_every_state_says_what_it_is_and_of_what(name: str) -> None:
    rig = load_rig(name)
    estimator = AdaptiveFilter(rig, compiled=False)
    joints, count = [joint.name for joint in rig.joints], len(rig.joints)
    of = estimator.state_names, estimator.state_kinds, estimator.state_parts
    states = list(zip(*of, strict=True))
    angles = [(StateKind.ANGLE, joint) for joint in joints]
    speeds = [(StateKind.SPEED, joint) for joint in joints]
    assert [state[1:] for state in states[: 2 * count]] == angles + speeds
    parts = {part.name for part in (*rig.joints, *rig.drives, *rig.tendons, *rig.sensors)}
    for state, kind, part in states[2 * count :]:
        if kind is StateKind.PARAMETER:
            common = f"common factor of {part.removesuffix('.factor')}"
            assert state in (in_words(rig, part), common)
            assert not any(key.isdigit() for key in part.split(".")), part
            continue
        if kind is StateKind.EXTERNAL_TORQUE:
            assert external_torques_of(estimator)[part] == estimator.state_names.index(state)
        else:
            assert state.startswith(STEMS[kind].format(part)), state
        assert part in parts


def test_every_state_has_a_unit() -> None:
    estimator = AdaptiveFilter(load_rig("lab-bench"), compiled=False)
    units = dict(zip(estimator.state_names, state_units(estimator)))
    assert all(units.values())
    known = {
        "theta": "rad",
        "theta_dot": "rad/s",
        "inertia of joint finger": "kg m^2",
        "friction coefficient of joint finger": "1",
        "common factor of cable": "1",
    }
    assert units.items() >= known.items()


def test_of_other_estimators_the_angles_and_speeds_are_known() -> None:
    rig = load_rig("paper-2008")
    kinematic, full = (make_estimator(name, rig, False) for name in ("inextensible", "ekf"))
    assert (kinematic.state_kinds, kinematic.state_parts) == (
        (StateKind.ANGLE, StateKind.OTHER, StateKind.OTHER),
        ("link", "tendon_angle_left", "tendon_angle_right"),
    )
    assert state_units(kinematic) == ("rad",) * 3
    found = dict(zip(full.state_names, zip(full.state_kinds, full.state_parts)))
    assert found["theta"] == (StateKind.ANGLE, "link")
    assert found["theta_dot"] == (StateKind.SPEED, "link")
    assert found["position_left"] == found["velocity_left"] == (StateKind.OTHER, "left")
    assert external_torques_of(full) == external_torques_of(kinematic) == {}
