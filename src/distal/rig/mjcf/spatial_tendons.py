"""Tendons of a model: those that pull, with their drives and sensors, and those that are springs of
joints.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.arrays import Floats
from distal.rig.mjcf.bodies import Units, joint_name, tendon_name
from distal.rig.mjcf.loading import (
    ASSUMED,
    LARGEST_ARM_ERROR,
    POSES,
    Poses,
    at_poses,
    fit_excursion,
    over_ranges,
    range_of,
    rest_lengths,
    turned_by,
)

if TYPE_CHECKING:
    import mujoco

FARTHEST_REST = 100.0
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
    poses = over_ranges(model, joints)
    crossing = {t: [joints[k] for k in turned_by(poses, t)] for t in spring_tendons(model)}
    for t, crossed in crossing.items():
        if len(crossed) > 1:
            names = ", ".join(joint_name(model, j) for j in crossed)
            left.append(
                f"spring '{tendon_name(model, t)}' pulls at several joints ({names}): left out"
            )
    for j in joints:
        low, high = range_of(model, j)
        angles = np.linspace(low, high, POSES)
        relaxed = float(model.qpos_spring[model.jnt_qposadr[j]])
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
        roots = [root for root in relaxed if abs(root - middle) <= FARTHEST_REST * span]
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
    weak = abs(mean) / (FARTHEST_REST * span)
    return {"stiffness": weak, "rest_angle": float(middle + mean / weak)}


def _left(spring: dict[str, float], angles: Floats, torque: Floats) -> float:
    x = angles - spring.get("rest_angle", 0.0)
    terms = (spring["stiffness"], spring.get("quadratic", 0.0), spring.get("cubic", 0.0))
    return float(np.sqrt(np.mean((np.polynomial.Polynomial([0.0, *terms])(x) + torque) ** 2)))


def described_drive(
    model: mujoco.MjModel, tendon: int, name: str, units: Units
) -> dict[str, object]:
    """Return the raw drive of a tendon; the tendon's `frictionloss` becomes friction of
    the drive.
    """
    constant = float(np.ravel(model.tendon_frictionloss[tendon])[0]) * units.force
    friction: dict[str, object] = {"load": ASSUMED.path_friction}
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
    units: Units,
) -> tuple[list[object], float, list[str]]:
    """Return the raw crossings of a tendon, the RMS error that their polynomial leaves of its
    length [m], and a note where its moment arms are not exact.

    The std of the polynomial's `scale`, or of the pulleys' radii, is what 92 % of the errors of its
    moment arms stay below, at least `LARGEST_ARM_ERROR`. The `poses` are those of the `hinges`.
    """
    crossed = turned_by(poses, tendon)
    joints = [hinges[k] for k in crossed]
    angles = poses.angles[:, crossed]
    lengths = poses.lengths[:, tendon] - rest_lengths(model, hinges)[tendon]
    excursion = fit_excursion(angles, lengths, poses.arms[:, tendon, crossed])
    names = [joint_name(model, j) for j in joints]
    std = max(LARGEST_ARM_ERROR, float(np.ceil(1e3 * excursion.arm_most)) / 1e3)
    notes = list[str]()
    switches = len(np.unique(poses.wraps[:, tendon])) > 1
    if switches or excursion.arm_rms.max() > LARGEST_ARM_ERROR:
        left = zip(names, excursion.arm_rms)
        shares = ", ".join(f"{100 * share:.2g} % at {name}" for name, share in left)
        notes.append(
            f"tendon '{name}': "
            + ("its path touches a surface at some angles only; " if switches else "")
            + f"degree {excursion.degree} leaves {1e3 * units.length * excursion.length_rms:.2g} "
            "mm RMS, " + f"of its moment arms {shares}"
        )
    if excursion.degree == 1:
        crossings: list[object] = []
        for (k,), slope in zip(
            (np.flatnonzero(row) for row in excursion.powers), excursion.coefficients
        ):
            radius = {"value": abs(float(slope)) * units.length, "std": f"{100 * std:g} %"}
            side = -1 if slope > 0.0 else 1
            crossings.append(
                {"joint": names[int(k)], "kind": "pulley", "radius": radius, "side": side}
            )
    else:
        terms = [
            {"powers": [int(p) for p in powers], "coefficient": float(f"{-c * units.length:.9g}")}
            for powers, c in zip(excursion.powers, excursion.coefficients)
        ]
        ends = [[float(end) for end in range_of(model, j)] for j in joints]
        scale = {"value": 1.0, "std": std}
        crossings = [
            {"kind": "polynomial", "joints": names, "range": ends, "scale": scale, "terms": terms}
        ]
    return crossings, excursion.length_rms * units.length, notes


def described_sensors(
    tendons: Mapping[str, float], joints: Sequence[str]
) -> list[dict[str, object]]:
    """Return the raw sensors: displacement and force of each drive, and an encoder at each joint
    for learning.

    Args:
        tendons: name → RMS error that the polynomial leaves of the tendon's length [m].
    """
    rows: list[tuple[str, str, str, str, dict[str, object]]] = []
    for name, left in tendons.items():
        rows.append(("x", "position", name, "m", {"noise": ASSUMED.noise(left)}))
        rows.append(("u", "force", name, "N", {"noise": ASSUMED.force_noise}))
    for name in joints:
        rows.append(("encoder", "angle", name, "rad", {"resolution": ASSUMED.encoder_step}))
    return [
        {"name": f"{column}_{name}", "measures": kind, "of": name, "column": f"{column}_{name}"}
        | {"unit": unit, "rate": ASSUMED.rate}
        | errors
        for column, kind, name, unit, errors in rows
    ]
