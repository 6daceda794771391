"""A rig from a MuJoCo model: tendons that pull, with their drives and sensors, and equalities of
the model as couplings of joints.

An actuator pulls the tendons that become the rig's; its joints turn, are asked for, and driven
tendons move them.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Legendre, Polynomial

from distal.errors import RigError, did_you_mean
from distal.rig.files import Imported, build_rig, name_of, parse_toml
from distal.rig.mjcf_bodies import (
    ASSUMED,
    CROSSED,
    EMBEDDED,
    LARGEST_ARM_ERROR,
    Coupled,
    Poses,
    at_poses,
    described_joints,
    fit_excursion,
    joint_name,
    joint_springs,
    mujoco_module,
    only_number,
    over_ranges,
    range_of,
    spring_tendons,
    stiffness_at_rest,
    tendon_name,
    tendon_slopes,
    turned_by,
)
from distal.rig.plausibility import USUAL
from distal.rig.rig import MOST_JOINTS, Rig
from distal.rig.values_with_stds import Raw

if TYPE_CHECKING:
    import mujoco


def couplings(model: mujoco.MjModel) -> tuple[list[Coupled], list[str]]:
    """Return the couplings of joints, and which of the model's equalities are left out or changed,
    in words.

    In MuJoCo q₁ − q₁₀ = Σ a_k (q₂ − q₂₀)^k; where this is curved, the nearest straight line over
    the range replaces it.
    """
    import mujoco

    coupled = list[Coupled]()
    left = list[str]()
    for i in range(model.neq):
        if not model.eq_active0[i]:
            continue
        name = model.equality(i).name or f"number {i}"
        kind = mujoco.mjtEq(int(model.eq_type[i]))
        first = int(model.eq_obj1id[i])
        second = int(model.eq_obj2id[i])
        if kind != mujoco.mjtEq.mjEQ_JOINT or second < 0:
            left.append(f"equality '{name}' ({kind.name.removeprefix('mjEQ_').lower()}): left out")
            continue
        zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second)]
        curve = Polynomial(model.eq_data[i][:5])(Polynomial([-zero[1], 1.0])) + zero[0]
        # a series of Legendre's polynomials, each within ±1: its first two are the nearest line
        series = curve.convert(domain=range_of(model, second), kind=Legendre)
        line = series.truncate(2)
        offset = float(line(0.0))
        ratio = float(line(1.0)) - offset
        off = float(np.abs(series.coef[2:]).sum())
        if abs(ratio) < 1e-9:
            left.append(f"equality '{name}' holds joint '{joint_name(model, first)}': left out")
            continue
        if off > 1e-6:
            left.append(
                f"equality '{name}': a straight line, up to {np.rad2deg(off):.1f}° off at "
                f"'{joint_name(model, first)}'"
            )
        inverse = sum(float(model.dof_invweight0[model.jnt_dofadr[j]]) for j in (first, second))
        stiffness = stiffness_at_rest(model, model.eq_solref[i], model.eq_solimp[i], inverse)
        if first < second:
            stiffness *= ratio**2
            first, second, ratio, offset = second, first, 1.0 / ratio, -offset / ratio
        coupled.append(Coupled(second, first, round(ratio, 9), round(offset, 9) + 0.0, stiffness))
    return coupled, left


def softened(
    coupled: Sequence[Coupled], springs: Mapping[int, Mapping[str, float]], length_unit: float
) -> list[Coupled]:
    """Return the couplings with ratio and offset at rest, where the spring of each follower pulls
    against the coupling: K (ρ θ_l + o − θ_f) = k (θ_f − θ₀).

    Args:
        springs: index of a joint → its raw return spring.
        length_unit: metres in one unit of length of the model.
    """
    soft = list[Coupled]()
    for pair in coupled:
        spring = springs.get(pair.follower, {})
        held = pair.stiffness * length_unit**2
        pulled = spring.get("stiffness", 0.0)
        share = held / (held + pulled)
        rest = spring.get("rest_angle", 0.0)
        offset = share * pair.offset + (1.0 - share) * rest
        soft.append(
            replace(pair, ratio=round(share * pair.ratio, 9), offset=round(offset, 9) + 0.0)
        )
    return soft


def described_drive(model: mujoco.MjModel, tendon: int, name: str, length_unit: float) -> Raw:
    """Return the raw drive of a tendon; the tendon's `frictionloss` becomes friction of the drive.
    The model's unit of length has `length_unit` metres.
    """
    constant = only_number(model.tendon_frictionloss[tendon]) * length_unit
    friction: Raw = {"load": ASSUMED.path_friction}
    if constant > 0.0:
        friction = {"constant": constant} | friction
    return {
        "name": name,
        "kind": "slider",
        "mass": ASSUMED.drive_mass,
        "friction": friction,
        "nominal_force": ASSUMED.nominal_force,
    }


def described_crossings(
    model: mujoco.MjModel,
    tendon: int,
    name: str,
    hinges: Sequence[int],
    poses: Poses,
    length_unit: float,
) -> tuple[list[object], float, list[str]]:
    """Return the raw crossings of a tendon, the RMS error that their polynomial leaves of its
    length [m], and a note where its moment arms are not exact.

    The std of the polynomial's `scale`, or of the pulleys' radii, is what 92 % of the errors of its
    moment arms stay below, at least `LARGEST_ARM_ERROR`. The `poses` are those of the `hinges`; the
    model's unit of length has `length_unit` metres.
    """
    crossed = turned_by(poses, tendon)
    joints = [hinges[k] for k in crossed]
    angles = poses.angles[:, crossed]
    lengths = poses.lengths[:, tendon]
    # displacements of drives count from the length with all joints at zero
    lengths -= at_poses(model, hinges, np.zeros((1, len(hinges)))).lengths[0, tendon]
    excursion = fit_excursion(angles, lengths, poses.arms[:, tendon, crossed])
    names = [joint_name(model, j) for j in joints]
    std = max(LARGEST_ARM_ERROR, float(np.ceil(1e3 * excursion.arm_most)) / 1e3)
    notes = list[str]()
    switches = len(np.unique(poses.wraps[:, tendon])) > 1
    if switches or excursion.arm_rms.max() > LARGEST_ARM_ERROR:
        shares = ", ".join(
            f"{100 * share:.2g} % at {name}" for name, share in zip(names, excursion.arm_rms)
        )
        notes.append(
            f"tendon '{name}': "
            + ("its path touches a surface at some angles only; " if switches else "")
            + f"degree {excursion.degree} leaves {1e3 * length_unit * excursion.length_rms:.2g} "
            "mm RMS, " + f"of its moment arms {shares}"
        )
    if excursion.degree == 1:
        crossings: list[object] = []
        for k, slope in zip(excursion.powers.argmax(axis=1), excursion.coefficients):
            radius = {"value": abs(float(slope)) * length_unit, "std": f"{100 * std:g} %"}
            side = -1 if slope > 0.0 else 1
            crossings.append({"joint": names[k], "kind": "pulley", "radius": radius, "side": side})
    else:
        terms = [
            {"powers": powers.tolist(), "coefficient": float(f"{-c * length_unit:.9g}")}
            for powers, c in zip(excursion.powers, excursion.coefficients)
        ]
        ends = [list(range_of(model, j)) for j in joints]
        scale = {"value": 1.0, "std": std}
        crossings = [
            {"kind": "polynomial", "joints": names, "range": ends, "scale": scale, "terms": terms}
        ]
    return crossings, excursion.length_rms * length_unit, notes


def described_sensor(column: str, measures: str, of: str, **errors: object) -> Raw:
    """Return a raw sensor, which measures something `of` a part, with its `errors`."""
    return {
        "name": f"{column}_{of}",
        "measures": measures,
        "of": of,
        "rate": ASSUMED.rate,
        **errors,
    }


def driven_tendons(model: mujoco.MjModel) -> tuple[dict[int, str], list[str]]:
    """Return index → name of the tendons that an actuator pulls, and what is left out, in words.

    In a model without actuators all tendons that are no springs count as pulled.

    Raises:
        RigError: no tendon is pulled, or one is pulled by a muscle.
    """
    import mujoco

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
        if model.actuator_gaintype[a] == mujoco.mjtGain.mjGAIN_MUSCLE:
            raise RigError(
                f"actuator '{name}' is a muscle; distal knows tendons that a motor pulls"
            )
        tendon = int(model.actuator_trnid[a][0])
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
    import mujoco

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
    import mujoco

    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    slopes = np.abs(tendon_slopes(model, data))
    notes = list[str]()
    for t, name in driven.items():
        least = CROSSED * max(slopes[t].max(), 1e-12)
        for j in range(model.njnt):
            if j in hinges or slopes[t, model.dof_jntid == j].max() <= least:
                continue
            kind = mujoco.mjtJoint(model.jnt_type[j])
            if kind != mujoco.mjtJoint.mjJNT_HINGE:
                raise RigError(
                    f"tendon '{name}' moves joint '{joint_name(model, j)}', which is no hinge but "
                    f"{kind.name.removeprefix('mjJNT_').lower()}; distal's joints turn"
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
    import mujoco

    # only a body that sits on the world can float, and it then has no other joint
    carrying = model.body_rootid[model.jnt_bodyid[first]]
    joint = model.body_jntadr[carrying]
    if chain is None and joint >= 0 and model.jnt_type[joint] == mujoco.mjtJoint.mjJNT_FREE:
        raise RigError(
            f"the base floats: joint '{joint_name(model, joint)}' is free; with --chain BODY it is "
            "held where the model has it"
        )


def kept_joints(
    hinges: Sequence[int],
    turned: Mapping[int, Sequence[int]],
    coupled: Sequence[Coupled],
    title: str,
    chain: str | None,
) -> list[int]:
    """Return those of the `hinges` that tendons turn (`turned` as in `other_joints`), and those
    that are coupled to one of these.

    Args:
        title: of the model, which begins messages.
        chain: as in `from_mujoco`.

    Raises:
        RigError: there are none, or too many.
    """
    kept = {hinges[k] for joints in turned.values() for k in joints}
    for coupling in coupled:
        pair = {coupling.leader, coupling.follower}
        if pair & kept and pair <= set(hinges):
            kept |= pair
    if not kept:
        where = f" of '{chain}'" if chain is not None else ""
        raise RigError(f"{title}: no tendon that an actuator pulls turns a joint{where}")
    if len(kept) > MOST_JOINTS:
        raise RigError(
            f"{title}: tendons turn {len(kept)} joints, up to {MOST_JOINTS} are supported; choose "
            "some with --chain or --joints"
        )
    return sorted(kept)


def opened(model: mujoco.MjModel | str | Path) -> tuple[mujoco.MjModel, str]:
    """Return a model, which may be given by its file, and its title: its own name, or that of its
    file.

    Raises:
        RigError: MuJoCo is not installed, there is no such file, or it is no model.
    """
    package = mujoco_module()
    title = "model"
    if isinstance(model, (str, Path)):
        title = Path(model).stem
        try:
            model = package.MjModel.from_xml_path(str(model))
        except Exception as problem:
            reason = " ".join(str(problem).split())
            raise RigError(f"{model}: MuJoCo does not take it: {reason}") from None
    elif not isinstance(model, package.MjModel):
        raise RigError(
            f"from_mujoco takes a mujoco.MjModel or the path of its file, {type(model).__name__} "
            "came"
        )
    name = bytes(model.names).split(b"\0", 1)[0].decode(errors="replace")
    return model, title if name in ("", "MuJoCo Model") else name


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
    model, title = opened(model)
    import mujoco

    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, EMBEDDED)
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
    kept = kept_joints(hinges, turned, coupled, title, chain)
    check_base(model, kept[0], chain)
    held = [joint_name(model, j) for j in hinges if j not in kept]
    if held:
        notes.append(f"no driven tendon turns {', '.join(held)}: held where the model has them")
    pulling = {t: name for t, name in driven.items() if turned[t]}
    springs, left = joint_springs(model, kept, length_unit)
    notes += left
    inside = [pair for pair in coupled if {pair.leader, pair.follower} <= set(kept)]
    soft = softened(inside, springs, length_unit)
    base, described = described_joints(model, kept, length_unit, springs, soft)
    tendons = list[Raw]()
    off = dict[str, float]()
    free = sum("coupled" not in joint for joint in described)
    for t, name in pulling.items():
        crossings, off[name], left = described_crossings(model, t, name, hinges, poses, length_unit)
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
    raw: Raw = {
        "name": title,
        "log": {"time": {"column": "time", "unit": "s"}},
        "base": base,
        "joints": described,
        "drives": [described_drive(model, t, name, length_unit) for t, name in pulling.items()],
        "tendons": tendons,
        "sensors": [
            *(
                sensor
                for name, left in off.items()
                for sensor in (
                    described_sensor("x", "position", name, noise=ASSUMED.noise(left)),
                    described_sensor("u", "force", name, noise=ASSUMED.force_noise),
                )
            ),
            *(
                described_sensor(
                    "encoder", "angle", joint_name(model, j), resolution=ASSUMED.encoder_step
                )
                for j in kept
            ),
        ],
    }
    imported = Imported.of(raw, title, "model", notes)
    _check_size(imported.rig)
    return imported


def _check_size(rig: Rig) -> None:
    largest = USUAL["radius"][1]
    for tendon in rig.tendons:
        for joint, arm in tendon.arms().items():
            if abs(arm) > largest:
                raise RigError(
                    f"tendon '{tendon.name}' has a moment arm of {abs(arm):.3g} m at '{joint}': "
                    "if the model is in millimetres, give --length-unit mm; the coef of a fixed "
                    'tendon is the radius of a pulley, such as coef="0.008"'
                )
