"""Springs of a model, those of joints and those that are tendons, as return springs of joints."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.rig.mjcf.bodies import Units, joint_name, tendon_name
from distal.rig.mjcf.poses import at_poses, over_ranges, range_of, turned_by

if TYPE_CHECKING:
    import mujoco


POINTS = 41
"""Number of angles at which the torque of a spring is computed [1]. Source: judgement."""

FARTHEST = 100.0
"""Largest distance from the middle of a joint's range at which its spring is relaxed, in ranges
[1]. Source: rounding (roots of a nearly constant torque).
"""


def spring_tendons(model: mujoco.MjModel) -> list[int]:
    """Return the indices of the tendons that are springs."""
    return [t for t in range(model.ntendon) if float(np.ravel(model.tendon_stiffness[t])[0]) > 0.0]


def joint_springs(
    model: mujoco.MjModel, joints: Sequence[int], units: Units
) -> tuple[dict[int, dict[str, float]], list[str]]:
    """Return the raw return spring of each joint that has one, and what is left out, in words.

    The torques of all springs that act on one joint alone are added over its range, and −(k x + q
    x² + c x³) with x = θ − θ₀ is fitted to the sum.
    """
    springs = dict[int, dict[str, float]]()
    left = list[str]()
    poses = over_ranges(model, joints, 50)
    crossing = {t: [joints[k] for k in turned_by(poses, t)] for t in spring_tendons(model)}
    for t, crossed in crossing.items():
        if len(crossed) > 1:
            names = ", ".join(joint_name(model, j) for j in crossed)
            left.append(
                f"spring '{tendon_name(model, t)}' pulls at several joints ({names}): left out"
            )
    for j in joints:
        low, high = range_of(model, j)
        angles = np.linspace(low, high, POINTS)
        relaxed = float(model.qpos_spring[int(model.jnt_qposadr[j])])
        torque = -float(np.ravel(model.jnt_stiffness[j])[0]) * (angles - relaxed)
        for t in (t for t, crossed in crossing.items() if crossed == [j]):
            along = at_poses(model, [j], angles[:, None])
            low_length, high_length = (
                float(end) for end in np.ravel(model.tendon_lengthspring[t])[:2]
            )
            length = along.lengths[:, t]
            stiffness = float(np.ravel(model.tendon_stiffness[t])[0])
            stretched = np.maximum(length - high_length, 0.0) - np.maximum(low_length - length, 0.0)
            torque = torque - stiffness * stretched * along.arms[:, t, 0]
        if np.abs(torque).max() > 0.0:
            torque = torque * units.torque
            springs[j] = _as_spring(angles, torque)
            rms = _left(springs[j], angles, torque)
            if rms > 0.05 * np.abs(torque).max():
                left.append(
                    f"springs of joint '{joint_name(model, j)}': a cubic leaves {rms:.2g} N m (RMS)"
                )
    return springs, left


def _as_spring(angles: Floats, torque: Floats) -> dict[str, float]:
    """Return the spring whose torque over the range is nearest; where it is relaxed, its stiffness
    is not negative.
    """
    span = float(angles[-1] - angles[0])
    for degree in (3, 1):
        fitted = np.polynomial.Polynomial.fit(angles, torque, degree).convert()
        slope = fitted.deriv()
        middle = (angles[0] + angles[-1]) / 2
        relaxed = [
            float(root.real)
            for root in fitted.roots()
            if abs(root.imag) < 1e-9 and -slope(root.real) > 0.0
        ]
        # further away it is rounding that bends the curve
        roots = [root for root in relaxed if abs(root - middle) <= FARTHEST * span]
        if roots:
            zero = min(roots, key=lambda root: abs(root - middle))
            second = fitted.deriv(2)(zero) / 2
            third = fitted.deriv(3)(zero) / 6 if degree > 2 else 0.0
            spring = {
                "stiffness": -slope(zero),
                "rest_angle": zero,
                "quadratic": -second,
                "cubic": -third,
            }
            return {
                name: float(f"{size:.6g}")
                for name, size in spring.items()
                if size or name == "stiffness"
            }
    # the torque does not fall over the range: a weak spring that is relaxed far away
    mean = float(np.mean(torque))
    weak = abs(mean) / (FARTHEST * span)
    return {"stiffness": weak, "rest_angle": float(middle + mean / weak)}


def _left(spring: dict[str, float], angles: Floats, torque: Floats) -> float:
    x = angles - spring.get("rest_angle", 0.0)
    fitted = -(
        x
        * (spring["stiffness"] + x * (spring.get("quadratic", 0.0) + x * spring.get("cubic", 0.0)))
    )
    return float(np.sqrt(np.mean((fitted - torque) ** 2)))
