"""Logs in MCAP files and ROS bags: columns named by topic and field, stamps merged into rows."""

from __future__ import annotations

import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TypeGuard

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import DistalWarning, LogError, did_you_mean
from distal.logs.formats import Message, format_of
from distal.logs.messages import number_of

NEAR = 0.1
"""Messages whose stamps differ by less than this share of the busiest topic's interval are one row."""

Read = Callable[[str], object]

LATEST = 9.0e9
"""No stamp is later than this [s]: a stamp in another unit is."""


def is_recording(path: object) -> TypeGuard[str | Path]:
    """Return whether a path is an MCAP file or a ROS bag."""
    return isinstance(path, (str, Path)) and format_of(path).messages is not None


def open_recording(
    path: str | Path, columns: Sequence[str], time: str, unit: float = 1.0
) -> tuple[dict[str, Floats], NDArray[np.int64]]:
    """Return the columns that are in a recording with the time from its first stamp on, and the stamps [ns].

    A column is ``/topic.field``, e.g. ``/joint_states.position[0]`` or ``/load/left.wrench.force.z``;
    ``/joint_states[left_wrist].position`` is the element of that name, in whichever message has it. A bare name is looked
    for in every JSON message. The stamp is that of a message's header where it has one, else when it was
    recorded; a JSON message may have its own, in the rig's time column.

    Args:
        path: an MCAP file, or a bag of ROS 2 (a folder) or ROS 1.
        unit: in which it is [s].

    Raises:
        LogError: it cannot be read, a package for that is missing, or none of the columns is there.
    """
    path = Path(path)
    wanted = [(column, *_named(column)) for column in columns if column != time]
    cells: dict[str, list[tuple[str, int | None, int, float]]] = {column: [] for column, _, _ in wanted}
    topics: set[str] = set()
    for message in _messages(path, topics):
        stamp = message.stamp
        if message.json:
            stamp = _own_stamp(path, message, time, unit)
        for column, topic, field in wanted:
            value = element(message.read, field) if topic in ("", message.topic) and (topic or message.json) else None
            if value is None and message.json:
                value = message.read(column)
            if value is None:
                continue
            if isinstance(value, (list, dict)) or np.asarray(value, dtype=object).ndim > 0:
                raise LogError(f"{path}: '{column}' is no number; name one element of it, e.g. {column}[0]")
            try:
                number = number_of(value, column)
            except LogError as problem:
                raise LogError(f"{path}: {problem}") from None
            if not 0 <= message.recorded < LATEST * 1e9:
                raise LogError(f"{path}: '{message.topic}' was recorded at {message.recorded} ns, which is no time")
            cells[column].append((message.topic, stamp, message.recorded, number))
    found = {column: values for column, values in cells.items() if values}
    if not found:
        one = next(iter(cells), "")
        raise LogError(
            f"{path}: no message has '{one}'{did_you_mean(one.partition('.')[0], topics)}; columns are /topic.field, "
            f"the topics are {', '.join(sorted(topics))[:300] or 'none'}"
        )
    stamped = _in_cycles(_stamped(path, found), {column: topic for column, topic, field in wanted if field[:1] == "["})
    rows = _merged([[stamp for stamp, _ in values] for values in stamped.values()])
    columns_of = {time: (rows - rows[0]) * 1e-9 / unit}
    for column, entries in stamped.items():
        filled = np.full(len(rows), np.nan)
        at = np.searchsorted(rows, [stamp for stamp, _ in entries], side="right") - 1
        filled[at] = [value for _, value in entries]
        columns_of[column] = filled
    return columns_of, rows


def _named(column: str) -> tuple[str, str]:
    """Return topic and field of a column; a bare name has no topic.

    Of ``/joint_states[left.wrist].position`` the field is ``[left.wrist].position``: see `element`.
    """
    found = re.fullmatch(r"([^\[\].]*/[^\[\].]*)(\[[^\[\]]+\])\.(.+)", column)
    if found is not None:
        return found[1], f"{found[2]}.{found[3]}"
    topic, dot, field = column.partition(".")
    return (topic, field) if dot and "/" in topic else ("", column)


def element(read: Read, field: str) -> object:
    """Return a field of a message; of ``[left_wrist].position`` the element whose place in the message's ``name`` that is.

    Args:
        read: gives a field, None where it is not there.
    """
    found = re.fullmatch(r"\[([^\[\]]+)\]\.(.+)", field)
    if found is None:
        return read(field)
    names = read("name")
    if isinstance(names, str) or not isinstance(names, Iterable) or found[1] not in (known := list(names)):
        return None  # a driver may publish each joint in a message of its own
    return read(f"{found[2]}[{known.index(found[1])}]")


def _own_stamp(path: Path, message: Message, time: str, unit: float) -> int | None:
    """Return the stamp that a JSON message has itself [ns], or None."""
    for name, factor in ((time, unit), ("timestamp", 1.0)):
        value = message.read(name)
        if value is None:
            continue
        try:
            seconds = number_of(value, name) * factor
        except LogError as problem:
            raise LogError(f"{path}: {problem}") from None
        if not abs(seconds) < LATEST:
            raise LogError(
                f"{path}: '{name}' is {value}, {seconds:g} s, which is no time; what unit has it? (log.time.unit)"
            )
        return round(seconds * 1e9)
    return None


def _stamped(
    path: Path, found: dict[str, list[tuple[str, int | None, int, float]]]
) -> dict[str, list[tuple[int, float]]]:
    """Return stamps and values of each column, by one clock: the headers' where a topic has them, else the recorder's.

    Where a clock was set back only the longest part between is taken, and that is said.
    """
    stamped: dict[str, list[tuple[int, float]]] = {}
    clocks = {}
    for column, values in found.items():
        # a header of zero is none, unless others of the same topic are not: a simulation that begins at zero
        own = any(stamp for _, stamp, _, _ in values if stamp)
        clocks[column] = own
        stamped[column] = [(stamp if own and stamp is not None else at, number) for _, stamp, at, number in values]
    starts = [values[0][0] for values in stamped.values()]
    if len(set(clocks.values())) > 1 and max(starts) - min(starts) > 1e15:
        raise LogError(
            f"{path}: some topics have stamps of their own (from {min(starts) * 1e-9:.6g} s on), others only that of the "
            f"recorder ({max(starts) * 1e-9:.12g} s): two clocks; record all with headers, or all without"
        )
    back = [
        values[k][0]
        for values in stamped.values()
        for k in range(1, len(values))
        if values[k][0] < values[k - 1][0] - 1_000_000_000
    ]
    if not back:
        return stamped
    parts = {column: _parts_between(values) for column, values in stamped.items()}
    count = min(len(each) for each in parts.values())
    longest = max(range(count), key=lambda i: min(len(each[i]) for each in parts.values()))
    warnings.warn(
        f"{path}: the clock was set back {count - 1} times; only part {longest + 1} of {count} is read, the longest",
        DistalWarning,
        stacklevel=4,
    )
    return {column: each[longest] for column, each in parts.items()}


def _in_cycles(
    stamped: dict[str, list[tuple[int, float]]], topic_of: dict[str, str]
) -> dict[str, list[tuple[int, float]]]:
    """Return the same with one stamp for all joints of a cycle, where a driver publishes each in a message of its own.

    A cycle of a topic begins with a joint that the last one has already, or half an interval after it began.

    Args:
        stamped: stamps and values of each column.
        topic_of: column → topic of columns that name an element.
    """
    moved = dict(stamped)
    for topic in sorted(set(topic_of.values())):
        columns = [column for column in stamped if topic_of.get(column) == topic]
        if len(columns) < 2:
            continue
        intervals = [
            np.median(np.diff([stamp for stamp, _ in stamped[column]]))
            for column in columns
            if len(stamped[column]) > 1
        ]
        longest = 0.5 * float(min(intervals, default=0.0))
        entries = sorted((stamp, column, value) for column in columns for stamp, value in stamped[column])
        moved.update({column: [] for column in columns})
        begun, there = entries[0][0], set[str]()
        for stamp, column, value in entries:
            if column in there or stamp - begun > longest:
                begun, there = stamp, set()
            there.add(column)
            moved[column].append((begun, value))
    return moved


def _parts_between(values: list[tuple[int, float]]) -> list[list[tuple[int, float]]]:
    parts: list[list[tuple[int, float]]] = [[]]
    for k, value in enumerate(values):
        if k and value[0] < values[k - 1][0] - 1_000_000_000:
            parts.append([])
        parts[-1].append(value)
    return parts


def _merged(stamps: list[list[int]]) -> NDArray[np.int64]:
    """Return the stamps of rows: what is nearer than `NEAR` of the busiest topic's interval is one row."""
    intervals = [float(np.median(np.diff(np.unique(each)))) for each in stamps if len(set(each)) > 1]
    near = NEAR * min(intervals, default=0.0)
    every = np.unique(np.concatenate([np.array(each, dtype=np.int64) for each in stamps]))
    rows = [every[0]]
    for stamp in every[1:]:
        if stamp - rows[-1] > near:
            rows.append(stamp)
    return np.array(rows, dtype=np.int64)


def _messages(path: Path, topics: set[str]) -> Iterator[Message]:
    if not path.exists():
        raise LogError(f"{path}: is not there")
    try:
        read = format_of(path).messages
        assert read is not None
        yield from read(path, topics)
    except (LogError, GeneratorExit, MemoryError):
        raise
    except Exception as problem:
        raise LogError(f"{path}: cannot be read ({type(problem).__name__}: {str(problem)[:120]})") from None
