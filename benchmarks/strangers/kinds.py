"""One rig for a kind of instrument: learned from some wrist poses of a real one, judged on poses
that it has not seen.
"""

from __future__ import annotations

import os
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

from tests.support.maps import with_learned_map

from benchmarks.strangers.poses import POSES
from benchmarks.strangers.scoring import Job, Record, Table, by_case, score
from distal import load_rig, read_log

NAME = "kinds"
HOMING = 3.0

HALVES = (
    (("wrist straight", "pitch +30°", "roll −45°"), ("pitch −30°", "roll +45°")),
    (("wrist straight", "pitch −30°", "roll +45°"), ("pitch +30°", "roll −45°")),
)
"""Poses that are learned from, and those that are judged."""

CLASSES = ("run_0", "run_2", "run_4")
"""Classes of motion with the wrist straight; each is left out once."""


def run(case: str, learned_from: list[Path], judged: list[tuple[str, Path]]) -> list[Record]:
    """Score `adaptive` and `regression`, learned from the same logs, and the shipped rig beside
    them.
    """
    rig = load_rig("da-vinci-grasper").bare()
    logs = [read_log(path, rig) for path in learned_from]
    adaptive = with_learned_map(logs, rig, "filter", HOMING)
    alone = with_learned_map(logs, rig, "readings", HOMING)
    records = []
    for pose, path in judged:
        log, name = read_log(path, rig), f"{case}: {path.stem}"
        records += [
            score(NAME, pose, name, log, adaptive, "adaptive", HOMING),
            score(NAME, pose, name, log, alone, "regression", HOMING),
            replace(
                score(NAME, pose, name, log, rig, "adaptive", HOMING),
                estimator="adaptive, nothing learned",
            ),
        ]
    return records


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: two halves of the poses, three classes left out."""
    folder = os.environ.get("DISTAL_DATA")
    if not folder:
        print("DISTAL_DATA is not set: the kinds of instrument are left out", file=sys.stderr)
        return []
    paths = {pose: sorted(Path(folder).glob(pattern)) for pose, pattern in POSES.items()}
    made = []
    for i, (some, others) in enumerate(HALVES):
        learned_from = [path for pose in some for path in paths[pose]]
        judged = [(pose, path) for pose in others for path in paths[pose]]
        made.append(partial(run, f"half {i}", learned_from, judged))
    straight = paths["wrist straight"]
    for each in () if quick else CLASSES:
        rest = [path for path in straight if not path.stem.startswith(each)]
        out = [("classes left out", path) for path in straight if path.stem.startswith(each)]
        made.append(partial(run, each, rest, out))
    return made


def tables(records: list[Record]) -> list[Table]:
    """Return the table by pose."""
    return [
        by_case(
            NAME, "da Vinci grasper as a kind, poses not seen, homing 3 s; errors after it", records
        )
    ]
