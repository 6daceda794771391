"""A rig from a MuJoCo model."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from distal.errors import RigError
from distal.rig.files import Imported
from distal.rig.mjcf.bodies import (
    Units,
    couplings,
    described_joints,
    joint_name,
    softened,
)
from distal.rig.mjcf.choice import (
    check_base,
    driven_tendons,
    kept_joints,
    other_joints,
    turning_joints,
)
from distal.rig.mjcf.loading import (
    ASSUMED,
    load_model,
    mujoco_module,
    over_ranges,
    turned_by,
)
from distal.rig.mjcf.spatial_tendons import (
    described_crossings,
    described_drive,
    described_sensors,
    joint_springs,
)
from distal.rig.plausibility import USUAL
from distal.rig.rig import MOST_JOINTS, Rig

if TYPE_CHECKING:
    import mujoco


def from_mujoco(
    model: mujoco.MjModel | str | Path,
    chain: str | None = None,
    joints: Sequence[str] | None = None,
    length_unit: float = 1.0,
) -> Imported:
    """Return a rig with the joints, links, springs and tendons of a MuJoCo model.

    Only joints that a driven tendon turns, or that are coupled to one of these, are kept; all
    others are held where the model has them. The lengths of a tendon become pulleys, or the lowest
    polynomial that leaves at most 1 % of each moment arm. Angles are those of the model.

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
