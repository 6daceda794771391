"""Logs in MCAP files and ROS bags: columns named by topic and field, stamps merged into rows."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from distal.errors import LogError, did_you_mean
from distal.logs.messages import find

if TYPE_CHECKING:
    import polars

NEAR = 0.1
"""Messages whose stamps differ by less than this share of the busiest topic's interval are one row."""

Message = tuple[str, int, Callable[[str], Any]]
"""Topic, stamp [ns], and what gives a field of it."""


def is_recording(path: object) -> bool:
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


def open_recording(path: str | Path, columns: Sequence[str], time: str, unit: float = 1.0) -> polars.DataFrame:
    """Return the columns that are in a recording, and the time from its first stamp on.

    A column is ``/topic.field``, e.g. ``/joint_states.position[0]`` or ``/load/left.wrench.force.z``; a bare name is
    looked for in every JSON message. The stamp is that of a message's header where it has one, else when it was
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
    wanted: dict[str, list[tuple[str, str]]] = {}
    for column in columns:
        if column != time:
            topic, _, field = column.partition(".") if "/" in column or column.startswith("/") else ("", "", column)
            wanted.setdefault(topic, []).append((field, column))
    stamps: dict[str, list[int]] = {}
    cells: dict[str, list[tuple[int, float]]] = {column: [] for column in columns if column != time}
    topics: set[str] = set()
    for topic, recorded, read in _messages(path, topics):
        stamp = recorded
        own = read(time) if topic.startswith(_JSON) else None
        plain = topic.removeprefix(_JSON)
        if own is not None:
            stamp = round(float(own) * unit * 1e9)
        for name, column in [*wanted.get(plain, ()), *(wanted.get("", ()) if plain != topic else ())]:
            value = read(name)
            if value is not None:
                if isinstance(value, (str, list, dict)) or np.ndim(value) > 0:
                    raise LogError(f"{path}: '{column}' is no number; name one element of it, e.g. {column}[0]")
                cells[column].append((stamp, float(value)))
                stamps.setdefault(plain, []).append(stamp)
    if not stamps:
        known = sorted(topic.removeprefix(_JSON) for topic in topics)
        one = next(iter(cells), "")
        raise LogError(
            f"{path}: no message has '{one}'{did_you_mean(one.partition('.')[0], known)}; columns are /topic.field, "
            f"the topics are {', '.join(known)[:300] or 'none'}"
        )
    rows = _merged(stamps)
    columns_of = {time: (rows - rows[0]) * 1e-9 / unit}
    for column, values in cells.items():
        if values:
            filled = np.full(len(rows), np.nan)
            at = np.searchsorted(rows, [stamp for stamp, _ in values], side="right") - 1
            filled[at] = [value for _, value in values]
            columns_of[column] = filled
    return polars.DataFrame(columns_of)


_JSON = "json:"


def _merged(stamps: dict[str, list[int]]) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Return the stamps of rows: what is nearer than `NEAR` of the busiest topic's interval is one row."""
    intervals = [float(np.median(np.diff(np.unique(each)))) for each in stamps.values() if len(set(each)) > 1]
    near = NEAR * min(intervals, default=0.0)
    every = np.unique(np.concatenate([np.array(each, dtype=np.int64) for each in stamps.values()]))
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
    except (LogError, GeneratorExit):
        raise
    except Exception as problem:
        raise LogError(f"{path}: cannot be read ({type(problem).__name__}: {str(problem)[:120]})") from None


def _mcap(path: Path, topics: set[str]) -> Iterator[Message]:
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise LogError(f"{path}: MCAP needs the package mcap (pip install 'distal[mcap]')") from None
    known: dict[int, Any] = {}
    with path.open("rb") as file:
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.message_encoding == "json":
                topics.add(channel.topic)
                read = json.loads(message.data)
                yield _JSON + channel.topic, message.log_time, lambda name, read=read: find(read, name)  # type: ignore[misc]
            elif channel.message_encoding == "cdr" and schema is not None:
                topics.add(channel.topic)
                if schema.id not in known:
                    known[schema.id] = _typestore(path, schema)
                read = known[schema.id].deserialize_cdr(message.data, schema.name)
                yield channel.topic, _stamp(read, message.log_time), lambda name, read=read: _field(read, name)  # type: ignore[misc]


def _typestore(path: Path, schema: Any) -> Any:
    """Return what can read messages of ROS 2 in an MCAP file, which holds their definitions."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise LogError(f"{path}: messages of ROS need the package rosbags (pip install 'distal[ros]')") from None
    store = get_typestore(Stores.LATEST)
    if schema.name not in store.fielddefs and schema.encoding == "ros2msg":
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
    return store


def _bag(path: Path, topics: set[str]) -> Iterator[Message]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError:
        raise LogError(f"{path}: ROS bags need the package rosbags (pip install 'distal[ros]')") from None
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        topics.update(connection.topic for connection in reader.connections)
        for connection, recorded, raw in reader.messages():
            read = reader.deserialize(raw, connection.msgtype)
            yield connection.topic, _stamp(read, recorded), lambda name, read=read: _field(read, name)  # type: ignore[misc]


def _stamp(message: Any, recorded: int) -> int:
    """Return the stamp of a message's header [ns], or when it was recorded."""
    stamp = getattr(getattr(message, "header", None), "stamp", None)
    own = int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec) if stamp is not None else 0
    return own if own > 0 else recorded


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
            yield int(part[1:-1]) if part[1:-1].isdigit() else part
        elif part:
            yield part
