"""Read logs from files by a rig's description, and write them."""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import DistalWarning, LogError, OutputError
from distal.logs.atomic_writes import write_whole
from distal.logs.cells import in_memory
from distal.logs.formats import TABLES, format_of
from distal.logs.header_units import factor_of, scale, time_factor
from distal.logs.log import LARGEST_READING, Log, check_stamps
from distal.logs.reader_process import read_apart
from distal.logs.recordings import is_recording, open_recording
from distal.logs.sources import Source
from distal.logs.stamps import Clock, clock_of
from distal.logs.tables import Table, open_table, table_of
from distal.logs.truth import NO_SOURCE, TruthKind, TruthSource
from distal.rig import REFERENCES, Capstan, Rig, Sensor, angle_names, log_factor, torque_names
from distal.units import unit_factor


def read_log(path: Source, rig: Rig, truth: str | Path | None = None) -> Log:
    """Read a log by the columns and units that a rig's sensors name.

    Sensors that measure a joint's angle are reference sensors. They may be absent; where the log
    has them, they are the truth if there is no other: a given `truth` comes first, then a simulated
    log's own ``true_theta``. All other sensors must be there. A header may give its unit, ``x1
    [mm]``: it counts where the rig gives none, and must agree with the rig's where there is one.

    Args:
        path: CSV, Parquet or HDF5; an MCAP file or a ROS bag, with columns ``/topic.field`` (see
            `open_recording`); a frame of pandas or polars with the same columns and units; or an
            episode of a dataset.
        truth: the true joint angle: a column of the log, or a second file with ``t`` and ``theta``
            (rad, or the unit in its header).

    Raises:
        LogError: see `read_table`; stamps repeat or go back; there are fewer than two rows; or the
            truth does not overlap the log.
    """
    needed = [sensor for sensor in rig.sensors if sensor.measures not in REFERENCES]
    desired = [sensor.log_column for sensor in needed]
    references = [
        sensor.log_column for kind in ("angle", "torque") for sensor in rig.sensors_of(kind)
    ]
    joints = rig.joint_names
    optional = [
        *references,
        *_goal_columns(rig).values(),
        *(f"true_{name}" for name in (*angle_names(joints), *torque_names(joints))),
    ]
    time_column = rig.log.time.column
    asked = [time_column, *desired, *optional, *([] if truth is None else [str(truth)])]
    recorded = None
    if is_recording(path):
        unit = unit_factor(rig.log.time.unit, "s")
        columns, recorded = read_apart(open_recording, Path(path), asked, time_column, unit)
        cells = in_memory(columns, Path(path), 0, columns)
    else:
        cells = open_table(path, asked, time_column)
    column = str(truth) if truth is not None and _is_column(cells.names, str(truth)) else None
    cells.check([time_column])
    clock = clock_of(
        cells, time_column, time_factor(rig, cells.units.get(time_column), str(cells.path))
    )
    table = table_of(cells, desired, [*optional, *([column] if column else [])])
    time = clock.time
    stamps = clock.stamps if recorded is None else np.asarray(recorded)
    if rig.log.time.repeated != "refused":
        rows = _distinct(time, last=rig.log.time.repeated == "last")
        table = replace(
            table, columns={name: values[rows] for name, values in table.columns.items()}
        )
        time = time[rows]
        stamps = None if stamps is None else stamps[rows]
    check_stamps(time, table.source, table.first_row)
    if len(time) < 2:
        raise LogError(f"{table.source}: has one row; an estimate over time needs at least two")
    channels = {sensor.name: _in_si(sensor, table) for sensor in needed}
    angles, origin = _known_angles(rig, table, column, truth, Clock(time, stamps))
    if angles and not any(np.isfinite(theta).any() for theta in angles.values()):
        if truth is not None:
            raise LogError(f"{table.source}: the truth ({origin}) has no value at all")
        angles = {}
        origin = NO_SOURCE  # the reference sensor was never connected
    for theta in angles.values():
        largest = float(np.max(np.abs(theta[np.isfinite(theta)]), initial=0.0))
        if largest > 1e6:
            raise LogError(
                f"{table.source}: the truth ({origin}) reaches {largest:.3g} rad, which is no angle"
            )
    known = angles | _known_torques(rig, table)
    log = Log(time, channels, known, table.source, origin, stamps, _goals(rig, table))
    for message in _doubts(log, rig):
        warnings.warn(message, DistalWarning, stacklevel=2)
    return log


def _distinct(time: Floats, last: bool) -> Bools:
    """Return which rows stay where neighbours have the same stamp, (n,): the `last` of them or the
    first.
    """
    same = np.diff(time) == 0.0
    return ~np.append(same, False) if last else ~np.insert(same, 0, False)


def _known_torques(rig: Rig, table: Table) -> dict[str, Floats]:
    """Return name → external torque [N m], of the joints whose torque a log has.

    A simulated log's own true torque comes before a torque sensor's reading.
    """
    joints = rig.joint_names
    names = dict(zip(joints, torque_names(joints)))
    read = {
        names[s.of]: _in_si(s, table)
        for s in rig.sensors_of("torque")
        if s.log_column in table.columns
    }
    simulated = {
        n: table.in_si(f"true_{n}", "N m") for n in names.values() if f"true_{n}" in table.columns
    }
    return {
        name: values for name, values in {**read, **simulated}.items() if np.isfinite(values).any()
    }


def _known_angles(
    rig: Rig, table: Table, column: str | None, truth: str | Path | None, clock: Clock
) -> tuple[dict[str, Floats], TruthSource]:
    """Return name → true angle [rad], of the joints whose angle a log or a file beside it has, and
    the source of these angles.
    """
    joints = rig.joint_names
    names = dict(zip(joints, angle_names(joints)))
    references = {sensor.log_column: sensor for sensor in rig.sensors_of("angle")}
    if column is not None:
        sensor = references.get(column)
        if sensor is None and len(joints) > 1:
            raise LogError(
                f"truth '{column}' is one column, but the rig has the joints {', '.join(joints)}; "
                "give a file with t, "
                f"{', '.join(names.values())}, or an angle sensor for each joint in the rig file"
            )
        if sensor is None:
            return {names[joints[0]]: table.in_si(column, "rad")}, TruthSource(
                TruthKind.COLUMN, f"column '{column}'"
            )
        return {names[sensor.of]: _in_si(sensor, table)}, TruthSource(
            TruthKind.SENSOR, f"column '{column}'"
        )
    if truth is not None:
        return read_truth(truth, clock.time, joints, clock.start), TruthSource(
            TruthKind.FILE, str(truth)
        )
    simulated = {name: f"true_{name}" for name in names.values()}
    angles = {
        name: table.in_si(header, "rad")
        for name, header in simulated.items()
        if header in table.columns
    }
    if angles:
        return angles, TruthSource(
            TruthKind.COLUMN, "column " + ", ".join(f"'{simulated[name]}'" for name in angles)
        )
    read = {names[s.of]: s for s in references.values() if s.log_column in table.columns}
    listed = ", ".join(f"'{sensor.log_column}'" for sensor in read.values())
    origin = TruthSource(TruthKind.SENSOR, f"column {listed}") if read else NO_SOURCE
    return {name: _in_si(sensor, table) for name, sensor in read.items()}, origin


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
    stamps, known = read_angles(path, angle_names(joints), start)
    angles = dict[str, Floats]()
    for name, theta in known.items():
        finite = np.isfinite(theta)
        if not finite.any() or stamps[finite][-1] < time[0] or stamps[finite][0] > time[-1]:
            raise LogError(
                f"{path}: does not overlap the log in time ({stamps[0]:g} to {stamps[-1]:g} s; "
                f"the log has {time[0]:g} to {time[-1]:g} s)"
            )
        angles[name] = np.interp(time, stamps[finite], theta[finite], left=np.nan, right=np.nan)
    return angles


def read_angles(
    path: str | Path, names: Sequence[str], start: int | None = None
) -> tuple[Floats, dict[str, Floats]]:
    """Return a file's stamps [s], from its column ``t``, and name → angle [rad] for the columns
    `names`.

    Args:
        start: when the log begins, since 1970 [ns], or None; see `read_truth`.

    Raises:
        LogError: the file cannot be read, or lacks a column.
    """
    cells = open_table(path, ["t", *names])
    cells.check(["t"])
    unit = scale(cells.units.get("t"), "s", f"{cells.path}: column 't'")
    stamps = clock_of(cells, "t", unit).since(start)
    table = table_of(cells, names)
    check_stamps(stamps, table.source, table.first_row)
    return stamps, {name: table.in_si(name, "rad") for name in names}


def unit_of_angles(path: str | Path, names: Sequence[str]) -> str:
    """Return "deg" where a header of the columns `names` in a file gives degrees, else "rad"."""
    units = {table_of(open_table(path, ["t", *names]), names).units.get(name) for name in names}
    return "deg" if units & {"deg", "°", "degrees", "degree"} else "rad"


def _in_si(sensor: Sensor, table: Table) -> Floats:
    factor = factor_of(sensor, table.units.get(sensor.log_column), table.source)
    values: Floats = sensor.sign * factor * table.columns[sensor.log_column]
    return values


def _goal_columns(rig: Rig) -> dict[str, str]:
    """Return drive → the log column of its setpoint, for the drives whose rig names one."""
    read = {sensor.of for sensor in rig.sensors_of("position")}
    servos = {drive.name: drive.servo for drive in rig.drives if drive.name in read}
    return {name: servo.goal for name, servo in servos.items() if servo and servo.goal}


def _goals(rig: Rig, table: Table) -> dict[str, Floats]:
    """Return drive → its setpoints in SI, (n,), for the drives whose setpoints the table has."""
    positions = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    goals = {}
    for name, column in _goal_columns(rig).items():
        if column in table.columns:
            position = positions[name]
            factor = factor_of(position, table.units.get(position.log_column), table.source)
            goals[name] = position.sign * factor * table.columns[column]
    return goals


def _doubts(log: Log, rig: Rig) -> Iterator[str]:
    """Yield a sentence for each sign that a unit is wrong: readings, intervals or angles of an
    unlikely size.
    """
    drives = {drive.name: drive for drive in rig.drives}
    for sensor in rig.sensors_of("position"):
        values = log.channels[sensor.name]
        values = np.where(np.abs(values) > LARGEST_READING, np.nan, values)
        if not np.isfinite(values).any():
            continue
        drive = drives[sensor.of]
        if drive.stops is not None:
            yield from _doubts_of_stops(log, sensor, values, drive.stops)
        span = float(np.nanmax(values) - np.nanmin(values))
        lever = drive.radius.value if isinstance(drive, Capstan) else 1.0
        # a joint turns by a few radians at most, and a tendon stretches by less than that
        travel = (
            span * lever / max(*(t.total_arm for t in rig.tendons if t.drive == sensor.of), 1e-12)
        )
        if travel > 50.0:
            hint = "mm" if sensor.si == "m" else "deg"
            yield (
                f"{log.source}: '{sensor.log_column}' spans {span:.3g} {sensor.si} when read in "
                f"'{sensor.unit or sensor.si}', far more than the joint can turn; is the log in "
                f"{hint}? "
                f"(--set 'sensors.{sensor.name}.unit=\"{hint}\"')"
            )
    rate = max((sensor.rate for sensor in rig.sensors), default=0.0)
    step = float(np.median(np.diff(log.time)))
    if rate > 0.0 and not 0.05 < step * rate < 20.0:
        yield (
            f"{log.source}: the stamps are {step:g} s apart, the rig's sensors give a value every "
            f"{1 / rate:g} s; is "
            "the unit of time right? (--set 'log.time.unit=\"ms\"', or the sensors' rate)"
        )
    joints = rig.joint_names
    names = dict(zip(joints, angle_names(joints)))
    for sensor in rig.sensors_of("angle"):
        theta = log.truth.get(names[sensor.of])
        largest = 0.0 if theta is None else float(np.nanmax(np.abs(theta), initial=0.0))
        if largest > 20.0:
            yield (
                f"{log.source}: the reference angle reaches {largest:.3g} rad; is it in degrees? "
                f"(--set 'sensors.{sensor.name}.unit=\"deg\"')"
            )


def _doubts_of_stops(
    log: Log, sensor: Sensor, values: Floats, stops: tuple[float, float]
) -> Iterator[str]:
    """Yield a sentence where a drive goes well beyond the stops that the rig gives it.

    The window of the motor's positions, its zero or its sign may then be wrong.
    """
    room = 0.02 * (stops[1] - stops[0]) + sensor.linearity + 5.0 * sensor.noise
    low = float(np.nanquantile(values, 0.02))
    high = float(np.nanquantile(values, 0.98))
    if low < stops[0] - room or high > stops[1] + room:
        drive = f"drives.{sensor.of}.stops"
        yield (
            f"{log.source}: '{sensor.log_column}' is between {low:.4g} and {high:.4g} {sensor.si} "
            "most of the time, beyond "
            f"{drive} = {list(stops)}; is the window right? (--set '{drive}=[…]')"
        )


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
    positions = {sensor.of: sensor for sensor in rig.sensors_of("position")}
    for name, column in _goal_columns(rig).items():
        if name in log.goals:
            position = positions[name]
            columns[column] = position.sign * log.goals[name] / log_factor(position)
    columns.update({f"true_{name}": values for name, values in log.truth.items()})
    write_columns(columns, path)


WRITTEN = "results are written as CSV (.csv, .txt) or Parquet (.parquet, .pq)"
"""Part of the message where a path ends in no format that can be written."""


def write_columns(columns: Mapping[str, NDArray[np.generic]], path: str | Path) -> None:
    """Write columns as CSV, or as Parquet if the path ends so; in CSV, NaN is an empty cell.

    Raises:
        OutputError: the file cannot be written.
    """
    write_whole(path, file_of(columns, path))


def file_of(columns: Mapping[str, NDArray[np.generic]], path: str | Path) -> bytes:
    """Return columns as the content of the file `path`, in the format of its ending.

    Raises:
        OutputError: see `check_format`.
    """
    check_format(path)
    write = format_of(path).write
    if write is None:
        raise OutputError(f"{path}: {WRITTEN}")
    return write(columns)


def check_format(path: str | Path) -> None:
    """Raise an `OutputError` where a path ends as a file that is never written (.xlsx, .ods, .mat,
    .npz, .h5), or where the package for its format is missing.
    """
    if Path(path).suffix.lower() in (".xlsx", ".xls", ".ods", ".mat", ".npz", ".h5"):
        raise OutputError(f"{path}: {WRITTEN}")
    package = format_of(path).package
    if package is not None and find_spec(package[0]) is None:
        raise OutputError(
            f"{path}: needs the package {package[0]} (pip install '.[{package[1]}]'); or write CSV"
        )
