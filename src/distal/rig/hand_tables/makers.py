"""Rigs of hands from files of their makers: an ORCA hand from its own `config.yaml` and
`calibration.yaml`, an Aero Hand from the user's own copy of its SDK, which is called; nothing of it
is copied.
"""

from __future__ import annotations

import ast
import importlib
import importlib.util
import runpy
from collections.abc import Callable, Mapping, Sequence
from math import radians
from pathlib import Path
from types import ModuleType
from typing import Annotated, TypeVar

import numpy as np
from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from distal.errors import RigError
from distal.rig.files import Imported, read_text
from distal.rig.hand_tables.described import ASSUMED, hand_of
from distal.rig.hand_tables.rows import Row
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
        of_config: dict[str, object] = {}
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
            of_config = {
                "ratio_std": ASSUMED.travel_share_std,
                "spool_radius": ASSUMED.radius / ratio,
                "joint_radius": ASSUMED.radius,
            }
            if motor in limits:
                of_config["zero"] = sum(ends) / 2 - direction * ratio * (low + high) / 2
                of_config["zero_std"] = ASSUMED.calibrated_zero_std
        raw = {"joint": joint, "motor": str(motor), "direction": direction, "low": low}
        rows.append(
            validated(Row, {**raw, "high": high, **of_config}, f"{path}: {joint}", RigError)
        )
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
            f"{path}: says 'calibrated: false', so that its limits are not those of this hand; "
            "calibrate the hand, or leave this file out"
        )
    return {
        motor: (low, high)
        for motor, (low, high) in hand.motor_limits.items()
        if low is not None and high is not None
    }


def _read(kind: type[Read], path: Path) -> Read:
    """Return what a file of orca_core says."""
    yaml = _yaml()
    try:
        found = yaml.safe_load(read_text(path, RigError))
    except (yaml.YAMLError, RecursionError, ValueError) as problem:
        raise RigError(f"{path}: not valid YAML: {problem}") from None
    if not isinstance(found, Mapping):
        raise RigError(f"{path}: is no configuration of a hand: names and values are expected")
    return validated(kind, found, f"{path}, read as a file of orca_core", RigError)


def _yaml() -> ModuleType:
    try:
        return importlib.import_module("yaml")
    except ImportError:
        raise RigError("YAML files need an extra: pip install 'distal[hands]'") from None


PACKAGE = "aero_open_sdk"
"""Name of the SDK's package."""

NAMES = ("_JOINT_NAMES", "_JOINT_LOWER_LIMITS", "_JOINT_UPPER_LIMITS", "_ACTUATIONS_NAMES")
"""Constants that are read from the SDK: names of joints, ends of their ranges [°], names
of motors.
"""

SMALLEST = 1e-6
"""Change of a motor's angle per change of a joint's below which the motor does not move the joint
[1]. Source: rounding (differences of the SDK's results).
"""


def from_aero(folder: str | Path | None = None) -> Imported:
    """Return the rig of an Aero Hand: its SDK computes how far each motor turns for each joint.

    Args:
        folder: of the package `aero_open_sdk`, or where it was cloned; None for the installed one.

    Raises:
        RigError: the SDK is not found, or is another one than this reads.
    """
    root = _root(folder)
    identified = _constants(root / "aero_hand.py")
    joints = identified["_JOINT_NAMES"]
    motors = identified["_ACTUATIONS_NAMES"]
    model = root / "joints_to_actuations.py"
    try:
        made = runpy.run_path(str(model), run_name="distal_asks_the_sdk")
    except Exception as problem:
        raise RigError(f"{model}: cannot be read ({type(problem).__name__}: {problem})") from None
    try:
        turned: Callable[[list[float]], Sequence[float]] = made[
            "JointsToActuationsModel"
        ]().hand_actuations
        spool = 1e-3 * float(made["MOTOR_PULLEY_RADIUS"])
        still = np.array(turned([0.0] * len(joints)), dtype=float)
        turns = [np.array(turned(list(row)), dtype=float) - still for row in np.eye(len(joints))]
        ends = [
            (radians(float(str(a))), radians(float(str(b))))
            for a, b in zip(identified[NAMES[1]], identified[NAMES[2]])
        ]
        if not len(joints) == len(ends) or any(len(row) != len(motors) for row in turns):
            raise ValueError(f"{len(joints)} joints, {len(ends)} ranges, {len(motors)} motors")
    except (AttributeError, TypeError, ValueError, LookupError) as problem:
        raise RigError(f"{root}: is another SDK than this reads ({problem})") from None
    rows = list[Row]()
    for m, motor in enumerate(motors):
        moved = [j for j in range(len(joints)) if abs(turns[j][m]) > SMALLEST]
        # a motor that turns one joint, as far as itself, holds it both ways
        direct = len(moved) == 1 and abs(abs(turns[moved[0]][m]) - 1.0) < SMALLEST
        for j in moved:
            low, high = ends[j]
            raw = {
                "joint": str(joints[j]),
                "motor": str(motor).removesuffix("_act"),
                "low": low,
                "high": high,
                "direction": 1 if turns[j][m] > 0 else -1,
                "spool_radius": spool,
                "joint_radius": abs(turns[j][m]) * spool,
                "back": "tendon" if direct else "spring",
                "unit": "deg",
                "zero": 0.0,
            }
            rows.append(validated(Row, raw, str(root), RigError))
    return hand_of(
        rows,
        "aero-hand",
        "SDK",
        ("readings are the actuations of the SDK, in degrees",),
    )


def _root(folder: str | Path | None) -> Path:
    """Return the folder of the SDK's package."""
    if folder is None:
        spec = importlib.util.find_spec(PACKAGE)
        if spec is None or spec.origin is None:
            raise RigError(
                f"'{PACKAGE}' is not installed: install the hand's SDK, or give the folder where "
                "it was cloned"
            )
        return Path(spec.origin).parent
    for inside in ("", PACKAGE, f"src/{PACKAGE}", f"sdk/src/{PACKAGE}"):
        if (Path(folder) / inside / "joints_to_actuations.py").is_file():
            return Path(folder) / inside
    raise RigError(f"{folder}: holds no '{PACKAGE}' with its joints_to_actuations.py")


def _constants(path: Path) -> dict[str, list[object]]:
    """Return the lists of names and ranges that stand in a file. The file is not run, since it
    would open a serial port.
    """
    try:
        tree = ast.parse(read_text(path, RigError))
    except SyntaxError as problem:
        raise RigError(f"{path}: is no Python file ({problem.msg})") from None
    found = {
        node.targets[0].id: _listed(node.value)
        for node in tree.body
        if isinstance(node, ast.Assign)
        and isinstance(node.targets[0], ast.Name)
        and node.targets[0].id in NAMES
    }
    missing = [name for name in NAMES if not found.get(name)]
    if missing:
        raise RigError(f"{path}: has no '{missing[0]}': is another SDK than this reads")
    return found


def _listed(node: ast.expr) -> list[object]:
    """Return a list that is written out, or made of others by + and *; of all else an empty one."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return _listed(node.left) + _listed(node.right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return _listed(node.left) * int(ast.literal_eval(node.right))
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return []
    return list(value) if isinstance(value, (list, tuple)) else []
