"""Real logs of a da Vinci grasper at five wrist poses, with a homing move of 3 s; least squares
beside the filters.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import cache, partial
from pathlib import Path

import numpy as np
from tests.support.maps import with_learned_map

from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, by_case, record, score
from distal import Log, Rig, load_rig, read_log

NAME = "poses"
HOMING = 3.0
"""How long the jaw's angle is known [s]; errors count afterwards."""

POSES = {
    "wrist straight": "da_vinci_grasper/run_*.csv",
    "pitch +30°": "da_vinci_poses/pitch_2_*.csv",
    "pitch −30°": "da_vinci_poses/pitch_4_*.csv",
    "roll −45°": "da_vinci_poses/roll_2_*.csv",
    "roll +45°": "da_vinci_poses/roll_4_*.csv",
}
"""Case → its files in the folder DISTAL_DATA."""

LEAST_SQUARES = "least squares"

LEARNED = "regression, learned from the straight wrist"
"""`regression` with the map of the twelve runs of the straight wrist, conditioned on homing."""


def least_squares(log: Log, case: str, name: str) -> Record:
    """Score the jaw's angle as least squares of (motor angle, motor torque, 1) over the homing
    move.
    """
    design = np.column_stack(
        [log.channels["motor_angle"], log.channels["motor_torque"], np.ones(len(log))]
    )
    true = log.truth["theta"]
    there = np.isfinite(design).all(axis=1) & np.isfinite(true)
    early = there & (log.time - log.time[0] < HOMING)
    weights, residuals = np.linalg.lstsq(design[early], true[early], rcond=None)[:2]
    spread = float(residuals[0]) / (early.sum() - 3)
    late = there & ~(log.time - log.time[0] < HOMING)
    inverse = np.linalg.inv(design[early].T @ design[early])
    stds = np.sqrt(spread * (1.0 + np.sum(design[late] @ inverse * design[late], axis=1)))
    return record(NAME, case, name, LEAST_SQUARES, design[late] @ weights - true[late], stds)


def run(case: str, path: Path) -> list[Record]:
    """Score all estimators on one recorded log, and least squares."""
    rig = load_rig("da-vinci-grasper").bare()  # what it learned of these very logs is left out
    log = read_log(path, rig)
    records = [
        *all_estimators(NAME, case, path.stem, log, rig, HOMING),
        least_squares(log, case, path.stem),
    ]
    if case != "wrist straight":
        taught = learned(str(path.parents[1]))
        records.append(
            replace(
                score(NAME, case, path.stem, log, taught, "regression", HOMING), estimator=LEARNED
            )
        )
    return records


@cache
def learned(folder: str) -> Rig:
    """Return the shipped rig with `[map]` from the runs of the straight wrist.

    Args:
        folder: with the data.
    """
    rig = load_rig("da-vinci-grasper").bare()
    logs = [read_log(path, rig) for path in sorted(Path(folder).glob(POSES["wrist straight"]))]
    return with_learned_map(logs, rig, "readings", HOMING)


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: all logs of each pose, or the first one."""
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        print("DISTAL_DATA is not set: the da Vinci poses are left out", file=sys.stderr)
        return []
    made = []
    for case, pattern in POSES.items():
        paths = sorted(Path(folder).glob(pattern))
        if not paths:
            print(f"no logs {pattern} in DISTAL_DATA: {case} is left out", file=sys.stderr)
        made += [partial(run, case, path) for path in paths[: 1 if quick else None]]
    return made


def tables(records: list[Record]) -> list[Table]:
    """Return the table by pose."""
    title = "da Vinci grasper, rig as shipped, homing move of 3 s; errors after it"
    return [by_case(NAME, title, records, "all")]
