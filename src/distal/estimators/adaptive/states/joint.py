"""Angles and speeds of the joints, which prediction moves by the model, and the torques on them
that no sensor measures, such as that of a hand or a contact.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial

from distal.estimators.adaptive.filter_context import FilterContext
from distal.estimators.adaptive.states.state import State
from distal.estimators.state_kinds import StateKind
from distal.rig import angle_names, speed_names, torque_names

START_SPEED = 0.3
"""Standard deviation of a joint's speed at the first sample [rad/s]: a log may begin within a
motion. Source: judgement.
"""


def motions(context: FilterContext) -> Iterator[State]:
    """Yield the angles of all joints, then the speeds of all."""
    rig = context.mechanism.rig
    joints = list(enumerate(rig.joints))
    for name, (j, joint) in zip(angle_names(rig.joint_names), joints):
        initial = joint.initial
        mean_by = partial(context.number, f"joints.{j}.initial")
        yield State(name, StateKind.ANGLE, joint.name, initial.value, initial.std, mean_by=mean_by)
    for name, (_, joint) in zip(speed_names(rig.joint_names), joints):
        yield State(name, StateKind.SPEED, joint.name, 0.0, START_SPEED)


def external_torques(context: FilterContext) -> Iterator[State]:
    """Yield the external torque τ_ext of each joint on which one can act: where the rig declares
    one, or where forces may show one. It is a first-order Gauss–Markov process.

    Where the rig declares none it is zero until a touch opens its variance, (13b).
    """
    rig = context.mechanism.rig
    for j, (joint, name) in enumerate(zip(rig.joints, torque_names(rig.joint_names))):
        std = joint.external_torque.std
        if std > 0.0 or j in context.touchable:
            path = f"joints.{j}.external_torque"
            yield State(
                name,
                StateKind.EXTERNAL_TORQUE,
                joint.name,
                0.0,
                std,
                to=("torque", j),
                std_by=partial(context.number, f"{path}.std"),
                fades_in=partial(context.number, f"{path}.correlation_time"),
            )
