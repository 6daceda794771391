"""Rigs of ORCA hands from their own `config.yaml` and `calibration.yaml`."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from math import radians
from pathlib import Path
from typing import Annotated, TypeVar

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from distal.errors import RigError
from distal.rig.files import Imported, read_text
from distal.rig.hand_tables.rig_of_table import ASSUMED, Row, hand_of
from distal.rig.quantities import Raw
from distal.rig.validation import validated

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


Read = TypeVar("Read", bound=_OfOrca)


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
        low, high = (radians(end) for end in hand.joint_roms[joint])
        motor = abs(signed)
        direction = 1 if signed > 0 else -1
        raw: Raw = {"joint": joint, "motor": str(motor), "direction": direction}
        raw |= {"low": low, "high": high}
        travel = radians(travels[joint]) if joint in travels else None
        if motor in limits:
            ends = limits[motor]
            travel = ends[1] - ends[0]
        if travel is not None:
            ratio = ASSUMED.travel_share * travel / (high - low)
            if not 0.02 < ratio < 50.0:
                raise RigError(
                    f"'{joint}': motor {motor} turns {ratio:.3g} times as far as it; from 0.02 to "
                    "50 is possible: are joint_roms, which are degrees, in radians?"
                )
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
    order = list[list[str]]()
    for step in _read(_Sequence, Path(config)).calibration_sequence:
        if list(step.joints) not in order:  # one step flexes them, another extends them
            order.append(list(step.joints))
    return order


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


def _read(kind: type[Read], path: Path) -> Read:
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
