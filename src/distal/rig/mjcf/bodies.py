"""Joints and links of a model, as a chain whose frames are all parallel where all angles are zero,
with the stiffness of the joints' limits and their couplings.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.polynomial import Legendre, Polynomial
from scipy.spatial.transform import Rotation

from distal.arrays import Floats
from distal.rig.files import Guess, name_of
from distal.rig.mjcf.loading import ASSUMED, mujoco_module, range_of

if TYPE_CHECKING:
    import mujoco


SMALLEST_INERTIA = 1e-9
"""Inertia of a joint to which the model gives no armature, beside its link's [kg m²]. Source:
rounding (an inertia of zero).
"""


@dataclass(frozen=True)
class Units:
    """Units of a model: metres in its unit of `length`; masses are in kilograms, times in
    seconds.
    """

    length: float = 1.0

    @property
    def force(self) -> float:
        """Newtons in one unit of force."""
        return self.length

    @property
    def torque(self) -> float:
        """Newton metres in one unit of torque."""
        return self.length**2


def joint_name(model: mujoco.MjModel, joint: int) -> str:
    """Return the name of a joint in the rig."""
    return name_of(model.joint(joint).name, f"joint{joint}")


def tendon_name(model: mujoco.MjModel, tendon: int) -> str:
    """Return the name of a tendon in the rig."""
    return name_of(model.tendon(tendon).name, f"tendon{tendon}")


def carried_by(model: mujoco.MjModel, joints: Sequence[int]) -> list[int]:
    """Return for each body the last one of the kept `joints` on its way from the base, −1 where
    there is none.
    """
    carrier = [-1] * model.nbody
    for body in range(1, model.nbody):
        above = carrier[model.body_parentid[body]]
        carrier[body] = max((j for j in joints if model.jnt_bodyid[j] == body), default=above)
    return carrier


def parent_of(
    model: mujoco.MjModel, joint: int, joints: Sequence[int], carrier: Sequence[int]
) -> int:
    """Return which of the kept `joints` turns the link on which a joint sits, −1 for none;
    `carrier` is by `carried_by`.
    """
    body = model.jnt_bodyid[joint]
    above = carrier[model.body_parentid[body]]
    return max((j for j in joints if model.jnt_bodyid[j] == body and j < joint), default=above)


def described_joints(
    model: mujoco.MjModel,
    joints: Sequence[int],
    units: Units,
    springs: Mapping[int, Mapping[str, float]],
    coupled: Sequence[Coupled],
) -> tuple[dict[str, object], list[dict[str, object]]]:
    """Return the raw base and the raw joints, in the model's order, with axes, positions, links,
    armature, damping, friction, springs, couplings and stops; a joint leads those that follow it
    within the stops of all.

    Args:
        springs: index of a joint → its raw return spring.
    """
    mujoco = mujoco_module()
    data = mujoco.MjData(model)
    data.qpos[[model.jnt_qposadr[j] for j in joints]] = 0.0
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    frame = data.xmat[int(model.jnt_bodyid[joints[0]])].reshape(3, 3)
    carrier = carried_by(model, joints)
    root = data.xanchor[joints[0]]
    described = list[dict[str, object]]()
    for j in joints:
        parent = parent_of(model, j, joints, carrier)
        position = data.xanchor[j] - (data.xanchor[parent] if parent >= 0 else root)
        raw: dict[str, object] = {
            "name": joint_name(model, j),
            "parent": joint_name(model, parent) if parent >= 0 else "base",
            "offset": _rounded(frame.T @ position * units.length),
            "axis": _rounded(frame.T @ data.xaxis[j], 12),
        }
        bodies = [body for body in range(model.nbody) if carrier[body] == j]
        link = _link(model, data, bodies, data.xanchor[j], frame, units)
        if link is not None:
            raw["link"] = link
        dof = model.jnt_dofadr[j]
        raw["inertia"] = max(float(model.dof_armature[dof]) * units.torque, SMALLEST_INERTIA)
        raw["damping"] = float(np.ravel(model.dof_damping[dof])[0]) * units.torque
        loss = float(model.dof_frictionloss[dof]) * units.torque
        if loss > 0.0:
            coefficient = {"value": ASSUMED.joint_friction, "std": "30 %"}
            raw["friction"] = {
                "coefficient": Guess(coefficient, "how well friction is known"),
                "radius": ASSUMED.friction_radius,
                "preload": loss / (ASSUMED.joint_friction * ASSUMED.friction_radius),
            }
        if j in springs:
            raw["spring"] = dict(springs[j])
        leads = [pair for pair in coupled if pair.follower == j]
        if leads:
            name = joint_name(model, leads[0].leader)
            raw["coupled"] = {"joint": name, "ratio": leads[0].ratio, "offset": leads[0].offset}
        else:
            initial = float(model.qpos0[model.jnt_qposadr[j]])
            raw["initial"] = Guess({"value": initial, "std": "5 deg"}, "angle at the start")
            raw |= described_stop(model, j, units, coupled)
        described.append(raw)
    gravity = [float(part) * units.length for part in model.opt.gravity]
    return {"gravity": gravity, "orientation": _rounded(_roll_pitch_yaw(frame), 12)}, described


def _link(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    bodies: Sequence[int],
    origin: Floats,
    frame: Floats,
    units: Units,
) -> dict[str, object] | None:
    """Return mass, centre and moments of inertia of bodies that move together, in the joint's
    frame; None if massless.
    """
    masses = np.array([float(model.body_mass[b]) for b in bodies])
    if masses.sum() <= 0.0:
        return None
    centres = np.array([frame.T @ (data.xipos[b] - origin) for b in bodies])
    centre = masses @ centres / masses.sum()
    moments = np.zeros(3)
    for mass, position, b in zip(masses, centres, bodies):
        turned = frame.T @ data.ximat[b].reshape(3, 3)
        off = position - centre
        shift = mass * (off @ off * np.eye(3) - np.outer(off, off))
        moments += np.diag(turned @ np.diag(model.body_inertia[b]) @ turned.T + shift)
    return {
        "mass": float(masses.sum()),
        "centre": _rounded(centre * units.length),
        "inertia": [float(f"{moment:.6g}") for moment in moments * units.torque],
    }


def _rounded(values: Floats, digits: int = 9) -> list[float]:
    return [round(float(value), digits) + 0.0 for value in values]


def _roll_pitch_yaw(matrix: Floats) -> Floats:
    """Return the angles of R = R_z(yaw) R_y(pitch) R_x(roll)."""
    with warnings.catch_warnings():
        # where pitch is ±90°, only a sum of the other two is determined; scipy warns and takes one
        warnings.simplefilter("ignore", UserWarning)
        angles: Floats = Rotation.from_matrix(matrix).as_euler("xyz")
    return angles


def stiffness_at_rest(
    model: mujoco.MjModel, solref: Floats, solimp: Floats, inverse_inertia: float
) -> float:
    """Return the stiffness of a constraint at rest, beyond the width of `solimp`, in the model's
    units.

    It is K = k/((1 − d) A), with k = 1/(T ζ)² or −solref[0], d = d_max and A the `inverse_inertia`.
    This follows from MuJoCo's documentation, "Computation": the force is f = (a_ref − a)/R with R =
    A (1 − d)/d and a_ref = −(d/d_max²) k r at rest.
    """
    time = float(solref[0])
    ratio = float(solref[1])
    d = float(np.clip(solimp[1], 1e-4, 0.9999))
    # MuJoCo takes no time constant below two steps
    k = 1.0 / (max(time, 2.0 * float(model.opt.timestep)) * ratio) ** 2 if time > 0.0 else -time
    return k / ((1.0 - d) * max(inverse_inertia, 1e-12))


def described_stop(
    model: mujoco.MjModel, joint: int, units: Units, coupled: Sequence[Coupled]
) -> dict[str, object]:
    """Return the stops of a joint, raw, with stiffness and damping by the joint's limits in MuJoCo;
    empty where neither it nor a joint that follows it has limits.
    """
    ends = kept_range(model, joint, coupled)
    if ends is None:
        return {}
    inverse = float(model.dof_invweight0[model.jnt_dofadr[joint]])
    stiffness = (
        stiffness_at_rest(model, model.jnt_solref[joint], model.jnt_solimp[joint], inverse)
        * units.torque
    )
    return {
        "stops": list(ends),
        "stop_stiffness": float(f"{stiffness:.6g}"),
        "stop_damping": float(f"{ASSUMED.return_time * stiffness:.6g}"),
    }


@dataclass(frozen=True)
class Coupled:
    """A coupling θ_follower = ratio θ_leader + offset [rad]; the leader has the lower index.

    The `stiffness` holds the follower there, in the model's units.
    """

    leader: int
    follower: int
    ratio: float
    offset: float
    stiffness: float


def couplings(model: mujoco.MjModel) -> tuple[list[Coupled], list[str]]:
    """Return the couplings of joints, and which of the model's equalities are left out or changed,
    in words.

    In MuJoCo q₁ − q₁₀ = Σ a_k (q₂ − q₂₀)^k; where this is curved, the nearest straight line over
    the range replaces it.
    """
    mujoco = mujoco_module()
    coupled = list[Coupled]()
    left = list[str]()
    for i in range(model.neq):
        if not model.eq_active0[i]:
            continue
        name = model.equality(i).name or f"number {i}"
        kind = mujoco.mjtEq(int(model.eq_type[i]))
        first = int(model.eq_obj1id[i])
        second = int(model.eq_obj2id[i])
        if int(kind) != int(mujoco.mjtEq.mjEQ_JOINT) or second < 0:
            left.append(f"equality '{name}' ({kind.name.removeprefix('mjEQ_').lower()}): left out")
            continue
        zero = [float(model.qpos0[model.jnt_qposadr[j]]) for j in (first, second)]
        low, high = range_of(model, second)
        curve = Polynomial(model.eq_data[i][:5])(Polynomial([-zero[1], 1.0])) + zero[0]
        # a series of Legendre's polynomials, each within ±1: its first two are the nearest line
        series = curve.convert(domain=[low, high], kind=Legendre)
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
    coupled: Sequence[Coupled], springs: Mapping[int, Mapping[str, float]], units: Units
) -> list[Coupled]:
    """Return the couplings with ratio and offset at rest, where the spring of each follower pulls
    against the coupling: K (ρ θ_l + o − θ_f) = k (θ_f − θ₀).

    Args:
        springs: index of a joint → its raw return spring.
    """
    soft = list[Coupled]()
    for pair in coupled:
        spring = springs.get(pair.follower, {})
        held = pair.stiffness * units.torque
        pulled = spring.get("stiffness", 0.0)
        share = held / (held + pulled)
        rest = spring.get("rest_angle", 0.0)
        offset = share * pair.offset + (1.0 - share) * rest
        soft.append(
            replace(pair, ratio=round(share * pair.ratio, 9), offset=round(offset, 9) + 0.0)
        )
    return soft


def kept_range(
    model: mujoco.MjModel, leader: int, coupled: Sequence[Coupled]
) -> tuple[float, float] | None:
    """Return the range of a leading joint in which it and all joints that follow it are within
    their limits [rad], None where none has limits.
    """
    ends = [range_of(model, leader)] if model.jnt_limited[leader] else []
    for coupling in coupled:
        if coupling.leader == leader and model.jnt_limited[coupling.follower]:
            low, high = sorted(
                (end - coupling.offset) / coupling.ratio
                for end in range_of(model, coupling.follower)
            )
            ends.append((low, high))
    return (max(low for low, _ in ends), min(high for _, high in ends)) if ends else None
