"""What each state is: said by the state vector, so that nobody has to read it from a name."""

from __future__ import annotations

import pytest

from distal import load_rig, make_estimator, shipped_rigs
from distal.estimators import AdaptiveFilter, StateKind, external_torques_of, kinds_of, state_units
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
    assert len(estimator.state_kinds) == len(estimator.state_parts) == len(estimator.state_names)
    assert (
        estimator.state_kinds[: 2 * count]
        == (StateKind.ANGLE,) * count + (StateKind.SPEED,) * count
    )
    assert list(estimator.state_parts[: 2 * count]) == 2 * joints
    parts = {part.name for part in (*rig.joints, *rig.drives, *rig.tendons, *rig.sensors)}
    for state, kind, part in list(
        zip(estimator.state_names, estimator.state_kinds, estimator.state_parts)
    )[2 * count :]:
        assert kind is not StateKind.OTHER, state
        if kind is StateKind.EXTERNAL_TORQUE:
            assert external_torques_of(estimator)[part] == estimator.state_names.index(state)
        elif kind is StateKind.PARAMETER:
            assert state in (
                in_words(rig, part),
                f"common factor of {part.removesuffix('.factor')}",
            )
            assert not any(key.isdigit() for key in part.split(".")), part
        else:
            assert state.startswith(STEMS[kind].format(part)), state
        assert part in parts or kind is StateKind.PARAMETER


def test_every_state_has_a_unit() -> None:
    estimator = AdaptiveFilter(load_rig("lab-bench"), compiled=False)
    units = dict(zip(estimator.state_names, state_units(estimator)))
    assert all(units.values())
    assert (units["theta"], units["theta_dot"], units["inertia of joint finger"]) == (
        "rad",
        "rad/s",
        "kg m^2",
    )
    assert (units["friction coefficient of joint finger"], units["common factor of cable"]) == (
        "1",
        "1",
    )


def test_of_other_estimators_the_angles_are_known() -> None:
    estimator = make_estimator("inextensible", load_rig("paper-2008"), False)
    assert kinds_of(estimator) == (
        (StateKind.ANGLE, StateKind.OTHER, StateKind.OTHER),
        ("link", "tendon_angle_left", "tendon_angle_right"),
    )
    assert state_units(estimator) == ("rad",) * 3
    assert external_torques_of(estimator) == {}
