"""Homing by rigs whose numbers are hardly known: random ones with stds eight times as wide, and a
real instrument.
"""

from __future__ import annotations

import os
import sys
from functools import partial
from pathlib import Path
from typing import Any

from benchmarks.strangers.poses import POSES
from benchmarks.strangers.random_rigs import random_case
from benchmarks.strangers.scoring import Job, Record, Table, by_case, score
from distal import Rig, load_rig, read_log

NAME = "homing"
HOMING = 3.0
"""How long the joint's angle is known [s]; errors count afterwards."""

TIMES = 8.0
"""By so much the stds of random rigs are wider than those that rigs of the bench `rigs` have."""

MOST = 0.6
"""A std is at most this share of its value."""

ESTIMATORS = ("adaptive", "regression", "inextensible")


def widened(raw: dict[str, Any]) -> dict[str, Any]:
    """Make the stds of a raw rig wider, in place, and return it."""

    def visit(part: Any, key: str) -> None:
        if isinstance(part, dict) and "value" in part:
            if key in ("initial", "nominal_force"):
                return
            if "std" in part:
                most = MOST * abs(part["value"]) if part["value"] else float("inf")
                part["std"] = min(TIMES * part["std"], most)
            if part.get("shared"):
                part["shared"]["std"] = min(TIMES * part["shared"]["std"], MOST)
        elif isinstance(part, dict):
            for name, inner in part.items():
                visit(inner, name)
        elif isinstance(part, list):
            for inner in part:
                visit(inner, key)

    visit(raw, "")
    return raw


def hardly_known(rig: Rig) -> Rig:
    """Return the grasper as somebody would describe one whose wrist may be turned: wide stds,
    nothing held, no zero.
    """
    values: dict[str, Any] = {"sensors.motor_angle.bias.std": "20 deg"}
    for i, tendon in enumerate(rig.tendons):
        path = f"tendons.{i}"
        for key, std in (("stiffness", 6000.0), ("stiffening", 4000.0)):
            values |= {f"{path}.{key}.hold": False, f"{path}.{key}.std": std}
        for key, std in (
            ("radius", 0.03 * tendon.insertion.radius.value),
            ("slope", 0.05),
            ("curvature", 0.05),
        ):
            number = getattr(tendon.insertion, key)
            share = min(std / abs(number.value), 1.0)
            values[f"{path}.insertion.{key}.hold"] = False
            values[f"{path}.insertion.{key}"] = {
                "value": number.value,
                "std": 0.0,
                "shared": {"name": f"jaw.{key}", "std": share},
            }
    return rig.with_values(values)


def random_run(seed: int) -> list[Record]:
    """Score estimators on a random rig with wide stds, its plant drawn from them."""
    case = random_case(seed, widened)
    return [
        score(
            NAME, f"random rigs, stds × {TIMES:g}", f"seed {seed}", case.log, case.rig, name, HOMING
        )
        for name in ESTIMATORS
    ]


def recorded_run(case: str, path: Path) -> list[Record]:
    """Score estimators on a recorded log."""
    rig = hardly_known(load_rig("da-vinci-grasper").bare())
    log = read_log(path, rig)
    return [
        score(NAME, f"da Vinci, {case}", path.stem, log, rig, name, HOMING) for name in ESTIMATORS
    ]


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 60 random rigs or 6, and all recorded logs or the first of each pose."""
    made: list[Job] = [partial(random_run, 5000 + first + i) for i in range(6 if quick else 60)]
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        print("DISTAL_DATA is not set: homing of the da Vinci grasper is left out", file=sys.stderr)
        return made
    for case, pattern in POSES.items():
        made += [
            partial(recorded_run, case, path)
            for path in sorted(Path(folder).glob(pattern))[: 1 if quick else None]
        ]
    return made


def tables(records: list[Record]) -> list[Table]:
    """Return the table by case."""
    return [
        by_case(
            NAME,
            "Homing move of 3 s by rigs whose numbers are hardly known; errors after it",
            records,
            "all",
        )
    ]
