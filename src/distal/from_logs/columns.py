"""What each column of some logs is: its role, its unit, whose it is, and how sure that is."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from distal.errors import LogError, did_you_mean
from distal.from_logs.column_names import (
    LIKELY,
    ROLES,
    SURE,
    NameEvidence,
    Role,
    name_evidence,
    with_families,
)
from distal.from_logs.column_values import (
    ColumnRole,
    Sureness,
    ValueEvidence,
    value_evidence,
    with_units,
)
from distal.from_logs.raw_log import RawLog, time_column
from distal.logs import name_and_unit, says_nothing
from distal.rig import name_of

CERTAIN = 99.0
"""How much a user's word speaks for a role [1]. Source: definition (more than any name)."""


@dataclass(frozen=True)
class Overrides:
    """What a user says of columns.

    Args:
        truth: headers of joints' reference angles.
        drives: header of a drive's position → its unit, or empty.
        ignore: headers that are none of this.
    """

    truth: tuple[str, ...] = ()
    drives: Mapping[str, str] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()


def column_roles(logs: Sequence[RawLog], overrides: Overrides) -> list[ColumnRole]:
    """Return what each column of some logs is, which have the same columns, in their order.

    Raises:
        LogError: none is a time, a unit is not known, or an override names a column that is not
            there, or the time.
    """
    headers = list(logs[0].columns)
    drives = {_header(name, headers): unit for name, unit in overrides.drives.items()}
    roles_by_name: dict[str, Role] = {_header(name, headers): "angle" for name in overrides.truth}
    roles_by_name |= dict.fromkeys(drives, "position")
    roles_by_name |= {_header(name, headers): "other" for name in overrides.ignore}
    names = with_families({header: name_evidence(header) for header in headers})
    values = {header: value_evidence([log.columns[header] for log in logs]) for header in headers}
    time = time_column(logs, headers, names)
    if time in roles_by_name:
        raise LogError(f"'{time}' is the only column that increases: it is the time")
    # nothing else is a second time
    constant = {
        header
        for header in headers
        if values[header].is_constant or _best(names[header].scores) == "time"
    }
    scores = {header: {**names[header].scores, "time": -CERTAIN} for header in headers}
    known: dict[str, Role] = {**dict.fromkeys(constant, "other"), time: "time", **roles_by_name}
    for header, role in known.items():
        scores[header][role] = CERTAIN
    open_headers = [header for header in headers if header not in known]
    _tell_joints(scores, open_headers, names)
    found = []
    for header in headers:
        column = _role(header, scores[header], names[header], values[header])
        if column.role != "other" and names[header].unknown_unit:
            raise LogError(
                f"column '{header}': the unit '{names[header].unknown_unit}' is not known; rename "
                "the column with one like mm, deg, N, N mm, mA or counts, or leave it out by "
                "--ignore"
            )
        if header in roles_by_name:
            column = replace(column, sureness="sure")
        if column.role == "effort":
            why = says_nothing(np.concatenate([log.columns[header] for log in logs]))
            if why is not None:
                column = replace(column, role="other", evidence=why)
        found.append(column)
    return with_units(_with_parts(found, names), names, drives)


def _header(name: str, headers: Sequence[str]) -> str:
    """Return the header of a column by that, or by its name without the unit.

    Raises:
        LogError: no column is called so.
    """
    for header in headers:
        if name in (header, name_and_unit(header)[0]):
            return header
    raise LogError(f"there is no column '{name}' in these logs{did_you_mean(name, headers)}")


def _tell_joints(
    scores: Mapping[str, dict[Role, float]],
    headers: Sequence[str],
    names: Mapping[str, NameEvidence],
) -> None:
    """Take columns that may be drives or joints for the ones where names tell only the others.
    Where names tell both, those whose names say nothing are passed over; where they tell neither,
    the last one may be a joint's. `scores` are changed in place.
    """
    movers = [h for h in headers if _best(scores[h]) in ("position", "angle")]
    margins = {h: names[h].scores["position"] - names[h].scores["angle"] for h in movers}
    unclear = [header for header in movers if abs(margins[header]) < LIKELY]
    named: set[Role] = {_best(names[header].scores) for header in {*movers} - {*unclear}}
    for header in unclear:
        if len(named) > 1 and names[header].says_nothing:
            scores[header]["other"] += LIKELY
        elif len(named) == 1:
            scores[header]["angle" if "position" in named else "position"] += 2.0 * LIKELY
    if unclear and not named:
        scores[unclear[-1]]["angle"] += LIKELY / 2.0


def _best(scores: Mapping[Role, float]) -> Role:
    return max(scores, key=lambda role: scores[role])


def _role(
    header: str, scores: Mapping[Role, float], name: NameEvidence, values: ValueEvidence
) -> ColumnRole:
    """Return the best role of a column, with how sure it is."""
    best = _best(scores)
    role: Role = best if scores[best] > 0.0 or name.says_nothing else "other"
    margin = scores[best] - max(0.0, *(scores[each] for each in scores if each != best))
    sureness: Sureness = "a guess"
    if values.is_constant or role == "time" or name.scores[role] > 0.0:
        sureness = "sure" if margin >= SURE else "likely" if margin >= LIKELY else "a guess"
    reasons = ["its name says so"] if name.scores[role] >= LIKELY else []
    if values.is_constant:
        reasons.append("its value never changes")
    else:
        reasons.append(f"values from {values.low:.4g} to {values.high:.4g}")
    if values.turn is not None and role in ("position", "angle"):
        reasons.append(f"wraps after {values.turn:.6g}")
    elif values.step > 0.0:
        reasons.append(f"in steps of {values.step:.3g}")
    elif values.noise > 0.0:
        reasons.append(f"noise {values.noise:.2g}")
    return ColumnRole(header, role, "", "", "", sureness, "a guess", ", ".join(reasons), values)


def _with_parts(
    columns: Sequence[ColumnRole], names: Mapping[str, NameEvidence]
) -> list[ColumnRole]:
    """Return columns with the drive or joint that each is of. An effort or a command is of the
    drive of its name, else of the next one in order.
    """
    parts: dict[Role, dict[str, str]] = {role: {} for role in ROLES}
    for column in columns:
        of_role = parts[column.role]
        kind, otherwise = ("joint", "joint") if column.role == "angle" else ("m", "motor")
        subject = names[column.header].subject
        name = name_of(f"{kind}{subject}" if subject[:1].isdigit() else subject or otherwise, kind)
        if name in of_role.values() or (not subject and of_role):
            name = f"{name}_{len(of_role) + 1}"
        of_role[column.header] = name
    drives = list(parts["position"].values())
    for role in ("effort", "command"):
        left = [drive for drive in drives if drive not in parts[role].values()]
        unmatched = [header for header, name in parts[role].items() if name not in drives]
        parts[role] |= dict(zip(unmatched, left))
    return [
        replace(c, part="" if c.role in ("time", "other") else parts[c.role][c.header])
        for c in columns
    ]
