"""A log before any rig is known: all its columns that hold numbers, as they came, and its time."""

from __future__ import annotations

import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from scipy.signal import medfilt

from distal.arrays import Bools, Floats
from distal.errors import LogError, RigError
from distal.from_logs.column_names import SURE, NameEvidence
from distal.from_logs.column_values import ColumnRole
from distal.logs import (
    Column,
    Episode,
    Source,
    decoded,
    open_table,
)
from distal.logs.cells import LIST
from distal.logs.stamps import clock_of, is_time, spread
from distal.units import USUAL, unit_factor

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")

FEWEST_ROWS = 50
"""A log with fewer rows than this shows nothing of a rig. Source: judgement."""


RATES = (0.5, 2e4)
"""Least and largest rate of a log [Hz]. Source: judgement."""

USUAL_VALUES = (0.025, 0.975)
"""Quantiles between which values of a column usually are [1]. Source: definition (95 %)."""

TIME = "time"
"""Column of a recording's stamps [s]. Source: definition (the name)."""


@dataclass(frozen=True)
class RawLog:
    """The columns of a log by their headers, numbers as they came, NaN where missing.

    Args:
        source: name of the file.
        columns: header → values, (n_samples,).
        texts: headers of columns that hold no numbers.
        wild: header → number of single readings far from their neighbours, taken as missing.
    """

    source: str
    columns: Mapping[str, Floats]
    texts: tuple[str, ...] = ()
    wild: Mapping[str, int] = field(default_factory=dict)

    @property
    def rows(self) -> int:
        """Number of samples."""
        return len(next(iter(self.columns.values()), ()))


ROWS = "evenly spaced rows"
"""Column of the time of rows whose rate a user gave [s]. Source: definition (the name)."""


def read_raw(path: Source, rows: int | None = None, rate: float | None = None) -> RawLog:
    """Return a log (CSV, Parquet, HDF5, MCAP, a ROS bag, a LeRobot episode or a frame) with all its
    columns, or their first `rows`; with the time `ROWS` where their `rate` is given [Hz].

    Raises:
        LogError: it cannot be read, holds no numbers, or has fewer than `FEWEST_ROWS` rows.
    """
    cells = open_table(path, None, TIME)
    if rows is not None:
        first = {name: column[:rows] for name, column in cells.columns.items()}
        cells = replace(cells, columns=first)
    source = str(path) if isinstance(path, (str, Path, Episode)) else cells.source
    check_rows(source, cells.rows)
    columns = dict[str, Floats]()
    texts = list[str]()
    for name in cells.names:
        column = cells.columns[name]
        try:
            timed = is_time(column)
            columns[name] = clock_of(cells, name, 1.0).time if timed else cells.values(name)
        except LogError:
            listed = isinstance(column, list) and LIST.fullmatch(column[0].strip())
            if _is_mostly_numeric(column) or (listed and re.search(r"\d", column[0])):
                raise
            texts.append(name)
    if not columns:
        raise LogError(f"{source}: no column holds numbers; a log has a header and rows of numbers")
    if rate is not None:
        columns[ROWS] = np.arange(cells.rows) / rate
    return _raw(source, columns, tuple(texts))


def _raw(source: str, columns: Mapping[str, Floats], texts: tuple[str, ...] = ()) -> RawLog:
    """Return a log in which registers that hold a sign are decoded and single wild readings are
    missing, as the conversion of readings does it with the written rig.
    """
    read = {name: decoded(values) for name, values in columns.items()}
    wild = {name: is_wild for name, values in read.items() if (is_wild := _wild(values)).any()}
    read |= {name: np.where(is_wild, np.nan, read[name]) for name, is_wild in wild.items()}
    return RawLog(source, read, texts, {name: int(is_wild.sum()) for name, is_wild in wild.items()})


def _wild(values: Floats) -> Bools:
    """Return which readings are farther from the median of their neighbours and themselves than
    nearly all readings are from one another, (k,).
    """
    wild = np.zeros(len(values), dtype=bool)
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < FEWEST_ROWS:
        return wild
    present = values[there]
    width = float(np.ptp(np.quantile(present, USUAL_VALUES)))
    wild[there] = (width > 0.0) & (np.abs(present - medfilt(present)) > width)
    wild[there[[0, -1]]] = False  # they have one neighbour only
    return wild


def check_rows(source: str, rows: int) -> None:
    """Raise a `LogError` where a log has too few rows to learn from."""
    if rows < FEWEST_ROWS:
        raise LogError(
            f"{source}: {rows} rows are too few to learn a rig from; {FEWEST_ROWS} at least"
        )


def _is_mostly_numeric(column: Column) -> bool:
    """Return whether most cells of a column are numbers, so that another cell is a mistake."""
    if not isinstance(column, list):
        return column.dtype.kind in "iuf"
    return statistics.mode(bool(_NUMBER.fullmatch(cell.strip())) for cell in column)


def without_repeats(log: RawLog, time: str) -> tuple[RawLog, str | None]:
    """Return a log without repeated stamps, and what was done (`log.time.repeated`), None where
    there are none: where most rows share theirs, they are spread, else the first ones are kept.
    """
    first = np.concatenate([[True], np.diff(log.columns[time]) > 0.0])
    if first.all():
        return log, None
    if 2 * first.sum() <= len(first):
        return replace(log, columns={**log.columns, time: spread(log.columns[time])}), "spread"
    kept = {name: values[first] for name, values in log.columns.items()}
    return replace(log, columns=kept), "first"


def with_same_columns(logs: Sequence[RawLog]) -> tuple[list[RawLog], dict[str, str]]:
    """Return logs that all have the same columns, NaN where a log lacks one, and header → the logs
    that lack it.

    Raises:
        LogError: two logs have fewer than two columns in common; says which are in which.
    """
    for log in logs[1:]:
        if len(set(log.columns) & set(logs[0].columns)) < 2:
            raise LogError(
                f"{log.source} has the columns {', '.join(log.columns)}; {logs[0].source} has "
                f"{', '.join(logs[0].columns)}: logs of one rig have the same columns"
            )
    lacking = dict[str, list[str]]()
    for name in dict.fromkeys(name for log in logs for name in log.columns):
        lacking[name] = [
            log.source for log in logs if not np.isfinite(log.columns.get(name, np.nan)).any()
        ]
    headers = [name for name, sources in lacking.items() if len(sources) < len(logs)]
    filled = [
        replace(
            log,
            columns={name: log.columns.get(name, np.full(log.rows, np.nan)) for name in headers},
        )
        for log in logs
    ]
    return filled, {name: ", ".join(lacking[name]) for name in headers if lacking[name]}


def time_column(
    logs: Sequence[RawLog], headers: Sequence[str], names: Mapping[str, NameEvidence]
) -> str:
    """Return the column that increases from row to row in all logs, by its name a time.

    Raises:
        LogError: there is none, or one that is called a time goes back or lacks values.
    """
    steps = {h: np.concatenate([np.diff(log.columns[h]) for log in logs]) for h in headers}
    increasing = [
        header
        for header in headers
        # a flag that is set once has two values
        if (steps[header] >= 0.0).all()
        and all(len(np.unique(log.columns[header])) > 2 for log in logs)
    ]
    called_time = [header for header in headers if names[header].scores["time"] >= SURE]
    if not set(called_time) & set(increasing):
        for header in called_time:
            _check_increasing(header, logs)
    if ROWS in headers:
        return ROWS
    if not increasing:
        raise LogError(
            f"no column of {logs[0].source} increases from row to row, so none is the time; the "
            f"columns are {', '.join(headers)}. If its rows are evenly spaced, say how many come "
            "in a second, as --rate 50"
        )

    def score(header: str) -> float:
        # a second word for a time says nothing more; stamps cut to seconds hardly rise
        of_name = names[header].scores["time"] - names[header].scores["other"]
        rises = 2.0 * float(np.mean(steps[header] > 0.0))
        return min(of_name, SURE) + rises - bool(np.all(steps[header] == 1.0))

    best = max(increasing, key=score)
    if np.all(steps[best] == 1.0) and names[best].scores["time"] <= 0.0:
        raise LogError(
            f"'{best}' counts rows, and no other column is a time: add one, such as 'time [s]', or "
            "say how many rows come in a second, as --rate 50"
        )
    return best


def _check_increasing(header: str, logs: Sequence[RawLog]) -> None:
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


def time_unit(time: ColumnRole, logs: Sequence[RawLog]) -> tuple[str, list[str]]:
    """Return the unit of time, that of the header where the rate is possible, else by the steps;
    and a sentence where the header says another.
    """
    steps = np.concatenate([np.diff(log.columns[time.header]) for log in logs])
    step = float(np.median(steps[steps > 0.0]))
    unit = time.unit or "s"
    size = unit_factor(unit, "s")
    slowest, fastest = RATES
    if slowest <= 1.0 / (step * size) <= fastest:
        return unit, []
    possible = [
        unit for unit, size in USUAL["s"].items() if slowest <= 1.0 / (step * size) <= fastest
    ]
    if not possible:
        raise RigError(f"{time.header} steps by {step:g}: no unit makes a rate of that")
    note = (
        f"{time.header} steps by {step:g}: taken as {possible[0]}, since in {unit} there would be "
        f"{1.0 / (step * size):.3g} samples in a second"
    )
    return possible[0], [note]


def rates_of(logs: Sequence[RawLog], time: ColumnRole, unit: str) -> dict[str, float]:
    """Return how often each column has a new sample [Hz]."""
    rates = dict[str, float]()
    for log in logs:
        stamps = log.columns[time.header] * unit_factor(unit, "s")
        for name, values in log.columns.items():
            there = np.isfinite(values)
            if there.sum() > 1 and name not in rates:
                span = max(float(np.ptp(stamps[there])), 1e-9)
                rates[name] = float(f"{(there.sum() - 1) / span:.3g}")
    return rates
