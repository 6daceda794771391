"""Tendons of a model with their drives and sensors, as a rig file describes them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.rig.imported import Guess
from distal.rig.mjcf.assumed_values import (
    DRIVE_MASS,
    ENCODER_STEP,
    FORCE_NOISE,
    NOMINAL_FORCE,
    PATH_FRICTION,
    PRETENSION,
    RATE,
    position_noise,
)
from distal.rig.mjcf.bodies import Units, joint_name
from distal.rig.mjcf.excursion import ENOUGH, fit_excursion, sizes
from distal.rig.mjcf.poses import over_ranges, range_of, rest_lengths

if TYPE_CHECKING:
    import mujoco

POSES = 3000
"""Number of random poses at which the lengths of a tendon are computed [1]. Source: judgement."""

SMALLEST_SHARE = 1e-6
"""Terms that are never larger than this share of a tendon's excursion are left out [1]. Source:
judgement.
"""


def described_drive(
    model: mujoco.MjModel, tendon: int, name: str, units: Units
) -> dict[str, object]:
    """Return the raw drive of a tendon; the tendon's `frictionloss` becomes friction of
    the drive.
    """
    constant = float(np.ravel(model.tendon_frictionloss[tendon])[0]) * units.force
    friction: dict[str, object] = {"load": PATH_FRICTION}
    if constant > 0.0:
        friction = {"constant": constant} | friction
    return {
        "name": name,
        "kind": "slider",
        "mass": DRIVE_MASS,
        "friction": friction,
        "nominal_force": NOMINAL_FORCE,
    }


def described_tendon(
    model: mujoco.MjModel,
    tendon: int,
    name: str,
    joints: Sequence[int],
    stiffness: Guess,
    units: Units,
) -> tuple[dict[str, object], float, list[str]]:
    """Return a raw tendon, the RMS error that its polynomial leaves of its length [m], and a note
    where its moment arms are not exact.

    The std of the polynomial's `scale`, or of the pulleys' radii, is what 92 % of the errors of its
    moment arms stay below, at least `ENOUGH`. Tendon and drive have one name.
    """
    poses = over_ranges(model, joints, POSES, seed=1)
    lengths = poses.lengths[:, tendon] - rest_lengths(model, joints)[tendon]
    excursion = fit_excursion(poses.angles, lengths, poses.arms[:, tendon])
    names = [joint_name(model, j) for j in joints]
    std = max(ENOUGH, float(np.ceil(1e3 * excursion.arm_most)) / 1e3)
    notes = list[str]()
    switches = len(np.unique(poses.wraps[:, tendon])) > 1
    if switches or excursion.arm_rms.max() > ENOUGH:
        notes.append(
            f"tendon '{name}': "
            + ("its path touches a surface at some angles only; " if switches else "")
            + f"degree {excursion.degree} leaves {1e3 * units.length * excursion.length_rms:.2g} "
            "mm RMS, " + f"of its moment arms {sizes(names, excursion.arm_rms)}"
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
        largest = np.prod(np.abs(poses.angles).max(axis=0) ** excursion.powers, axis=1)
        reach = np.abs(excursion.coefficients * largest)
        terms = [
            {"powers": [int(p) for p in powers], "coefficient": float(f"{-c * units.length:.9g}")}
            for powers, c, size in zip(excursion.powers, excursion.coefficients, reach)
            if size > SMALLEST_SHARE * np.ptp(lengths)
        ]
        ends = [[float(end) for end in range_of(model, j)] for j in joints]
        scale = {"value": 1.0, "std": std}
        crossings = [
            {"kind": "polynomial", "joints": names, "range": ends, "scale": scale, "terms": terms}
        ]
    raw: dict[str, object] = {
        "name": name,
        "drive": name,
        "stiffness": stiffness,
        "pretension": PRETENSION,
        "crossings": crossings,
    }
    return raw, excursion.length_rms * units.length, notes


def described_sensors(
    tendons: Mapping[str, float], joints: Sequence[str]
) -> list[dict[str, object]]:
    """Return the raw sensors: displacement and force of each drive, and an encoder at each joint
    for learning.

    Args:
        tendons: name → RMS error that the polynomial leaves of the tendon's length [m].
    """
    sensors: list[dict[str, object]] = []
    for name, left in tendons.items():
        for kind, column, unit, noise in (
            ("position", "x", "m", position_noise(left)),
            ("force", "u", "N", FORCE_NOISE),
        ):
            sensors.append(
                {
                    "name": f"{column}_{name}",
                    "measures": kind,
                    "of": name,
                    "column": f"{column}_{name}",
                    "unit": unit,
                    "rate": RATE,
                    "noise": noise,
                }
            )
    for name in joints:
        sensors.append(
            {
                "name": f"encoder_{name}",
                "measures": "angle",
                "of": name,
                "column": f"encoder_{name}",
                "unit": "rad",
                "rate": RATE,
                "resolution": ENCODER_STEP,
            }
        )
    return sensors
