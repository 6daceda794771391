"""A rig of an Aero Hand from the user's own copy of its SDK: the SDK is called, nothing of it is
copied.
"""

from __future__ import annotations

import ast
import importlib.util
import runpy
from collections.abc import Callable, Sequence
from math import radians
from pathlib import Path

import numpy as np

from distal.errors import RigError
from distal.rig.files import Imported, read_text
from distal.rig.hand_tables.described import hand_of
from distal.rig.hand_tables.rows import Row
from distal.rig.validation import validated

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
