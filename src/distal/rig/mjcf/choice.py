"""The choice of the tendons and joints of a model that become the rig's: an actuator pulls the
tendons; the joints turn, are asked for, and driven tendons move them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.errors import RigError
from distal.rig.files import name_of
from distal.rig.mjcf.bodies import Coupled, joint_name, tendon_name
from distal.rig.mjcf.loading import CROSSED, mujoco_module, tendon_slopes
from distal.rig.mjcf.spatial_tendons import spring_tendons
from distal.suggestions import did_you_mean

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
        if model.actuator_trntype[a] != mujoco.mjtTrn.mjTRN_TENDON:
            elsewhere.append(name)
            continue
        if (
            model.actuator_dyntype[a] == mujoco.mjtDyn.mjDYN_MUSCLE
            or model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_MUSCLE
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


def turning_joints(
    model: mujoco.MjModel, chain: str | None, joints: Sequence[str] | None
) -> list[int]:
    """Return the indices of those joints that turn about one axis and are asked for; for `chain`
    and `joints` see `from_mujoco`.
    """
    mujoco = mujoco_module()
    turning = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    if chain is not None:
        bodies = [model.body(b).name for b in range(model.nbody)]
        if chain not in bodies:
            raise RigError(f"no body is called '{chain}'{did_you_mean(chain, bodies)}")
        inside = {bodies.index(chain)}
        for b in range(1, model.nbody):
            if model.body_parentid[b] in inside:
                inside.add(b)
        turning = [j for j in turning if model.jnt_bodyid[j] in inside]
    if joints is not None:
        names = {joint_name(model, j): j for j in turning} | {
            model.joint(j).name: j for j in turning
        }
        for name in joints:
            if name not in names:
                raise RigError(
                    f"no joint that turns is called '{name}'{did_you_mean(name, sorted(names))}"
                )
        turning = sorted({names[name] for name in joints})
    if not turning:
        others = ", ".join(joint_name(model, j) for j in range(model.njnt))
        raise RigError(
            "no joint turns about one axis"
            + (f" in '{chain}'" if chain else f" ({others or 'none at all'})")
        )
    return turning


def other_joints(
    model: mujoco.MjModel,
    hinges: Sequence[int],
    driven: Mapping[int, str],
    turned: Mapping[int, Sequence[int]],
) -> list[str]:
    """Return notes on joints outside of the choice `hinges` that driven tendons turn too.

    Args:
        driven: index → name of each driven tendon.
        turned: index of each driven tendon → which joints of the choice it turns.

    Raises:
        RigError: such a joint is no hinge.
    """
    mujoco = mujoco_module()
    kinds = {
        int(mujoco.mjtJoint.mjJNT_SLIDE): (1, "slides"),
        int(mujoco.mjtJoint.mjJNT_BALL): (3, "turns every way"),
        int(mujoco.mjtJoint.mjJNT_FREE): (6, "is free"),
    }
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    slopes = np.abs(tendon_slopes(model, data))
    notes = list[str]()
    for t, name in driven.items():
        for j in (j for j in range(model.njnt) if j not in hinges):
            dof = model.jnt_dofadr[j]
            width, kind = kinds.get(int(model.jnt_type[j]), (1, None))
            if slopes[t, dof : dof + width].max() <= CROSSED * max(float(slopes[t].max()), 1e-12):
                continue
            if kind is not None:
                raise RigError(
                    f"tendon '{name}' moves joint '{joint_name(model, j)}', which {kind}; "
                    "distal's joints turn"
                )
            if turned[t]:
                notes.append(
                    f"tendon '{name}' also turns '{joint_name(model, j)}', which is held where "
                    "the model has it"
                )
    return notes


def check_base(model: mujoco.MjModel, first: int, chain: str | None) -> None:
    """Raise a `RigError` where the base of the `first` kept joint floats, unless a `chain` is asked
    for.
    """
    body = model.jnt_bodyid[first]
    free = mujoco_module().mjtJoint.mjJNT_FREE
    while body > 0 and chain is None:
        for j in range(model.njnt):
            if model.jnt_bodyid[j] == body and model.jnt_type[j] == free:
                raise RigError(
                    f"the base floats: joint '{joint_name(model, j)}' is free; with --chain BODY "
                    "it is held where the "
                    "model has it"
                )
        body = model.body_parentid[body]


def kept_joints(
    hinges: Sequence[int], turned: Mapping[int, Sequence[int]], coupled: Sequence[Coupled]
) -> list[int]:
    """Return those of the `hinges` that tendons turn (`turned` as in `other_joints`), and those
    that are coupled to one of these.
    """
    kept = {hinges[k] for joints in turned.values() for k in joints}
    for coupling in coupled:
        pair = {coupling.leader, coupling.follower}
        if pair & kept and pair <= set(hinges):
            kept |= pair
    return sorted(kept)
