"""Couplings between joints, by the equalities of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from distal.rig.mjcf.bodies import Units, joint_name
from distal.rig.mjcf.constraints import stiffness_at_rest
from distal.rig.mjcf.loading import mujoco_module
from distal.rig.mjcf.poses import range_of

if TYPE_CHECKING:
    import mujoco


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
        zero = [float(model.qpos0[int(model.jnt_qposadr[j])]) for j in (first, second)]
        low, high = range_of(model, second)
        angles = np.linspace(low, high, 41)
        desired = np.polynomial.Polynomial(model.eq_data[i][:5])(angles - zero[1]) + zero[0]
        offset, ratio = (float(c) for c in np.polynomial.polynomial.polyfit(angles, desired, 1))
        off = float(np.abs(ratio * angles + offset - desired).max())
        if abs(ratio) < 1e-9:
            left.append(f"equality '{name}' holds joint '{joint_name(model, first)}': left out")
            continue
        if off > 1e-6:
            left.append(
                f"equality '{name}': a straight line, up to {np.rad2deg(off):.1f}° off at "
                f"'{joint_name(model, first)}'"
            )
        inverse = sum(
            float(model.dof_invweight0[int(model.jnt_dofadr[j])]) for j in (first, second)
        )
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
