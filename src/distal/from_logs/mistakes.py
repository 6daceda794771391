"""Mistakes in logs that would make a wrong rig: each is named before anything is written.

A log may be unlike the others: swapped or mirrored columns, another unit, another rig. All drives
are regressed on all joints; where one log is left out and the others then agree far better, that
log is odd. The change that makes it like the others says why.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from math import pi

import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.from_logs.column_values import ColumnRole, longest_run
from distal.from_logs.motion_data import MotionData, scaled_solution
from distal.from_logs.raw_log import RawLog
from distal.logs import Log
from distal.regression import FEWEST_LOGS

OTHER_UNIT = 1000.0**0.5
"""Ratio of the sampling rates of two logs from which on a unit of time is wrong [1]. Source:
definition (nearer to that of two units than to one).
"""

STILL_MOVES = 0.5
"""Share of its range that each drive moves while a stuck reference has one value [1]. Source:
judgement.
"""

ODD = 3.0
"""Ratio of the residuals with a log and without it, from which on it is odd; a change after which
it is smaller explains that [1]. Source: judgement.
"""

OF_ANOTHER_RIG = 0.1
"""Residual of a log by the others, per RMS of a drive's motion, from which on nothing is learned
from it [1]. Source: judgement (moment arms that differ by a tenth).
"""

FACTORS = {
    -1.0: "counts the other way than in the others",
    180.0 / pi: "is in degrees, where the others are in radians",
    pi / 180.0: "is in radians, where the others are in degrees",
    1000.0: "is a thousand times as large as in the others",
    0.001: "is a thousandth of what it is in the others",
}
"""Factor of a column → what it says. Source: definition (units)."""


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


def mistakes(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each mistake because of which no rig can be written."""
    sentences = [*_other_rates(raw, columns)]
    for log in raw:
        sentences += _still(log, columns)
    return sentences or [text for text, stops in odd_logs(data, columns) if stops]


def remarks(
    raw: Sequence[RawLog], columns: Sequence[ColumnRole], data: Sequence[MotionData]
) -> list[str]:
    """Return a sentence for each thing in the logs that a rig can be written in spite of."""
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
    return [*lines, *(text for text, _ in odd_logs(data, columns))]


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
            np.ptp(values[rows]) > STILL_MOVES * max(np.ptp(values), 1e-300) for values in drives
        ):
            yield (
                f"{log.source}: {header} stays at {log.columns[header][rows.start]:g} for "
                f"{count} samples while all drives move: is it stuck? Leave these cells empty"
            )


def odd_logs(
    logs: Sequence[MotionData], columns: Sequence[ColumnRole]
) -> Iterator[tuple[str, bool]]:
    """Yield a sentence on the log that is not like the others, and whether no rig must be learned
    from all of them; nothing where all are alike.

    Args:
        logs: with known angles.
        columns: of the drives and the joints.
    """
    usable = [log for log in logs if np.isfinite(log.angles).all(axis=1).sum() > 1]
    if len(usable) < FEWEST_LOGS:
        return
    rests = [[log for log in usable if log is not left] for left in usable]
    alone = np.array([_residual(rest, rest) for rest in rests])
    worst = int(np.argmin(np.max(alone, axis=1)))
    limit = ODD * np.maximum(alone[worst], 1e-12)
    if (_residual(usable, usable) < limit).all():
        return
    log = usable[worst]
    rest = rests[worst]
    for text, changed in _changes(log, columns):
        if (_residual(rest, [changed]) < limit).all():
            yield f"{log.source}: {text}; correct the file", True
            return
    unlike = float(np.max(_residual(rest, [log])))
    if unlike < OF_ANOTHER_RIG:
        yield (
            f"{log.source} differs from the other logs by {100 * unlike:.0f} % of a drive's "
            "motion: slack, a load, or a changed tendon",
            False,
        )
        return
    yield (
        f"{log.source} does not agree with the other logs: is it of another rig, or was a tendon "
        "changed? Leave it out",
        True,
    )


def _regression(log: MotionData, drive: int) -> tuple[Floats, Floats]:
    """Return the columns of a drive's regression and the drive, each about its mean."""
    usable = np.isfinite(log.angles).all(axis=1)
    columns = [log.angles[usable], log.directions[usable, drive][:, None]]
    effort = log.efforts[usable, drive]
    if np.isfinite(effort).all():
        columns.append(effort[:, None])
    matrix = np.column_stack(columns)
    target = log.positions[usable, drive]
    return matrix - matrix.mean(axis=0), target - target.mean()


def _residual(training: Sequence[MotionData], tested: Sequence[MotionData]) -> Floats:
    """Return the RMS residual of each drive per RMS of its motion in the training logs."""
    residuals = []
    for drive in range(training[0].positions.shape[1]):
        parts = [_regression(log, drive) for log in training]
        target = np.concatenate([values for _, values in parts])
        coefficients, _ = scaled_solution(np.vstack([matrix for matrix, _ in parts]), target)
        errors = [
            values - matrix @ coefficients
            for matrix, values in (_regression(log, drive) for log in tested)
        ]
        scale = max(float(np.std(target)), 1e-300)
        residuals.append(np.sqrt(np.mean(np.concatenate(errors) ** 2)) / scale)
    return np.array(residuals)


def _changes(log: MotionData, columns: Sequence[ColumnRole]) -> Iterator[tuple[str, MotionData]]:
    """Yield what may be wrong with a log, the simplest first, and the log without it."""
    drives = _headers(columns, "position")
    joints = _headers(columns, "angle")
    for factor, text in FACTORS.items():
        for d, name in enumerate(drives):
            factors = np.where(np.arange(len(drives)) == d, factor, 1.0)
            directions = log.directions * np.sign(factors)
            changed = replace(log, positions=log.positions / factors, directions=directions)
            yield f"{name} {text}", changed
        for j, name in enumerate(joints):
            factors = np.where(np.arange(len(joints)) == j, factor, 1.0)
            yield f"{name} {text}", replace(log, angles=log.angles / factors)
        yield f"{', '.join(joints)}: each {text}", replace(log, angles=log.angles / factor)
    for a, b in combinations(range(len(drives)), 2):
        order = _swapped(len(drives), a, b)
        moved = replace(log, positions=log.positions[:, order], directions=log.directions[:, order])
        efforts = log.efforts[:, order]
        these = f"{drives[a]} and {drives[b]}"
        yield f"{these} are swapped", moved
        yield f"all columns of {these} are swapped", replace(moved, efforts=efforts)
        yield f"the forces beside {these} are swapped", replace(log, efforts=efforts)
    for a, b in combinations(range(len(joints)), 2):
        angles = log.angles[:, _swapped(len(joints), a, b)]
        yield f"{joints[a]} and {joints[b]} are swapped", replace(log, angles=angles)


def _swapped(n: int, a: int, b: int) -> list[int]:
    return [{a: b, b: a}.get(i, i) for i in range(n)]
