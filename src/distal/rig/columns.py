"""Names of the joints' angles wherever one is written: states, columns, truth, C, JSON."""

from __future__ import annotations

from collections.abc import Sequence


def angle_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints' angles: ``theta`` for one joint, else ``theta_JOINT``.

    A standard deviation has ``_std`` behind it (`std_name`), a speed ``_dot`` (`speed_names`).
    """
    return ("theta",) if len(joints) == 1 else tuple(f"theta_{joint}" for joint in joints)


def speed_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints' speeds: ``theta_dot``, or ``theta_JOINT_dot``."""
    return tuple(f"{name}_dot" for name in angle_names(joints))


def torque_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the external torques on the joints: ``external_torque``, or
    ``external_torque_JOINT``.
    """
    return (
        ("external_torque",)
        if len(joints) == 1
        else tuple(f"external_torque_{joint}" for joint in joints)
    )


def std_name(name: str) -> str:
    """Return the name of the std of what is called `name`: ``theta_std``, ``std of inertia of joint
    pip``.
    """
    return f"std of {name}" if " " in name else f"{name}_std"


def tendon_angle_name(tendon: str) -> str:
    """Return the name of the joint angle that a kinematic estimator computes from one tendon alone:
    ``tendon_angle_TENDON``.
    """
    return f"tendon_angle_{tendon}"
