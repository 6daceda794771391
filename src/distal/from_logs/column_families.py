"""Roles of columns whose names say nothing, such as a0, a1, b0, b1: by family, from the values."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from itertools import combinations

import numpy as np

from distal.arrays import Floats
from distal.from_logs.column_names import CLEAR_WORD, NameEvidence, Role
from distal.from_logs.least_squares import scaled_solution
from distal.from_logs.raw_log import RawLog

MOVES = 0.8
"""Share of the variance that drives and joints explain of each other, at least: of a force they
explain less. Source: benchmark (benchmarks/from_logs columns, rigs drawn from 7000 on).
"""

ALIKE = 0.95
"""Share from which on a third family moves as the drives do: commands, not forces. Source:
judgement.
"""

LONGEST_LAG = 20
"""Samples by which a joint may follow its drives. Source: judgement."""

FAMILIES = (2, 3)
"""So many families of columns without names are told apart: positions and angles, and forces.
Source: definition (what a log needs to show a rig).
"""


def find_families(
    logs: Sequence[RawLog],
    scores: dict[str, dict[Role, float]],
    names: Mapping[str, NameEvidence],
    left: Collection[str],
) -> list[str]:
    """Set the scores of columns whose names say nothing, where none says more, and return them.

    Drives and joints explain each other, and a force is the family that they explain less. Drives
    are as many as forces, or lead the joints. Where neither tells, or a third family moves as these
    do, nothing is changed.

    Args:
        logs: all of them.
        scores: header → role → score; changed in place.
        names: header → what its name says.
        left: headers whose role is known: the time, constants, what a user gave.
    """
    headers = [header for header in scores if header not in left]
    families = dict[str, list[str]]()
    for header in headers:
        if max(names[header].scores.values()) > 0.0 or names[header].si is not None:
            return []  # this name tells something: `find_joints` goes on from it
        families.setdefault(header.rstrip("0123456789"), []).append(header)
    log = max(logs, key=lambda log: log.rows)
    columns = {stem: _columns(log, of) for stem, of in families.items()}
    pairs = list(combinations(families, 2))
    if len(families) not in FAMILIES or log.rows <= 2 * LONGEST_LAG + len(headers):
        return []
    shared = [min(_explained(columns[a], columns[b], 0) for a, b in (p, p[::-1])) for p in pairs]
    first, second = pairs[int(np.argmax(shared))]
    forces = [stem for stem in families if stem not in (first, second)]
    if max(shared) < MOVES or (forces and sorted(shared)[-2] > ALIKE):
        return []
    counts = [len(families[stem]) for stem in (*forces, first, second)]
    if forces and (counts[0] == counts[1]) != (counts[0] == counts[2]):
        drives = first if counts[0] == counts[1] else second
    else:
        lags = range(-LONGEST_LAG, LONGEST_LAG + 1)
        follows = lags[
            int(np.argmax([_explained(columns[first], columns[second], lag) for lag in lags]))
        ]
        if follows == 0:
            return []
        drives = first if follows > 0 else second
    joints = second if drives == first else first
    role_of: dict[str, Role] = {drives: "position", joints: "angle"}
    for stem, of in families.items():
        for header in of:
            role = role_of.get(stem, "effort")
            scores[header] = dict.fromkeys(scores[header], 0.0) | {role: CLEAR_WORD}
    return headers


def _columns(log: RawLog, headers: Sequence[str]) -> Floats:
    """Return columns less their means, missing values filled between their neighbours."""
    rows = np.arange(log.rows)
    filled = []
    for header in headers:
        values = log.columns[header]
        present = np.isfinite(values)
        is_empty = not present.any()
        filled.append(0.0 * rows if is_empty else np.interp(rows, rows[present], values[present]))
    matrix = np.column_stack(filled)
    centred: Floats = matrix - matrix.mean(axis=0)
    return centred


def _explained(causes: Floats, effects: Floats, lag: int) -> float:
    """Return the least share of the variance of one of the `effects`, (k, n), that the `causes`,
    (k, m), explain `lag` samples before.
    """
    rows = len(causes) - 2 * LONGEST_LAG
    matrix = causes[LONGEST_LAG - lag :][:rows]
    shares = []
    for effect in effects[LONGEST_LAG:][:rows].T:
        _, left = scaled_solution(matrix, effect)
        shares.append(1.0 - left**2 / max(float(np.mean(effect**2)), 1e-300))
    return min(shares)
