"""Which drive moves which joints, by least squares on logs left out.

At rest a drive at s with effort e pulls its tendon over joints at θ:

    s = c + Σ_j a_j θ_j + b e + g d

with a_j the moment arm over the lever of the drive, b the compliance of the tendon at the drive, d
in [−1, 1] the direction in which the drive last moved (friction along the cable), and c its zero,
which may differ from log to log. A drive is regressed on the joints, not the other way round: the
references of joints have the smaller errors. Which joints it moves is judged by all samples. Sizes
are from those in which the drive moves: in a drive at rest friction may have any value up to its
limit, by which b would come out too small. So it would by friction and noise as errors of the
effort: where positions tell the effort well, that is regressed instead. Where they are clear, two
terms are added, with the mean effort ē: h d (e − ē), friction that grows with the load, and
q (e − ē)², a tendon that stiffens.

Mistakes in logs that would make a wrong rig: each is named before anything is written.

A log may be unlike the others: swapped or mirrored columns, another unit, another rig. All drives
are regressed on all joints; where one log is left out and the others then agree far better, that
log is odd.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import NamedTuple

import numpy as np

from distal.arrays import Floats
from distal.errors import RigError
from distal.from_logs.column_names import Columns, longest_run, of_role
from distal.from_logs.motion_data import (
    BETTER,
    THRESHOLDS,
    WITHIN,
    Equations,
    Logs,
    RawLog,
    left_out,
    rms,
    scaled_solution,
    stacked,
)
from distal.logs import Log, jumps_away, said_of_jumps
from distal.logs.raw_to_si import FEWEST
from distal.regression import FEWEST_LOGS

BLOCKS = 5
"""Parts of a log whose errors are compared in pairs, each left out in turn where there is one log
only [1]. Source: reference (fivefold cross-validation; Breiman and Spector 1992).
"""


SMALLEST_SHARE = 0.03
"""A joint whose motion moves the drive by less than this share of its range is not crossed [1].
Source: benchmark (`python -m benchmarks.from_logs structure --rigs 80 --first-seed 9700`: 80 right
with 0.05, 79 with 0.03, of 40 37 with 0.02; `python -m benchmarks.positions_only`: a coupling of
4 % that is left out costs 0.6°).
"""


EXPLAINED = 0.5
"""A drive moves joints if they explain at least this share of its variance, has an inertia of its
own that is at least this share of all that it moves, and tells its effort by its position if that
explains so much of it [1]. Source: definition (more than is left).
"""


@dataclass(frozen=True)
class DriveStructure:
    """What one drive moves.

    Args:
        joints: indices of the joints.
        ratios: a of each of them [m/rad or 1].
        ratio_stds: their standard errors over logs left out.
        compliance: b [m/N, rad/(N m) or rad/A]; NaN without a sensor of effort.
        compliance_std: its standard error.
        hysteresis: g [m or rad].
        growth: h per effort, 0 where it is not clear.
        growth_std: its standard error.
        curvature: q per effort squared, 0 where it is not clear.
        curvature_std: its standard error.
        effort: ē, 0 without a sensor of effort.
        zero: mean of c over the logs, at zero effort.
        zero_spread: standard deviation of c between logs.
        explained: share of the drive's variance that the joints alone explain there.
        rival: the other set of joints whose error is within two standard errors, empty if there is
            none.
    """

    joints: tuple[int, ...]
    ratios: Floats
    ratio_stds: Floats
    compliance: float
    compliance_std: float
    hysteresis: float
    growth: float
    growth_std: float
    curvature: float
    curvature_std: float
    effort: float
    zero: float
    zero_spread: float
    explained: float
    rival: tuple[int, ...]

    @property
    def knows_compliance(self) -> bool:
        """Whether b is clear of its error."""
        return abs(self.compliance) > WITHIN * self.compliance_std

    def friction(self, efforts: Floats) -> Floats:
        """Return the effort that friction takes while the drive moves, f = −(g + h (e − ē))/b, at
        some efforts; 0 where b is not clear.
        """
        if not self.knows_compliance:
            return np.zeros_like(efforts)
        taken = self.hysteresis + self.growth * (efforts - self.effort)
        return np.asarray(-taken / self.compliance)


class Fold(NamedTuple):
    """A log for one drive: columns of the regression without a constant, and the drive."""

    angles: Floats
    others: Floats
    target: Floats


Folds = Sequence[Fold]
"""Several logs for one drive, or the parts of one."""


def drive_structure(logs: Logs, drive: int, free: Sequence[int]) -> DriveStructure | None:
    """Return what a drive moves of the joints that are `free`, by their indices; None where no log
    knows their angles.
    """
    folds = folds_of(logs, drive)
    if not folds:
        return None
    by_error = sorted(free, key=lambda j: _error(folds, (j,)))
    joints = sorted(by_error[: THRESHOLDS.joints_at_once])
    sizes = range(len(joints))
    candidates = [chosen for size in sizes for chosen in combinations(joints, size + 1)]
    errors = {joints: _block_errors(folds, joints) for joints in candidates}
    best = min(errors, key=lambda joints: np.mean(errors[joints]))
    beyond = {joints: _standard_errors(errors[joints] - errors[best]) for joints in candidates}
    # the simplest within one standard error (Breiman and others, 1984, section 3.4.3)
    near = [joints for joints in candidates if beyond[joints] <= 1.0]
    chosen = min(near, key=lambda joints: (len(joints), np.mean(errors[joints])))
    chosen = _without_small(folds, chosen)
    rivals = [
        joints
        for joints in candidates
        if beyond[joints] <= WITHIN and len(joints) == len(chosen) and joints != chosen
    ]
    return described(logs, drive, chosen, next(iter(rivals), ()))


def added_error(logs: Logs, drive: int, joints: tuple[int, ...], joint: int) -> float:
    """Return the mean squared error of a drive that moves one joint more than `joints`, on logs
    left out, over that without it.
    """
    folds = folds_of(logs, drive)
    return _error(folds, (*joints, joint)) / _error(folds, joints)


def folds_of(logs: Logs, drive: int, moving: bool = False) -> Folds:
    """Return the logs for one drive, of which only samples in which it is `moving` may count."""
    folds = []
    for log in logs:
        effort = log.efforts[:, drive]
        regressors = [log.directions[:, drive]]
        if np.isfinite(effort).all():
            regressors.append(effort)
        usable = log.is_known
        if moving and (usable & log.moves(drive)).sum() >= FEWEST:
            usable &= log.moves(drive)
        if usable.sum() < FEWEST:
            continue
        folds.append(
            Fold(
                log.angles[usable],
                np.column_stack(regressors)[usable],
                log.positions[usable, drive],
            )
        )
    if len(folds) == 1:
        return [Fold(*parts) for parts in zip(*(np.array_split(c, BLOCKS) for c in folds[0]))]
    return folds


def _centred(fold: Fold, joints: Sequence[int]) -> Equations:
    """Return columns and target of a log about their means: each log has a zero of its own."""
    columns = np.column_stack([fold.angles[:, joints], fold.others])
    return columns - columns.mean(axis=0), fold.target - fold.target.mean()


def pooled(folds: Folds, joints: Sequence[int]) -> Equations:
    """Return columns and target of several logs, each about its own mean."""
    return stacked(_centred(fold, joints) for fold in folds)


def _sizes(folds: Folds, joints: Sequence[int]) -> Floats:
    """Return the coefficients of least squares over several logs, by the regression of the effort
    on the others where that explains it well.

    Friction and noise are errors of the effort, not of the position. With the effort among the
    causes they would make the compliance too small (regression dilution; Fuller 1987, section 1.1).
    """
    columns, position = pooled(folds, joints)
    forward = scaled_solution(columns, position)
    effort = len(joints) + 1
    if len(forward) <= effort:
        return forward
    causes = np.column_stack([np.delete(columns, effort, axis=1), position])
    solution = scaled_solution(causes, columns[:, effort])
    compliance = 1.0 / solution[-1]
    # their ratio is the squared correlation of effort and position, given all else
    if forward[effort] / compliance < EXPLAINED:
        return forward
    return np.asarray(np.insert(-compliance * solution[:-1], effort, compliance))


def _block_errors(folds: Folds, joints: Sequence[int]) -> Floats:
    """Return mean squared errors of parts of each log, by the coefficients of the other logs."""
    residuals = left_out([_centred(fold, joints) for fold in folds])
    parts = [part for errors in residuals for part in np.array_split(errors, BLOCKS)]
    return np.array([np.mean(errors**2) for errors in parts])


def _error(folds: Folds, joints: Sequence[int]) -> float:
    """Return the mean of these errors."""
    return float(np.mean(_block_errors(folds, joints)))


def _standard_errors(differences: Floats) -> float:
    """Return the mean of differences of errors in pairs over its standard error; 0 of none."""
    standard_error = np.std(differences) / np.sqrt(max(len(differences) - 1, 1))
    return float(np.mean(differences) / max(standard_error, 1e-300))


def _without_small(folds: Folds, joints: tuple[int, ...]) -> tuple[int, ...]:
    """Return joints without those whose motion hardly moves the drive; the largest stays."""
    coefficients = scaled_solution(*pooled(folds, joints))
    widths = np.ptp(np.vstack([fold.angles[:, joints] for fold in folds]), axis=0)
    moved = np.abs(coefficients[: len(joints)]) * widths
    range_of_drive = np.ptp(np.concatenate([fold.target for fold in folds]))
    kept = tuple(j for j, way in zip(joints, moved) if way > SMALLEST_SHARE * range_of_drive)
    return kept or (joints[int(np.argmax(moved))],)


def described(
    logs: Logs, drive: int, joints: tuple[int, ...], rival: tuple[int, ...]
) -> DriveStructure:
    """Return what a drive moves if it moves these joints, and may as well move the `rival` ones:
    the coefficients of all logs, and their scatter over logs left out.
    """
    n = len(joints)
    folds = folds_of(logs, drive, moving=True)
    effort = 0.0
    forms: tuple[str, ...] = ()
    if folds[0].others.shape[1] > 1:
        effort = float(np.mean(np.concatenate([fold.others[:, 1] for fold in folds])))
        folds, forms = _with_clear_forms(folds, joints, effort)
    coefficients = _sizes(folds, joints)
    stds = _jackknife(folds, joints)
    terms = ("direction", "effort", *forms)
    unknown = {"effort": float("nan"), "growth": 0.0, "curvature": 0.0}
    by_term = unknown | dict(zip(terms, coefficients[n:].tolist()))
    errors = unknown | dict(zip(terms, stds[n:].tolist()))
    zeros = [
        np.mean(fold.target - np.column_stack([fold.angles[:, joints], fold.others]) @ coefficients)
        + by_term["curvature"] * effort**2
        for fold in folds
    ]
    alone = [fold._replace(others=fold.others[:, :0]) for fold in folds_of(logs, drive)]
    left = _error(alone, joints)
    total = np.var(pooled(alone, joints)[1])
    return DriveStructure(
        joints=joints,
        ratios=coefficients[:n],
        ratio_stds=stds[:n],
        compliance=by_term["effort"],
        compliance_std=errors["effort"],
        hysteresis=by_term["direction"],
        growth=by_term["growth"],
        growth_std=errors["growth"],
        curvature=by_term["curvature"],
        curvature_std=errors["curvature"],
        effort=effort,
        zero=float(np.mean(zeros)),
        zero_spread=float(np.std(zeros)),
        explained=1.0 - left / max(float(total), 1e-300),
        rival=rival,
    )


def _jackknife(folds: Folds, joints: Sequence[int]) -> Floats:
    """Return the standard errors of the coefficients, by their scatter over logs left out."""
    sizes = [_sizes([*folds[:k], *folds[k + 1 :]], joints) for k in range(len(folds))]
    return np.asarray(np.sqrt(len(folds) - 1) * np.std(sizes, axis=0))


def _with_clear_forms(
    folds: Folds, joints: Sequence[int], effort: float
) -> tuple[Folds, tuple[str, ...]]:
    """Return logs with the columns of those of the terms `growth` and `curvature`, about a mean
    `effort`, that help on logs left out, and these terms, the more helpful one first.
    """
    forms: tuple[str, ...] = ()
    least = _error(folds, joints)
    while left := [form for form in ("growth", "curvature") if form not in forms]:
        extended = {form: _with_form(folds, form, effort) for form in left}
        errors = {form: _error(extended[form], joints) for form in left}
        best = min(left, key=lambda form: errors[form])
        if errors[best] > BETTER**2 * least:
            break
        forms = (*forms, best)
        folds = extended[best]
        least = errors[best]
    return folds, forms


def _with_form(folds: Folds, form: str, effort: float) -> Folds:
    """Return logs with the column of a term about a mean `effort`."""
    extended = []
    for fold in folds:
        direction = fold.others[:, 0]
        beyond = fold.others[:, 1] - effort
        column = beyond * (direction if form == "growth" else beyond)
        extended.append(fold._replace(others=np.column_stack([fold.others, column])))
    return extended


OTHER_UNIT = 1000.0**0.5
"""Ratio of the sampling rates of two logs from which on a unit of time is wrong [1]. Source:
definition (nearer to that of two units than to one).
"""


def left_columns(raw: Sequence[RawLog], columns: Columns, lacking: Mapping[str, str]) -> list[str]:
    """Return sentences on columns that hold no numbers, and on those that some logs lack.

    Raises:
        RigError: a log lacks the position or the effort of a drive.
    """
    notes = []
    texts = dict.fromkeys(name for log in raw for name in log.texts)
    if texts:
        notes.append(f"these columns hold text and are left out: {', '.join(texts)}")
    for column in of_role(columns, "position", "effort", "angle", "time"):
        if column.header not in lacking:
            continue
        where = lacking[column.header]
        if column.role != "angle":
            raise RigError(
                f"'{column.header}' has no values in {where}; give it there, or leave it out by "
                "--ignore"
            )
        notes.append(f"{column.header} has no values in {where}: nothing is learned of it there")
    return notes


def remarks(raw: Sequence[RawLog], columns: Columns, data: Logs) -> list[str]:
    """Return a sentence for each thing in the logs that a rig can be written in spite of.

    Raises:
        RigError: no rig can be written because of a mistake, or of several.
    """
    name = of_role(columns, "time")[0].header
    steps = [np.median(np.diff(log.columns[name])) for log in raw]
    usual = np.median(steps)
    wrong = [
        f"{log.source}: {name} steps by {step:g}, in the other logs by {usual:g}; is it in another "
        "unit? Correct the file"
        for log, step in zip(raw, steps)
        if not 1.0 / OTHER_UNIT <= step / usual <= OTHER_UNIT
    ]
    for log in raw:
        wrong += _still(log, columns)
    if wrong:
        raise RigError("; ".join(wrong))
    headers = [column.header for column in of_role(columns, "position", "effort", "angle")]
    lines = []
    for log in raw:
        gaps = Log(log.columns[name], {}).gaps()
        if gaps:
            lines.append(f"{log.source}: rows are missing at {len(gaps)} places: {name} jumps")
        lines += [
            f"{log.source}: {header} jumps away and back {count} times: taken as missing"
            for header, count in log.wild.items()
            if count and header in headers
        ]
        for column in of_role(columns, "angle"):
            values = log.columns[column.header]
            away = jumps_away(values)
            if away.any():
                lines.append(f"{log.source}: {column.header} {said_of_jumps(values, away)}")
    return [*lines, *odd_log(data)]


def _still(log: RawLog, columns: Columns) -> Iterator[str]:
    """Yield a sentence on each column that never changes, or not while all drives move."""
    drives = [log.columns[column.header] for column in of_role(columns, "position")]
    for column in of_role(columns, "position", "angle"):
        header = column.header
        there = np.flatnonzero(np.isfinite(log.columns[header]))
        if not len(there):
            continue
        first, count = longest_run(log.columns[header][there])
        rows = slice(there[first], there[first + count - 1] + 1)
        if count == len(there):
            yield f"{log.source}: {header} never changes there; leave this log out"
        elif all(
            np.ptp(values[rows]) > THRESHOLDS.still_moves * np.ptp(values) for values in drives
        ):
            yield (
                f"{log.source}: {header} stays at {log.columns[header][rows.start]:g} for "
                f"{count} samples while all drives move: is it stuck? Leave these cells empty"
            )


def odd_log(logs: Logs) -> list[str]:
    """Return a sentence on the log that is a little unlike the others; none where all are alike.

    Raises:
        RigError: it is so unlike that no rig must be learned from all of them.
    """
    usable = [log for log in logs if log.is_known.sum() >= FEWEST]
    if len(usable) < FEWEST_LOGS:
        return []
    drives = [folds_of(usable, d) for d in range(logs[0].positions.shape[1])]
    indices = range(len(usable))
    rests = [[k for k in indices if k != left] for left in indices]
    alone = np.array([_residual(drives, rest, rest) for rest in rests])
    worst = int(np.argmin(np.max(alone, axis=1)))
    alike = THRESHOLDS.odd * np.maximum(alone[worst], 1e-12)
    if (_residual(drives, indices, indices) < alike).all():
        return []
    log = usable[worst]
    unlike = np.max(_residual(drives, rests[worst], [worst]))
    if unlike >= THRESHOLDS.of_another_rig:
        raise RigError(
            f"{log.source} does not agree with the other logs: are columns swapped, mirrored or in "
            "another unit there, or is it of another rig? Correct the file, or leave it out"
        )
    return [
        f"{log.source} differs from the other logs by {100 * unlike:.0f} % of a drive's motion: "
        "slack, a load, a changed tendon, or forces in other columns"
    ]


def _residual(drives: Sequence[Folds], training: Sequence[int], tested: Sequence[int]) -> Floats:
    """Return the RMS residual of each drive in some logs, per RMS of its motion in those by which
    all joints explain it.
    """
    residuals = []
    for folds in drives:
        joints = range(folds[0].angles.shape[1])
        columns, target = pooled([folds[k] for k in training], joints)
        matrix, values = pooled([folds[k] for k in tested], joints)
        errors = values - matrix @ scaled_solution(columns, target)
        residuals.append(rms(errors) / max(float(np.std(target)), 1e-300))
    return np.array(residuals)
