"""The raw descriptions of drives, tendons, joints and sensors, as a rig file has them; what no log
tells is a `Guess`.
"""

from __future__ import annotations

from math import degrees, inf, pi

import numpy as np

from distal.from_logs.column_names import ColumnRole
from distal.from_logs.drive_and_tendon_sizes import (
    FoundDrive,
    FoundJoint,
    Joints,
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
    inertia = "inertia"
    unit_of_inertia = "kg m^2"
    unit_of_damping = "N m s"
    if drive.is_slider:
        inertia = "mass"
        unit_of_inertia = "kg"
        unit_of_damping = "kg/s"
        raw["mass"] = Guess("20 g", "masses of drives")
    else:
        raw["inertia"] = ASSUMED.motor_inertia
        raw["radius"] = Guess(number(1e3 * ASSUMED.radius, "mm"), "lengths: radii of spools")
        raw["damping"] = ASSUMED.motor_damping
    shown = drive.friction
    if shown is not None and shown.inertia > 0.0:
        raw[inertia] = about(shown.inertia, SURE_MOTION, unit_of_inertia)
    if shown is not None and shown.damping > 0.0:
        raw["damping"] = about(shown.damping, SURE_MOTION, unit_of_damping)
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
    coulomb = usual / PARTS
    load = about(coulomb / drive.load, 1.0)
    if share > 0.0:
        coulomb = max(usual - share * drive.load, SURE_MOTION * usual)
        load = within(share, max(2.0 * friction.share_std, SURE_MOTION * share))
    return {"constant": about(coulomb, 1.0, unit), "load": load}


def raw_tendons(drive: FoundDrive, joints: Joints) -> list[Raw]:
    """Return the tendons of a drive over the joints that it moves."""
    structure = drive.structure
    raw: Raw = {"stiffness": about(drive.stiffness / 1e3, drive.stiffness_std or 0.6, "N/mm")}
    if not drive.stiffness_std:
        raw["stiffness"] = Guess(raw["stiffness"], "stiffness of tendons")
    if drive.stiffening > 0.0:
        share = max(2.0 * abs(structure.curvature_std / structure.curvature), SURE_MOTION)
        raw["stiffening"] = about(drive.stiffening, share, "1/m")
    raw |= _start(drive)
    if drive.friction is None or drive.friction.share == 0.0:
        # along a path it cannot be told from that of the drive by its load, where logs show this
        raw["path"] = Guess(_path(drive), "friction along the paths")
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
    """Return a guess of the friction along a path."""
    friction = within(0.1, 0.08)
    if drive.friction is not None:
        friction = about(drive.friction.usual / PARTS / drive.load / WRAP, 1.0)
    return {"friction": friction, "wrap": number(degrees(WRAP), "deg")}


def _start(drive: FoundDrive) -> Raw:
    """Return the pre-tension of a tendon, or its slack, at zero angles and zero position."""
    # zeros that differ from log to log are another pre-tension in each
    factors = (1.0, 0.4, 0.3) if drive.friction is None or drive.is_pair else (2.0, 0.2, 0.1)
    spreads = (drive.zero_spread * drive.stiffness, drive.pretension, drive.tension)
    spread = max(factor * size for factor, size in zip(factors, spreads))
    if drive.slack <= 0.0:
        return {"pretension": within(drive.pretension, spread, "N")}
    std = max(0.3 * drive.slack, spread / drive.stiffness)
    return {"slack": within(1e3 * drive.slack, 1e3 * std, "mm")}


def raw_joint(joint: FoundJoint, logs: Logs) -> Raw:
    """Return a joint."""
    balance = joint_balance(joint, logs)
    raw: Raw = {"name": joint.name, "parent": "base", **_dynamics(balance)}
    if joint.follows is not None:
        return raw | {"coupled": {"joint": joint.follows.name, "ratio": number(joint.ratio)}}
    columns = [log.angles[:, joint.index] for log in logs]
    angles = [column[np.isfinite(column)] for column in columns]
    first = np.degrees(np.concatenate([of_log[:1] for of_log in angles]))
    scatter = float(np.std(first, ddof=1)) if len(first) > 1 else 0.0
    raw["initial"] = within(float(np.mean(first)), max(THRESHOLDS.start_std, scatter), "deg")
    low, high = np.quantile(np.concatenate(angles), [0.0, 1.0]).tolist()
    raw["friction"] = _joint_friction(joint, balance)
    raw |= _stops(low, high, *joint_stops(joint, logs))
    if not joint.is_pulled_both_ways:
        raw["spring"] = _needed_spring(low, high, joint, balance)
    elif balance.has_spring:
        # tendons that stiffen look like one too
        raw["spring"] = _spring(balance, 1.0, 0.0)
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


def _joint_friction(joint: FoundJoint, balance: JointBalance) -> object:
    """Return the friction of a joint on its axle. Tendons press it there; the preload is what else
    does, such as a spring.
    """
    is_shown = balance.friction > 0.0 and joint.is_pulled_both_ways
    coefficient = within(0.2, 0.1)
    radius = number(AXLE, "mm")
    preload = within(1.0, 1.0, "N")
    if is_shown:
        load = sum(drive.load / drive.lever for drive, _ in joint.pulls)
        coefficient = about(balance.friction / (1e-3 * AXLE * load), SURE_MOTION)
    elif not joint.is_pulled_both_ways:
        coefficient = within(0.1, 0.08)
        radius = "3 mm"
        preload = about(joint.tension, 0.6, "N")
    friction = {"coefficient": coefficient, "radius": radius, "preload": preload}
    return friction if is_shown else Guess(friction, "friction of joints")


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


def _spring(balance: JointBalance, share: float, nearest: float) -> Raw:
    """Return the spring that logs show, with the std of its stiffness as a share; that of its rest
    angle is by how far this is from the `nearest` angle.
    """
    spread = max(SURE_MOTION * degrees(abs(nearest - balance.rest)), 5.0)
    return {
        "stiffness": about(balance.stiffness, share, "N m/rad"),
        "rest_angle": within(degrees(balance.rest), spread, "deg"),
    }


def _needed_spring(low: float, high: float, joint: FoundJoint, balance: JointBalance) -> object:
    """Return the spring of a joint that tendons pull one way only, over angles from `low` to
    `high`.
    """
    arm = joint.pulls[0][1]
    side = 1.0 if arm > 0.0 else -1.0
    nearest, farthest = (low, high) if side > 0.0 else (high, low)
    if balance.stiffness > 0.0 and side * (nearest - balance.rest) > 0.0:
        return _spring(balance, 0.4, nearest)
    rest = nearest - side * ASSUMED.spring_below
    stiffness = abs(arm) * joint.tension / max(abs(farthest - rest), 0.1)
    guess = {
        "stiffness": about(stiffness, 0.6, "N m/rad"),
        "rest_angle": within(degrees(rest), 15.0, "deg"),
    }
    return Guess(guess, "springs that bring joints back")


def drive_sensors(drive: FoundDrive) -> list[Raw]:
    """Return the sensors of a drive."""
    column = drive.position
    position = _sensor(drive.name, "position", column)
    if column.si == "count":
        counts = counts_of(column)
        is_seen = column.values.turn is not None
        position["counts_per_turn"] = counts if is_seen else Guess(counts, "counts of encoders")
    if drive.gear != 1.0:
        position["gear"] = Guess(drive.gear, "gears of motors")
    position |= {"sign": drive.position_sign, **_errors(column)}
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
    return [position, force | {"sign": drive.effort_sign, **_errors(effort)}]


def reference(joint: FoundJoint) -> Raw:
    """Return the reference sensor of a joint, whose zero is that of the joint: no log tells
    another.
    """
    sensor = _sensor(joint.name, "angle", joint.angle) | {"name": f"{joint.name}_reference"}
    errors = _errors(joint.angle)
    errors.pop("resolution", None)
    return sensor | errors


def _sensor(of: str, measures: str, column: ColumnRole) -> Raw:
    where = {"column": column_of(column), "unit": column.unit}
    return {"name": f"{of}_{measures}", "measures": measures, "of": of, **where}


def _errors(column: ColumnRole) -> Raw:
    """Return rate, noise and resolution of a column. Noise is at least that of its steps; of one
    that stays at a value for longer than noise lets it, the noise is its resolution.
    """
    values = column.values
    noise = max(values.noise, 0.3 * values.step, 1e-6 * values.width)
    errors: Raw = {"rate": number(column.rate), "noise": number(noise, column.unit)}
    step = values.step
    # the chance that readings with this noise are alike, see `logs.raw_to_si`
    if noise > step and (step / (2.0 * pi**0.5 * noise)) ** (values.stays - 1) < IMPROBABLE:
        step = noise
    if step > 0.0 and column.si != "count":
        errors["resolution"] = number(step, column.unit)
    return errors
