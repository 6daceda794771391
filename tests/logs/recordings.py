"""Recordings that tests write: bags of ROS 2, and MCAP files of messages as JSON."""

from __future__ import annotations

import json
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

State = tuple[str, int, int, Sequence[str], Sequence[float], Sequence[float]]
"""Topic, stamp in the header [ns], time of recording [ns], names, positions and efforts."""


def write_bag(folder: Path, states: Iterable[State]) -> Path:
    """Write a bag of joint states, and one topic that nobody asked for."""
    from rosbags.rosbag2 import Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.LATEST)
    state, header = store.types["sensor_msgs/msg/JointState"], store.types["std_msgs/msg/Header"]
    time, text = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/String"]
    topics = {}
    with Writer(folder, version=9) as writer:
        chat = writer.add_connection("/chatter", text.__msgtype__, typestore=store)
        for topic, stamp, recorded, names, positions, efforts in states:
            if topic not in topics:
                topics[topic] = writer.add_connection(topic, state.__msgtype__, typestore=store)
            at = time(sec=stamp // 10**9, nanosec=stamp % 10**9)
            message = state(
                header=header(stamp=at, frame_id=""),
                name=list(names),
                position=np.array(positions),
                velocity=np.array([]),
                effort=np.array(efforts),
            )
            data = store.serialize_cdr(message, state.__msgtype__)
            writer.write(topics[topic], recorded, data)
        writer.write(chat, recorded, store.serialize_cdr(text(data="hello"), text.__msgtype__))
    return folder


class Recorder:
    """Writes messages as JSON to an MCAP file."""

    def __init__(self, path: Path) -> None:
        from mcap.writer import Writer

        self._file = path.open("wb")
        self._writer = Writer(self._file, chunk_size=4096)
        self._writer.start(profile="", library="test")
        self._channels: dict[str, int] = {}

    def add(self, topic: str, time: float, message: dict[str, object]) -> None:
        if topic not in self._channels:
            schema = self._writer.register_schema(topic, "jsonschema", b"{}")
            self._channels[topic] = self._writer.register_channel(topic, "json", schema)
        stamp = max(0, round(time * 1e9)) if abs(time) < 1e9 else 0
        finite = {
            k: None if isinstance(v, float) and not np.isfinite(v) else v
            for k, v in message.items()
        }
        data = json.dumps(finite).encode()
        self._writer.add_message(self._channels[topic], stamp, data, stamp)

    def close(self) -> None:
        self._writer.finish()
        self._file.close()
