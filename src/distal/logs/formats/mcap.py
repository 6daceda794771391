"""MCAP files: recordings of messages in JSON or of ROS 2."""

from __future__ import annotations

import json
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from distal.errors import LogError
from distal.logs.formats.format import Format, Message
from distal.logs.formats.ros_messages import field, stamp_of
from distal.logs.memory_limit import check_memory
from distal.logs.messages import find


def read_mcap(path: Path, topics: set[str]) -> Iterator[Message]:
    """Yield the messages of an MCAP file in the order in which they were recorded.

    Args:
        topics: a set, into which the names of the topics are put.
    """
    try:
        from mcap.reader import make_reader
    except ImportError:
        raise LogError(f"{path}: MCAP needs the package mcap (pip install '.[mcap]')") from None
    stores: dict[int, Any] = {}
    with path.open("rb") as file:
        reader = make_reader(file)
        summary = reader.get_summary()
        for chunk in [] if summary is None else summary.chunk_indexes:
            check_memory(
                path,
                2 * chunk.uncompressed_size,
                f"its header says {chunk.uncompressed_size:,} bytes in a chunk",
            )
        # in the order of recording, which shows where a clock was set back
        for schema, channel, message in reader.iter_messages(log_time_order=False):
            if channel.message_encoding == "json":
                topics.add(channel.topic)
                try:
                    read = json.loads(message.data)
                except (ValueError, RecursionError):
                    continue  # a message that is no JSON is skipped
                member = partial(find, read)
                yield Message(channel.topic, message.log_time, None, member, read, json=True)
            elif channel.message_encoding == "cdr" and schema is not None:
                topics.add(channel.topic)
                if schema.id not in stores:
                    stores[schema.id] = _typestore(path, schema)
                read = stores[schema.id].deserialize_cdr(message.data, schema.name)
                member = partial(field, read)
                yield Message(channel.topic, message.log_time, stamp_of(read), member, read)


def _typestore(path: Path, schema: Any) -> Any:
    """Return the reader of a schema's messages of ROS 2; an MCAP file holds their definitions."""
    try:
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore
    except ImportError:
        raise LogError(
            f"{path}: messages of ROS need the package rosbags (pip install '.[ros]')"
        ) from None
    store = get_typestore(Stores.LATEST)
    if schema.name not in store.fielddefs and schema.encoding == "ros2msg":
        store.register(get_types_from_msg(schema.data.decode(), schema.name))
    return store


MCAP = Format(endings=(".mcap",), messages=read_mcap)
