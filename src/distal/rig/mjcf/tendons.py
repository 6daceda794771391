"""Tendons of a model with their drives and sensors, as a rig file describes them."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from distal.rig.mjcf.bodies import Units, joint_name
from distal.rig.mjcf.excursion import ENOUGH, fit_excursion, sizes
from distal.rig.mjcf.guesses import Guess
from distal.rig.mjcf.poses import over_ranges, range_of, rest_lengths

if TYPE_CHECKING:
    import mujoco

POSES = 3000
"""At how many random poses a tendon is looked at."""

SMALLEST_SHARE = 1e-6
"""Terms that never make more than this share of a tendon's excursion are not written."""

DRIVE_MASS = 0.02
"""Of a drive that the model does not have [kg]; a filter follows the place that is measured."""


def described_drive(model: mujoco.MjModel, tendon: int, name: str, units: Units) -> dict[str, object]:
    """Return the raw drive of a tendon; a tendon's `frictionloss` rubs there."""
    constant = float(np.ravel(model.tendon_frictionloss[tendon])[0]) * units.force
    friction: dict[str, object] = {"load": Guess({"value": 0.05, "std": 0.1}, "friction along the path")}
    if constant > 0.0:
        friction = {"constant": constant} | friction
    return {
        "name": name,
        "kind": "slider",
        "mass": Guess(DRIVE_MASS, "the drive's mass"),
        "friction": friction,
        "nominal_force": Guess({"value": "5 N", "std": "5 N"}, "usual force"),
    }


def described_tendon(
    model: mujoco.MjModel, tendon: int, name: str, joints: Sequence[int], units: Units
) -> tuple[dict[str, object], list[str]]:
    """Return a raw tendon, and what its polynomial leaves where that is much, in words.

    What is left of the moment arms on 92 % of the poses is the std of their scale. Tendon and drive have one name.
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
            + f"degree {excursion.degree} leaves {1e3 * units.length * excursion.length_rms:.2g} mm RMS, "
            + f"of its moment arms {sizes(names, excursion.arm_rms)}"
        )
    if excursion.degree == 1:
        crossings: list[object] = []
        for (k,), slope in zip((np.flatnonzero(row) for row in excursion.powers), excursion.coefficients):
            radius = {"value": abs(float(slope)) * units.length, "std": f"{100 * std:g} %"}
            side = -1 if slope > 0.0 else 1
            crossings.append({"joint": names[int(k)], "kind": "pulley", "radius": radius, "side": side})
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
        crossings = [{"kind": "polynomial", "joints": names, "range": ends, "scale": scale, "terms": terms}]
    raw: dict[str, object] = {
        "name": name,
        "drive": name,
        "stiffness": Guess({"value": "20 N/mm", "std": "50 %"}, "series stiffness"),
        "pretension": Guess({"value": "1 N", "std": "1 N"}, "tension at zero angle and zero displacement"),
        "crossings": crossings,
    }
    return raw, notes


def described_sensors(tendons: Sequence[str], joints: Sequence[str]) -> list[dict[str, object]]:
    """Return raw sensors: displacement and force of each drive, and an encoder at each joint for learning."""
    rate = Guess(100.0, "rate of the sensors")
    sensors: list[dict[str, object]] = []
    for name in tendons:
        for kind, column, unit, noise in (("position", "x", "m", "0.02 mm"), ("force", "u", "N", "0.2 N")):
            sensors.append(
                {"name": f"{column}_{name}", "measures": kind, "of": name, "column": f"{column}_{name}", "unit": unit,
                 "rate": rate, "noise": Guess(noise, f"noise of a {kind}")}
            )  # fmt: skip
    for name in joints:
        sensors.append(
            {"name": f"encoder_{name}", "measures": "angle", "of": name, "column": f"encoder_{name}", "unit": "rad",
             "rate": rate, "resolution": Guess("0.1 deg", "encoders, which are for learning and comparing only")}
        )  # fmt: skip
    return sensors
