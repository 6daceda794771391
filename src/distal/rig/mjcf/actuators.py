"""Which tendons of a model an actuator pulls."""

from __future__ import annotations

from typing import TYPE_CHECKING

from distal.errors import RigError
from distal.rig.imported import name_of
from distal.rig.mjcf.bodies import tendon_name
from distal.rig.mjcf.joint_springs import spring_tendons
from distal.rig.mjcf.loading import mujoco_module

if TYPE_CHECKING:
    import mujoco


def driven_tendons(model: mujoco.MjModel) -> tuple[dict[int, str], list[str]]:
    """Return index → name of the tendons that an actuator pulls, and what is left out, in words.

    In a model without actuators all tendons that are no springs count as pulled.

    Raises:
        RigError: no tendon is pulled, or one is pulled by a muscle.
    """
    mujoco = mujoco_module()
    if not model.ntendon:
        raise RigError("the model has no tendon")
    driven = dict[int, str]()
    elsewhere = list[str]()
    left = list[str]()
    for a in range(model.nu):
        name = name_of(model.actuator(a).name, f"actuator{a}")
        if int(model.actuator_trntype[a]) != int(mujoco.mjtTrn.mjTRN_TENDON):
            elsewhere.append(name)
            continue
        kinds = int(model.actuator_dyntype[a]), int(model.actuator_gaintype[a])
        if kinds[0] == int(mujoco.mjtDyn.mjDYN_MUSCLE) or kinds[1] == int(
            mujoco.mjtGain.mjGAIN_MUSCLE
        ):
            raise RigError(
                f"actuator '{name}' is a muscle; distal knows tendons that a motor pulls"
            )
        tendon = int(model.actuator_trnid[a][0])
        if tendon in driven:
            left.append(
                f"actuator '{name}' pulls tendon '{driven[tendon]}', which another pulls too: "
                "left out"
            )
            continue
        driven[tendon] = tendon_name(model, tendon)
    if not model.nu:
        springs = spring_tendons(model)
        driven = {t: tendon_name(model, t) for t in range(model.ntendon) if t not in springs}
        left.append("the model has no actuator: each tendon that is no spring has a drive")
    if not driven:
        raise RigError(
            f"no actuator pulls a tendon: the model has {model.ntendon}, and its {model.nu} "
            "actuators are on joints"
        )
    if elsewhere:
        left.append(f"actuators that pull no tendon: {', '.join(elsewhere)}")
    return driven, left
