"""The rig of a hand from the rows of its table."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees, radians

from distal.errors import RigError
from distal.rig.files import Guess, Imported, name_of
from distal.rig.hand_tables import assumed_values_of_hands as guess
from distal.rig.hand_tables.row import Row

Raw = dict[str, object]

NARROWEST = radians(7.0)
"""Some joint of a hand has a wider range than this [rad]; if none has, radians were read as
degrees, since a whole turn of 2π would be 6.3°. Source: definition (a whole turn in radians).
"""


def hand_of(rows: Sequence[Row], title: str, source: str, notes: Sequence[str] = ()) -> Imported:
    """Return the rig of a hand; what its rows do not say is a guess with a std, and is listed.

    Each joint sits on the base, without a link, so that no weight of one acts on another. A motor
    of one joint whose row has `back` = "tendon" has two tendons on its spool, which may be slack.
    Any other motor has one tendon over all of its joints, and springs bring these back.

    Raises:
        RigError: no joint has a motor, or rows contradict each other.
    """
    joints = dict[str, list[Row]]()
    motors = dict[str, list[Row]]()
    for row in rows:
        joints.setdefault(_name(row.joint, "joint"), []).append(row)
        if row.motor is not None:
            motors.setdefault(_name(row.motor, "motor"), []).append(row)
    if not motors:
        raise RigError(f"{title}: no joint has a motor")
    widest = max(row.high - row.low for row in rows)
    if widest < NARROWEST:
        raise RigError(
            f"{title}: no joint turns by more than {degrees(widest):.3g}°; are the ranges in "
            "radians, which were read as degrees?"
        )
    times = {row.time_column for row in rows if row.time_column is not None}
    if len(times) > 1:
        raise RigError(f"{title}: logs have one column of time, {', '.join(sorted(times))} came")
    for name, same in joints.items():
        if len({(row.low, row.high, row.range_std, row.follows) for row in same}) > 1:
            raise RigError(
                f"{title}: '{name}' has several lines with different ranges, or joints that it "
                "follows"
            )
    for name, same in motors.items():
        if len({(row.spool_radius, row.unit, row.counts, row.torque_constant) for row in same}) > 1:
            raise RigError(
                f"{title}: motor '{name}' has several lines with different spools, units or "
                "constants"
            )
        if len({row.joint for row in same}) < len(same):
            raise RigError(f"{title}: motor '{name}' has two lines for one joint")
        if len(same) > 1 and all(row.back == "tendon" for row in same):
            joints_of = ", ".join(row.joint for row in same)
            raise RigError(
                f"{title}: motor '{name}' has several joints ({joints_of}): give each a motor, or "
                "'spring' in 'back'"
            )
    raw: Raw = {
        "name": title,
        "log": {"time": _time(next(iter(times), "time"))},
        "joints": [_joint(name, same) for name, same in joints.items()],
        "drives": [_drive(name, same) for name, same in motors.items()],
        "tendons": [tendon for name, same in motors.items() for tendon in _tendons(name, same)],
        "sensors": [
            *(sensor for name, same in motors.items() for sensor in _sensors(name, same)),
            *(_encoder(name) for name in joints),
        ],
    }
    return Imported.of(raw, title, source, tuple(notes))


def _time(column: str) -> Raw:
    """Return the time column of a log; its unit stands in brackets behind its name."""
    name, _, unit = column.rstrip(" ])").partition(" [")
    return {"column": name, "unit": unit or "s"}


def position_of(motor: str) -> str:
    """Return the column of a motor's angle in a log, by the name of its drive."""
    return f"{motor}_position"


def current_of(motor: str) -> str:
    """Return the column of a motor's current in a log, by the name of its drive."""
    return f"{motor}_current"


def in_degrees(angle: float) -> str:
    """Return an `angle` [rad] as text in degrees, as a rig file has it."""
    return f"{round(degrees(angle), 6) + 0.0:.8g} deg"


def _name(name: str, kind: str) -> str:
    return name_of(f"{kind}_{name}" if name[:1].isdigit() else name, kind)


def _joint(name: str, rows: Sequence[Row]) -> Raw:
    row = rows[0]
    raw: Raw = {"name": name, "parent": "base", "inertia": guess.INERTIA, "damping": guess.DAMPING}
    if row.follows is not None:
        return raw | {"coupled": {"joint": _name(row.follows, "joint"), "ratio": row.ratio}}
    raw |= {
        "initial": guess.initial_angle(row.low, row.high),
        "friction": guess.JOINT_FRICTION,
        "stops": [in_degrees(row.low), in_degrees(row.high)],
        "stops_std": guess.RANGE_STD if row.range_std is None else in_degrees(row.range_std),
    }
    if all(other.back == "spring" for other in rows):
        raw["spring"] = {
            "stiffness": guess.spring(max(row.joint_radius or guess.USUAL_RADIUS for row in rows)),
            "rest_angle": guess.rest_angle(row.low),
        }
    return raw


def _drive(name: str, rows: Sequence[Row]) -> Raw:
    row = rows[0]
    arm = row.joint_radius
    spool = row.spool_radius
    is_identified = arm is not None and spool is not None
    radius = guess.SPOOL_RADIUS.value if spool is None else spool
    share = (
        row.ratio_std
        if row.ratio_std is not None
        else guess.RATIO_STD
        if is_identified
        else guess.UNKNOWN_RATIO_STD
    )
    value: Raw = {"value": radius, "std": f"{100 * share:g} %"}
    return {
        "name": name,
        "kind": "capstan",
        "inertia": guess.MOTOR_INERTIA,
        "radius": value if is_identified else Guess(value, guess.SPOOL_RADIUS.of),
        "damping": guess.MOTOR_DAMPING,
        "friction": guess.MOTOR_FRICTION,
        "servo": guess.SERVO,
    }


def _tendons(motor: str, rows: Sequence[Row]) -> list[Raw]:
    """Return the tendons of a motor: two where a tendon brings its only joint back, else one over
    all of its joints.
    """
    pair = len(rows) == 1 and rows[0].back == "tendon"
    if not pair:
        crossings = [
            {
                "joint": _name(row.joint, "joint"),
                "side": row.direction * _winds(rows),
                "kind": "pulley",
                "radius": _arm(row),
            }
            for row in rows
        ]
        common: Raw = {"damping": guess.TENDON_DAMPING, "slack": guess.LOOSE, "path": guess.PATH}
        stiffness = Guess(
            {"value": guess.STIFFNESS.value, "std": f"{100 * guess.STIFFNESS_STD:g} %"},
            guess.STIFFNESS.of,
        )
        return [
            {
                "name": motor,
                "drive": motor,
                "side": 1,
                "crossings": crossings,
                "stiffness": stiffness,
            }
            | common
        ]
    shared: Raw = {"name": f"stiffness_{motor}", "std": guess.STIFFNESS_STD}
    return [
        {
            "name": f"{motor}_{word}",
            "joint": _name(rows[0].joint, "joint"),
            "drive": motor,
            "side": side,
            "insertion": {"kind": "pulley", "radius": _arm(rows[0])},
            "stiffness": Guess(
                {"value": guess.STIFFNESS.value, "shared": shared}, guess.STIFFNESS.of
            ),
            "damping": guess.TENDON_DAMPING,
            "slack": guess.SLACK,
            "path": guess.PATH,
        }
        for word, side in (("plus", 1), ("minus", -1))
    ]


def _arm(row: Row) -> object:
    return guess.JOINT_RADIUS if row.joint_radius is None else row.joint_radius


def _winds(rows: Sequence[Row]) -> int:
    """Return the sign with which the motor's reading counts as winding its tendon: +1 where some
    joint's angle grows with the reading, else −1.
    """
    return max(row.direction for row in rows)


def _sensors(motor: str, rows: Sequence[Row]) -> list[Raw]:
    row = rows[0]
    unsaid = guess.UNKNOWN_ZERO_STD if row.zero is None else guess.IDENTIFIED_ZERO_STD
    zero_std = (
        Guess(in_degrees(unsaid), guess.ZERO_STD)
        if row.zero_std is None
        else in_degrees(row.zero_std)
    )
    counts = guess.COUNTS.value if row.counts is None else row.counts
    assert isinstance(counts, (int, float))
    logged: Raw = (
        {"unit": row.unit}
        if row.counts is None
        else {"unit": "count", "counts_per_turn": row.counts}
    )
    step: object = f"{360 / counts:.6g} deg"
    position: Raw = {
        "name": position_of(motor),
        "measures": "position",
        "of": motor,
        **logged,
        "sign": _winds(rows),
        "rate": guess.RATE,
        "noise": guess.POSITION_NOISE,
        "resolution": Guess(step, guess.COUNTS.of) if row.counts is None else step,
        "bias": {"value": in_degrees(_winds(rows) * (row.zero or 0.0)), "std": zero_std},
    }
    if row.position_column is not None:
        position["column"] = row.position_column
    current: Raw = {
        "name": current_of(motor),
        "measures": "force",
        "of": motor,
        "unit": "mA",
        "torque_constant": guess.TORQUE_CONSTANT
        if row.torque_constant is None
        else row.torque_constant,
        "sign": _winds(rows),
        "rate": guess.RATE,
        "noise": guess.CURRENT_NOISE,
    }
    if row.current_column is not None:
        current["column"] = row.current_column
    return [position, current]


def _encoder(joint: str) -> Raw:
    return {
        "name": f"encoder_{joint}",
        "measures": "angle",
        "of": joint,
        "unit": "deg",
        "rate": guess.RATE,
        "resolution": Guess(
            "0.1 deg", "encoders of joints, which are for learning and comparing only"
        ),
    }
