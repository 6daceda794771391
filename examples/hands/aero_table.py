"""Print the table of an Aero Hand for `distal rig from-table`: `python aero_table.py [FOLDER] > aero.csv`.

The hand's own SDK says how far each motor turns for each joint; FOLDER is that of its package `aero_open_sdk`, by default the
installed one.
"""

from __future__ import annotations

import ast
import importlib.util
import runpy
import sys
from pathlib import Path

import numpy as np

SMALLEST = 1e-6  # change of a motor's angle per change of a joint's below which the motor does not move the joint


def constants(path: Path) -> dict[str, list]:
    """Return the lists that stand in a file. It is not run, since it would open a serial port."""
    found = {}
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Assign) and isinstance(node.targets[0], ast.Name):
            found[node.targets[0].id] = listed(node.value)
    return found


def listed(node: ast.expr) -> list:
    """Return a list that is written out, or made of others by + and *; of all else an empty one."""
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
        return listed(node.left) + listed(node.right)
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.Mult):
        return listed(node.left) * int(ast.literal_eval(node.right))
    try:
        value = ast.literal_eval(node)
    except ValueError:
        return []
    return list(value) if isinstance(value, (list, tuple)) else []


if sys.argv[1:]:
    root = Path(sys.argv[1])
else:
    root = Path(importlib.util.find_spec("aero_open_sdk").origin).parent
said = constants(root / "aero_hand.py")
joints, motors = said["_JOINT_NAMES"], said["_ACTUATIONS_NAMES"]
ends = list(zip(said["_JOINT_LOWER_LIMITS"], said["_JOINT_UPPER_LIMITS"], strict=True))
model = runpy.run_path(str(root / "joints_to_actuations.py"), run_name="asked")
turned, spool = model["JointsToActuationsModel"]().hand_actuations, model["MOTOR_PULLEY_RADIUS"]
still = np.array(turned([0.0] * len(joints)), dtype=float)
turns = [np.array(turned(list(row)), dtype=float) - still for row in np.eye(len(joints))]
print(
    "joint,motor,low [deg],high [deg],direction,spool_radius [mm],joint_radius [mm],back,unit,zero [deg]"
)
for m, motor in enumerate(motors):
    moved = [j for j in range(len(joints)) if abs(turns[j][m]) > SMALLEST]
    # a motor that turns one joint, as far as itself, holds it both ways
    direct = len(moved) == 1 and abs(abs(turns[moved[0]][m]) - 1.0) < SMALLEST
    for j in moved:
        direction, back = 1 if turns[j][m] > 0 else -1, "tendon" if direct else "spring"
        print(
            joints[j],
            motor.removesuffix("_act"),
            *ends[j],
            direction,
            spool,
            abs(turns[j][m]) * spool,
            back,
            "deg",
            0,
            sep=",",
        )
