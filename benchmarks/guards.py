"""What each guard of `adaptive` brings: `python -m benchmarks.guards [NAME …]` prints tables;
names: those of `Robustness`.

Each guard alone is taken out (or changed as `WITHOUT` says), and constants of the algorithm are
changed as `CONSTANTS` says, on the friendly logs of `make accuracy` and on those of
`benchmarks.strangers`. A row is a kind of log, a cell the RMS error [°] and the share inside the 95
% band.
"""

from __future__ import annotations

import json
import os
import sys
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from functools import lru_cache
from importlib import import_module
from math import inf

os.environ["DISTAL_COMPILE"] = "0"

import numpy as np
from tests.support import cases

from benchmarks.report import table
from benchmarks.strangers import glitches, poses, rigs, scoring, series, steps
from benchmarks.strangers.scoring import Record
from distal import DistalError, Log, Rig, estimate
from distal.estimators import AdaptiveFilter, Robustness
from distal.homing import with_references
from distal.rig import build_rig

WITHOUT: dict[str, float] = {
    "wild_displacement": inf,
    "real_jump": 0.0,
    "bend_share": 0.0,
    "follow_time": inf,
    "wild_force": inf,
    "sticking_time": 0.0,
    "turning_time": 0.0,
    "unknown_friction": 0.0,
    "unknown_friction_walk": 0.0,
    "parameter_walk": 0.0,
    "unmodelled": 0.0,
}
"""Guard → its value where it does nothing."""

CONSTANTS: dict[str, tuple[str, float]] = {
    "SHARP_BEND": ("update", 1e9),
    "TURNING_DECLARED": ("update", 1.0),
    "STICK_STD": ("update", 0.0),
    "MEAN_TIME": ("update", 1e-3),
    "CLEAR_STICK": ("update", 0.5),
    "TURNING": ("update", 0.0),
    "CREST": ("prediction", 0.0),
    "TIE": ("update", 1.0),
}
"""Constant of the algorithm → its module, and its value where it does nothing (or little)."""

SEEDS = 3


@dataclass(frozen=True)
class Case:
    """A log to estimate, and the row of the table that it belongs to."""

    row: str
    log: Log
    rig: Rig
    homing: float | None = None


def friendly() -> list[Case]:
    """Return logs as those of `make accuracy`: plants within the rig's stds and beyond, whole and
    spoiled, and hands.
    """
    made = []
    for kind in cases.SCENARIOS:
        where = "mid-range" if kind in cases.MID_RANGE else "into stops"
        for plant in (*cases.WITHIN, *cases.HARD):
            row = f"friendly, {where}" if plant in cases.WITHIN else "plants beyond the stds"
            for seed in range(SEEDS if plant in cases.WITHIN else 1):
                log, rig = cases.paper_log(kind, plant, seed), cases.paper_rig(plant)
                made.append(Case(row, log, rig))
                if plant in cases.WITHIN:
                    made.append(Case(f"{row}, spoiled", cases.spoiled(log, seed), rig))
    for friction in cases.HAND_FRICTION:
        made += [
            Case("hand", cases.hand_log(seed), cases.hand_rig(friction)) for seed in range(SEEDS)
        ]
    return made


def strange() -> list[Case]:
    """Return the logs of `benchmarks.strangers`, one seed each and 40 random rigs."""
    made: list[Case] = []

    def collect(
        bench: str,
        case: str,
        name: str,
        log: Log,
        rig: Rig,
        estimator: str,
        homing: float | None = None,
    ) -> Record:
        if estimator == "adaptive":
            made.append(
                Case(
                    f"{bench}, {case}" if bench in ("glitches", "rigs") else bench, log, rig, homing
                )
            )
        return Record(bench, case, name, estimator, 0.0, 0.0, 0.0)

    usual, scoring.score = scoring.score, collect
    known = scoring.score_known
    for bench in (rigs, steps):
        vars(bench)["score_known"] = _nothing
    try:
        for bench in (steps, glitches, series, poses):
            for job in bench.jobs(True, 100):
                job()
        for seed in range(40):
            rigs.run(1000 + seed)
    finally:
        scoring.score = usual
        for bench in (rigs, steps):
            vars(bench)["score_known"] = known
    return made


def _nothing(*arguments: object) -> Record:
    return Record("", "", "", "", 0.0, 0.0, 0.0)


_CASES: list[Case] = []


Variant = tuple[Robustness, str]
"""Guards, and the name of a constant that is changed, or nothing."""


@lru_cache(maxsize=64)
def filter_with(variant: Variant, described: str, homed: bool) -> AdaptiveFilter:
    """Return the filter of a rig with some guards; the same rig stands behind many logs."""
    robustness, constant = variant
    rig = build_rig(json.loads(described), "rig")
    references = rig.sensors_of("angle")[-1:] if homed else ()
    if not constant:
        return AdaptiveFilter(rig, False, robustness, references=references)
    module = import_module(f"distal.estimators.adaptive.{CONSTANTS[constant][0]}")
    usual = getattr(module, constant)
    setattr(module, constant, CONSTANTS[constant][1])
    try:
        return AdaptiveFilter(rig, False, robustness, references=references)
    finally:
        setattr(module, constant, usual)


def score(job: tuple[Variant, int]) -> tuple[float, float]:
    """Return RMS [°] and share inside of one case with some guards."""
    variant, index = job
    case = _CASES[index]
    rig, log = case.rig, case.log
    if case.homing is not None:
        rig, _ = with_references(rig, log)
    estimator = filter_with(variant, rig.model_dump_json(), case.homing is not None)
    try:
        found = estimate(log, estimator.rig, estimator, homing=case.homing)
    except DistalError:
        return scoring.LOST, 0.0
    return float(np.rad2deg(found.rms_error())), found.inside_band()


def main() -> None:
    """Print the tables: one for each kind of logs, a row for each guard."""
    asked = set(sys.argv[1:])
    variants: dict[str, Variant] = {"as it is": (Robustness(), "")}
    for names in [(name,) for name in WITHOUT]:
        if not asked or "+".join(names) in asked:
            without = replace(Robustness(), **{name: WITHOUT[name] for name in names})
            variants[f"without {' + '.join(names)}"] = (without, "")
    for name, (_, value) in CONSTANTS.items():
        if not asked or name in asked:
            variants[f"{name} = {value:g}"] = (Robustness(), name)
    _CASES.extend([*friendly(), *strange()])
    rows = list(dict.fromkeys(case.row for case in _CASES))
    jobs = [(variant, i) for variant in variants.values() for i in range(len(_CASES))]
    with ProcessPoolExecutor(os.cpu_count() or 1) as pool:
        scores = list(pool.map(score, jobs, chunksize=16))
    found = np.array(scores).reshape(len(variants), len(_CASES), 2)
    cells = []
    for row in rows:
        own = [i for i, case in enumerate(_CASES) if case.row == row]
        # random rigs differ by far in size: their median
        pooled = (
            np.median
            if row.startswith("rigs")
            else lambda values, axis: np.sqrt(np.mean(values**2, axis=axis))
        )
        rms, inside = pooled(found[:, own, 0], axis=1), 100 * np.mean(found[:, own, 1], axis=1)
        cells.append([row, *(f"{e:.3f}, {s:.0f} %" for e, s in zip(rms, inside))])
    for start in range(0, len(variants), 6):
        chosen = list(range(start, min(start + 6, len(variants))))
        chosen = chosen if start == 0 else [0, *chosen]
        heads = [list(variants)[i] for i in chosen]
        table(
            f"guards-{start // 6 + 1}",
            "RMS error [°] and share inside the band, one guard taken out at a time",
            ["logs", *heads],
            [[line[0], *(line[1 + i] for i in chosen)] for line in cells],
        )


if __name__ == "__main__":
    main()
