"""A rig of an ORCA hand from its own `config.yaml` and `calibration.yaml`."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from math import degrees, radians
from pathlib import Path
from types import ModuleType

from distal.errors import RigError, UnitError
from distal.rig.files import Imported, read_text
from distal.rig.hand_tables.described import hand_of
from distal.rig.hand_tables.row import Row
from distal.units import to_si

REVISED = 21
"""Number that `hardware_version` has for the revision to which the keys that end in _v21 belong
[1]. Source: definition (files of orca_core).
"""

NARROWEST = 7.0
"""Some joint of a hand has a wider range than this [°]; if none has, the ranges are in radians,
since a whole turn of 2π would read as 6.3°. Source: definition (a whole turn in radians).
"""

LOST = 0.92
"""Ratio of motor to joint as a share of the ratio of their travels [1]: a motor's travel from stop
to stop also stretches the tendons and takes up their play. Source: judgement.
"""

LOST_STD = 0.06
"""Std of `LOST` [1]. Source: judgement."""

CALIBRATED_ZERO_STD = radians(4.0)
"""Std of the motor's angle at a joint's zero after a calibration against the stops [rad]. Source:
judgement.
"""


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
    identified = _mapping(path)
    revised = identified.get("hardware_version") == REVISED
    motors = dict(_section(path, identified, "joint_to_motor_map"))
    if revised and "joint_to_motor_map_v21" in identified:
        motors |= _section(path, identified, "joint_to_motor_map_v21")
    ranges = _section(path, identified, "joint_roms")
    key = "joint_motor_travel" if "joint_motor_travel" in identified else "joint_motor_travel_v21"
    travels = _section(path, identified, key) if key in identified else {}
    limits = _limits(Path(calibration)) if calibration is not None else {}
    spans = [_pair(path, "joint_roms", joint, ranges.get(joint)) for joint in motors]
    if max(high - low for low, high in spans) < NARROWEST:
        raise RigError(
            f"{path}: joint_roms: no joint turns by more than {NARROWEST:g}°; they are degrees, "
            "and these look as if they were in radians"
        )
    rows = list[Row]()
    notes = list[str]()
    guessed = 0
    for joint, signed in motors.items():
        if not isinstance(signed, int) or signed == 0:
            raise RigError(
                f"{path}: joint_to_motor_map: '{joint}' needs the number of its motor, {signed!r} "
                "came"
            )
        low, high = (radians(end) for end in _pair(path, "joint_roms", joint, ranges.get(joint)))
        motor = abs(signed)
        direction = 1 if signed > 0 else -1
        ratio = None
        zero = None
        if motor in limits:
            ends = _pair(Path(str(calibration)), "motor_limits", str(motor), limits[motor])
            ratio = LOST * (ends[1] - ends[0]) / (high - low)
            zero = (ends[0] + ends[1]) / 2 - direction * ratio * (low + high) / 2
        elif joint in travels:
            ratio = LOST * _number(path, key, joint, travels[joint]) / degrees(high - low)
        if ratio is not None and not 0.02 < ratio < 50.0:
            raise RigError(
                f"'{joint}': motor {motor} turns {ratio:.3g} times as far as it; from 0.02 to 50 "
                "is possible"
            )
        if zero is None:
            guessed += 1
        rows.append(_row(str(joint), motor, direction, (low, high), ratio, zero))
    if not travels and not limits:
        notes.append(
            "no ratio of motors to joints: give calibration.yaml too, or run the power-on routine"
        )
    elif not limits:
        of = "this revision" if revised else "revision 2.1, which this hand may not be"
        notes.append(f"ratios of motors to joints are from the travel of {of}")
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
    path = Path(config)
    steps = _mapping(path).get("calibration_sequence")
    order = list[list[str]]()
    if not isinstance(steps, list) or not all(isinstance(step, Mapping) for step in steps):
        raise RigError(f"{path}: 'calibration_sequence' is missing: is this a file of orca_core?")
    for step in steps:
        joints = list(_section(path, step, "joints"))
        if joints not in order:  # one step flexes them, another extends them
            order.append(joints)
    return order


def _row(
    joint: str,
    motor: int,
    direction: int,
    ends: tuple[float, float],
    ratio: float | None,
    zero: float | None,
) -> Row:
    arm = 8e-3
    return Row(
        joint=joint,
        motor=str(motor),
        direction=direction,
        low=ends[0],
        high=ends[1],
        ratio_std=None if ratio is None else LOST_STD,
        spool_radius=None if ratio is None else arm / ratio,
        joint_radius=None if ratio is None else arm,
        zero=zero,
        zero_std=None if zero is None else CALIBRATED_ZERO_STD,
    )


def _limits(path: Path) -> dict[int, object]:
    """Return where each motor met its stops, without those that were not calibrated."""
    identified = _mapping(path)
    if identified.get("calibrated") is False:
        raise RigError(
            f"{path}: says 'calibrated: false', so that its limits are not those of this hand; "
            "calibrate the hand, or leave this file out"
        )
    found = _section(path, identified, "motor_limits")
    limits = dict[int, object]()
    for motor, ends in found.items():
        if not motor.isdigit():
            raise RigError(f"{path}: motor_limits: '{motor}' is no number of a motor")
        if isinstance(ends, list) and all(end is None for end in ends):
            continue
        limits[int(motor)] = ends
    return limits


def _mapping(path: Path) -> Mapping[str, object]:
    yaml = _yaml()
    text = read_text(path, RigError)
    try:
        identified = yaml.safe_load(text)
    except (yaml.YAMLError, RecursionError, ValueError) as problem:
        raise RigError(f"{path}: not valid YAML: {problem}") from None
    if not isinstance(identified, Mapping):
        raise RigError(f"{path}: is no configuration of a hand: names and values are expected")
    return identified


def _section(path: Path, identified: Mapping[str, object], key: str) -> dict[str, object]:
    section = identified.get(key)
    if not isinstance(section, Mapping) or not section:
        raise RigError(f"{path}: '{key}' is missing or empty: is this a file of orca_core?")
    return {str(name): value for name, value in section.items()}


def _pair(path: Path, key: str, name: object, ends: object) -> tuple[float, float]:
    if not isinstance(ends, list) or len(ends) != 2:
        raise RigError(f"{path}: {key}: '{name}' needs two ends, {ends!r} came")
    low, high = (_number(path, key, name, end) for end in ends)
    if not low < high:
        raise RigError(f"{path}: {key}: the ends of '{name}' must rise, {low:g} and {high:g} came")
    return low, high


def _number(path: Path, key: str, name: object, value: object) -> float:
    try:
        return to_si(None if isinstance(value, str) else value, "")
    except UnitError as problem:
        raise RigError(f"{path}: {key}: '{name}' needs a number: {problem}") from None


def _yaml() -> ModuleType:
    try:
        return importlib.import_module("yaml")
    except ImportError:
        raise RigError("YAML files need an extra: pip install 'distal[hands]'") from None
