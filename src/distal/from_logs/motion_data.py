"""Logs before any rig is known: their columns of numbers, as they came, and then as drives, efforts
and joints in SI at a common lower rate; and least squares by columns of one size, with how well
each coefficient is known.

Angles, speeds and accelerations of a log are those of local cubics (Savitzky and Golay 1964), all
smoothed alike.
"""

from __future__ import annotations

import re
import statistics
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from math import inf, pi
from pathlib import Path

import numpy as np
from scipy.ndimage import convolve1d, correlate1d, distance_transform_edt
from scipy.signal import medfilt, savgol_coeffs, savgol_filter

from distal.arrays import Bools, Floats
from distal.errors import LogError
from distal.from_logs.column_names import SURE, ColumnRole, Columns, Names, as_role, of_role
from distal.logs import (
    Column,
    Episode,
    Source,
    decoded,
    held_samples,
    jumps_away,
    open_table,
)
from distal.logs.raw_to_si import FEWEST
from distal.logs.stamps import clock_of, is_time, spread
from distal.logs.table_cells import LIST
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


def read_raw(path: Source, rate: float | None) -> RawLog:
    """Return a log (CSV, Parquet, HDF5, MCAP, a ROS bag, a LeRobot episode or a frame) with all its
    columns, and the time `ROWS` where the `rate` of its rows is given [Hz]. It is without empty
    rows, registers that hold a sign are decoded, and single wild readings missing.

    Raises:
        LogError: it cannot be read, holds no numbers, or has fewer than `FEWEST` rows.
    """
    cells = open_table(path, None, TIME)
    source = str(path) if isinstance(path, (str, Path, Episode)) else cells.source
    if cells.rows < FEWEST:
        raise LogError(
            f"{source}: {cells.rows} rows are too few to learn a rig from; {FEWEST} at least"
        )
    columns = dict[str, Floats]()
    for name, column in cells.columns.items():
        try:
            values = clock_of(cells, name, 1.0).time if is_time(column) else cells.values(name)
        except LogError:
            listed = isinstance(column, list) and LIST.fullmatch(column[0].strip())
            if _is_mostly_numeric(column) or (listed and re.search(r"\d", column[0])):
                raise
            continue
        if np.isfinite(values).any():
            columns[name] = values
    if not columns:
        raise LogError(f"{source}: no column holds numbers; a log has a header and rows of numbers")
    texts = tuple(name for name in cells.names if name not in columns)
    if rate is not None:
        columns[ROWS] = np.arange(cells.rows) / rate
    # registers and wild readings as the conversion of readings treats them with the written rig
    has_value = np.any([np.isfinite(values) for values in columns.values()], axis=0)
    read = {name: decoded(values[has_value]) for name, values in columns.items()}
    wild = {name: _wild(values) for name, values in read.items()}
    kept = {name: np.where(wild[name], np.nan, values) for name, values in read.items()}
    return RawLog(source, kept, texts, {name: int(wild[name].sum()) for name in wild})


def _wild(values: Floats) -> Bools:
    """Return which readings are farther from the median of their neighbours and themselves than
    nearly all readings are from one another, (k,).
    """
    wild = np.zeros(len(values), dtype=bool)
    there = np.flatnonzero(np.isfinite(values))
    if len(there) < FEWEST:
        return wild
    present = values[there]
    width = np.ptp(np.quantile(present, USUAL_VALUES))
    wild[there] = (width > 0.0) & (np.abs(present - medfilt(present)) > width)
    wild[there[[0, -1]]] = False  # they have one neighbour only
    return wild


def _is_mostly_numeric(column: Column) -> bool:
    """Return whether most cells of a column are numbers, so that another cell is a mistake."""
    if not isinstance(column, list):
        return column.dtype.kind in "iuf"
    return statistics.mode(bool(_NUMBER.fullmatch(cell.strip())) for cell in column)


def without_repeats(logs: list[RawLog], time: str) -> tuple[list[RawLog], str | None]:
    """Return logs without repeated stamps, and what was done (`log.time.repeated`), None where
    there are none: where most rows share theirs, they are spread, else the first ones are kept.
    """
    first = [np.diff(log.columns[time], prepend=-np.inf) > 0.0 for log in logs]
    every = np.concatenate(first)
    if every.all():
        return logs, None
    is_spread = 2 * every.sum() <= len(every)
    cleaned = []
    for log, rows in zip(logs, first):
        columns = {name: values[rows] for name, values in log.columns.items()}
        if is_spread:
            columns = {**log.columns, time: spread(log.columns[time])}
        cleaned.append(replace(log, columns=columns))
    return cleaned, "spread" if is_spread else "first"


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
    lacking = {
        name: [log.source for log in logs if not np.isfinite(log.columns.get(name, np.nan)).any()]
        for name in dict.fromkeys(name for log in logs for name in log.columns)
    }
    headers = [name for name, sources in lacking.items() if len(sources) < len(logs)]
    filled = [
        replace(
            log,
            columns={name: log.columns.get(name, np.full(log.rows, np.nan)) for name in headers},
        )
        for log in logs
    ]
    return filled, {name: ", ".join(lacking[name]) for name in headers if lacking[name]}


def time_column(logs: Sequence[RawLog], names: Names) -> str:
    """Return the column that increases from row to row in all logs, by its name a time.

    Raises:
        LogError: there is none, or one that is called a time goes back or lacks values.
    """
    if ROWS in names:
        return ROWS
    steps = {h: np.concatenate([np.diff(log.columns[h]) for log in logs]) for h in names}
    increasing = [
        header
        for header in names
        # a flag that is set once has two values
        if (steps[header] >= 0.0).all()
        and all(len(np.unique(log.columns[header])) > 2 for log in logs)
    ]
    called_time = [header for header, name in names.items() if name.scores["time"] >= SURE]
    wrong = () if {*called_time} & {*increasing} else called_time
    for header, log in product(wrong, logs):
        stamps = log.columns[header]
        bad = np.flatnonzero(~(np.diff(stamps) >= 0.0))
        if len(bad):
            before, after = stamps[bad[0] : bad[0] + 2]
            raise LogError(
                f"{log.source}: '{header}' goes back, or has no value, after sample {bad[0] + 1}: "
                f"{before:g}, then {after:g}; a log is one run"
            )
    if not increasing:
        raise LogError(
            f"no column of {logs[0].source} increases from row to row, so none is the time; the "
            f"columns are {', '.join(names)}. If its rows are evenly spaced, say how many come "
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


def with_rates(columns: Columns, logs: Sequence[RawLog]) -> list[ColumnRole]:
    """Return columns with their rates, the time in the unit of its header where the rate is
    possible, else by its steps.

    Raises:
        LogError: no unit of time makes a rate of that.
    """
    (time,) = of_role(columns, "time")
    steps = np.concatenate([np.diff(log.columns[time.header]) for log in logs])
    step = np.median(steps[steps > 0.0])
    named = time.unit or "s"
    rates = {unit: 1.0 / (step * unit_factor(unit, "s")) for unit in (named, *USUAL["s"])}
    slowest, fastest = RATES
    unit = next((unit for unit, rate in rates.items() if slowest <= rate <= fastest), None)
    if unit is None:
        raise LogError(f"{time.header} steps by {step:g}: no unit makes a rate of that")
    evidence = time.evidence
    if unit != named:
        evidence = (
            f"it steps by {step:g}, taken as {unit}, since in {named} there would be "
            f"{rates[named]:.3g} samples in a second"
        )
    with_unit = replace(time, unit=unit, evidence=evidence)
    factor = unit_factor(unit, "s")

    def rate_of(header: str) -> float:
        sampled = (log.columns[time.header][np.isfinite(log.columns[header])] for log in logs)
        stamps = next((stamps for stamps in sampled if len(stamps) > 1), np.array([0.0, inf]))
        return float(f"{(len(stamps) - 1) / max(np.ptp(stamps) * factor, 1e-9):.3g}")

    return [replace(with_unit if c is time else c, rate=rate_of(c.header)) for c in columns]


class THRESHOLDS:
    """What logs are judged by where nothing but judgement says how.

    Attributes:
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
        start_std: least standard deviation of the angle at which logs begin [deg].
        zero_std: least standard deviation of the zero of a drive with two tendons [rad].
    """

    windows = (0.02, 0.04, 0.08, 0.12, 0.2)
    of_speed = 0.04
    noise = 0.2
    samples = 1500
    turned = 0.01
    slow = 0.03
    clear_direction = 0.99
    still_moves = 0.5
    odd = 3.0
    of_another_rig = 0.1
    rigid = 0.01
    joints_at_once = 5
    largest_ratio = 4.0
    usual_stiffness = (2e3, 2e5)
    start_std = 3.0
    zero_std = 0.01


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
        gain = np.sqrt(np.sum(savgol_coeffs(length, 3, deriv=2, delta=step) ** 2))
        acceleration = smoothed(angles, length, step, 2)
        if gain * noise < THRESHOLDS.noise * np.std(acceleration):
            return length
    return lengths[-1]


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
def with_values(names: Names, logs: Sequence[RawLog], time: str) -> Names:
    """Return what names and values of columns say together: what goes as the speed of another
    column is no position; of two columns with the same values the one ahead is the other's goal.
    """
    movers = [h for h, name in names.items() if name.best in ("position", "angle") and h != time]
    if len(movers) < 2:
        return dict(names)
    read = [np.column_stack([bridged(log.columns[header]) for header in movers]) for log in logs]
    x = np.concatenate([values - values.mean(axis=0) for values in read])
    v = np.concatenate([smoothed(values, SMALLEST_WINDOW, 1.0, 1) for values in read])
    size = rms(x)
    off = np.abs(np.subtract.outer(*2 * [[np.nanmean(logs[0].columns[h]) for h in movers]]))
    by_speed = x.T @ v / len(x) / np.outer(size, np.std(v, axis=0))
    alike = np.abs(np.divide.outer(size, size) - 1.0) < ALIKE
    alike &= (off < size) & (x.T @ x / len(x) / np.outer(size, size) > 1.0 - ALIKE)
    result = dict(names)
    for i, header in enumerate(movers):
        name = names[header]
        sure = name.scores[name.best] >= SURE
        if not sure and (by_speed[i] > 1.0 - ALIKE).any():
            result[header] = as_role(name, "other")
        for j in np.flatnonzero(alike[i]):
            other = names[movers[j]]
            # motors that go together are called alike, and what is called a joint has no goal
            is_pair = other.best == name.best == "position"
            is_pair &= other.kind_of_name != name.kind_of_name
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


def rms(values: Floats) -> Floats:
    """Return the root of the mean square of samples along their first axis."""
    return np.asarray(np.sqrt(np.mean(values**2, axis=0)))


def scaled_solution(matrix: Floats, target: Floats) -> Floats:
    """Return the solution of least squares, (n,), by columns that are scaled to one size.

    Args:
        matrix: columns, (n_samples, n).
        target: (n_samples,).
    """
    size = np.maximum(rms(matrix), 1e-300)
    return np.asarray(np.linalg.lstsq(matrix / size, target, rcond=1e-9)[0] / size)


Equations = tuple[Floats, Floats]
"""What a regression of a log takes: a matrix, (k, n), and a target, (k,)."""


def stacked(parts: Iterable[Equations]) -> Equations:
    """Return the equations of several logs as one."""
    matrices, targets = zip(*parts)
    return np.vstack(matrices), np.concatenate(targets)


def left_out(parts: Sequence[Equations]) -> list[Floats]:
    """Return what each of several logs has left of its target, (k,) each, by the solution of all
    others; of a single log by its own.
    """
    residuals = []
    for k, (matrix, target) in enumerate(parts):
        training = [part for i, part in enumerate(parts) if i != k] or parts
        residuals.append(target - matrix @ scaled_solution(*stacked(training)))
    return residuals


def with_errors(
    matrix: Floats, target: Floats, window: int, prior: Sequence[float] = ()
) -> tuple[Floats, Floats]:
    """Return this solution of a `matrix`, (n_samples, n), for a `target`, (n_samples,), and its
    standard errors, (n,) each.

    Args:
        matrix: columns, (n_samples, n).
        target: (n_samples,).
        window: number of samples over which both sides are smoothed, which count as one.
        prior: mean, and standard deviation too, of the first coefficients; of the others nothing
            is known before.
    """
    solution = scaled_solution(matrix, target)
    noise = np.sqrt(window) * np.maximum(rms(target - matrix @ solution), 1e-150)
    size = np.maximum(rms(matrix), 1e-300)
    scaled = matrix / size
    before = np.zeros(len(size))
    before[: len(prior)] = noise / (size[: len(prior)] * prior)
    covariance = np.linalg.pinv(scaled.T @ scaled + np.diag(before**2))
    lacking = np.append(prior, solution[len(prior) :]) - solution
    solution += covariance @ (before**2 * lacking * size) / size
    return solution, noise * np.sqrt(np.diag(covariance)) / size


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

    @property
    def step(self) -> float:
        """Usual time between samples [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def window(self) -> int:
        """Number of samples over which speeds are taken, by `THRESHOLDS.of_speed`."""
        return length_of(THRESHOLDS.of_speed, self.step)

    @property
    def is_known(self) -> Bools:
        """When all angles are known, (n_samples,)."""
        return np.asarray(np.isfinite(self.angles).all(axis=1))

    def speed_of(self, values: Floats) -> Floats:
        """Return the speed of samples, (n_samples,), in which gaps are NaN, which are bridged."""
        has_value = np.isfinite(values)
        if has_value.sum() < 2 or self.window > len(values):
            return np.zeros(len(values))
        even = np.interp(self.time, self.time[has_value], values[has_value])
        return smoothed(even, self.window, self.step, 1)

    def is_fast(self, values: Floats) -> Bools:
        """Return when samples, (n_samples,), change so fast that friction has a direction."""
        speed = np.abs(self.speed_of(values))
        return np.asarray(speed > THRESHOLDS.slow * rms(speed))

    def moves(self, drive: int) -> Bools:
        """Return when a drive moves, so that friction acts against its direction, (n_samples,)."""
        is_clear = np.abs(self.directions[:, drive]) > THRESHOLDS.clear_direction
        return np.asarray(self.is_fast(self.positions[:, drive]) & is_clear)


Logs = Sequence[MotionData]
"""The logs of one rig."""


def motion_data(log: RawLog, columns: Columns) -> MotionData:
    """Return a log as drives, efforts and joints, missing positions held."""
    (stamp,) = of_role(columns, "time")
    drives = of_role(columns, "position")
    efforts = {column.part: column for column in of_role(columns, "effort")}
    stride = max(1, log.rows // THRESHOLDS.samples)
    time = log.columns[stamp.header] * factor_of_column(stamp)

    nothing = np.full(len(time[::stride]), np.nan)

    def smooth(column: ColumnRole | None) -> Floats:
        if column is None:
            return nothing
        values = log.columns[column.header].copy()
        if column.values.turn is not None:
            is_finite = np.isfinite(values)
            values[is_finite] = np.unwrap(values[is_finite], period=column.values.turn)
        values *= factor_of_column(column)
        if column.role == "angle":
            values[held_samples(values) | jumps_away(values)] = np.nan
        present = np.flatnonzero(np.isfinite(values))
        if len(present) < 2:
            return nothing
        even = bridged(values)
        if column.role == "angle":
            # a slow camera is bridged between its samples, also where one is lost, a gap is not
            nearest = distance_transform_edt(~np.isfinite(values))
            even[nearest > np.median(np.diff(present))] = np.nan
        kernel = np.ones(stride) / stride
        return np.asarray(correlate1d(even, kernel, mode="nearest")[::stride])

    positions = np.column_stack([smooth(column) for column in drives])
    widths = np.maximum(THRESHOLDS.turned * np.ptp(positions, axis=0), 1e-12)
    directions = np.column_stack(
        [(values - played(values, half)) / half for values, half in zip(positions.T, widths)]
    )
    return MotionData(
        log.source,
        time[::stride] - time[0],
        positions,
        directions,
        np.column_stack([smooth(efforts.get(column.part)) for column in drives]),
        np.column_stack([smooth(column) for column in of_role(columns, "angle")]),
    )
