"""A log before any rig is known: all its columns that hold numbers, as they came, and its time.

The columns of some logs as drives, efforts and joints in SI, at a common lower rate; and least
squares by columns of one size, with how well each coefficient is told.

Angles, speeds and accelerations of a log are those of local cubics (Savitzky and Golay 1964), all
smoothed alike.
"""

from __future__ import annotations

import re
import statistics
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from math import pi
from pathlib import Path

import numpy as np
from scipy.ndimage import convolve1d
from scipy.signal import medfilt, savgol_coeffs, savgol_filter

from distal.arrays import Bools, Floats
from distal.errors import LogError, RigError
from distal.from_logs.column_names import ROLES, SURE, ColumnRole, NameEvidence, as_role, in_si
from distal.logs import (
    Column,
    Episode,
    Source,
    decoded,
    held_samples,
    jumps_away,
    open_table,
)
from distal.logs.cells import LIST
from distal.logs.raw_to_si import FEWEST
from distal.logs.stamps import clock_of, is_time, spread
from distal.regression import played
from distal.rig.hand_tables import ASSUMED
from distal.units import USUAL, unit_factor

_NUMBER = re.compile(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?")


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
        LogError: it cannot be read, holds no numbers, or has fewer than `FEWEST` rows.
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
            values = clock_of(cells, name, 1.0).time if timed else cells.values(name)
            if np.isfinite(values).any():
                columns[name] = values
            else:
                texts.append(name)
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
    """Return a log without empty rows, in which registers that hold a sign are decoded and single
    wild readings are missing, as the conversion of readings does it with the written rig.
    """
    has_value = np.any([np.isfinite(values) for values in columns.values()], axis=0)
    read = {name: decoded(values[has_value]) for name, values in columns.items()}
    wild = {name: is_wild for name, values in read.items() if (is_wild := _wild(values)).any()}
    read |= {name: np.where(is_wild, np.nan, read[name]) for name, is_wild in wild.items()}
    return RawLog(source, read, texts, {name: int(is_wild.sum()) for name, is_wild in wild.items()})


def _wild(values: Floats) -> Bools:
    """Return which readings are farther from the median of their neighbours and themselves than
    nearly all readings are from one another, (k,).
    """
    wild = np.zeros(len(values), dtype=bool)
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < FEWEST:
        return wild
    present = values[there]
    width = float(np.ptp(np.quantile(present, USUAL_VALUES)))
    wild[there] = (width > 0.0) & (np.abs(present - medfilt(present)) > width)
    wild[there[[0, -1]]] = False  # they have one neighbour only
    return wild


def check_rows(source: str, rows: int) -> None:
    """Raise a `LogError` where a log has too few rows to learn from."""
    if rows < FEWEST:
        raise LogError(f"{source}: {rows} rows are too few to learn a rig from; {FEWEST} at least")


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


@dataclass(frozen=True)
class Thresholds:
    """What logs are judged by where nothing but judgement says how.

    Args:
        windows: times over which derivatives may be taken [s]; steps of a finger take 0.1 s.
        of_speed: time over which speeds, and accelerations of drives, are taken [s].
        noise: noise of an acceleration per its RMS, above which it is taken over a longer time [1].
        samples: of a log that are used: more say nothing new of sizes [1].
        turned: share of its range after which a drive has a direction [1].
        slow: speed of a body, per its RMS speed, below which friction may hold any force [1].
        clear_direction: magnitude of a direction from which on it is clear [1].
        still_moves: share of its range that each drive moves while a stuck reference has one value
            [1].
        odd: ratio of the residuals with a log and without it, from which on it is odd [1].
        of_another_rig: residual of a log by the others, per RMS of a drive's motion, from which on
            nothing is learned from it [1]: moment arms that differ by a tenth.
        rigid: what a line of another joint leaves, per a joint's range, below which it follows that
            rigidly [1].
        joints_at_once: joints tried together; of more, those that alone explain a drive best [1].
        largest_ratio: turns of a drive per turn of a joint, above which it has a gear, behind which
            spool and pulley are taken as alike [1].
        usual_stiffness: least and largest stiffness of a usual tendon, of a braided line and of a
            short steel rope [N/m].
        share_of_pair: pre-tension of two tendons on one spool per usual difference of their
            tensions [1]; both stay taut above a half.
        start_std: least standard deviation of the angle at which logs begin [deg].
        zero_std: least standard deviation of the zero of a drive with two tendons [rad].
    """

    windows: tuple[float, ...] = (0.02, 0.04, 0.08, 0.12, 0.2)
    of_speed: float = 0.04
    noise: float = 0.2
    samples: int = 1500
    turned: float = 0.01
    slow: float = 0.03
    clear_direction: float = 0.99
    still_moves: float = 0.5
    odd: float = 3.0
    of_another_rig: float = 0.1
    rigid: float = 0.01
    joints_at_once: int = 5
    largest_ratio: float = 4.0
    usual_stiffness: tuple[float, float] = (2e3, 2e5)
    share_of_pair: float = 1.5
    start_std: float = 3.0
    zero_std: float = 0.01


THRESHOLDS = Thresholds()


SMALLEST_WINDOW = 5
"""Least number of samples in a window [1]. Source: definition (a cubic needs four)."""


def length_of(time: float, step: float) -> int:
    """Return the number of samples of a window, for a time and a `step` between samples [s]."""
    return max(SMALLEST_WINDOW, 2 * round(time / step / 2) + 1)


def window_of(angles: Floats, step: float, noise: float) -> int:
    """Return the number of samples of the shortest window in which the noise of an acceleration is
    small.

    Args:
        angles: evenly sampled [rad], (k,).
        step: time between samples [s].
        noise: standard deviation of an angle [rad].
    """
    lengths = [length_of(time, step) for time in THRESHOLDS.windows]
    for length in lengths:
        if length > len(angles):
            break
        gain = float(np.sqrt(np.sum(savgol_coeffs(length, 3, deriv=2, delta=step) ** 2)))
        acceleration = savgol_filter(angles, length, 3, deriv=2, delta=step)
        if gain * noise < THRESHOLDS.noise * float(np.std(acceleration)):
            return length
    return lengths[-1]


def speed_of(values: Floats, time: Floats) -> Floats:
    """Return the speed of samples over `Thresholds.of_speed`, (k,).

    Args:
        values: (k,), NaN in gaps, which are bridged.
        time: their stamps [s], (k,).
    """
    has_value = np.flatnonzero(np.isfinite(values))
    step = float(np.median(np.diff(time)))
    window = length_of(THRESHOLDS.of_speed, step)
    if len(has_value) < 2 or window > len(values):
        return np.zeros(len(values))
    bridged = np.interp(time, time[has_value], values[has_value])
    return smoothed(bridged, window, step, 1)


def smoothed(values: Floats, window: int, step: float, order: int = 0) -> Floats:
    """Return the derivative of samples along their first axis; every order is smoothed alike.

    The second derivative g of local cubics is that of the samples after they were smoothed by a
    kernel K, g = K * (1, −2, 1)/dt². K smooths the values and first differences too: by filters of
    their own they would keep fast motions that the acceleration has lost, and inertia would come
    out too large.

    Args:
        values: evenly sampled, (k,) or (k, n).
        window: number of samples over which it is taken.
        step: time between samples [s].
        order: of the derivative, 0, 1 or 2; 0 smooths.
    """
    second = savgol_coeffs(window, 3, deriv=2, delta=step, use="conv")
    kernel = step**2 * np.cumsum(np.cumsum(second))[:-2]
    if order == 2:
        return np.asarray(savgol_filter(values, window, 3, deriv=2, delta=step, axis=0))
    rates = np.gradient(values, step, axis=0) if order == 1 else values
    return np.asarray(convolve1d(rates, kernel, axis=0, mode="nearest"))


ALIKE = 0.05
"""Share by which a column may differ in size from another's of which it is the goal, or a
correlation from one [1]; a joint differs by more, or lags. Source: judgement.
"""


@np.errstate(divide="ignore", invalid="ignore")
def with_values(
    names: Mapping[str, NameEvidence], logs: Sequence[RawLog], time: str
) -> dict[str, NameEvidence]:
    """Return what names and values of columns say together: what goes as the speed of another
    column is no position; of two columns with the same values the one ahead is the other's goal.
    """
    best = {header: max(ROLES, key=name.scores.__getitem__) for header, name in names.items()}
    movers = [h for h, role in best.items() if role in ("position", "angle") and h != time]
    moved = list[Floats]()
    speeds = list[Floats]()
    for log in logs if len(movers) > 1 else ():
        values = np.column_stack([bridged(log.columns[header]) for header in movers])
        moved.append(values - values.mean(axis=0))
        speeds.append(smoothed(values, SMALLEST_WINDOW, 1.0, 1))
    if not moved:
        return dict(names)
    x = np.concatenate(moved)
    v = np.concatenate(speeds)
    size = np.sqrt(np.mean(x**2, axis=0))
    off = np.abs(np.subtract.outer(*2 * [[np.nanmean(logs[0].columns[h]) for h in movers]]))
    by_speed = x.T @ v / len(x) / np.outer(size, np.std(v, axis=0))
    alike = np.abs(np.divide.outer(size, size) - 1.0) < ALIKE
    alike &= (off < size) & (x.T @ x / len(x) / np.outer(size, size) > 1.0 - ALIKE)
    result = dict(names)
    for i, header in enumerate(movers):
        name = names[header]
        sure = name.scores[best[header]] >= SURE
        if not sure and (by_speed[i] > 1.0 - ALIKE).any():
            result[header] = as_role(name, "other")
        for j in np.flatnonzero(alike[i]):
            other = names[movers[j]]
            # motors that go together are called alike
            is_pair = best[movers[j]] == best[header] and other.kind_of_name != name.kind_of_name
            if is_pair and v[:, i] @ (x[:, j] - x[:, i]) < 0.0:
                result[header] = as_role(name, "command")
    return result


def bridged(values: Floats) -> Floats:
    """Return samples with the missing ones in line with their neighbours, (k,)."""
    rows = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), rows, values[rows]) if len(rows) else values * 0.0


CLEAR = 4.0
"""Inertia, damping and friction count that are so many standard errors above zero [1]. Source:
benchmark (`benchmarks.from_logs rigs`, seeds 7301 to 7304: 4 to 27 with inertia in the plant, else
below 2.5).
"""


BETTER = 0.9
"""Terms and drives are told that bring the RMS error on other logs below this share [1]. Source:
benchmark (docs/results/from-logs.md: links of fingers 0.6 to 0.8, of a light wrist 0.95 to 1.02;
growth and stiffening 0.5 to 0.86 in plants that have them, else 0.93).
"""

WITHIN = 2.0
"""Numbers differ clearly that are so many standard errors apart [1]. Source: reference (Hastie,
Tibshirani and Friedman 2009, section 7.10, with two in place of one).
"""


def scaled_solution(matrix: Floats, target: Floats) -> tuple[Floats, float]:
    """Return the solution of least squares, (n,), by columns that are scaled to one size, and the
    RMS of what it leaves.

    Args:
        matrix: columns, (n_samples, n).
        target: (n_samples,).
    """
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    solution = np.linalg.lstsq(matrix / size, target, rcond=1e-9)[0] / size
    return solution, float(np.sqrt(np.mean((target - matrix @ solution) ** 2)))


def left_out(parts: Sequence[tuple[Floats, Floats]]) -> list[Floats]:
    """Return what each of several logs has left of its target, (k,) each, by the solution of all
    others; of a single log by its own. Each log is a matrix, (k, n), and a target, (k,).
    """
    residuals = []
    for k, (matrix, target) in enumerate(parts):
        training = [part for i, part in enumerate(parts) if i != k] or parts
        solution, _ = scaled_solution(
            np.vstack([columns for columns, _ in training]),
            np.concatenate([values for _, values in training]),
        )
        residuals.append(target - matrix @ solution)
    return residuals


def relative_errors(matrix: Floats, window: int) -> Floats:
    """Return the standard errors of the coefficients of a `matrix`, (n,), per RMS of what is left,
    where the samples of a `window`, over which both sides are smoothed, count as one.
    """
    size = np.maximum(np.sqrt(np.mean(matrix**2, axis=0)), 1e-300)
    scaled = matrix / size
    covariance = np.linalg.pinv(scaled.T @ scaled / window)
    return np.asarray(np.sqrt(np.diag(covariance)) / size)


def factor_of_column(column: ColumnRole) -> float:
    """Return the factor of a column to SI; counts become radians by an assumed or a seen turn."""
    if column.si == "count":
        return 2.0 * pi / counts_of(column)
    return unit_factor(column.unit, column.si) if column.unit else 1.0


def counts_of(column: ColumnRole) -> float:
    """Return the counts of an encoder in one turn."""
    return column.values.turn or ASSUMED.counts


@dataclass(frozen=True)
class MotionData:
    """One log.

    Args:
        source: its name.
        time: [s], (n_samples,).
        positions: of the drives [m or rad], (n_samples, n_drives).
        directions: which way each drive last moved, −1 to 1, (n_samples, n_drives).
        efforts: of the drives [N, N m or A], NaN without a sensor, (n_samples, n_drives).
        angles: of the joints by their references [rad], NaN where not known, (n_samples, n_joints).
    """

    source: str
    time: Floats
    positions: Floats
    directions: Floats
    efforts: Floats
    angles: Floats

    def moves(self, drive: int) -> Bools:
        """Return when a drive moves, so that friction acts against its direction, (n_samples,)."""
        speed = np.abs(speed_of(self.positions[:, drive], self.time))
        fast = speed > THRESHOLDS.slow * np.sqrt(np.mean(speed**2))
        moving: Bools = fast & (np.abs(self.directions[:, drive]) > THRESHOLDS.clear_direction)
        return moving


def motion_data(log: RawLog, columns: Sequence[ColumnRole]) -> MotionData:
    """Return a log as drives, efforts and joints, missing positions held."""
    stamp = next(column for column in columns if column.role == "time")
    drives = [column for column in columns if column.role == "position"]
    joints = [column for column in columns if column.role == "angle"]
    efforts = {column.part: column for column in columns if column.role == "effort"}
    stride = max(1, log.rows // THRESHOLDS.samples)
    time = log.columns[stamp.header] * factor_of_column(stamp)

    def smooth(column: ColumnRole | None) -> Floats:
        if column is None:
            return np.full(len(time[::stride]), np.nan)
        values = in_si(column, log.columns[column.header], factor_of_column(column))
        if column.role == "angle":
            values = np.where(held_samples(values) | jumps_away(values), np.nan, values)
        present = np.flatnonzero(np.isfinite(values))
        if len(present) < 2:
            return np.full(len(time[::stride]), np.nan)
        rows = np.arange(len(values))
        bridged = np.interp(rows, present, values[present])
        if column.role == "angle":
            # a slow camera is bridged between its samples, also where one is lost, a gap is not
            nearest = np.abs(
                rows - present[np.searchsorted(present, rows).clip(0, len(present) - 1)]
            )
            before = present[(np.searchsorted(present, rows, side="right") - 1).clip(0)]
            nearest = np.minimum(nearest, np.abs(rows - before))
            bridged[nearest > np.median(np.diff(present))] = np.nan
        values = bridged
        kernel = np.ones(stride) / stride
        padded = np.pad(values, (stride // 2, stride - 1 - stride // 2), mode="edge")
        return np.asarray(np.convolve(padded, kernel, mode="valid")[::stride])

    positions = np.column_stack([smooth(column) for column in drives])
    widths = [max(THRESHOLDS.turned * float(np.ptp(values)), 1e-12) for values in positions.T]
    directions = np.column_stack(
        [(values - played(values, half)) / half for values, half in zip(positions.T, widths)]
    )
    return MotionData(
        log.source,
        time[::stride] - time[0],
        positions,
        directions,
        np.column_stack([smooth(efforts.get(column.part)) for column in drives]),
        np.column_stack([smooth(column) for column in joints])
        if joints
        else np.empty((len(positions), 0)),
    )
