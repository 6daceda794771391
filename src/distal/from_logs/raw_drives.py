"""The raw description of a drive and of its tendons."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulled_both_ways, pulls_of
from distal.from_logs.raw_values import Raw, about, number
from distal.from_logs.sizes import ASSUMED_RADIUS, DriveSizes
from distal.rig import Guess


def raw_drive(drive: FoundDrive) -> Raw:
    """Return a drive."""
    sizes = drive.sizes
    unit = "N" if sizes.is_slider else "N m"
    force = sizes.tension * sizes.lever
    angles = np.isfinite(sizes.friction)
    constant = {
        "value": number(sizes.friction if angles else 0.05 * force, unit),
        "std": "70 %",
    }
    raw: Raw = {"name": drive.name, "kind": "slider" if sizes.is_slider else "capstan"}
    if sizes.is_slider:
        raw["mass"] = Guess("20 g", "masses of drives")
    else:
        raw["inertia"] = Guess("2e-4 kg m^2", "inertia of motors")
        raw["radius"] = Guess(number(1e3 * ASSUMED_RADIUS, "mm"), "lengths: radii of spools")
    per_speed = "kg/s" if sizes.is_slider else "N m s"
    if sizes.damping > 0.0:
        raw["damping"] = about(sizes.damping, 1.0, per_speed)
    elif not sizes.is_slider:
        raw["damping"] = Guess("1e-3 N m s", "damping of motors")
    friction: Raw = {"constant": constant, "load": {"value": 0.06, "std": 0.04}}
    raw["friction"] = friction if angles else Guess(friction, "friction of drives")
    if drive.effort is None:
        side = 0.0 if sizes.is_pair else sizes.winding
        nominal = {"value": number(side * force, unit), "std": number(0.5 * force, unit)}
        raw["nominal_force"] = Guess(nominal, "forces: no column has them")
    return raw


def raw_tendons(
    drive: FoundDrive, joints: Sequence[FoundJoint], drives: Sequence[FoundDrive]
) -> list[Raw]:
    """Return the tendons of a drive over the joints that it moves; `drives` are all of them."""
    sizes = drive.sizes
    stiffness: object = about(
        sizes.stiffness / 1e3, sizes.stiffness_std if sizes.stiffness_std > 0 else 0.4, "N/mm"
    )
    if not np.isfinite(sizes.stiffness_std):
        stiffness = Guess(about(sizes.stiffness / 1e3, 0.6, "N/mm"), "stiffness of tendons")
    sides = (1, -1) if sizes.is_pair else (1,)
    stiffening: Raw = {}
    is_opposed = any(pulled_both_ways(pulls_of(j, drives)) for j in drive.structure.joints)
    if np.isfinite(sizes.stiffness_std) and is_opposed and not sizes.is_pair:
        # against a spring, or on one spool, it costs fits minutes and changes no angle
        stiffening["stiffening"] = Guess({"value": 50.0, "std": 50.0}, "stiffening of tendons")
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
                "path": Guess(
                    {"friction": {"value": 0.1, "std": 0.08}, "wrap": "90 deg"},
                    "friction along the paths",
                ),
            }
        )
    return tendons


def _start(sizes: DriveSizes) -> Raw:
    """Return the pre-tension of a tendon, or its slack, at zero angles and zero position."""
    # zeros that differ from log to log are another pre-tension in each
    spread = max(0.4 * sizes.pretension, 0.3 * sizes.tension, sizes.zero_spread * sizes.stiffness)
    if sizes.slack <= 0.0:
        std = number(spread, "N")
        return {"pretension": {"value": number(sizes.pretension, "N"), "std": std}}
    std = number(1e3 * max(0.3 * sizes.slack, spread / sizes.stiffness), "mm")
    return {"slack": {"value": number(1e3 * sizes.slack, "mm"), "std": std}}
