"""Tables from files and frames: CSV, Parquet, HDF5; MCAP files and ROS bags, where topic and field
name a column and near stamps become one row; episodes of robot-learning datasets (LeRobot,
versions 2 and 3), each of which is a log.

Every error names the file, row and column, the value found, and what is allowed.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, is_dataclass, replace
from functools import lru_cache
from math import isnan, nan
from pathlib import Path
from typing import Any, Protocol, TypeAlias

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.errors import LogError, did_you_mean
from distal.logs.formats.format import Message, UndecodableError
from distal.logs.formats.registry import check_is_content, format_of
from distal.logs.messages import TIMES, number_of, stamp_of
from distal.logs.stamps import (
    LATEST_DATE,
    longest_part,
    say_wild,
    set_backs,
    wild_stamps,
)
from distal.logs.table_cells import (
    INFO,
    Cells,
    Column,
    as_column,
    dataset_info,
    headers_of,
    name_and_unit,
    needed,
    say,
)

SAME_ROW = 0.1
"""Share of the busiest topic's interval within which messages belong to one row. Source:
judgement.
"""

OF_A_TOPIC = 50
"""Number of messages of one topic that are looked at for columns: a driver may publish each joint
in a message of its own. Source: judgement.
"""

LONGEST = 64
"""Length of the longest array whose elements are columns; longer ones are images and clouds of
points. Source: judgement.
"""

NO_TIME = round(LATEST_DATE * 1e9)
"""Stamp in place of one that is no time [ns]. Source: definition (unit conversion)."""

SAMPLE = np.dtype(
    [("order", np.int64), ("stamp", np.int64), ("recorded", np.int64), ("value", np.float64)]
)
"""What a recording holds of a column: number of the message in the recording, stamp by its own
clock [ns], stamp of the recorder [ns], and value.
"""

Samples: TypeAlias = NDArray[np.void]
"""Samples of a column, (n,), of `SAMPLE`."""

Stamped: TypeAlias = tuple[NDArray[np.int64], Floats]
"""Stamps [ns] and values of a column, (n,) each."""


def read_recording(path: Path, columns: Sequence[str] | None, time: str, unit: float) -> Cells:
    """Return the columns that a recording has, and the stamps of its rows as dates.

    A column is ``/topic.field``, e.g. ``/joint_states.position[0]`` or
    ``/load/left.wrench.force.z``. In ``/joint_states[left_wrist].position``, the name in brackets
    says which joint's element it is, at whichever index a message has it. A bare name is looked for
    in every JSON message. A message's stamp is that of its header; a JSON message has it in the
    rig's time column or in ``timestamp``. Where a topic has no stamps, the time of recording is
    taken.

    Args:
        path: an MCAP file, or a bag of ROS 2 (a folder) or ROS 1.
        columns: names of the columns that are needed; None needs all that hold numbers.
        time: name of the rig's time column.
        unit: unit of the time column in JSON messages [s].

    Raises:
        LogError: none of the columns is there, one is no number, or the names of joints change
            their order.
    """
    columns = recorded_columns(path) if columns is None else columns
    if not columns:
        raise LogError("no message has numbers")
    readings: dict[str, list[tuple[int, int, int, float]]]
    readings = {column: [] for column in columns if column != time}
    topics = set[str]()
    owners = dict[str, str]()
    for order, message in enumerate(_messages_of(path, topics)):
        for column, samples in readings.items():
            cell = _cell(message, column)
            if cell is None:
                continue
            owner = _owner(message, column)
            if owner is not None and owners.setdefault(column, owner) != owner:
                topic, _, field = column.partition(".")
                raise LogError(
                    f"the names in {topic} change their order: '{column}' is of {owners[column]}, "
                    f"then of {owner}; name the joint, "
                    f"{topic}[{owners[column]}].{field.partition('[')[0]}"
                )
            if isinstance(cell, dict | list | np.ndarray):
                raise LogError(f"'{column}' is no number; name one element of it, e.g. {column}[0]")
            recorded = min(message.recorded, NO_TIME)
            stamp = recorded if message.stamp is None else message.stamp
            seconds = stamp_of(message.content, time, unit) if message.json else nan
            if not isnan(seconds):
                stamp = round(seconds * 1e9) if abs(seconds) < LATEST_DATE else NO_TIME
            samples.append((order, stamp, recorded, number_of(cell, column)))
    held = {column: samples for column, samples in readings.items() if samples}
    if not held:
        first = next(iter(readings), "")
        raise LogError(
            f"no message has '{first}'{did_you_mean(first.partition('.')[0], topics)}; columns are "
            f"/topic.field, the topics are {', '.join(sorted(topics))[:300] or 'none'}"
        )
    stamped = _stamped(path, held)
    _check_publishers(stamped)
    for topic in topics:
        in_cycle = {
            column: samples
            for column, samples in stamped.items()
            if _named(column)[0] == topic and _named(column)[1]
        }
        if len(in_cycle) > 1:
            stamped |= _in_cycles(in_cycle)
    rows, values_of = together(stamped)
    columns_of: dict[str, Column] = {time: rows.view("datetime64[ns]"), **values_of}
    return Cells(columns_of, path, 0, tuple(columns_of))


def together(stamped: Mapping[str, Stamped]) -> tuple[NDArray[np.int64], dict[str, Floats]]:
    """Return the stamps of rows [ns], (n,), and column → its values in them, NaN where missing.

    Stamps that are nearer to a row's first stamp than `SAME_ROW` times the busiest column's
    interval belong to this row.
    """
    distinct = [np.unique(stamps) for stamps, _ in stamped.values()]
    near = SAME_ROW * _shortest_interval(distinct)
    firsts = list[np.int64]()
    for stamp in np.unique(np.concatenate(distinct)):
        if not firsts or stamp - firsts[-1] > near:
            firsts.append(stamp)
    rows = np.array(firsts, dtype=np.int64)
    cells = {column: np.full(len(rows), np.nan) for column in stamped}
    for column, (stamps, values) in stamped.items():
        cells[column][np.searchsorted(rows, stamps, side="right") - 1] = values
    return rows, cells


@np.errstate(over="ignore")
def _check_publishers(stamped: dict[str, Stamped]) -> None:
    """Raise a `LogError` where most messages of a topic have the stamp of another one with another
    value: two nodes publish it.
    """
    for column, (stamps, values) in stamped.items():
        order = np.argsort(stamps, kind="stable")
        same = np.diff(stamps[order]) == 0
        differ = same & (np.diff(values[order]) != 0.0)
        if 4 * np.count_nonzero(differ) > len(stamps):
            topic = _named(column)[0]
            raise LogError(
                f"{np.count_nonzero(same)} of {len(stamps)} messages of {topic} have the stamp of "
                f"another one, with another {column}: are there two publishers? Record one of them "
                "alone, under a name of its own"
            )


@lru_cache
def _named(column: str) -> tuple[str, str, str]:
    """Return the topic of a column, the joint that it names, empty for none, and the field; or the
    two parts of a path in a JSON message.
    """
    match = re.fullmatch(r"([^\[\].]+)\[([^\[\]]+)\]\.(.+)", column)
    if match is not None:
        return match[1], match[2], match[3]
    topic, _, field = column.partition(".")
    return topic, "", field


def _cell(message: Message, column: str) -> object:
    """Return what a message holds of a column, or None where it lacks that."""
    topic, joint, field = _named(column)
    cell = None
    if field and topic == message.topic:
        cell = _element(message, joint, field) if joint else message.read(field)
    return message.read(column) if cell is None and message.json else cell


def _owner(message: Message, column: str) -> str | None:
    """Return whose element a column with an index is in a message, where that has names."""
    topic, joint, field = _named(column)
    at = re.search(r"\[(\d+)\]$", field)
    if at is None or joint or topic != message.topic:
        return None
    names = message.read("name")
    return str(names[int(at[1])]) if isinstance(names, list) and int(at[1]) < len(names) else None


def _element(message: Message, joint: str, field: str) -> object:
    """Return the element of a field at the index at which ``name`` holds the joint."""
    names = message.read("name")
    if isinstance(names, str) or not isinstance(names, Iterable):
        return None
    known = list(names)
    # a driver may publish each joint in a message of its own
    return message.read(f"{field}[{known.index(joint)}]") if joint in known else None


def _stamped(
    path: Path, readings: Mapping[str, list[tuple[int, int, int, float]]]
) -> dict[str, Stamped]:
    """Return column → its stamps and values, all by one clock: that of the headers where a topic
    has them, else the recorder's.

    A wild stamp is left out with its message, and a topic on another clock than most. Where a clock
    was set back, all topics are cut at its messages, and only the longest part is taken. All that
    is said.
    """
    kept = dict[str, Samples]()
    wild_in = dict[str, Bools]()
    for column, samples in readings.items():
        read = np.array(samples, SAMPLE)
        # a stamp of zero counts as missing, unless another stamp of the column is not zero, as in a
        # simulation that begins at zero
        if not read["stamp"].any():
            read["stamp"] = read["recorded"]
        stamps = read["stamp"]
        wild = wild_stamps(stamps)
        # what came late only stands where its stamp is
        wild &= (stamps < stamps[~wild].min()) | (stamps > stamps[~wild].max())
        wild_in[_named(column)[0]] = wild
        kept[column] = read[~wild]
        if (stamps[~wild] == NO_TIME).any():
            raise LogError(
                f"a stamp of '{column}' is beyond {LATEST_DATE:g} s, which is no time; what unit "
                "has it? (log.time.unit)"
            )
    for topic, wild in wild_in.items():
        say_wild(str(path), wild, f"message {int(wild.argmax()) + 1} of {topic}")
    _leave_out_another_clock(path, kept)
    ends, orders = max(
        ((set_backs(read["stamp"]), read["order"]) for read in kept.values()),
        key=lambda pair: (len(pair[0]), len(pair[1])),
    )
    part = orders[longest_part(ends, len(orders), str(path))]
    stamped = dict[str, Stamped]()
    for column, read in kept.items():
        if len(ends):
            read = read[(read["order"] >= part[0]) & (read["order"] <= part[-1])]
        stamped[column] = read["stamp"], read["value"]
    return stamped


def _leave_out_another_clock(path: Path, kept: dict[str, Samples]) -> None:
    """Remove the columns whose clock is farther from that of most columns than the recording is
    long, and warn of them. Clocks are compared by the recorder's, which is one for all.
    """
    away = {column: np.median(read["stamp"] - read["recorded"]) for column, read in kept.items()}
    longest = max(np.ptp(read[of]) for read in kept.values() for of in ("stamp", "recorded"))
    usual = max(away.values(), key=lambda one: sum(abs(one - a) <= longest for a in away.values()))
    begins = dict[str, float]()
    for column in [column for column, own in away.items() if abs(own - usual) > longest]:
        begins[_named(column)[0]] = 1e-9 * kept.pop(column)["stamp"][0]
    first = 1e-9 * next(iter(kept.values()))["stamp"][0]
    for topic, begin in begins.items():
        say(
            f"{path}: {topic} left out: its clock begins at {begin:.12g} s, the others' at "
            f"{first:.12g} s"
        )


def _in_cycles(stamped: Mapping[str, Stamped]) -> dict[str, Stamped]:
    """Return columns of one topic with one stamp for all joints of a cycle.

    This is for drivers that publish each joint in a message of its own. A cycle ends before a joint
    that it has already, and half an interval after it began.
    """
    longest = 0.5 * _shortest_interval([stamps for stamps, _ in stamped.values()])
    begins = dict[tuple[np.int64, str], np.int64]()
    begun = np.int64(0)
    cycle = set[str]()
    for at in sorted((stamp, column) for column in stamped for stamp in stamped[column][0]):
        stamp, column = at
        if not cycle or column in cycle or stamp - begun > longest:
            begun = stamp
            cycle = set()
        cycle.add(column)
        begins[at] = begun
    return {
        column: (np.array([begins[stamp, column] for stamp in stamps]), values)
        for column, (stamps, values) in stamped.items()
    }


def _shortest_interval(stamps: list[NDArray[np.int64]]) -> float:
    """Return the usual interval of the busiest column [ns], 0 where none has two stamps."""
    intervals = [np.median(np.diff(of_column)) for of_column in stamps if len(of_column) > 1]
    return float(min(intervals, default=0.0))


def _messages_of(path: Path, topics: set[str]) -> Iterator[Message]:
    """Yield the messages of a recording, and put the names of its topics into the set `topics`."""
    read = format_of(path).messages
    assert read is not None
    return read(path, topics)


def recorded_columns(path: Path) -> list[str]:
    """Return the columns with numbers in a recording: ``/topic.field``, and for an array beside
    names ``/topic[name].field``; stamps are none.

    Raises:
        LogError: the recording cannot be read, or a package for that is missing.
    """
    seen = Counter[str]()
    columns = dict[str, None]()
    for message in _messages_of(path, set()):
        seen[message.topic] += 1
        if seen[message.topic] <= OF_A_TOPIC:
            # messages that nobody asks for may be of a kind that cannot be read
            with suppress(UndecodableError, RecursionError):
                columns |= dict.fromkeys(_columns_of(message))
    return list(columns)


def _columns_of(message: Message) -> Iterator[str]:
    topic = "" if message.json and "/" not in message.topic else message.topic
    names = message.read("name")
    of_joints = [str(name) for name in names] if isinstance(names, list) else []
    for field in _fields(message.content):
        if message.json and field in TIMES:
            continue
        array, _, index = field.partition("[")
        index = index.rstrip("]")
        if topic and index.isdecimal() and int(index) < len(of_joints):
            yield f"{topic}[{of_joints[int(index)]}].{array}"
        else:
            yield f"{topic}.{field}" if topic else field


def _fields(content: object) -> Iterator[str]:
    """Yield the paths of all numbers in a message but those of its header."""
    members = vars(content) if is_dataclass(content) else content
    if not isinstance(members, dict):
        return
    for name, member in members.items():
        if name == "header":
            continue
        if _is_number(member):
            yield str(name)
        elif isinstance(member, list | np.ndarray):
            if len(member) <= LONGEST and all(map(_is_number, member)):
                yield from (f"{name}[{i}]" for i in range(len(member)))
        else:
            yield from (f"{name}.{inner}" for inner in _fields(member))


def _is_number(member: object) -> bool:
    return isinstance(member, int | float | np.number) and not isinstance(member, bool)


EPISODE = "episode_index"
"""Column that holds the number of the episode to which a row belongs."""


@dataclass(frozen=True)
class Episode:
    """One episode of a dataset: the file that holds it, and the episode's number."""

    path: Path
    number: int

    @property
    def name(self) -> str:
        """The episode's name in tables of results, and of files without their ending."""
        return f"episode_{self.number:06d}"

    stem = name

    def __str__(self) -> str:
        """Return file and number."""
        return f"{self.path}, episode {self.number}"


def episodes_of(folder: Path) -> list[Episode]:
    """Return the episodes of a dataset, in the order of its files.

    A file that cannot be read is left out with a warning.

    Raises:
        LogError: the dataset has no file, its description or all its files cannot be read, a row
            has no episode, or an episode is in two files.
    """
    dataset_info(folder)
    files = sorted((folder / "data").rglob("*.parquet"))
    if not files:
        raise LogError(f"{folder}: is a dataset without files in 'data'")
    found = dict[int, Episode]()
    problems = list[LogError]()
    for file in files:
        try:
            cells = _read(file, [EPISODE])
        except LogError as problem:
            problems.append(problem)  # a recording that broke off leaves a file without its end
            continue
        cells.check([EPISODE])
        values = cells.values(EPISODE)
        if not np.isfinite(values).all():
            raise LogError(f"{file}: '{EPISODE}' lacks values")
        for number in map(int, dict.fromkeys(values.tolist())):
            if number in found:
                raise LogError(f"{found[number]}: is in two files")
            found[number] = Episode(file, number)
    if not found and problems:
        raise problems[0]
    for unread in problems:
        say(f"left out: {unread}")
    return list(found.values())


def sources_of(logs: Sequence[Path]) -> list[Path | Episode]:
    """Return logs, each LeRobot dataset as its episodes; see `episodes_of`."""
    sources = list[Path | Episode]()
    for path in logs:
        sources += episodes_of(path) if (path / INFO).is_file() else [path]
    return sources


def _rows_of(episode: Episode, columns: Sequence[str] | None) -> Cells:
    """Return the cells of an episode."""
    asked = None if columns is None else (*columns, EPISODE)
    path = episode.path
    cells = _file(path, path.stat().st_mtime_ns if path.exists() else 0, asked)
    cells.check([EPISODE])
    mine = cells.values(EPISODE) == episode.number
    return replace(
        cells, columns={name: np.asarray(column)[mine] for name, column in cells.columns.items()}
    )


@lru_cache(maxsize=2)
def _file(path: Path, written: int, columns: tuple[str, ...] | None) -> Cells:
    """Return a file's cells, which are kept for the next call, since its episodes are read one
    after the other. `written` is when the file was changed last [ns], so that a changed file is
    read again.
    """
    return _read(path, columns)


class Frame(Protocol):
    """A table in memory with named columns, such as a frame of pandas or polars."""

    @property
    def columns(self) -> Iterable[str]:
        """Names of the frame's columns."""

    def __getitem__(self, name: str, /) -> object:
        """Return the column of a name."""


Source: TypeAlias = str | Path | Frame | Episode
"""The path of a file, a frame, or an episode of a dataset."""


def read_table(path: str | Path, desired: Sequence[str] | None = None) -> Cells:
    """Return columns of a CSV or Parquet file as numbers.

    Args:
        path: a file whose format follows from its ending; without a known ending it is CSV with a
            header, separated by comma, semicolon or tab.
        desired: columns that must be there; None reads all.

    Raises:
        LogError: the file cannot be read, a column is missing or doubled, a cell is not a number, a
            row is short or long, or there is no row.
    """
    cells = open_table(path, desired)
    return cells.parsed(cells.names if desired is None else desired)


def open_table(
    path: Source, columns: Sequence[str] | None = None, time: str = "t", unit: float = 1.0
) -> Cells:
    """Return the cells of a file, a recording of topics (`read_recording`), a frame, or
    an episode of a dataset.

    Args:
        path: a path, a frame of any library whose columns have ``to_numpy``, or an episode.
        columns: names of the columns that are needed, with or without units; None needs all. Others
            may be left out where the format allows that.
        time: time column; a recording has its stamps there, and a pandas frame that lacks it its
            index of dates.
        unit: unit of the time column in a recording's JSON messages [s].

    Raises:
        LogError: see `read_table`.
    """
    cells = _opened(path, columns, time, unit)
    name_of = headers_of(cells.names, columns or (), cells.source)
    if time in (columns or ()) and time not in (*cells.names, *name_of.values()):
        usual = [text for text in cells.columns if name_and_unit(text)[0].lower() in TIMES]
        if len(usual) == 1:
            name_of[usual[0]] = time
    return cells.renamed(name_of)


def _opened(path: Source, columns: Sequence[str] | None, time: str, unit: float) -> Cells:
    if isinstance(path, Episode):
        return _rows_of(path, columns)
    if isinstance(path, (str, Path)):
        return _read(Path(path), columns, time, unit)
    if not hasattr(path, "columns"):
        raise LogError(f"a log is a path, a frame or a distal.Log; {type(path).__name__} came")
    columns_of = {
        str(name): _column(path[name]) for name in path.columns if needed(str(name), columns)
    }
    names = [str(name) for name in path.columns]
    index = getattr(path, "index", None)
    if time not in names and _is_dated(index):
        columns_of[time] = _column(index)
        names = [*names, time]
    return Cells(columns_of, Path("the frame"), 0, tuple(names))


def _read(path: Path, columns: Sequence[str] | None, time: str = "t", unit: float = 1.0) -> Cells:
    """Return the cells of a file or a recording; see `open_table`."""
    kind = format_of(path)
    with kind.reading(path):
        check_is_content(path)
        if kind.read is None:
            return read_recording(path, columns, time, unit)
        if path.is_dir():
            raise LogError(
                f"is a folder without {INFO}, so no dataset; give its files, such as {path}/*.csv"
            )
        return kind.read(path, columns and [*columns, *TIMES])


def _is_dated(column: Any) -> bool:
    """Return whether a column or an index of a frame holds dates."""
    return str(getattr(column, "dtype", "")).startswith("datetime64")


def _column(column: Any) -> Column:
    """Return a frame's column or index as cells.

    Dates with a zone are turned into UTC.
    """
    if _is_dated(column) and getattr(column.dtype, "tz", None) is not None:
        column = getattr(column, "dt", column).tz_convert(None)
    return as_column(np.asarray(column.to_numpy()))
