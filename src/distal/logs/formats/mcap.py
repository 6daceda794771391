"""MCAP files: recordings of messages in JSON or of ROS 2."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from os import SEEK_END
from pathlib import Path
from typing import Any, BinaryIO

from distal.errors import LogError
from distal.logs.formats.format import Format, Message
from distal.logs.table_cells import say
from distal.machine_limits import memory_limit

MAGIC = b"\x89MCAP0\r\n"
"""First and last bytes of an MCAP file. Source: definition (MCAP specification)."""


def read_mcap(path: Path, topics: set[str]) -> Iterator[Message]:
    """Yield the messages of an MCAP file in the order in which they were recorded.

    Of a file without an end these are the messages that are whole.

    Args:
        topics: a set, into which the names of the topics are put.
    """
    from mcap.reader import NonSeekingReader

    stores: dict[int, Any] = {}
    with path.open("rb") as file:
        complete = _is_complete(path, file)
        reader = NonSeekingReader(file, record_size_limit=memory_limit())
        # in the order of recording, which shows where a clock was set back; where a file ends in
        # the middle of something, its reader may raise anything
        with suppress(*(() if complete else (Exception,))):
            for schema, channel, message in reader.iter_messages(log_time_order=False):
                in_json = channel.message_encoding == "json"
                if in_json or (channel.message_encoding == "cdr" and schema is not None):
                    topics.add(channel.topic)
                    decode = (
                        partial(_json, message.data)
                        if in_json
                        else partial(_of_ros, stores, schema, message.data)
                    )
                    yield Message(channel.topic, message.log_time, decode, in_json)


def _is_complete(path: Path, file: BinaryIO) -> bool:
    """Return whether an MCAP file has an end; warn where it has none."""
    begins = file.read(len(MAGIC))
    if begins != MAGIC:
        raise LogError(f"is no MCAP file, since it begins with {begins!r}")
    size = file.seek(-len(MAGIC), SEEK_END)
    complete = file.read() == MAGIC and size > 0
    file.seek(0)
    if not complete:
        say(f"{path}: has no end, recording or copying it was cut off; what is there is read")
    return complete


def _json(data: bytes) -> object:
    """Return the content of a message in JSON; one that is no JSON has none."""
    try:
        return json.loads(data)
    except (ValueError, RecursionError):
        return None


def _of_ros(stores: dict[int, Any], schema: Any, data: bytes) -> object:
    """Return the content of a message of ROS 2; an MCAP file holds the definitions of messages."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    if schema.id not in stores:
        store = get_typestore(Stores.LATEST)
        if schema.name not in store.fielddefs and schema.encoding == "ros2msg":
            store.register(get_types_from_msg(schema.data.decode(), schema.name))
        stores[schema.id] = store
    return stores[schema.id].deserialize_cdr(data, schema.name)


MCAP = Format("MCAP", endings=(".mcap",), messages=read_mcap)
