"""Bags of ROS 1, which are files, and of ROS 2, which are folders."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from distal.logs.formats.format import Format, Message


def read_rosbag(path: Path, topics: set[str]) -> Iterator[Message]:
    """Yield the messages of a bag.

    Args:
        path: the bag, or the database (``.db3``) in the folder of a ROS 2 bag.
        topics: a set, into which the names of the topics are put.
    """
    from rosbags.highlevel import AnyReader
    from rosbags.typesys import Stores, get_typestore

    path = path.parent if path.suffix.lower() == ".db3" else path
    with AnyReader([path], default_typestore=get_typestore(Stores.LATEST)) as reader:
        topics.update(connection.topic for connection in reader.connections)
        for connection, recorded, raw in reader.messages():
            decode = partial(reader.deserialize, raw, connection.msgtype)
            yield Message(connection.topic, recorded, decode)


ROSBAG = Format("a ROS bag", endings=(".bag", ".db3"), messages=read_rosbag, folder="metadata.yaml")
