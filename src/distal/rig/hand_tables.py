"""The rig of a hand from its table, a spreadsheet's CSV with a line for each joint and what moves
it, and what is assumed where the table says nothing; and rigs of ORCA hands from their own
`config.yaml` and `calibration.yaml`.
"""

from __future__ import annotations

import csv
import importlib
import re
from collections.abc import Mapping, Sequence
from math import degrees, inf, pi, radians
from pathlib import Path
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, BaseModel, BeforeValidator, ConfigDict, Field, model_validator

from distal.errors import RigError, UnitError, did_you_mean
from distal.rig.files import Guess, Imported, name_of, read_text
from distal.rig.validation import Checked, validated
from distal.rig.values_with_stds import AnyRadians, Description, In, Radians, Raw, TorqueConstant
from distal.units import to_si

COUNTED = ("count", "counts")
"""Units of a `zero` that is given in counts of an encoder, with `counts` in one turn."""

_HEADER = re.compile(r"^\s*([A-Za-z_ ]+?)\s*(?:[\[(]\s*(.*?)\s*[\])])?\s*$")


def _sign(raw: object) -> object:
    """Return ±1 for a text of it."""
    return {"1": 1, "+1": 1, "-1": -1}.get(raw, raw) if isinstance(raw, str) else raw


Radius = Annotated[float, In("m", within=(1e-4, 0.5))]


class Row(Description):
    """A joint that a motor's tendon moves, or that follows another; None stands for what is not
    known. Each field is a column of a table.

    Args:
        joint: its name.
        low: end of the joint's range [rad].
        high: the other end [rad].
        motor: name or number of the motor; None for a joint that only `follows` another.
        spool_radius: of the motor [m].
        joint_radius: of the pulley at the joint [m].
        direction: +1 where the joint's angle grows as the motor's reading grows.
        back: whether a second "tendon" on the same spool or a "spring" brings the joint back.
        zero: what the motor reads while the joint is at zero [rad].
        zero_std: std of that reading [rad].
        ratio_std: std of the ratio of both radii, as a share.
        unit: of what the motor reads, "rad" or "deg", where it does not log counts.
        counts: of the encoder in one turn; None for a log in `unit`.
        torque_constant: of the motor [N m/A].
        follows: a joint to which it is coupled rigidly.
        ratio: turns of this joint for one turn of the joint that it follows.
        range_std: std of each end of its range [rad].
        position_column: what the motor's reading is called in logs.
        current_column: what its current is called.
        time_column: what the time is called; one for all.
    """

    joint: str
    low: AnyRadians
    high: AnyRadians
    motor: str | None = None
    spool_radius: Radius | None = None
    joint_radius: Radius | None = None
    direction: Annotated[Literal[1, -1], BeforeValidator(_sign)] = 1
    back: Annotated[Literal["tendon", "spring"], BeforeValidator(str.lower)] = "tendon"
    zero: AnyRadians | None = None
    zero_std: Radians | None = None
    ratio_std: Annotated[float, In("", "nonnegative")] | None = None
    unit: Annotated[Literal["rad", "deg"], BeforeValidator(str.lower)] = "rad"
    counts: Annotated[float, In("", within=(2.0, inf))] | None = None
    torque_constant: TorqueConstant | None = None
    follows: str | None = None
    ratio: Annotated[float, In("")] = 1.0
    range_std: Radians | None = None
    position_column: str | None = None
    current_column: str | None = None
    time_column: str | None = None

    @model_validator(mode="after")
    def _whole(self) -> Self:
        if not -2 * pi <= self.low < self.high <= 2 * pi:
            raise ValueError(
                f"the range of '{self.joint}' must be from a lower to a higher angle within ±360°, "
                f"{self.low:.4g} to {self.high:.4g} rad came; is the unit right?"
            )
        if (self.motor is None) == (self.follows is None):
            raise ValueError(
                f"'{self.joint}' needs a motor, or the joint that it follows, one of both"
            )
        return self


def read_rows(path: Path) -> list[Row]:
    """Return the lines of a table; units stand behind the names of columns or in the cells.

    Raises:
        RigError: the file is no such table; says which line and what is allowed.
    """
    text = enumerate(read_text(path, RigError).splitlines(), 1)
    lines = {i: line for i, line in text if line.strip(" ,;\t") and line.lstrip()[0] != "#"}
    if len(lines) < 2:
        raise RigError(
            f"{path}: a table has a line of names and one for each joint; {len(lines)} came"
        )
    separator = max(",;\t", key=next(iter(lines.values())).count)
    names, *rows = csv.reader(lines.values(), delimiter=separator)
    columns = _header(path, names)
    return [_row(f"{path}: line {i}", columns, row) for i, row in zip([*lines][1:], rows)]


def _header(path: Path, cells: list[str]) -> dict[str, str | None]:
    """Return name → unit of each column."""
    columns: dict[str, str | None] = {}
    for cell in cells:
        match = _HEADER.match(cell)
        name = "" if match is None else match[1].lower().replace(" ", "_")
        if match is None or name not in Row.model_fields:
            raise RigError(
                f"{path}: there is no column '{cell}'{did_you_mean(name, Row.model_fields)}"
            )
        if name in columns:
            raise RigError(f"{path}: two columns are called '{name}'")
        if match[2] is not None and Row.model_fields[name].annotation in (str, str | None):
            raise RigError(f"{path}: column '{name}' holds text, '{match[2]}' is no unit of it")
        columns[name] = match[2]
    return columns


def _row(source: str, units: dict[str, str | None], cells: list[str]) -> Row:
    """Return a line as a row; the `source` begins messages."""
    raw: Raw = {}
    for (name, unit), cell in zip(units.items(), cells):
        text = cell.strip()
        if unit is not None and unit not in COUNTED and re.fullmatch(r"[-+.\deE]+", text):
            text = f"{text} {unit}"
        if text:
            raw[name] = text
    if "zero" in raw and units["zero"] in COUNTED:
        try:
            raw["zero"] = 2 * pi * to_si(raw["zero"], "") / to_si(raw.get("counts"), "")
        except (UnitError, ZeroDivisionError):
            raise RigError(f"{source}: a zero in counts needs 'counts' of one turn") from None
    return validated(Row, raw, source, RigError)


NARROWEST = radians(7.0)
"""Some joint of a hand has a wider range than this [rad]; if none has, radians were read as
degrees, since a whole turn of 2π would be 6.3°. Source: definition (a whole turn in radians).
"""


class ASSUMED:
    """Values for what a table of a hand does not say, with wide stds; they suit small hands with
    braided lines.

    Attributes:
        radius: at which a tendon passes a joint, and that of a spool [m].
        ratio_std: std of a ratio of radii that a drawing or a table gives, each of them to 2 %, as
            a share.
        unknown_ratio_std: std of a ratio of radii that nothing gives, as a share.
        stiffness_std: std of the stiffness of a tendon, as a share.
        zero_std: std of the motor's angle at a joint's zero that a table gives [rad].
        unknown_zero_std: the same where nothing gives it [rad].
        calibrated_zero_std: the same after a calibration against the stops [rad].
        travel_share: ratio of motor to joint as a share of the ratio of their travels: a motor's
            travel from stop to stop also stretches the tendons and takes up their play.
        travel_share_std: std of that share.
        spring_below: how far before the range of its joint a spring rests [rad].
        slack: of each of the two tendons that pull a joint to both sides.
        loose: slack of a tendon whose joints springs bring back.
        counts: of an encoder in one turn; where a log is not in counts, they give its resolution.
    """

    radius = 8e-3
    ratio_std = 0.03
    unknown_ratio_std = 0.25
    stiffness_std = 0.6
    zero_std = radians(5.0)
    unknown_zero_std = radians(60.0)
    calibrated_zero_std = radians(4.0)
    travel_share = 0.92
    travel_share_std = 0.06
    spring_below = radians(18.0)
    inertia = Guess("1e-5 kg m^2", "inertia of joints")
    damping = Guess("1e-3 N m s", "damping of joints")
    joint_friction = Guess(
        {"coefficient": {"value": 0.1, "std": 0.05}, "radius": "3 mm", "preload": "30 N"},
        "friction of joints",
    )
    range_std = Guess("1 deg", "how well ranges are known")
    motor_inertia = Guess("2e-4 kg m^2", "inertia of motors")
    motor_damping = Guess("1e-3 N m s", "damping of motors")
    motor_friction = Guess(
        {
            "constant": {"value": "0.035 N m", "std": "0.015 N m"},
            "load": {"value": 0.06, "std": 0.03},
        },
        "friction of motors",
    )
    servo = Guess({"bandwidth": "5 Hz", "delay": "10 ms"}, "how motors follow")
    stiffness = "20 N/mm"
    tendon_damping = Guess("2 N s/m", "damping of tendons")
    slack = Guess({"value": "0.3 mm", "std": "0.25 mm"}, "slack of tendons")
    loose = Guess({"value": "0.5 mm", "std": "1 mm"}, "slack of tendons")
    path = Guess(
        {"friction": {"value": 0.1, "std": 0.05}, "wrap": "80 deg"}, "friction along the paths"
    )
    torque_constant = Guess("0.5 N m/A", "torque constants")
    current_noise = Guess("6 mA", "noise of currents")
    position_noise = Guess("0.05 deg", "noise of encoders")
    rate = Guess(100.0, "rate of the sensors")
    counts = 4096
    encoder_step = Guess("0.1 deg", "encoders of joints, which are for learning and comparing only")

    @classmethod
    def spring(cls, radius: float) -> Guess:
        """Return the stiffness of the return spring at a joint whose tendon passes at some `radius`
        [m]. It is proportional to the radius, so that the joints of one tendon close together.
        """
        return Guess(
            {"value": f"{0.05 * radius / cls.radius:.3g} N m/rad", "std": "60 %"},
            "stiffness of springs",
        )


def from_table(path: str | Path) -> Imported:
    """Return the rig of a hand whose joints and motors stand in a table.

    A line is a joint that a motor moves: `joint`, `motor`, `spool_radius`, `joint_radius`,
    `direction` (+1 where the joint's angle grows as the motor's reading grows), `low` and `high`.
    Units stand behind the names, ``low [deg]``, or in the cells. A motor whose tendon crosses
    several joints has a line for each. What is left out is taken from `ASSUMED`: see `Row`.

    Raises:
        RigError: the file is no such table; says which line and what is allowed.
    """
    path = Path(path)
    rows = read_rows(path)
    unidentified = [
        row.joint for row in rows if row.follows is None and "direction" not in row.model_fields_set
    ]
    note = (
        f"no direction of {', '.join(unidentified)}: each angle is taken to grow with its motor's "
        "reading; look once"
    )
    return hand_of(rows, path.stem, "table", [note] if unidentified else [])


def hand_of(
    rows: Sequence[Row],
    title: str,
    source: str,
    notes: Sequence[str] = (),
) -> Imported:
    """Return the rig of a hand; what its rows do not say is taken from `ASSUMED`, with a std,
    and is listed.

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
        _agree(f"{title}: joint '{name}'", same, "low", "high", "range_std", "follows")
    for name, same in motors.items():
        _agree(
            f"{title}: motor '{name}'", same, "spool_radius", "unit", "counts", "torque_constant"
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
    return Imported.of(raw, title, source, notes)


def _agree(what: str, rows: Sequence[Row], *fields: str) -> None:
    """Refuse several lines for one thing that contradict each other."""
    for field in fields:
        if len({getattr(row, field) for row in rows}) > 1:
            raise RigError(f"{what} has several lines with different '{field}'")


def _time(column: str) -> Raw:
    """Return the time column of a log; its unit stands in brackets behind its name."""
    name, _, unit = column.rstrip(" ])").partition(" [")
    return {"column": name, "unit": unit or "s"}


def in_degrees(angle: float) -> str:
    """Return an `angle` [rad] as text in degrees, as a rig file has it."""
    return f"{round(degrees(angle), 6) + 0.0:.8g} deg"


def _name(name: str, kind: str) -> str:
    return name_of(f"{kind}_{name}" if name[:1].isdigit() else name, kind)


def _joint(name: str, rows: Sequence[Row]) -> Raw:
    row = rows[0]
    raw: Raw = {
        "name": name,
        "parent": "base",
        "inertia": ASSUMED.inertia,
        "damping": ASSUMED.damping,
    }
    if row.follows is not None:
        return raw | {"coupled": {"joint": _name(row.follows, "joint"), "ratio": row.ratio}}
    raw |= {
        "initial": Guess(
            {
                "value": f"{degrees(row.low + row.high) / 2:.4g} deg",
                "std": f"{degrees(row.high - row.low) / 4:.4g} deg",
            },
            "angles at the start",
        ),
        "friction": ASSUMED.joint_friction,
        "stops": [in_degrees(row.low), in_degrees(row.high)],
        "stops_std": ASSUMED.range_std if row.range_std is None else in_degrees(row.range_std),
    }
    if all(other.back == "spring" for other in rows):
        raw["spring"] = {
            "stiffness": ASSUMED.spring(max(row.joint_radius or ASSUMED.radius for row in rows)),
            # so far below its range that it holds the joint open
            "rest_angle": Guess(
                {"value": f"{degrees(row.low - ASSUMED.spring_below):.4g} deg", "std": "7 deg"},
                "where springs rest",
            ),
        }
    return raw


def _drive(name: str, rows: Sequence[Row]) -> Raw:
    row = rows[0]
    is_identified = row.joint_radius is not None and row.spool_radius is not None
    share = ASSUMED.ratio_std if is_identified else ASSUMED.unknown_ratio_std
    share = share if row.ratio_std is None else row.ratio_std
    value: Raw = {"value": row.spool_radius or ASSUMED.radius, "std": f"{100 * share:g} %"}
    return {
        "name": name,
        "kind": "capstan",
        "inertia": ASSUMED.motor_inertia,
        "radius": value if is_identified else Guess(value, "radii of spools"),
        "damping": ASSUMED.motor_damping,
        "friction": ASSUMED.motor_friction,
        "servo": ASSUMED.servo,
    }


def _tendons(motor: str, rows: Sequence[Row]) -> list[Raw]:
    """Return the tendons of a motor: two where a tendon brings its only joint back, else one over
    all of its joints.
    """
    shapes = [
        {"joint": _name(row.joint, "joint"), "side": row.direction * _winds(rows)}
        | {"kind": "pulley", "radius": _arm(row)}
        for row in rows
    ]
    if len(rows) > 1 or rows[0].back != "tendon":
        meetings: dict[str, Raw] = {motor: {"side": 1, "crossings": shapes}}
        spread: Raw = {"std": f"{100 * ASSUMED.stiffness_std:g} %"}
        slack = ASSUMED.loose
    else:
        insertion = {"kind": "pulley", "radius": _arm(rows[0])}
        meetings = {
            f"{motor}_{word}": {"joint": shapes[0]["joint"], "side": side, "insertion": insertion}
            for word, side in (("plus", 1), ("minus", -1))
        }
        spread = {"shared": {"name": f"stiffness_{motor}", "std": ASSUMED.stiffness_std}}
        slack = ASSUMED.slack
    common: Raw = {
        "stiffness": Guess({"value": ASSUMED.stiffness, **spread}, "stiffness of tendons"),
        "damping": ASSUMED.tendon_damping,
        "slack": slack,
        "path": ASSUMED.path,
    }
    return [{"name": name, "drive": motor, **meetings[name], **common} for name in meetings]


def _arm(row: Row) -> object:
    return row.joint_radius or Guess(
        ASSUMED.radius, "radii of joints (only their ratio to the spools counts)"
    )


def _winds(rows: Sequence[Row]) -> int:
    """Return the sign with which the motor's reading counts as winding its tendon: +1 where some
    joint's angle grows with the reading, else −1.
    """
    return max(row.direction for row in rows)


def _sensors(motor: str, rows: Sequence[Row]) -> list[Raw]:
    row = rows[0]
    unsaid = ASSUMED.unknown_zero_std if row.zero is None else ASSUMED.zero_std
    zero_std = (
        Guess(in_degrees(unsaid), "where encoders have their zero (a power-on routine finds it)")
        if row.zero_std is None
        else in_degrees(row.zero_std)
    )
    logged: Raw = (
        {"unit": row.unit}
        if row.counts is None
        else {"unit": "count", "counts_per_turn": row.counts}
    )
    step: object = f"{360 / (row.counts or ASSUMED.counts):.6g} deg"
    position: Raw = {
        **logged,
        "noise": ASSUMED.position_noise,
        "resolution": Guess(step, "counts of encoders") if row.counts is None else step,
        "bias": {"value": in_degrees(_winds(rows) * (row.zero or 0.0)), "std": zero_std},
    }
    current: Raw = {
        "unit": "mA",
        "torque_constant": row.torque_constant or ASSUMED.torque_constant,
        "noise": ASSUMED.current_noise,
    }
    return [
        {"name": f"{motor}_{name}", "measures": measures, "of": motor}
        | ({} if column is None else {"column": column})
        | {"sign": _winds(rows), "rate": ASSUMED.rate}
        | fields
        for name, measures, column, fields in (
            ("position", "position", row.position_column, position),
            ("current", "force", row.current_column, current),
        )
    ]


def _encoder(joint: str) -> Raw:
    return {
        "name": f"encoder_{joint}",
        "measures": "angle",
        "of": joint,
        "unit": "deg",
        "rate": ASSUMED.rate,
        "resolution": ASSUMED.encoder_step,
    }


REVISED = 21
"""Number that `hardware_version` has for the revision to which the keys that end in _v21 belong
[1]. Source: definition (files of orca_core).
"""


def _rising(ends: tuple[float, float]) -> tuple[float, float]:
    if not ends[0] < ends[1]:
        raise ValueError(f"the ends must rise, {ends[0]:g} and {ends[1]:g} came")
    return ends


Ends = Annotated[tuple[float, float], AfterValidator(_rising)]


class _OfOrca(BaseModel):
    """A file of orca_core, of which some keys are read."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)


class _Config(_OfOrca):
    hardware_version: object = None
    joint_to_motor_map: dict[str, int] = Field(min_length=1)
    joint_to_motor_map_v21: dict[str, int] = {}
    joint_roms: dict[str, Ends] = Field(min_length=1)
    joint_motor_travel: dict[str, float] = {}
    joint_motor_travel_v21: dict[str, float] = {}


class _Calibration(_OfOrca):
    calibrated: bool = True
    motor_limits: dict[int, Ends | tuple[None, None]] = Field(min_length=1)


class _Step(_OfOrca):
    joints: dict[str, object] = Field(min_length=1)


class _Sequence(_OfOrca):
    calibration_sequence: list[_Step]


def from_orca(config: str | Path, calibration: str | Path | None = None) -> Imported:
    """Return the rig of an ORCA hand from the files that its own software reads.

    The radii in it are guesses: only their ratio follows from the motors' travel.

    Args:
        config: file with the joints' ranges and the signed map of joints to motors.
        calibration: file that says where the motors met the stops.

    Raises:
        RigError: a file cannot be read or has no such entries; says which and what is needed.
    """
    path = Path(config)
    hand = _read(_Config, path)
    revised = hand.hardware_version == REVISED
    motors = hand.joint_to_motor_map | (hand.joint_to_motor_map_v21 if revised else {})
    travels = hand.joint_motor_travel or hand.joint_motor_travel_v21
    limits = {} if calibration is None else _limits(Path(calibration))
    for joint in motors:
        if joint not in hand.joint_roms:
            raise RigError(f"{path}: joint_roms: '{joint}' needs two ends, none came")
    rows = list[Row]()
    notes = list[str]()
    for joint, signed in motors.items():
        if signed == 0:
            raise RigError(f"{path}: joint_to_motor_map: '{joint}' needs the number of its motor")
        low, high = map(radians, hand.joint_roms[joint])
        motor = abs(signed)
        direction = 1 if signed > 0 else -1
        raw: Raw = {
            "joint": joint,
            "motor": str(motor),
            "direction": direction,
            "low": low,
            "high": high,
        }
        travel = radians(travels[joint]) if joint in travels else None
        if motor in limits:
            ends = limits[motor]
            travel = ends[1] - ends[0]
        if travel is not None:
            ratio = ASSUMED.travel_share * travel / (high - low)
            raw |= {
                "ratio_std": ASSUMED.travel_share_std,
                "spool_radius": ASSUMED.radius / ratio,
                "joint_radius": ASSUMED.radius,
            }
            if motor in limits:
                raw["zero"] = sum(ends) / 2 - direction * ratio * (low + high) / 2
                raw["zero_std"] = ASSUMED.calibrated_zero_std
        rows.append(validated(Row, raw, f"{path}: {joint}", RigError))
    if not travels and not limits:
        notes.append(
            "no ratio of motors to joints: give calibration.yaml too, or run the power-on routine"
        )
    elif not limits:
        of = "this revision" if revised else "revision 2.1, which this hand may not be"
        notes.append(f"ratios of motors to joints are from the travel of {of}")
    guessed = sum(row.zero is None for row in rows)
    if guessed:
        notes.append(
            f"where {guessed} motors have their zero is not known: run the power-on routine"
        )
    return hand_of(rows, path.resolve().parent.name or path.stem, "config", notes)


def orca_order(config: str | Path) -> list[list[str]]:
    """Return the joints that an ORCA hand's own calibration moves at one time, in its order; for
    `RoutineOptions.order`.

    Raises:
        RigError: the file has no such sequence.
    """
    steps = _read(_Sequence, Path(config)).calibration_sequence
    # one step flexes them, another extends them
    return [list(joints) for joints in dict.fromkeys(tuple(step.joints) for step in steps)]


def _limits(path: Path) -> dict[int, tuple[float, float]]:
    """Return where each motor met its stops, without those that were not calibrated."""
    hand = _read(_Calibration, path)
    if not hand.calibrated:
        raise RigError(
            f"{path}: says 'calibrated: false'; calibrate the hand, or leave this file out"
        )
    return {
        motor: (low, high)
        for motor, (low, high) in hand.motor_limits.items()
        if low is not None and high is not None
    }


def _read(kind: type[Checked], path: Path) -> Checked:
    """Return what a file of orca_core says."""
    try:
        yaml = importlib.import_module("yaml")
    except ImportError:
        raise RigError("YAML files need an extra: pip install 'distal[hands]'") from None
    try:
        found = yaml.safe_load(read_text(path, RigError))
    except (yaml.YAMLError, RecursionError, ValueError) as problem:
        raise RigError(f"{path}: not valid YAML: {problem}") from None
    if not isinstance(found, Mapping):
        raise RigError(f"{path}: is no configuration of a hand: names and values are expected")
    return validated(kind, found, f"{path}, read as a file of orca_core", RigError)
