"""Mistakes in logs that would make a wrong rig: each is named before anything is written.

A log may be unlike the others: swapped or mirrored columns, another unit, another rig. All drives
are regressed on all joints; where one log is left out and the others then agree far better, that
log is odd.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.from_logs.column_values import ColumnRole, longest_run
from distal.from_logs.motion_data import THRESHOLDS, MotionData, scaled_solution
from distal.from_logs.raw_log import FEWEST_ROWS, RawLog
from distal.from_logs.which_drive_moves_what import Fold, folds_of, pooled
from distal.logs import Log, jumps_away, said_of_jumps
from distal.regression import FEWEST_LOGS

OTHER_UNIT = 1000.0**0.5
"""Ratio of the sampling rates of two logs from which on a unit of time is wrong [1]. Source:
definition (nearer to that of two units than to one).
"""


def left_columns(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], lacking: Mapping[str, str]
) -> list[str]:
    """Return sentences on columns that hold no numbers, and on those that some logs lack.

    Raises:
        RigError: a log lacks the position or the effort of a drive.
    """
    notes = []
    texts = dict.fromkeys(name for log in raw for name in log.texts)
    if texts:
        notes.append(f"these columns hold text and are left out: {', '.join(texts)}")
    for column in columns:
        if column.header not in lacking or column.role in ("other", "command"):
            continue
        where = lacking[column.header]
        if column.role != "angle":
            raise RigError(
                f"'{column.header}' has no values in {where}; give it there, or leave it out by "
                "--ignore"
            )
        notes.append(f"{column.header} has no values in {where}: nothing is learned of it there")
    return notes


def remarks(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each thing in the logs that a rig can be written in spite of.

    Raises:
        RigError: no rig can be written because of a mistake, or of several.
    """
    wrong = [*_other_rates(raw, columns)]
    for log in raw:
        wrong += _still(log, columns)
    if wrong:
        raise RigError("; ".join(wrong))
    (name,) = _headers(columns, "time")
    headers = _headers(columns, "position", "effort", "angle")
    lines = []
    for log in raw:
        gaps = Log(log.columns[name], {}).gaps()
        if gaps:
            lines.append(f"{log.source}: rows are missing at {len(gaps)} places: {name} jumps")
        lines += [
            f"{log.source}: {header} jumps away and back {count} times: taken as missing"
            for header, count in log.wild.items()
            if header in headers
        ]
        for header in _headers(columns, "angle"):
            away = jumps_away(log.columns[header])
            if away.any():
                lines.append(f"{log.source}: {header} {said_of_jumps(log.columns[header], away)}")
    return [*lines, *odd_log(data)]


def _headers(columns: Sequence[ColumnRole], *roles: str) -> list[str]:
    return [column.header for column in columns if column.role in roles]


def _other_rates(raw: Sequence[RawLog], columns: Sequence[ColumnRole]) -> Iterator[str]:
    (name,) = _headers(columns, "time")
    steps = [float(np.median(np.diff(log.columns[name]))) for log in raw]
    usual = float(np.median(steps))
    for log, step in zip(raw, steps):
        if max(step, usual) > OTHER_UNIT * min(step, usual):
            yield (
                f"{log.source}: {name} steps by {step:g}, in the other logs by {usual:g}; is it in "
                "another unit? Correct the file"
            )


def _still(log: RawLog, columns: Sequence[ColumnRole]) -> Iterator[str]:
    """Yield a sentence on each column that never changes, or not while all drives move."""
    drives = [log.columns[header] for header in _headers(columns, "position")]
    for header in _headers(columns, "position", "angle"):
        there = np.flatnonzero(np.isfinite(log.columns[header]))
        if not len(there):
            continue
        first, count = longest_run(log.columns[header][there])
        rows = slice(there[first], there[first + count - 1] + 1)
        if count == len(there):
            yield f"{log.source}: {header} never changes there; leave this log out"
        elif all(
            np.ptp(values[rows]) > THRESHOLDS.still_moves * max(np.ptp(values), 1e-300)
            for values in drives
        ):
            yield (
                f"{log.source}: {header} stays at {log.columns[header][rows.start]:g} for "
                f"{count} samples while all drives move: is it stuck? Leave these cells empty"
            )


def odd_log(logs: Sequence[MotionData]) -> list[str]:
    """Return a sentence on the log that is a little unlike the others; none where all are alike.

    Raises:
        RigError: it is so unlike that no rig must be learned from all of them.
    """
    usable = [log for log in logs if np.isfinite(log.angles).all(axis=1).sum() >= FEWEST_ROWS]
    if len(usable) < FEWEST_LOGS:
        return []
    drives = [folds_of(usable, d) for d in range(logs[0].positions.shape[1])]
    indices = list(range(len(usable)))
    rests = [[k for k in indices if k != left] for left in indices]
    alone = np.array([_residual(drives, rest, rest) for rest in rests])
    worst = int(np.argmin(np.max(alone, axis=1)))
    alike = THRESHOLDS.odd * np.maximum(alone[worst], 1e-12)
    if (_residual(drives, indices, indices) < alike).all():
        return []
    log = usable[worst]
    unlike = float(np.max(_residual(drives, rests[worst], [worst])))
    if unlike >= THRESHOLDS.of_another_rig:
        raise RigError(
            f"{log.source} does not agree with the other logs: are columns swapped, mirrored or in "
            "another unit there, or is it of another rig? Correct the file, or leave it out"
        )
    return [
        f"{log.source} differs from the other logs by {100 * unlike:.0f} % of a drive's motion: "
        "slack, a load, a changed tendon, or forces in other columns"
    ]


def _residual(
    drives: Sequence[Sequence[Fold]], training: Sequence[int], tested: Sequence[int]
) -> Floats:
    """Return the RMS residual of each drive in some logs, per RMS of its motion in those by which
    all joints explain it.
    """
    residuals = []
    for folds in drives:
        joints = range(folds[0].angles.shape[1])
        columns, target = pooled([folds[k] for k in training], joints)
        matrix, values = pooled([folds[k] for k in tested], joints)
        errors = values - matrix @ scaled_solution(columns, target)[0]
        residuals.append(np.sqrt(np.mean(errors**2)) / max(float(np.std(target)), 1e-300))
    return np.array(residuals)
