"""How much names, values and other columns speak for each role of a column."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.from_logs.column_names import NameEvidence, Role
from distal.from_logs.column_values import ValueEvidence
from distal.from_logs.raw_log import RawLog

CLEARLY = 2.5
"""Margin of the best role before the next from which it is sure [1], a logarithm of odds. Source:
judgement.
"""


LIKELY = 1.0
"""The same from which it is likely [1]. Source: judgement."""


SPEAKS = 0.7
"""How much one property of the values speaks for a role. Source: judgement."""


ROUGH = 3e-3
"""Noise per range above which a force is likely [1]. Source: judgement."""


SMOOTH = 3e-4
"""Noise per range below which a force is unlikely [1]. Source: judgement."""


MANY_COUNTS = 200.0
"""Whole numbers over a wider range than this are counts of an encoder. Source: judgement."""


SLOW = 0.5
"""A column that changes less often than this share of the most frequent one has a rate of its own.
Source: judgement.
"""


TWIN = 0.97
"""Correlation above which one position column is the command of another. Source: judgement."""


LONGEST_LAG = 40
"""Samples by which a drive may follow its command. Source: judgement."""


def time_column(
    logs: Sequence[RawLog], headers: Sequence[str], names: Mapping[str, NameEvidence]
) -> str:
    """Return the column that increases from row to row in all logs, by its name a time."""
    increasing = [
        header
        for header in headers
        if all(np.all(np.diff(log.columns[header]) >= 0.0) for log in logs)
        and all(np.ptp(log.columns[header]) > 0.0 for log in logs)
    ]
    called_time = [header for header in headers if names[header].scores["time"] >= CLEARLY]
    if not set(called_time) & set(increasing):
        for header in called_time:
            check_increasing(header, logs)
    if not increasing:
        raise LogError(
            f"no column of {logs[0].source} increases from row to row, so none is the time; the "
            f"columns are {', '.join(headers)}"
        )

    def score(header: str) -> float:
        steps = np.concatenate([np.diff(log.columns[header]) for log in logs])
        is_index = bool(np.all(steps == 1.0))
        strictly = float(np.mean(steps > 0.0))
        return names[header].scores["time"] - names[header].scores["other"] + strictly - is_index

    best = max(increasing, key=score)
    steps = np.concatenate([np.diff(log.columns[best]) for log in logs])
    if np.all(steps == 1.0) and names[best].scores["time"] <= 0.0:
        raise LogError(
            f"'{best}' counts rows, and no other column is a time: add one, such as 'time [s]'"
        )
    return best


def check_increasing(header: str, logs: Sequence[RawLog]) -> None:
    """Raise a `LogError` where a column that is called a time goes back or lacks values."""
    for log in logs:
        stamps = log.columns[header]
        if not np.isfinite(stamps).all():
            row = int(np.flatnonzero(~np.isfinite(stamps))[0])
            raise LogError(f"{log.source}: '{header}' has no value in sample {row + 1}")
        back = np.flatnonzero(np.diff(stamps) < 0.0)
        if len(back):
            raise LogError(
                f"{log.source}: '{header}' goes back after sample {back[0] + 1}, from "
                f"{stamps[back[0]]:g} to {stamps[back[0] + 1]:g}; a log is one run"
            )


def scores_of(
    header: str,
    time: str,
    names: Mapping[str, NameEvidence],
    values: Mapping[str, ValueEvidence],
) -> dict[Role, float]:
    """Return how much name and values of a column speak for each role."""
    scores = dict(names[header].scores)
    if header == time:
        return dict.fromkeys(scores, 0.0) | {"time": 9.0}
    scores["time"] = -9.0
    evidence = values[header]
    if evidence.is_constant:
        scores["other"] += 9.0
        return scores
    if evidence.is_whole and evidence.width > MANY_COUNTS:
        scores["position"] += SPEAKS
        scores["command"] += SPEAKS
    if evidence.roughness > ROUGH:
        scores["effort"] += SPEAKS
    if evidence.roughness < SMOOTH:
        scores["effort"] -= SPEAKS
    usual = max(other.changes for name, other in values.items() if name != time)
    is_slow = evidence.changes < SLOW * usual and evidence.step == 0.0
    is_named_drive = names[header].scores["position"] > names[header].scores["angle"]
    if (evidence.missing > 0.05 or is_slow) and not is_named_drive:
        scores["angle"] += SPEAKS
    return scores


def find_commands(
    logs: Sequence[RawLog], scores: dict[str, dict[Role, float]], overruled: Collection[str]
) -> None:
    """Raise the score of a command: a position column follows it, and it has no noise.

    Args:
        logs: all of them.
        scores: header → role → score; changed in place.
        overruled: headers whose role a user gave.
    """
    positions = [h for h in scores if best_role(scores[h]) in ("position", "command")]
    for header in positions:
        if header in overruled or scores[header]["command"] > CLEARLY:
            continue
        for other in positions:
            if other != header and _follows(logs, other, header):
                scores[header]["command"] += CLEARLY
                break


def _follows(logs: Sequence[RawLog], follower: str, leader: str) -> bool:
    """Return whether a column is another one, later and with noise of its own."""
    log = max(logs, key=lambda log: log.rows)
    late, early = (_standard(log.columns[header]) for header in (follower, leader))
    if late is None or early is None:
        return False
    lags = range(-LONGEST_LAG, LONGEST_LAG + 1, 2)
    correlations = [_correlation(late, early, lag) for lag in lags]
    best = int(np.argmax(correlations))
    quieter = np.median(np.abs(np.diff(early, 2))) < 0.5 * np.median(np.abs(np.diff(late, 2)))
    return bool(correlations[best] > TWIN and lags[best] > 0 and quieter)


def _standard(values: Floats) -> Floats | None:
    """Return values with mean 0 and variance 1, missing ones held; None where they are constant."""
    present = np.isfinite(values)
    if present.sum() < 10:
        return None
    filled = np.interp(np.arange(len(values)), np.flatnonzero(present), values[present])
    spread = filled.std()
    return (filled - filled.mean()) / spread if spread > 0.0 else None


def _correlation(late: Floats, early: Floats, lag: int) -> float:
    """Return the correlation of one column with another `lag` samples before."""
    n = len(late) - abs(lag)
    if n < 10:
        return 0.0
    a = late[max(lag, 0) : max(lag, 0) + n]
    b = early[max(-lag, 0) : max(-lag, 0) + n]
    return float(np.mean(a * b))


def find_joints(
    logs: Sequence[RawLog],
    scores: dict[str, dict[Role, float]],
    names: Mapping[str, NameEvidence],
    overruled: Collection[str],
) -> None:
    """Tell joints from drives where no name does: beside columns that names call drives an angle
    is a joint's, and the other way round; else joints follow drives.

    Args:
        logs: all of them.
        scores: header → role → score; changed in place.
        names: header → what its name says.
        overruled: headers whose role a user gave.
    """
    unclear = [
        header
        for header in scores
        if header not in overruled
        and best_role(scores[header]) in ("position", "angle")
        and abs(scores[header]["position"] - scores[header]["angle"]) < LIKELY
        and abs(names[header].scores["position"] - names[header].scores["angle"]) < LIKELY
        and names[header].si in (None, "rad")
    ]
    movers = [h for h in scores if best_role(scores[h]) in ("position", "angle")]
    named = {best_role(names[header].scores) for header in movers if header not in unclear}
    log = max(logs, key=lambda log: log.rows)
    columns = {header: _standard(log.columns[header]) for header in movers}
    for header in unclear:
        if len(named & {"position", "angle"}) == 1:
            scores[header]["angle" if "position" in named else "position"] += LIKELY
            continue
        leads = 0.0
        for other in movers:
            a = columns[header]
            b = columns[other]
            if other == header or a is None or b is None:
                continue
            lags = range(-LONGEST_LAG, LONGEST_LAG + 1, 2)
            correlations = [abs(_correlation(a, b, lag)) for lag in lags]
            best = int(np.argmax(correlations))
            if correlations[best] > 0.5:
                leads -= float(np.sign(lags[best]))
        scores[header]["position" if leads >= 0.0 else "angle"] += SPEAKS


def best_role(scores: Mapping[Role, float]) -> Role:
    """Return the role that most speaks for."""
    return max(scores, key=lambda role: scores[role])
