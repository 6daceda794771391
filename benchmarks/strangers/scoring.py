"""What an estimator made of one log, and how such records are pooled into rows of a table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.shell import estimate as by_command
from distal import DistalError, Log, Rig
from distal.confidence import BAND
from distal.rig import build_rig

ESTIMATORS = ("adaptive", "regression", "inextensible", "elastic", "ekf")
KNOWN = "adaptive, plant known"
"""The filter with the plant's values: what the model class can give."""

LOST = 90.0
"""The error [deg] that a run counts with that diverged or was refused."""


@dataclass(frozen=True)
class Record:
    """One estimator on one log.

    Args:
        bench: name of the bench.
        case: row of its table.
        log: which log of the case: seed or file, and what it is.
        estimator: its name.
        rms: error of the angle [deg].
        inside: share of samples with the truth inside the 95 % band.
        half: mean half-width of that band [deg].
        note: empty, "diverged" or "refused".
    """

    bench: str
    case: str
    log: str
    estimator: str
    rms: float
    inside: float
    half: float
    note: str = ""


Job = partial[list[Record]]
"""Returns its records."""


def score(
    bench: str,
    case: str,
    name: str,
    log: Log,
    rig: Rig,
    estimator: str,
    homing: float | None = None,
) -> Record:
    """Return what an estimator makes of a log; a run that is refused or diverges counts as an error
    of `LOST`.
    """
    try:
        result = by_command(log, rig, estimator, homing=homing)
    except DistalError as problem:
        note = "diverged" if "left all bounds" in str(problem) else "refused"
        return Record(bench, case, name, estimator, LOST, 0.0, 0.0, note)
    errors, stds = result.errors(), result.theta_std
    there = np.isfinite(errors)
    # more than half a turn off, or a band that is no number
    lost = bool(np.any(np.abs(errors[there]) > np.pi) or not np.all(np.isfinite(stds[there])))
    note = "diverged" if lost else ""
    return record(bench, case, name, estimator, errors[there], stds[there], note)


def record(
    bench: str,
    case: str,
    name: str,
    estimator: str,
    errors: Any,
    stds: Any,
    note: str = "",
) -> Record:
    """Return the record of errors and standard deviations [rad], (k,) each."""
    if note:
        return Record(bench, case, name, estimator, LOST, 0.0, 0.0, note)
    rms = float(np.rad2deg(np.sqrt(np.mean(errors**2))))
    inside = float(np.mean(np.abs(errors) <= BAND * stds))
    half = float(np.rad2deg(BAND * np.mean(stds)))
    return Record(bench, case, name, estimator, round(rms, 4), round(inside, 4), round(half, 4))


def all_estimators(
    bench: str, case: str, name: str, log: Log, rig: Rig, homing: float | None = None
) -> list[Record]:
    """Return the records of all estimators on a log."""
    can = homing is not None or (rig.map is not None and rig.map.readings)
    able = [one for one in ESTIMATORS if one != "regression" or can]
    return [score(bench, case, name, log, rig, estimator, homing) for estimator in able]


def known_rig(rig: Rig, plant: dict[str, Any]) -> Rig:
    """Return the rig with the plant's values and no std but that of the first angle."""
    raw = rig.with_values(plant).model_dump()

    def visit(part: Any) -> None:
        if isinstance(part, dict) and "value" in part and "std" in part:
            part["std"], part["shared"] = 0.0, None
        elif isinstance(part, (dict, list, tuple)):
            for inner in part.values() if isinstance(part, dict) else part:
                visit(inner)

    visit(raw)
    for i, joint in enumerate(rig.joints):
        raw["joints"][i]["initial"]["std"] = joint.initial.std
    return build_rig(raw, rig.name)


def score_known(
    bench: str, case: str, name: str, log: Log, rig: Rig, plant: dict[str, Any]
) -> Record:
    """Return what `adaptive` makes of a log when it knows the plant."""
    return replace(
        score(bench, case, name, log, known_rig(rig, plant), "adaptive"), estimator=KNOWN
    )


@dataclass(frozen=True)
class Table:
    """A table of numbers: rows are found by their labels.

    Args:
        name: of its file.
        title: what it shows.
        labels: columns of words.
        columns: (name, decimals) of the columns of numbers.
        rows: labels → numbers, NaN where there is none.
    """

    name: str
    title: str
    labels: tuple[str, ...]
    columns: tuple[tuple[str, int], ...]
    rows: dict[tuple[str, ...], tuple[float, ...]]


POOLED = (
    ("logs", 0),
    ("RMS [°]", 2),
    ("mean of logs [°]", 2),
    ("worst log [°]", 2),
    ("inside 95 % band [%]", 0),
    ("half-width / RMS", 1),
    ("diverged or refused", 0),
)


def pooled(records: Sequence[Record]) -> tuple[float, ...]:
    """Return the numbers of `POOLED`: errors pooled over logs, the other means over logs."""
    rms = float(np.sqrt(np.mean([one.rms**2 for one in records])))
    return (
        float(len(records)),
        rms,
        float(np.mean([one.rms for one in records])),
        max(one.rms for one in records),
        100.0 * float(np.mean([one.inside for one in records])),
        float(np.mean([one.half for one in records])) / rms,
        float(sum(1 for one in records if one.note)),
    )


def by_case(bench: str, title: str, records: Sequence[Record], together: str = "") -> Table:
    """Return the table of a bench: a row per case and estimator, and one of all cases where
    `together` names it.
    """
    rows: dict[tuple[str, ...], tuple[float, ...]] = {}
    cases = list(dict.fromkeys(one.case for one in records))
    estimators = list(dict.fromkeys(one.estimator for one in records))
    for case in [*cases, *([together] if together else [])]:
        for estimator in estimators:
            chosen = [
                one
                for one in records
                if one.estimator == estimator and case in (one.case, together)
            ]
            if chosen:
                rows[(case, estimator)] = pooled(chosen)
    return Table(f"strangers-{bench}", title, ("case", "estimator"), POOLED, rows)
