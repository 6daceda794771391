"""Read logs from files by a rig's description, and write them."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import LogError, did_you_mean
from distal.logs.formats.registry import TABLES, file_of
from distal.logs.log import (
    NO_SOURCE,
    WRONG_UNIT,
    Log,
    TruthKind,
    TruthSource,
    check_stamps,
    check_unit,
    earlier,
    held_samples,
    jumps_away,
    said_of_jumps,
)
from distal.logs.output_files import write_whole
from distal.logs.raw_to_si import TURN, RawToSI, says_nothing
from distal.logs.stamps import Clock, clock_of, dated, in_order, is_time, spread
from distal.logs.table_cells import Cells, factor_of, say, scale, time_factor
from distal.logs.tables import Source, open_table, together
from distal.rig import (
    REFERENCES,
    Rig,
    Role,
    Sensor,
    angle_names,
    log_factor,
    measurand_of,
    torque_names,
)
from distal.units import unit_factor


def read_log(
    path: Source,
    rig: Rig,
    truth: str | Path | None = None,
    *,
    ranged: bool = True,
) -> Log:
    """Read a log by the columns and units that a rig's sensors name.

    Sensors that measure a joint's angle are reference sensors. They may be absent; where the log
    has them, they are the truth if there is no other: a given `truth` comes first, then a simulated
    log's own ``true_theta``. All other sensors must be there. A header may give its unit, ``x1
    [mm]``: it counts before the rig's.

    Args:
        path: CSV, Parquet or HDF5; an MCAP file or a ROS bag, with columns ``/topic.field`` (see
            `read_recording`); a frame of pandas or polars with the same columns and units; or an
            episode of a dataset.
        truth: the true joint angle: a column of the log, or a second file with ``t`` and ``theta``
            (rad, or the unit in its header).
        ranged: whether the ranges of the joints say in which turn a motor is; before a power-on
            routine they do not.

    Raises:
        LogError: see `read_table`; stamps repeat or go back; there are fewer than two rows; or the
            truth does not overlap the log.
    """
    needed = [sensor for sensor in rig.sensors if sensor.measures not in REFERENCES]
    joints = rig.joint_names
    goals = _goals_of(rig)
    given = [] if truth is None else [str(truth)]
    desired = [sensor.log_column for sensor in needed]
    optional = [
        *(sensor.log_column for sensor in rig.sensors if sensor.measures in REFERENCES),
        *(column for column, _ in goals.values()),
        *(f"true_{name}" for name in (*angle_names(joints), *torque_names(joints))),
        *given,
    ]
    timing = rig.log.time
    timed = [timing.column] if timing.rate is None else []
    cells = open_table(
        path, [*timed, *desired, *optional], timing.column, unit_factor(timing.unit, "s")
    )
    column = next((name for name in given if _is_column(cells.names, name)), None)
    if timing.rate is not None:
        clock = Clock(np.arange(cells.rows) / timing.rate)
    else:
        if timing.column not in cells.names:
            raise _without_time(open_table(path), timing.column, rig)
        cells.check([timing.column])
        clock = clock_of(cells, timing.column, time_factor(rig, cells.units, cells.source))
    there = [name for name in optional if name in cells.names]
    table, clock = _with_whole_rows(cells.parsed([*desired, *there]), clock)
    table, clock = _in_order(rig, table, clock)
    time = clock.time
    source = table.source
    if len(time) < 2:
        raise LogError(f"{source}: has one row; an estimate over time needs at least two")
    check_unit(time, rig, source)
    readings = _readings(rig, table, time, column, ranged)
    angles, origin = _known_angles(rig, table, readings, column, truth, clock)
    if not _has_values(angles, f"{source}: the truth ({origin})"):
        if angles and truth is not None:
            raise LogError(f"{source}: the truth ({origin}) has no value at all")
        angles = {}
        origin = NO_SOURCE  # the reference sensor was never connected
    # a simulated log's own true torque comes before a torque sensor's reading
    names = torque_names(joints)
    torques = _of_references(rig, rig.sensors_of("torque"), names, readings)
    torques |= _simulated(names, "N m", table)
    known = {name: values for name, values in torques.items() if np.isfinite(values).any()}
    channels = {sensor.name: readings[sensor.name] for sensor in needed}
    setpoints = {
        name: table.values(goal) * factor_of(sensor, table.units, source)
        for name, (goal, sensor) in goals.items()
        if goal in table.columns
    }
    return Log(time, channels, angles | known, source, origin, clock.stamps, setpoints)


def _has_values(angles: Mapping[str, Floats], subject: str) -> bool:
    """Return whether any angle is known.

    Raises:
        LogError: one is so large that it is none.
    """
    known = [theta[np.isfinite(theta)] for theta in angles.values()]
    largest = max((float(np.max(np.abs(theta))) for theta in known if len(theta)), default=0.0)
    if largest > 1e6:
        raise LogError(f"{subject} reaches {largest:.3g} rad, which is no angle")
    return any(len(theta) for theta in known)


def _without_time(cells: Cells, time_column: str, rig: Rig) -> LogError:
    """Return what is wrong with a table without the rig's time column, which of its columns may be
    the time, and what else helps.
    """
    rising = list[str]()
    for name, column in cells.columns.items():
        with suppress(LogError, ValueError, OverflowError):
            stamps = cells.values(name) if not is_time(column) else clock_of(cells, name, 1.0).time
            if len(stamps) > 1 and np.mean(np.diff(stamps) > 0.0) > 0.9:
                rising.append(name)
    may_be = " or ".join(f"--set 'log.time.column=\"{name}\"'" for name in rising)
    rises = f"; what rises with the rows may be the time: {may_be}" if rising else ""
    return LogError(
        f"{cells.source}: column '{time_column}' is missing, which is the time{rises}; if rows are "
        f"evenly spaced, give their rate: --set 'log.time.rate=\"{_usual_rate(rig):g} Hz\"'"
        f"{did_you_mean(time_column, cells.names)}"
    )


def _usual_rate(rig: Rig) -> float:
    """Return the rate at which a rig's log may have been written [Hz]."""
    return max((sensor.rate for sensor in rig.sensors), default=100.0)


def _with_whole_rows(table: Cells, clock: Clock) -> tuple[Cells, Clock]:
    """Return a table in which rows with near stamps are one, where no row has all values: each
    topic of a recording may have rows of its own.
    """
    read = {name: table.values(name) for name in table.columns}
    held = {name: values for name, values in read.items() if np.isfinite(values).any()}
    if len(held) < 2 or np.isfinite([*held.values()]).all(axis=0).any():
        return table, clock
    dates = clock.stamps
    since = np.round(clock.time * 1e9) if dates is None else dates
    at = {name: np.isfinite(values) & np.isfinite(clock.time) for name, values in held.items()}
    stamps, columns = together(
        {name: (since[at[name]].astype(np.int64), held[name][at[name]]) for name in held}
    )
    if not np.isfinite([*columns.values()]).all(axis=0).any():
        return table, clock
    none = np.full(len(stamps), np.nan)
    joined = replace(table, columns={name: columns.get(name, none) for name in table.columns})
    return joined, Clock(stamps.astype(np.float64) * 1e-9) if dates is None else dated(stamps)


def _in_order(rig: Rig, table: Cells, clock: Clock) -> tuple[Cells, Clock]:
    """Return the rows of a table whose stamps rise, and their time; what to do with repeated stamps
    the rig says.
    """
    time = clock.time
    stamps = clock.stamps
    rows = in_order(time, table.source, table.first_row)
    same = np.diff(time[rows]) == 0.0
    repeated = rig.log.time.repeated
    if same.any():
        _check_repeated(rig, time[rows], table.source)
        if repeated == "spread":
            moved = spread(time[rows]) - time[rows]
            time[rows] += moved
            if stamps is not None:
                stamps[rows] += np.round(moved * 1e9).astype(np.int64)
        elif repeated != "refused":
            at = len(same) if repeated == "last" else 0
            rows = rows[~np.insert(same, at, False)]
    check_stamps(time[rows], table.source, rows + table.first_row)
    if len(rows) < len(time) or (rows != np.arange(len(time))).any():
        table = replace(table, columns={name: table.values(name)[rows] for name in table.columns})
        time = time[rows]
        if stamps is not None:
            stamps = stamps[rows]
            time = time - time[0]
    return table, Clock(time, stamps)


def _check_repeated(rig: Rig, time: Floats, source: str) -> None:
    """Raise a `LogError` where most rows share their stamp with others, so that one of each stamp
    is not the log, and the rig does not say what to do.

    Args:
        time: rising stamps of the rows, some of them repeated [s], (k,).
    """
    if rig.log.time.repeated == "spread" and time[-1] > time[0]:
        return
    distinct = len(np.unique(time))
    if 2 * distinct > len(time):
        return
    rate = _usual_rate(rig)
    name = rig.log.time.column
    together = f"{source}: {len(time) / distinct:.0f} rows share each stamp of '{name}': "
    if time[-1] == time[0] or len(time) / (time[-1] - time[0]) < rate / WRONG_UNIT:
        raise LogError(
            f"{together}it has too few digits to be a time; write it with more, or give the rate "
            f"of evenly spaced rows: --set 'log.time.rate=\"{rate:g} Hz\"'"
        )
    raise LogError(
        f"{together}it was rounded; --set 'log.time.repeated=\"spread\"' spreads them evenly"
    )


def _known_angles(
    rig: Rig,
    table: Cells,
    readings: Mapping[str, Floats],
    column: str | None,
    truth: str | Path | None,
    clock: Clock,
) -> tuple[dict[str, Floats], TruthSource]:
    """Return name → true angle [rad], of the joints whose angle a log or a file beside it has, and
    the source of these angles.
    """
    joints = rig.joint_names
    names = angle_names(joints)
    sensors = [
        sensor
        for sensor in rig.sensors_of("angle")
        if sensor.name in readings and column in (None, sensor.log_column)
    ]
    if column is not None and not sensors:
        if len(joints) > 1:
            raise LogError(
                f"truth '{column}' is one column, but the rig has the joints {', '.join(joints)}; "
                f"give a file with t, {', '.join(names)}, or an angle sensor for each joint in the "
                "rig file"
            )
        return {names[0]: table.in_si(column, "rad")}, TruthSource(position=f"column '{column}'")
    if column is None:
        if truth is not None:
            start = None if clock.stamps is None else int(clock.stamps[0])
            angles = read_truth(truth, clock.time, joints, start)
            return angles, TruthSource(position=str(truth))
        angles = _simulated(names, "rad", table)
        if angles:
            listed = ", ".join(f"'true_{name}'" for name in angles)
            return angles, TruthSource(position=f"column {listed}")
    listed = ", ".join(f"'{sensor.log_column}'{_late(sensor)}" for sensor in sensors)
    angles = _of_references(rig, sensors, names, readings)
    return angles, TruthSource(TruthKind.SENSOR, f"column {listed}") if sensors else NO_SOURCE


def _late(sensor: Sensor) -> str:
    return f" (taken as {1e3 * sensor.delay:.0f} ms late)" if sensor.delay else ""


def _of_references(
    rig: Rig, sensors: Iterable[Sensor], names: Sequence[str], readings: Mapping[str, Floats]
) -> dict[str, Floats]:
    """Return name → what reference sensors read in SI; `names` has one name for each joint."""
    name_of = dict(zip(rig.joint_names, names))
    return {
        name_of[sensor.of]: readings[sensor.name] for sensor in sensors if sensor.name in readings
    }


def _readings(
    rig: Rig,
    table: Cells,
    time: Floats,
    truth: str | None,
    ranged: bool,
) -> dict[str, Floats]:
    """Return sensor → its readings in SI, of those in a table, by the conversion. A reference
    in a unit of something else is left out, unless its column is asked for as the
    `truth`.

    The angle of a reference that wraps is in the turn in which its joint can be; a value that only
    repeats a sample which was held is missing, and one that is late by its sensor's `delay` stands
    where it belongs.
    """
    factors = dict[Sensor, float]()
    for sensor in rig.sensors:
        if sensor.log_column in table.columns:
            try:
                factors[sensor] = factor_of(sensor, table.units, table.source)
            except LogError as problem:
                if sensor.measures not in REFERENCES or sensor.log_column == truth:
                    raise
                say(f"{problem}: left out")
    to_si = RawToSI(rig, [*factors], factors.values(), ranged=ranged)
    logged = [table.values(sensor.log_column) for sensor in factors]
    readings, lines = to_si.through(time, logged)
    moving = {
        sensor.of
        for sensor in factors
        if sensor.measures == "position" and np.isfinite(np.unique(readings[sensor.name])).sum() > 1
    }
    stops = {joint.name: joint.stops for joint in rig.joints}
    for sensor in factors:
        values = readings[sensor.name]
        why = None
        if measurand_of(sensor).role is Role.EFFORT and sensor.of in moving:
            why = says_nothing(values)
        if why is not None:
            readings[sensor.name] = np.full(len(time), np.nan)
            lines.append(f"{sensor.log_column} {why}: left out")
        if sensor.measures in REFERENCES:
            away = jumps_away(values)
            if away.any():
                lines.append(f"{sensor.log_column} {said_of_jumps(values, away)}")
            plain = np.where(held_samples(values) | away, np.nan, values)
            values = earlier(time, plain, sensor.delay)
            ends = stops[sensor.of] if sensor.measures == "angle" else None
            if ends is not None and np.isfinite(values).any():
                off = float(np.nanmedian(values)) - (ends[0] + ends[1]) / 2
                values = values - TURN * round(off / TURN)
            readings[sensor.name] = values
    for line in lines:
        say(f"{table.source}: {line}")
    return readings


def _simulated(names: Sequence[str], si: str, table: Cells) -> dict[str, Floats]:
    """Return name → the true values in SI that a simulation wrote."""
    return {
        name: table.in_si(f"true_{name}", si) for name in names if f"true_{name}" in table.columns
    }


def _is_column(names: tuple[str, ...], name: str) -> bool:
    """Return whether the truth `name` is one of the log's columns (True) or a file (False)."""
    if name in names:
        return True
    if Path(name).exists() or Path(name).suffix.lower() in TABLES:
        return False
    raise LogError(
        f"truth '{name}' is neither a file nor a column (the log has {', '.join(names)})"
    )


def read_truth(
    path: str | Path, time: Floats, joints: Sequence[str] = ("joint",), start: int | None = None
) -> dict[str, Floats]:
    """Return name → true angle [rad] at the stamps `time`, interpolated linearly between a file's
    stamps.

    Args:
        path: CSV or Parquet with ``t`` and ``theta``, in SI or in the units of its header (``theta
            [deg]``); with several joints, a column for each (`distal.rig.angle_names`).
        time: stamps of the log [s], (n,).
        start: when the log begins, since 1970 [ns], if it has dates; a file that has dates, too, is
            then aligned with it by date.

    Raises:
        LogError: the file cannot be read, or does not overlap the log.
    """
    stamps, known, _ = read_angles(path, angle_names(joints), start)
    angles = dict[str, Floats]()
    for name, theta in known.items():
        finite = np.isfinite(theta)
        at = stamps[finite]
        if not len(at) or at[-1] < time[0] or at[0] > time[-1]:
            raise LogError(
                f"{path}: does not overlap the log in time ({stamps[0]:g} to {stamps[-1]:g} s; "
                f"the log has {time[0]:g} to {time[-1]:g} s)"
            )
        angles[name] = np.interp(time, at, theta[finite], left=np.nan, right=np.nan)
    return angles


def read_angles(
    path: str | Path, names: Sequence[str], start: int | None = None
) -> tuple[Floats, dict[str, Floats], str]:
    """Return a file's stamps [s], from its column ``t``, name → angle [rad] for the columns
    `names`, and "deg" where one of their headers gives degrees, else "rad".

    Args:
        start: when the log begins, since 1970 [ns], or None; see `read_truth`.

    Raises:
        LogError: the file cannot be read, or lacks a column.
    """
    cells = open_table(path, ["t", *names])
    cells.check(["t"])
    clock = clock_of(cells, "t", scale(cells.units, "t", "s", cells.source))
    stamps = clock.time
    if start is not None and clock.stamps is not None:
        stamps = (clock.stamps - start).astype(np.float64) * 1e-9
    table = cells.parsed(names)
    check_stamps(stamps, table.source, table.first_row + np.arange(len(stamps)))
    in_degrees = not {"deg", "°", "degrees", "degree"}.isdisjoint(table.units.values())
    angles = {name: table.in_si(name, "rad") for name in names}
    return stamps, angles, "deg" if in_degrees else "rad"


def _goals_of(rig: Rig) -> dict[str, tuple[str, Sensor]]:
    """Return drive → the log column of its setpoint and its position sensor, for the drives whose
    rig names such a column.
    """
    read = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    return {
        drive.name: (drive.servo.goal, read[drive.name])
        for drive in rig.drives
        if drive.servo is not None and drive.servo.goal and drive.name in read
    }


def write_log(log: Log, rig: Rig, path: str | Path) -> None:
    """Write a log in the form that `read_log` reads: the rig's columns and units, then the truth as
    ``true_…`` in SI.

    The file is CSV, or Parquet if the path ends so.

    Raises:
        OutputError: the file cannot be written.
    """
    columns = {rig.log.time.column: log.time / unit_factor(rig.log.time.unit, "s")}
    for sensor in rig.sensors:
        if sensor.name in log.channels:
            columns[sensor.log_column] = (
                sensor.sign * log.channels[sensor.name] / log_factor(sensor)
            )
    for name, (column, position) in _goals_of(rig).items():
        if name in log.goals:
            columns[column] = position.sign * log.goals[name] / log_factor(position)
    columns |= {f"true_{name}": values for name, values in log.truth.items()}
    write_columns(columns, path)


def write_columns(columns: Mapping[str, NDArray[np.generic]], path: str | Path) -> None:
    """Write columns as CSV, or as Parquet if the path ends so; in CSV, NaN is an empty cell.

    Raises:
        OutputError: the file cannot be written.
    """
    write_whole(path, file_of(columns, path))
