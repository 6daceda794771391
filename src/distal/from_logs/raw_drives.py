"""The raw description of a drive and of its tendons."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, pi

import numpy as np

from distal.from_logs.found_parts import FoundDrive, FoundJoint
from distal.from_logs.raw_values import Raw, about, number
from distal.from_logs.sizes import ASSUMED_RADIUS, DriveSizes
from distal.rig import Guess

USUAL_LOAD: Raw = {"load": {"value": 0.06, "std": 0.04}}
"""Friction of a drive per load where no effort is read. Source: judgement (spools on bearings)."""

USUAL_PATH: Raw = {"friction": {"value": 0.1, "std": 0.08}, "wrap": "90 deg"}
"""Friction along a path where no effort is read. Source: judgement (braided line over steel)."""

WRAP = pi / 2.0
"""Angle by which a path is taken to wrap [rad]. Source: judgement."""

PARTS = 3.0
"""Friction that no log divides: constant, by load in the drive, by load along the path. Source:
judgement.
"""

LEAST = 0.2
"""Least constant friction per usual friction, and least std of a share per that share [1]. Source:
judgement.
"""


SURE_MOTION = 0.3
"""Standard deviation of a drive's inertia and damping, per value, where the logs show them. Source:
benchmark (`benchmarks.learned plants`, seeds 8301 and 8900: wrists, 2n and n + 1 5 to 30 % off).
"""


def raw_drive(drive: FoundDrive) -> Raw:
    """Return a drive."""
    sizes = drive.sizes
    unit = "N" if sizes.is_slider else "N m"
    force = sizes.tension * sizes.lever
    raw: Raw = {"name": drive.name, "kind": "slider" if sizes.is_slider else "capstan"}
    if sizes.is_slider:
        raw["mass"] = Guess("20 g", "masses of drives")
    else:
        raw["inertia"] = Guess("2e-4 kg m^2", "inertia of motors")
        raw["radius"] = Guess(number(1e3 * ASSUMED_RADIUS, "mm"), "lengths: radii of spools")
        raw["damping"] = Guess("1e-3 N m s", "damping of motors")
    raw |= _of_motion(sizes)
    raw["friction"] = _friction(sizes, unit)
    if drive.effort is None:
        side = 0.0 if sizes.is_pair else sizes.winding
        nominal = {"value": number(side * force, unit), "std": number(0.5 * force, unit)}
        raw["nominal_force"] = Guess(nominal, "forces: no column has them")
    return raw


def _of_motion(sizes: DriveSizes) -> Raw:
    """Return mass or inertia, and damping, where the logs show them."""
    friction = sizes.friction
    raw: Raw = {}
    if friction is not None and friction.inertia > 0.0:
        name, unit = ("mass", "kg") if sizes.is_slider else ("inertia", "kg m^2")
        raw[name] = about(friction.inertia, SURE_MOTION, unit)
    if friction is not None and friction.damping > 0.0:
        unit = "kg/s" if sizes.is_slider else "N m s"
        raw["damping"] = about(friction.damping, SURE_MOTION, unit)
    return raw


def _friction(sizes: DriveSizes, unit: str) -> object:
    """Return the friction of a drive: what grows with the load, where the logs show that; else
    equal parts that are constant, grow in the drive, and grow along the path.
    """
    if sizes.friction is None:
        guess = 0.05 * sizes.tension * sizes.lever
        constant = {"value": number(guess, unit), "std": "70 %"}
        return Guess({"constant": constant, **USUAL_LOAD}, "friction of drives")
    share = sizes.friction.share
    if share > 0.0:
        usual = sizes.friction.usual
        constant = about(max(usual - share * sizes.load, LEAST * usual), 1.0, unit)
        std = max(2.0 * sizes.friction.share_std, LEAST * share)
        return {"constant": constant, "load": {"value": number(share), "std": number(std)}}
    part = sizes.friction.usual / PARTS
    return {"constant": about(part, 1.0, unit), "load": about(part / sizes.load, 1.0)}


def raw_tendons(drive: FoundDrive, joints: Sequence[FoundJoint]) -> list[Raw]:
    """Return the tendons of a drive over the joints that it moves."""
    sizes = drive.sizes
    stiffness: object = about(
        sizes.stiffness / 1e3, sizes.stiffness_std if sizes.stiffness_std > 0 else 0.4, "N/mm"
    )
    if not np.isfinite(sizes.stiffness_std):
        stiffness = Guess(about(sizes.stiffness / 1e3, 0.6, "N/mm"), "stiffness of tendons")
    sides = (1, -1) if sizes.is_pair else (1,)
    stiffening: Raw = {}
    if sizes.stiffening > 0.0:
        std = max(2.0 * sizes.stiffening_std, LEAST * sizes.stiffening)
        stiffening["stiffening"] = about(sizes.stiffening, std / sizes.stiffening, "1/m")
    tendons = []
    for side in sides:
        crossings = [
            {
                "joint": joints[j].name,
                "kind": "pulley",
                "radius": about(1e3 * abs(arm), float(share), "mm"),
                "side": side * (1 if arm > 0.0 else -1),
            }
            for j, arm, share in zip(drive.structure.joints, sizes.arms, sizes.arm_stds)
        ]
        name = drive.name if len(sides) == 1 else f"{drive.name}_{'plus' if side > 0 else 'minus'}"
        tendons.append(
            {
                "name": name,
                "drive": drive.name,
                "side": side * sizes.winding,
                "crossings": crossings,
                "stiffness": stiffness,
                **stiffening,
                **_start(sizes),
                **_path(sizes),
            }
        )
    return tendons


def _path(sizes: DriveSizes) -> Raw:
    """Return the friction along a path; none where the logs show that of the drive by its load,
    from which it cannot be told.
    """
    if sizes.friction is None:
        return {"path": Guess(USUAL_PATH, "friction along the paths")}
    if sizes.friction.share > 0.0:
        return {}
    share = sizes.friction.usual / PARTS / sizes.load
    guess = {"friction": about(share / WRAP, 1.0), "wrap": number(degrees(WRAP), "deg")}
    return {"path": Guess(guess, "friction along the paths")}


def _start(sizes: DriveSizes) -> Raw:
    """Return the pre-tension of a tendon, or its slack, at zero angles and zero position."""
    # zeros that differ from log to log are another pre-tension in each
    spread = sizes.zero_spread * sizes.stiffness
    if sizes.friction is None or sizes.is_pair:
        spread = max(spread, 0.4 * sizes.pretension, 0.3 * sizes.tension)
    else:
        spread = max(2.0 * spread, 0.2 * sizes.pretension, 0.1 * sizes.tension)
    if sizes.slack <= 0.0:
        std = number(spread, "N")
        return {"pretension": {"value": number(sizes.pretension, "N"), "std": std}}
    std = number(1e3 * max(0.3 * sizes.slack, spread / sizes.stiffness), "mm")
    return {"slack": {"value": number(1e3 * sizes.slack, "mm"), "std": std}}
