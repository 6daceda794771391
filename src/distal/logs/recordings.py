"""Logs in MCAP files and ROS bags: columns named by topic and field, stamps merged into rows."""

from __future__ import annotations

import json
import re
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeGuard

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalWarning, LogError, did_you_mean
from distal.logs.memory import check_memory
from distal.logs.messages import find, number_of

if TYPE_CHECKING:
    import polars

NEAR = 0.1
"""Messages whose stamps differ by less than this share of the busiest topic's interval are one row."""

Read = Callable[[str], object]

LATEST = 9.0e9
"""No stamp is later than this [s]: a stamp in another unit is."""


@dataclass(frozen=True)
class Message:
    """One message of a recording.

    Args:
        topic: where it was published.
        recorded: when [ns].
        stamp: of its header [ns]; None where it has none.
        read: gives a field, None where it is not there.
        json: whether it is JSON, whose fields may be looked for by name alone.
    """

    topic: str
    recorded: int
    stamp: int | None
    read: Read
    json: bool = False


def is_recording(path: object) -> TypeGuard[str | Path]:
    """Return whether a path is an MCAP file or a ROS bag.

    Args:
        path: of a log.
    """
    if not isinstance(path, (str, Path)):
        return False
    path = Path(path)
    try:
        return path.suffix.lower() in (".mcap", ".bag", ".db3") or (path / "metadata.yaml").is_file()
    except OSError:
        return False


def open_recording(
    path: str | Path, columns: Sequence[str], time: str, unit: float = 1.0
) -> tuple[polars.DataFrame, NDArray[np.int64]]:
    """Return the columns that are in a recording with the time from its first stamp on, and the stamps [ns].

    A column is ``/topic.field``, e.g. ``/joint_states.position[0]`` or ``/load/left.wrench.force.z``;
    ``/joint_states[left_wrist].position`` is the element of that name, in whichever message has it. A bare name is looked
    for in every JSON message. The stamp is that of a message's header where it has one, else when it was
    recorded; a JSON message may have its own, in the rig's time column.

    Args:
        path: an MCAP file, or a bag of ROS 2 (a folder) or ROS 1.
        columns: names that are wanted.
        time: the rig's time column.
        unit: in which it is [s].

    Raises:
        LogError: it cannot be read, a package for that is missing, or none of the columns is there.
    """
    import polars

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
            if isinstance(value, (list, dict)) or np.ndim(value) > 0:  # type: ignore[arg-type]
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
    return polars.DataFrame(columns_of), rows


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
        field: its name.
    """
    found = re.fullmatch(r"\[([^\[\]]+)\]\.(.+)", field)
    if found is None:
        return read(field)
    names = read("name")
    if not isinstance(names, Iterable) or isinstance(names, str) or found[1] not in list(names):
        return None  # a driver may publish each joint in a message of its own
    return read(f"{found[2]}[{list(names).index(found[1])}]")


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
        if path.suffix.lower() == ".mcap":
            yield from _mcap(path, topics)
        else:
            yield from _bag(path.parent if path.suffix.lower() == ".db3" else path, topics)
    except (LogError, GeneratorExit, MemoryError):
        raise
    except Exception as problem:
        raise LogError(f"{path}: cannot be read ({type(problem).__name__}: {str(problem)[:120]})") from None


def _mcap(path: Path, topics: set[str]) -> Iterator[Message]:
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise LogError(f"{path}: MCAP needs the package mcap (pip install '.[mcap]')") from None
    known: dict[int, Any] = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        for chunk in [] if summary is None else summary.chunk_indexes:
            check_memory(
                path, 2 * chunk.uncompressed_size, f"its header says {chunk.uncompressed_size:,} bytes in a chunk"
            )
        # as they were recorded: a clock that was set back is then seen
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                topics.add(channel.topic)
                try:
                    read = json.loads(message.data)
                except (ValueError, RecursionError):
                    continue  # one message that is none costs itself only
                yield Message(channel.topic, message.log_time, None, partial(find, read), json=True)
            elif channel.message_encoding == "cdr" and schema is not None:
                topics.add(channel.topic)
                if schema.id not in known:
                    known[schema.id] = _typestore(path, schema)
                read = known[schema.id].deserialize_cdr(message.data, schema.name)
                yield Message(channel.topic, message.log_time, _stamp(read), partial(_field, read))


def _typestore(path: Path, schema: Any) -> Any:
    """Return what can read messages of ROS 2 in an MCAP file, which holds their definitions."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise LogError(f"{path}: messages of ROS need the package rosbags (pip install '.[ros]')") from None
    store = get_typestore(Stores.LATEST)
    if schema.name not in store.fielddefs and schema.encoding == "ros2msg":
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
    return store


def _bag(path: Path, topics: set[str]) -> Iterator[Message]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(f"{path}: ROS bags need the package rosbags (pip install '.[ros]')") from None
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        topics.update(connection.topic for connection in reader.connections)
        for connection, recorded, raw in reader.messages():
            read = reader.deserialize(raw, connection.msgtype)
            yield Message(connection.topic, recorded, _stamp(read), partial(_field, read))


def _stamp(message: object) -> int | None:
    """Return the stamp of a message's header [ns], None where it has none."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    return None if stamp is None else int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def _field(message: Any, path: str) -> Any:
    """Return a field of a message of ROS, ``wrench.force.z`` or ``position[0]``; None if it is not there."""
    for part in _parts(path):
        if isinstance(part, int):
            if not hasattr(message, "__len__") or part >= len(message):
                return None
            message = message[part]
        else:
            message = getattr(message, part, None)
            if message is None:
                return None
    return message


def _parts(path: str) -> Iterable[str | int]:
    for part in path.replace("[", ".[").split("."):
        if part.startswith("["):
            yield int(part[1:-1]) if part[1:-1].isdecimal() else part
        elif part:
            yield part
