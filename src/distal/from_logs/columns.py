"""What each column of some logs is: its role, its unit, whose it is, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

from distal.arrays import Floats
from distal.errors import LogError
from distal.from_logs.column_families import find_families
from distal.from_logs.column_names import CLEAR, NameEvidence, Role, name_evidence
from distal.from_logs.column_parts import named_columns
from distal.from_logs.column_role import ColumnRole, Overrides, Sureness
from distal.from_logs.column_scores import (
    CLEARLY,
    LIKELY,
    find_commands,
    find_joints,
    scores_of,
    time_column,
)
from distal.from_logs.column_units import (
    check_unit,
    with_common_units,
    with_forces_of_sliders,
    with_torques,
    with_unit,
)
from distal.from_logs.column_values import ValueEvidence, unwrapped, value_evidence
from distal.from_logs.raw_log import RawLog
from distal.logs import name_and_unit
from distal.suggestions import did_you_mean

BY_FAMILY = "by its values beside those of the others, as its name says nothing"


def column_roles(logs: Sequence[RawLog], overrides: Overrides) -> list[ColumnRole]:
    """Return what each column of some logs is, which have the same columns, in their order.

    Raises:
        LogError: none is a time, a unit is not known, or an override names a column that is not
            there, or the time.
    """
    headers = list(logs[0].columns)
    drives = {_header(name, headers): unit for name, unit in overrides.drives.items()}
    truth = [_header(name, headers) for name in overrides.truth]
    ignored = [_header(name, headers) for name in overrides.ignore]
    names = {header: name_evidence(header) for header in headers}
    values = {header: value_evidence([log.columns[header] for log in logs]) for header in headers}
    time = time_column(logs, headers, names)
    scores = {header: scores_of(header, time, names, values) for header in headers}
    for header in truth:
        scores[header] = dict.fromkeys(CLEAR, 0.0) | {"angle": 99.0}
    for header in drives:
        scores[header] = dict.fromkeys(CLEAR, 0.0) | {"position": 99.0}
    for header in ignored:
        scores[header] = dict.fromkeys(CLEAR, 0.0) | {"other": 99.0}
    overruled = {*truth, *drives, *ignored}
    if time in overruled:
        raise LogError(f"'{time}' is the only column that increases: it is the time")
    find_commands(logs, scores, overruled)
    find_joints(logs, scores, names, overruled)
    constant = [header for header in headers if values[header].is_constant]
    by_family = find_families(logs, scores, names, {time, *constant, *overruled})
    roles = [_role(header, scores[header], names[header], values[header]) for header in headers]
    for column in roles:
        check_unit(column, names[column.header])
    roles = [
        replace(column, sureness="sure") if column.header in overruled else column
        for column in roles
    ]
    roles = [
        replace(column, sureness="likely", evidence=f"{column.evidence}, {BY_FAMILY}")
        if column.header in by_family
        else column
        for column in roles
    ]
    roles = [with_unit(column, names[column.header], drives) for column in roles]
    return with_forces_of_sliders(with_torques(named_columns(with_common_units(roles), names)))


def _header(name: str, headers: Sequence[str]) -> str:
    """Return the header of a column by that, or by its name without the unit.

    Raises:
        LogError: no column is called so.
    """
    for header in headers:
        if name in (header, name_and_unit(header)[0]):
            return header
    raise LogError(f"there is no column '{name}' in these logs{did_you_mean(name, headers)}")


def _role(
    header: str, scores: Mapping[Role, float], name: NameEvidence, values: ValueEvidence
) -> ColumnRole:
    """Return the best role of a column, with how sure it is."""
    ordered = sorted(scores, key=lambda role: -scores[role])
    role: Role = ordered[0] if scores[ordered[0]] > 0.0 else "other"
    margin = scores[ordered[0]] - max(scores[ordered[1]], 0.0)
    sureness: Sureness = "a guess"
    if values.is_constant or role == "time" or name.scores[role] > 0.0:
        if margin >= CLEARLY:
            sureness = "sure"
        elif margin >= LIKELY:
            sureness = "likely"
    reasons = [f"values from {values.low:.4g} to {values.high:.4g}"]
    if values.is_constant:
        reasons = ["its value never changes"]
    elif values.turn is not None and role in ("position", "angle"):
        reasons.append(f"wraps after {values.turn:.6g}")
    elif values.step > 0.0:
        reasons.append(f"in steps of {values.step:.3g}")
    elif values.noise > 0.0:
        reasons.append(f"noise {values.noise:.2g}")
    if name.scores[role] > 0.0 and name.scores[role] >= LIKELY:
        reasons.insert(0, "its name says so")
    return ColumnRole(header, role, "", "", "", sureness, "a guess", ", ".join(reasons), values)


def in_si(column: ColumnRole, values: Floats, factor: float) -> Floats:
    """Return a column's values without wraps, times the factor of its unit."""
    if column.values.turn is not None:
        values = unwrapped(values, column.values.turn)
    return values * factor
