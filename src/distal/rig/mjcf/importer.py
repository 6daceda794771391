"""A rig from a MuJoCo model.

An actuator pulls the tendons that become the rig's; its joints turn, are asked for, and driven
tendons move them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from distal.errors import RigError, did_you_mean
from distal.rig.files import Imported, build_rig, name_of, parse_toml
from distal.rig.mjcf.bodies import (
    Coupled,
    Units,
    couplings,
    described_joints,
    joint_name,
    softened,
    tendon_name,
)
from distal.rig.mjcf.loading import (
    ASSUMED,
    CROSSED,
    EMBEDDED,
    load_model,
    mujoco_module,
    over_ranges,
    tendon_slopes,
    turned_by,
)
from distal.rig.mjcf.spatial_tendons import (
    described_crossings,
    described_drive,
    described_sensors,
    joint_springs,
    spring_tendons,
)
from distal.rig.plausibility import USUAL
from distal.rig.rig import MOST_JOINTS, Rig

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


def from_mujoco(
    model: mujoco.MjModel | str | Path,
    chain: str | None = None,
    joints: Sequence[str] | None = None,
    length_unit: float = 1.0,
) -> Imported:
    """Return a rig with the joints, links, springs and tendons of a MuJoCo model.

    Only joints that a driven tendon turns, or that are coupled to one of these, are kept; all
    others are held where the model has them. The lengths of a tendon become pulleys, or the lowest
    polynomial that leaves at most 1 % of each moment arm. Angles are those of the model. A model
    that was written from a rig holds that rig, which is returned unless joints are chosen.

    Args:
        model: the model, or the path of its file.
        chain: name of a body: only joints of it and of what it carries are kept; None keeps all.
        joints: names of the joints to keep; None keeps all.
        length_unit: metres in one unit of length of the model.

    Raises:
        RigError: no rig can be made of this model; the message names the element.
    """
    package = mujoco_module()
    if not isinstance(model, (str, Path, package.MjModel)):
        raise RigError(
            f"from_mujoco takes a mujoco.MjModel or the path of its file, {type(model).__name__} "
            "came"
        )
    title = "model"
    units = Units(length_unit)
    if isinstance(model, (str, Path)):
        title = Path(model).stem
        model = load_model(model)
    title = _title(model, title)
    text = package.mj_name2id(model, package.mjtObj.mjOBJ_TEXT, EMBEDDED)
    if text >= 0 and chain is None and joints is None:
        written = bytes(model.text_data)[model.text_adr[text] :].split(b"\0")[0].decode()
        return Imported(build_rig(parse_toml(written, title, RigError), title), written, (), ())
    driven, notes = driven_tendons(model)
    hinges = turning_joints(model, chain, joints)
    poses = over_ranges(model, hinges)
    turned = {t: turned_by(poses, t) for t in driven}
    notes += other_joints(model, hinges, driven, turned)
    coupled, left = couplings(model)
    notes += left
    kept = kept_joints(hinges, turned, coupled)
    if not kept:
        where = f" of '{chain}'" if chain is not None else ""
        raise RigError(f"{title}: no tendon that an actuator pulls turns a joint{where}")
    if len(kept) > MOST_JOINTS:
        raise RigError(
            f"{title}: tendons turn {len(kept)} joints, up to {MOST_JOINTS} are supported; choose "
            "some with --chain or --joints"
        )
    check_base(model, kept[0], chain)
    held = [joint_name(model, j) for j in hinges if j not in kept]
    if held:
        notes.append(f"no driven tendon turns {', '.join(held)}: held where the model has them")
    pulling = {t: name for t, name in driven.items() if turned[t]}
    _check_coefficients(model, pulling)
    springs, left = joint_springs(model, kept, units)
    notes += left
    inside = [pair for pair in coupled if {pair.leader, pair.follower} <= set(kept)]
    soft = softened(inside, springs, units)
    base, described = described_joints(model, kept, units, springs, soft)
    raw: dict[str, object] = {
        "name": title,
        "log": {"time": {"column": "time", "unit": "s"}},
        "base": base,
        "joints": described,
        "drives": [described_drive(model, t, name, units) for t, name in pulling.items()],
    }
    tendons = list[dict[str, object]]()
    off = dict[str, float]()
    free = sum("coupled" not in joint for joint in described)
    for t, name in pulling.items():
        crossings, off[name], left = described_crossings(model, t, name, hinges, poses, units)
        tendons.append(
            {
                "name": name,
                "drive": name,
                "stiffness": ASSUMED.stiffness(len(pulling), free),
                "pretension": ASSUMED.pretension,
                "crossings": crossings,
            }
        )
        notes += left
    raw |= {
        "tendons": tendons,
        "sensors": described_sensors(off, [joint_name(model, j) for j in kept]),
    }
    imported = Imported.of(raw, title, "model", tuple(notes))
    _check_size(imported.rig)
    return imported


def _title(model: mujoco.MjModel, otherwise: str) -> str:
    name = bytes(model.names).split(b"\0", 1)[0].decode(errors="replace")
    return name if name and name != "MuJoCo Model" else otherwise


def _check_coefficients(model: mujoco.MjModel, driven: Mapping[int, str]) -> None:
    """Raise a `RigError` where a fixed tendon sums angles: its coefficients, larger than the whole
    model, are no moment arms.
    """
    joint = mujoco_module().mjtWrap.mjWRAP_JOINT
    for t, name in driven.items():
        begin = int(model.tendon_adr[t])
        wraps = range(begin, begin + int(model.tendon_num[t]))
        sums = [float(model.wrap_prm[i]) for i in wraps if model.wrap_type[i] == joint]
        if max(map(abs, sums), default=0.0) > model.stat.extent:
            listed = " and ".join(f"{coefficient:g}" for coefficient in sums)
            raise RigError(
                f"the fixed tendon '{name}' sums angles, by the coefficients {listed}, which are "
                "no lengths: its path is not in the model. Write the radius of each pulley as its "
                'coef, such as coef="0.008" for 8 mm'
            )


def _check_size(rig: Rig) -> None:
    largest = USUAL["radius"][1]
    for tendon in rig.tendons:
        for joint, arm in tendon.arms().items():
            if abs(arm) > largest:
                raise RigError(
                    f"tendon '{tendon.name}' has a moment arm of {abs(arm):.3g} m at '{joint}': "
                    "if the model is in "
                    "millimetres, give --length-unit mm"
                )
