"""The raw descriptions of drives, tendons, joints and sensors, as a rig file has them; what no log
tells is a `Guess`.
"""

from __future__ import annotations

from collections.abc import Mapping
from math import degrees, inf, pi
from statistics import median

import numpy as np

from distal.from_logs.column_names import ColumnRole
from distal.from_logs.drive_and_tendon_sizes import (
    Drives,
    FoundDrive,
    FoundJoint,
    Joints,
    Pulls,
    pulled_both_ways,
    pulls_of,
)
from distal.from_logs.link_masses_and_stops import JointBalance, joint_balance, joint_stops
from distal.from_logs.motion_data import THRESHOLDS, Logs, counts_of
from distal.logs import name_and_unit
from distal.logs.raw_to_si import IMPROBABLE
from distal.rig import Guess
from distal.rig.hand_tables import ASSUMED
from distal.units import to_si

Raw = dict[str, object]

WRAP = pi / 2.0
"""Angle by which a path is taken to wrap [rad]; only its product with the coefficient counts.
Source: definition (a quarter of a turn).
"""

PARTS = 3.0
"""Friction that no log divides: constant, by load in the drive, by load along the path. Source:
definition (equal parts of three).
"""

SURE_MOTION = 0.3
"""Standard deviation of inertia, damping and friction per value, where the logs show them, and the
least one of a share and of a rest angle [1]. Source: benchmark (`benchmarks.learned plants`, seeds
8301 and 8900: wrists, 2n and n + 1 5 to 30 % off).
"""

NO_STOP = 4.0
"""Angle beyond the logs where a joint has a stop on one side only [rad]. Source: definition (a rig
file has both).
"""


AXLE = 2.0
"""Radius of a joint's axle [mm]; only its product with the coefficient of friction counts. Source:
definition (pins of fingers).
"""


def column_of(column: ColumnRole) -> str:
    """Return a column as a rig file names it: a unit in square brackets is the log's own, unless
    its scale is assumed.
    """
    return column.header if column.unit_sureness == "assumed" else name_and_unit(column.header)[0]


def number(value: float, unit: str = "") -> object:
    """Return a `value` in its unit, which may be empty, as a rig file has it."""
    return f"{value:.5g} {unit}" if unit else float(f"{value:.5g}")


def about(value: float, share: float, unit: str = "") -> Raw:
    """Return a `value` in its unit with a standard deviation that is a share of it."""
    return {"value": number(value, unit), "std": f"{100 * share:.2g} %"}


def within(value: float, std: float, unit: str = "") -> Raw:
    """Return a `value` with its standard deviation `std` in the same unit, which may be empty."""
    return {"value": number(value, unit), "std": number(std, unit)}


def raw_drive(drive: FoundDrive) -> Raw:
    """Return a drive."""
    raw: Raw = {"name": drive.name, "kind": "slider" if drive.is_slider else "capstan"}
    unit = "N" if drive.is_slider else "N m"
    if drive.is_slider:
        raw["mass"] = Guess("20 g", "masses of drives")
    else:
        raw["inertia"] = ASSUMED.motor_inertia
        raw["radius"] = Guess(number(1e3 * ASSUMED.radius, "mm"), "lengths: radii of spools")
        raw["damping"] = ASSUMED.motor_damping
    shown = drive.friction
    if shown is not None and shown.inertia > 0.0:
        inertia = about(shown.inertia, SURE_MOTION, "kg" if drive.is_slider else "kg m^2")
        raw["mass" if drive.is_slider else "inertia"] = inertia
    if shown is not None and shown.damping > 0.0:
        raw["damping"] = about(shown.damping, SURE_MOTION, "kg/s" if drive.is_slider else "N m s")
    raw["friction"] = _drive_friction(drive, unit)
    if drive.effort is None:
        force = drive.tension * drive.lever
        nominal = within(0.0 if drive.is_pair else drive.winding * force, 0.5 * force, unit)
        raw["nominal_force"] = Guess(nominal, "forces: no column has them")
    return raw


def _drive_friction(drive: FoundDrive, unit: str) -> object:
    """Return the friction of a drive: what grows with the load, where the logs show that; else
    equal parts that are constant, grow in the drive, and grow along the path.
    """
    friction = drive.friction
    if friction is None:
        constant = about(0.05 * drive.tension * drive.lever, 0.7, unit)
        return Guess({"constant": constant, "load": within(0.06, 0.04)}, "friction of drives")
    usual = friction.usual
    share = friction.share
    if share > 0.0:
        constant = about(max(usual - share * drive.load, SURE_MOTION * usual), 1.0, unit)
        std = max(2.0 * friction.share_std, SURE_MOTION * share)
        return {"constant": constant, "load": within(share, std)}
    part = usual / PARTS
    return {"constant": about(part, 1.0, unit), "load": about(part / drive.load, 1.0)}


def raw_tendons(drive: FoundDrive, joints: Joints) -> list[Raw]:
    """Return the tendons of a drive over the joints that it moves."""
    structure = drive.structure
    stiffness = about(drive.stiffness / 1e3, drive.stiffness_std or 0.6, "N/mm")
    guess = Guess(stiffness, "stiffness of tendons")
    raw: Raw = {"stiffness": stiffness if drive.stiffness_std else guess}
    if drive.stiffening > 0.0:
        share = max(2.0 * abs(structure.curvature_std / structure.curvature), SURE_MOTION)
        raw["stiffening"] = about(drive.stiffening, share, "1/m")
    raw |= _start(drive) | _path(drive)
    tendons = []
    for side in (1, -1) if drive.is_pair else (1,):
        crossings = [
            {
                "joint": joints[j].name,
                "kind": "pulley",
                "radius": about(1e3 * abs(arm), share, "mm"),
                "side": side * (1 if arm > 0.0 else -1),
            }
            for j, arm, share in zip(structure.joints, drive.arms, drive.arm_stds)
        ]
        name = f"{drive.name}_{'plus' if side > 0 else 'minus'}" if drive.is_pair else drive.name
        of_drive = {"name": name, "drive": drive.name, "side": side * drive.winding}
        tendons.append({**of_drive, "crossings": crossings, **raw})
    return tendons


def _path(drive: FoundDrive) -> Raw:
    """Return the friction along a path; none where the logs show that of the drive by its load,
    from which it cannot be told.
    """
    friction = within(0.1, 0.08)
    if drive.friction is not None:
        if drive.friction.share > 0.0:
            return {}
        friction = about(drive.friction.usual / PARTS / drive.load / WRAP, 1.0)
    guess = {"friction": friction, "wrap": number(degrees(WRAP), "deg")}
    return {"path": Guess(guess, "friction along the paths")}


def _start(drive: FoundDrive) -> Raw:
    """Return the pre-tension of a tendon, or its slack, at zero angles and zero position."""
    # zeros that differ from log to log are another pre-tension in each
    spread = drive.zero_spread * drive.stiffness
    if drive.friction is None or drive.is_pair:
        spread = max(spread, 0.4 * drive.pretension, 0.3 * drive.tension)
    else:
        spread = max(2.0 * spread, 0.2 * drive.pretension, 0.1 * drive.tension)
    if drive.slack <= 0.0:
        return {"pretension": within(drive.pretension, spread, "N")}
    std = max(0.3 * drive.slack, spread / drive.stiffness)
    return {"slack": within(1e3 * drive.slack, 1e3 * std, "mm")}


def raw_joint(
    j: int,
    joint: FoundJoint,
    drives: Drives,
    logs: Logs,
) -> Raw:
    """Return a joint.

    Args:
        j: index of the joint.
        joint: its column.
        drives: all of them.
        logs: all of them.
    """
    pulls = pulls_of(j, drives)
    balance = joint_balance(j, joint.noise, pulls, logs)
    raw: Raw = {"name": joint.name, "parent": "base", **_dynamics(balance)}
    if joint.follows is not None:
        return raw | {"coupled": {"joint": joint.follows, "ratio": number(joint.ratio)}}
    angles = [log.angles[np.isfinite(log.angles[:, j]), j] for log in logs]
    first = np.degrees(np.concatenate([each[:1] for each in angles]))
    scatter = float(np.std(first, ddof=1)) if len(first) > 1 else 0.0
    raw["initial"] = within(float(np.mean(first)), max(THRESHOLDS.start_std, scatter), "deg")
    every = np.concatenate(angles)
    low = float(every.min())
    high = float(every.max())
    raw["friction"] = _joint_friction(pulls, balance)
    raw |= _stops(low, high, *joint_stops(j, drives, logs))
    if not pulled_both_ways(pulls):
        raw["spring"] = _spring(low, high, pulls, balance)
    elif balance.has_spring:
        # tendons that stiffen look like one too
        rest = degrees(-balance.offset / balance.stiffness)
        raw["spring"] = {
            "stiffness": about(balance.stiffness, 1.0, "N m/rad"),
            "rest_angle": within(rest, max(SURE_MOTION * abs(rest), 5.0), "deg"),
        }
    return raw


def _stops(low: float, high: float, lower: float, upper: float) -> Raw:
    """Return the stops of a joint whose angles are from `low` to `high`; where the logs show one,
    the other, which is infinite, is far beyond them.
    """
    if lower == -inf and upper == inf:
        return {}
    ends = (max(lower, low - NO_STOP), min(upper, high + NO_STOP))
    stop_angles: object = [number(degrees(angle), "deg") for angle in ends]
    if lower == -inf or upper == inf:
        which = "lower" if lower == -inf else "upper"
        stop_angles = Guess(stop_angles, f"the {which} stop of a joint")
    return {"stops": stop_angles, "stops_std": "0.5 deg"}


def _joint_friction(pulls: Pulls, balance: JointBalance) -> object:
    """Return the friction of a joint on its axle. Tendons press it there; the preload is what else
    does, such as a spring.
    """
    if not pulled_both_ways(pulls):
        tension = median(drive.tension for drive, _ in pulls)
        preload = about(tension, 0.6, "N")
        guess = {"coefficient": within(0.1, 0.08), "radius": "3 mm", "preload": preload}
        return Guess(guess, "friction of joints")
    friction: Raw = {
        "coefficient": within(0.2, 0.1),
        "radius": number(AXLE, "mm"),
        "preload": within(1.0, 1.0, "N"),
    }
    if balance.friction == 0.0:
        return Guess(friction, "friction of joints")
    load = sum(drive.load / drive.lever for drive, _ in pulls)
    coefficient = about(balance.friction / (1e-3 * AXLE * load), SURE_MOTION)
    return friction | {"coefficient": coefficient}


def _dynamics(balance: JointBalance) -> Raw:
    """Return inertia and damping of a joint, as the logs show them or as guesses."""
    raw: Raw = {
        "inertia": ASSUMED.inertia,
        "damping": Guess(about(2e-4, 0.8, "N m s"), "damping of joints"),
    }
    if balance.inertia > 0.0:
        raw["inertia"] = about(balance.inertia, 1.0, "kg m^2")
    elif balance.most_inertia < to_si(ASSUMED.inertia.value, "kg m^2"):
        raw["inertia"] = about(balance.most_inertia / 2.0, 1.0, "kg m^2")
    if balance.damping > 0.0:
        raw["damping"] = about(balance.damping, 1.0, "N m s")
    return raw


def _spring(
    low: float,
    high: float,
    pulls: Pulls,
    balance: JointBalance,
) -> object:
    """Return the spring of a joint that tendons pull one way only, over angles from `low` to
    `high`.
    """
    side = 1.0 if pulls[0][1] > 0.0 else -1.0
    nearest, farthest = (low, high) if side > 0.0 else (high, low)
    if balance.stiffness > 0.0:
        rest = -balance.offset / balance.stiffness
        if side * (nearest - rest) > 0.0:
            spread = max(SURE_MOTION * abs(degrees(nearest - rest)), 5.0)
            return {
                "stiffness": about(balance.stiffness, 0.4, "N m/rad"),
                "rest_angle": within(degrees(rest), spread, "deg"),
            }
    tension = median(drive.tension for drive, _ in pulls)
    rest = nearest - side * ASSUMED.spring_below
    stiffness = abs(pulls[0][1]) * tension / max(abs(farthest - rest), 0.1)
    guess = {
        "stiffness": about(stiffness, 0.6, "N m/rad"),
        "rest_angle": within(degrees(rest), 15.0, "deg"),
    }
    return Guess(guess, "springs that bring joints back")


def drive_sensors(drive: FoundDrive, rates: Mapping[str, float]) -> list[Raw]:
    """Return the sensors of a drive; `rates` are the columns' samples per second [Hz]."""
    column = drive.position
    position = _sensor(drive.name, "position", column)
    if column.si == "count":
        counts = counts_of(column)
        is_seen = column.values.turn is not None
        position["counts_per_turn"] = counts if is_seen else Guess(counts, "counts of encoders")
    if drive.gear != 1.0:
        position["gear"] = Guess(drive.gear, "gears of motors")
    position |= {"sign": drive.position_sign, **_errors(column, rates)}
    if drive.is_pair:
        spread = max(drive.structure.zero_spread / drive.gear, THRESHOLDS.zero_std)
        position["bias"] = within(drive.structure.zero / drive.gear, spread, "rad")
    effort = drive.effort
    if effort is None:
        return [position]
    force = _sensor(drive.name, "force", effort)
    if effort.si == "A":
        constant = number(drive.torque_constant, "N m/A")
        force["torque_constant"] = Guess(constant, "forces: torque constants")
    elif effort.si == "N" and not drive.is_slider:
        force["lever"] = Guess(number(1e3 * drive.lever, "mm"), "lengths: levers of load cells")
    return [position, force | {"sign": drive.effort_sign, **_errors(effort, rates)}]


def reference(joint: FoundJoint, rates: Mapping[str, float]) -> Raw:
    """Return the reference sensor of a joint, whose zero is that of the joint: no log tells
    another; `rates` are the columns' samples per second [Hz].
    """
    column = joint.angle
    sensor = _sensor(joint.name, "angle", column) | {"name": f"{joint.name}_reference"}
    errors = _errors(column, rates)
    return sensor | {"rate": errors["rate"], "noise": errors["noise"]}


def _sensor(of: str, measures: str, column: ColumnRole) -> Raw:
    where = {"column": column_of(column), "unit": column.unit}
    return {"name": f"{of}_{measures}", "measures": measures, "of": of, **where}


def _errors(column: ColumnRole, rates: Mapping[str, float]) -> Raw:
    """Return rate, noise and resolution of a column. Noise is at least that of its steps; of one
    that stays at a value for longer than noise lets it, the noise is its resolution.
    """
    values = column.values
    noise = max(values.noise, 0.3 * values.step, 1e-6 * values.width)
    errors: Raw = {"rate": number(rates[column.header]), "noise": number(noise, column.unit)}
    step = values.step
    # the chance that readings with this noise are alike, see `logs.raw_to_si`
    if noise > step and (step / (2.0 * pi**0.5 * noise)) ** (values.stays - 1) < IMPROBABLE:
        step = noise
    if step > 0.0 and column.si != "count":
        errors["resolution"] = number(step, column.unit)
    return errors
