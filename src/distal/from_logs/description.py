"""The raw description of a rig from columns, structure and sizes, each guess marked."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from math import degrees

import numpy as np

from distal.from_logs.column_role import ColumnRole
from distal.from_logs.column_units import TAKEN_FORCES
from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulls_of
from distal.from_logs.joint_balance import JointBalance, joint_balance
from distal.from_logs.motion_data import MotionData, counts_of
from distal.from_logs.sizes import ASSUMED_RADIUS, DriveSizes
from distal.from_logs.stops import joint_stops
from distal.logs import name_and_unit
from distal.rig import Guess

Raw = dict[str, object]

SURE_START = 3.0
"""Logs that begin at one angle do so within this [deg]. Source: judgement."""

SCATTER = 0.5
"""Standard deviation of the first angle per range of the logs' first angles. Source: judgement."""

SPREAD = 0.2
"""Standard deviation of a spring's rest angle per distance from the logs' angles. Source:
judgement.
"""

SURE_ZERO = 0.01
"""Least standard deviation of the zero of a drive with two tendons [rad]. Source: judgement."""

SMALLEST_INERTIA = 1e-7
"""Inertia of a joint below which the logs do not show it [kg m²]. Source: judgement."""

SMALLEST_DAMPING = 1e-6
"""Damping of a joint below which the logs do not show it [N m s/rad]. Source: judgement."""

ZERO_OF_REFERENCE = "0.1 deg"
"""How well a temporary encoder or a camera is aligned: no log shows that. Source: judgement."""

RESTING = 20
"""Samples in a row with one value, from which on a sensor is quantised [1]. Source: judgement."""

ABOVE_NOISE = 1.1
"""Least step of such a sensor per its noise [1]. Source: judgement."""

BEFORE_START = 0.3
"""A spring rests so far before the range of its joint [rad]. Source: judgement."""


def raw_description(
    title: str,
    time: ColumnRole,
    time_unit: str,
    rates: Mapping[str, float],
    joints: Sequence[FoundJoint],
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
) -> Raw:
    """Return the description of a rig; what no log tells is a `Guess` with a wide std.

    Args:
        title: name of the rig.
        time: its column.
        time_unit: of that.
        rates: header of a column → its samples per second [Hz].
        joints: in the order of their columns.
        drives: the same.
        logs: all of them.
    """
    taken = []
    if any(not drive.sizes.is_slider for drive in drives):
        taken.append("length")
    if not all(_knows_force(drive.effort) for drive in drives):
        taken.append("force")
    tension = float(np.median([drive.sizes.tension for drive in drives]))
    return {
        "name": title,
        "taken": taken,
        "log": {"time": {"column": column_of(time), "unit": time_unit}},
        "joints": [_joint(j, joint, drives, logs, tension) for j, joint in enumerate(joints)],
        "drives": [_drive(drive) for drive in drives],
        "tendons": [tendon for drive in drives for tendon in _tendons(drive, joints)],
        "sensors": [
            *(sensor for drive in drives for sensor in _drive_sensors(drive, rates)),
            *(_reference(joint, rates) for joint in joints),
        ],
    }


def _knows_force(effort: ColumnRole | None) -> bool:
    """Return whether a column is a force or a torque of a true scale."""
    return effort is not None and effort.si != "A" and effort.unit not in TAKEN_FORCES.values()


def column_of(column: ColumnRole) -> str:
    """Return a column as a rig file names it: a unit in square brackets is the log's own."""
    return name_and_unit(column.header)[0]


def _number(value: float, unit: str = "") -> object:
    return f"{value:.5g} {unit}" if unit else float(f"{value:.5g}")


def _about(value: float, share: float, unit: str = "") -> Raw:
    return {"value": _number(value, unit), "std": f"{100 * share:.2g} %"}


def _joint(
    j: int,
    joint: FoundJoint,
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
    tension: float,
) -> Raw:
    balance = joint_balance(j, pulls_of(j, drives), logs)
    raw: Raw = {"name": joint.name, "parent": "base", **_dynamics(balance)}
    if joint.follows is not None:
        return raw | {"coupled": {"joint": joint.follows, "ratio": _number(joint.ratio)}}
    raw["initial"] = _initial(j, logs)
    raw["friction"] = Guess(
        {
            "coefficient": {"value": 0.1, "std": 0.08},
            "radius": "3 mm",
            "preload": {"value": _number(tension, "N"), "std": "60 %"},
        },
        "friction of joints",
    )
    stops = joint_stops(j, drives, logs)
    if stops is not None:
        raw["stops"] = [_number(degrees(angle), "deg") for angle in stops]
        raw["stops_std"] = "0.5 deg"
    spring = _spring(j, drives, logs, balance)
    return raw if spring is None else raw | {"spring": spring}


def _initial(j: int, logs: Sequence[MotionData]) -> Raw:
    """Return where logs begin, with how much that differs from log to log."""
    firsts = [log.angles[np.isfinite(log.angles[:, j]), j][:1] for log in logs]
    angles = np.degrees(np.concatenate(firsts))
    return {
        "value": _number(float(np.mean(angles)), "deg"),
        "std": _number(max(SURE_START, SCATTER * float(np.ptp(angles))), "deg"),
    }


def _dynamics(balance: JointBalance | None) -> Raw:
    """Return inertia and damping of a joint, as the logs show them or as guesses."""
    raw: Raw = {
        "inertia": Guess("1e-5 kg m^2", "inertia of joints"),
        "damping": Guess({"value": "2e-4 N m s", "std": "80 %"}, "damping of joints"),
    }
    if balance is not None and balance.inertia > SMALLEST_INERTIA:
        raw["inertia"] = _about(balance.inertia, 1.0, "kg m^2")
    if balance is not None and balance.damping > SMALLEST_DAMPING:
        raw["damping"] = _about(balance.damping, 1.0, "N m s")
    return raw


def _spring(
    j: int,
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
    balance: JointBalance | None,
) -> object:
    """Return the spring of a joint; None where the tendons need none."""
    pulls = pulls_of(j, drives)
    sides = [arm for drive, arm in pulls if not drive.sizes.is_pair]
    pulls_one_way = len(sides) == len(pulls) and len({arm > 0.0 for arm in sides}) == 1
    angles = np.concatenate([log.angles[:, j] for log in logs])
    low = float(np.nanmin(angles))
    high = float(np.nanmax(angles))
    side = 1.0 if pulls[0][1] > 0.0 else -1.0
    nearest, farthest = (low, high) if side > 0.0 else (high, low)
    if balance is not None and balance.stiffness > 0.0:
        rest_angle = -balance.offset / balance.stiffness
        holds = side * (nearest - rest_angle) > 0.0
        if holds or not pulls_one_way:
            spread = max(SPREAD * abs(degrees(nearest - rest_angle)), 5.0)
            angle = {"value": _number(degrees(rest_angle), "deg"), "std": _number(spread, "deg")}
            return {"stiffness": _about(balance.stiffness, 0.4, "N m/rad"), "rest_angle": angle}
    if not pulls_one_way:
        return None
    tension = float(np.median([drive.sizes.tension for drive, _ in pulls]))
    rest_angle = nearest - side * BEFORE_START
    stiffness = abs(pulls[0][1]) * tension / max(abs(farthest - rest_angle), 0.1)
    guess = {
        "stiffness": _about(stiffness, 0.6, "N m/rad"),
        "rest_angle": {"value": _number(degrees(rest_angle), "deg"), "std": "15 deg"},
    }
    return Guess(guess, "springs that bring joints back")


def _drive(drive: FoundDrive) -> Raw:
    sizes = drive.sizes
    unit = "N" if sizes.is_slider else "N m"
    force = sizes.tension * sizes.lever
    angles = np.isfinite(sizes.friction)
    constant = {
        "value": _number(sizes.friction if angles else 0.05 * force, unit),
        "std": "70 %",
    }
    raw: Raw = {"name": drive.name, "kind": "slider" if sizes.is_slider else "capstan"}
    if sizes.is_slider:
        raw["mass"] = Guess("20 g", "masses of drives")
    else:
        raw["inertia"] = Guess("2e-4 kg m^2", "inertia of motors")
        raw["radius"] = Guess(_number(1e3 * ASSUMED_RADIUS, "mm"), "lengths: radii of spools")
    per_speed = "kg/s" if sizes.is_slider else "N m s"
    if sizes.damping > 0.0:
        raw["damping"] = _about(sizes.damping, 1.0, per_speed)
    elif not sizes.is_slider:
        raw["damping"] = Guess("1e-3 N m s", "damping of motors")
    friction: Raw = {"constant": constant, "load": {"value": 0.06, "std": 0.04}}
    raw["friction"] = friction if angles else Guess(friction, "friction of drives")
    if drive.effort is None:
        side = 0.0 if sizes.is_pair else sizes.winding
        nominal = {"value": _number(side * force, unit), "std": _number(0.5 * force, unit)}
        raw["nominal_force"] = Guess(nominal, "forces: no column has them")
    return raw


def _tendons(drive: FoundDrive, joints: Sequence[FoundJoint]) -> list[Raw]:
    sizes = drive.sizes
    stiffness: object = _about(
        sizes.stiffness / 1e3, sizes.stiffness_std if sizes.stiffness_std > 0 else 0.4, "N/mm"
    )
    if not np.isfinite(sizes.stiffness_std):
        stiffness = Guess(_about(sizes.stiffness / 1e3, 0.6, "N/mm"), "stiffness of tendons")
    sides = (1, -1) if sizes.is_pair else (1,)
    tendons = []
    for side in sides:
        crossings = [
            {
                "joint": joints[j].name,
                "kind": "pulley",
                "radius": _about(1e3 * abs(arm), float(share), "mm"),
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
    spread = max(0.4 * sizes.pretension, 0.3 * sizes.tension)
    if sizes.slack <= 0.0:
        std = _number(spread, "N")
        return {"pretension": {"value": _number(sizes.pretension, "N"), "std": std}}
    std = _number(1e3 * max(0.3 * sizes.slack, spread / sizes.stiffness), "mm")
    return {"slack": {"value": _number(1e3 * sizes.slack, "mm"), "std": std}}


def _drive_sensors(drive: FoundDrive, rates: Mapping[str, float]) -> list[Raw]:
    sizes = drive.sizes
    column = drive.position
    position: Raw = {
        "name": f"{drive.name}_position",
        "measures": "position",
        "of": drive.name,
        "column": column_of(column),
        "unit": column.unit,
    }
    if column.si == "count":
        counts = counts_of(column)
        is_seen = column.values.turn is not None
        position["counts_per_turn"] = counts if is_seen else Guess(counts, "counts of encoders")
    if sizes.gear != 1.0:
        position["gear"] = Guess(sizes.gear, "gears of motors")
    position |= {
        "sign": sizes.position_sign,
        "rate": _number(rates[column.header]),
        **_errors(column),
    }
    if sizes.is_pair:
        position["bias"] = {
            "value": _number(drive.structure.zero / sizes.gear, "rad"),
            "std": _number(max(drive.structure.zero_spread / sizes.gear, SURE_ZERO), "rad"),
        }
    if drive.effort is None:
        return [position]
    effort = drive.effort
    force: Raw = {
        "name": f"{drive.name}_force",
        "measures": "force",
        "of": drive.name,
        "column": column_of(effort),
        "unit": effort.unit,
    }
    if effort.si == "A":
        constant = _number(sizes.torque_constant, "N m/A")
        force["torque_constant"] = Guess(constant, "forces: torque constants")
    elif effort.si == "N" and not sizes.is_slider:
        force["lever"] = Guess(_number(1e3 * sizes.lever, "mm"), "lengths: levers of load cells")
    force |= {
        "sign": sizes.effort_sign,
        "rate": _number(rates[effort.header]),
        **_errors(effort),
    }
    return [position, force]


def _errors(column: ColumnRole) -> Raw:
    """Return noise and resolution of a column; one that stays at a value has steps above its
    noise, so that nobody takes it for a dead sensor.
    """
    errors: Raw = {"noise": _noise(column)}
    step = column.values.step
    if column.values.stays >= RESTING:
        step = max(step, ABOVE_NOISE * column.values.noise)
    if step > 0.0 and column.si != "count":
        errors["resolution"] = _number(step, column.unit)
    return errors


def _noise(column: ColumnRole) -> object:
    """Return the noise of a column in its unit, at least that of its steps."""
    noise = max(column.values.noise, 0.3 * column.values.step, 1e-6 * column.values.width)
    return _number(noise, "count" if column.si == "count" else column.unit)


def _reference(joint: FoundJoint, rates: Mapping[str, float]) -> Raw:
    return {
        "name": f"{joint.name}_reference",
        "measures": "angle",
        "of": joint.name,
        "column": column_of(joint.angle),
        "unit": joint.angle.unit,
        "rate": _number(rates[joint.angle.header]),
        "noise": _noise(joint.angle),
        "bias": Guess({"value": 0.0, "std": ZERO_OF_REFERENCE}, "zeros of references"),
    }
