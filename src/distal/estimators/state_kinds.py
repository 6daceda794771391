"""The kind of each state of an estimator, and the component of the rig that it belongs to."""

from __future__ import annotations

from collections.abc import Sequence
from enum import Enum

from distal.estimators.estimator_protocol import KernelEstimator
from distal.rig import (
    Rig,
    effort_unit,
    number,
    position_unit,
    tendon_angle_name,
)


class StateKind(Enum):
    """The kind of a state. Programs use this; the name of a state is for people."""

    ANGLE = "angle of a joint"
    SPEED = "speed of a joint"
    EXTERNAL_TORQUE = "torque on a joint from outside"
    PARAMETER = "number of the rig, or what several err by together"
    LINEARITY = "weight of the curve of a position sensor's error"
    POSITION = "place of a drive that nothing measures"
    FRICTION = "friction at a drive that the rig does not declare"
    TRANSMITTED = "effort that a drive's play passes on"
    TRANSMISSION_ERROR = "what one play leaves out of a transmission"
    BACKLASH = "far side of a backlash"
    SHEATH = "point of a cable in its sheath"
    CREEP = "slow part of a tendon's stretch"
    SENSOR_BIAS = "offset of a sensor of force, tension or angle"
    SENSOR_GAIN = "share by which such a sensor reads too much"
    OTHER = "anything else"


def kinds_of(estimator: KernelEstimator) -> tuple[tuple[StateKind, ...], tuple[str, ...]]:
    """Return the kind of each state of an estimator, (n,), and the component of the rig that it
    belongs to, (n,).

    Where the estimator does not give them, the first states are the joints' angles; all others are
    `StateKind.OTHER`, and their component is their name.
    """
    if hasattr(estimator, "state_kinds") and hasattr(estimator, "state_parts"):
        return estimator.state_kinds, estimator.state_parts
    joints = estimator.rig.joint_names
    others = estimator.state_names[len(joints) :]
    kinds = [StateKind.ANGLE] * len(joints) + [StateKind.OTHER] * len(others)
    return tuple(kinds), (*joints, *others)


_OF_JOINT = {
    StateKind.ANGLE: "rad",
    StateKind.SPEED: "rad/s",
    StateKind.EXTERNAL_TORQUE: "N m",
}
"""Kind of a joint's state → its unit."""

_OF_DRIVE = {
    StateKind.POSITION: position_unit,
    StateKind.BACKLASH: position_unit,
    StateKind.FRICTION: effort_unit,
    StateKind.TRANSMITTED: effort_unit,
    StateKind.TRANSMISSION_ERROR: effort_unit,
}


def state_units(estimator: KernelEstimator) -> tuple[str, ...]:
    """Return the SI units of an estimator's states, (n,): ``1`` for a plain number, empty where the
    unit is not known.
    """
    rig: Rig = estimator.rig
    by_name = dict.fromkeys((tendon_angle_name(tendon.name) for tendon in rig.tendons), "rad")
    drives = {drive.name: drive for drive in rig.drives}
    sensors = {sensor.name: sensor for sensor in rig.sensors}

    def unit(name: str, kind: StateKind, part: str) -> str:
        if kind is StateKind.PARAMETER:
            return (
                "1"
                if part.endswith(".factor")
                else number(rig, part.removesuffix(".deviation")).quantity.si or "1"
            )
        if kind in (StateKind.SHEATH, StateKind.CREEP):
            return "m"
        if kind in (StateKind.LINEARITY, StateKind.SENSOR_BIAS):
            return str(sensors[part].si)
        if kind in _OF_DRIVE:
            return _OF_DRIVE[kind](drives[part])
        return (
            "1" if kind is StateKind.SENSOR_GAIN else _OF_JOINT.get(kind) or by_name.get(name, "")
        )

    return tuple(unit(*state) for state in zip(estimator.state_names, *kinds_of(estimator)))


def states_of(
    kind: StateKind,
    parts: Sequence[str],
    state_kinds: Sequence[StateKind],
    state_parts: Sequence[str],
) -> dict[str, int]:
    """Return component → index of its state of one kind, in the order of `parts`; components
    without such a state are left out.

    Args:
        parts: names of the components.
        state_kinds: kind of each state, (n,).
        state_parts: component of each state, (n,).
    """
    indices = {
        part: i
        for i, (state_kind, part) in enumerate(zip(state_kinds, state_parts))
        if state_kind is kind
    }
    return {part: indices[part] for part in parts if part in indices}


def external_torques_of(estimator: KernelEstimator) -> dict[str, int]:
    """Return joint → index of the state that is the external torque on it, in the order of the
    joints.
    """
    return states_of(
        StateKind.EXTERNAL_TORQUE,
        estimator.rig.joint_names,
        *kinds_of(estimator),
    )
