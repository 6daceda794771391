"""The columns that a recording of topics offers, as `open_recording` names them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator
from dataclasses import fields, is_dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from distal.logs.formats import Message, UndecodableError
from distal.logs.messages import STAMPS
from distal.logs.recordings import messages_of

LOOKED_AT = 5000
"""Number of messages at the beginning whose fields are looked at. Source: judgement."""

OF_A_TOPIC = 50
"""Number of messages of one topic that are looked at: a driver may publish each joint in a message
of its own. Source: judgement.
"""

LONGEST = 64
"""Length of the longest array whose elements are columns; longer ones are images and clouds of
points. Source: judgement.
"""


def recorded_columns(path: str | Path) -> list[str]:
    """Return the columns with numbers in a recording: ``/topic.field``, and for an array beside
    names ``/topic[name].field``; stamps are none.

    Raises:
        LogError: the recording cannot be read, or a package for that is missing.
    """
    seen = Counter[str]()
    columns = dict[str, None]()
    for message in islice(messages_of(Path(path), set()), LOOKED_AT):
        seen[message.topic] += 1
        if seen[message.topic] <= OF_A_TOPIC:
            columns |= dict.fromkeys(_readable_columns(message))
    return list(columns)


def _readable_columns(message: Message) -> list[str]:
    """Return the columns of a message; none where it is of a kind that cannot be read, which
    messages that nobody asks for may be.
    """
    try:
        return list(_columns_of(message))
    except (UndecodableError, RecursionError):
        return []


def _columns_of(message: Message) -> Iterator[str]:
    topic = "" if message.json and "/" not in message.topic else message.topic
    names = message.read("name")
    of_joints = [str(name) for name in names] if isinstance(names, list) else []
    for field in _fields(message.content):
        if message.json and field in STAMPS:
            continue
        array, _, index = field.partition("[")
        index = index.rstrip("]")
        if topic and index.isdecimal() and int(index) < len(of_joints):
            yield f"{topic}[{of_joints[int(index)]}].{array}"
        else:
            yield f"{topic}.{field}" if topic else field


def _fields(content: object) -> Iterator[str]:
    """Yield the paths of all numbers in a message but those of its header."""
    if is_dataclass(content):
        members = {part.name: getattr(content, part.name) for part in fields(content)}
    elif isinstance(content, dict):
        members = content
    else:
        return
    for name, member in members.items():
        if name == "header" or isinstance(member, bool):
            continue
        if isinstance(member, int | float | np.number):
            yield str(name)
        elif isinstance(member, list | np.ndarray):
            is_numeric = len(member) <= LONGEST and all(
                isinstance(number, int | float | np.number) and not isinstance(number, bool)
                for number in member
            )
            yield from (f"{name}[{i}]" for i in range(len(member)) if is_numeric)
        else:
            yield from (f"{name}.{inner}" for inner in _fields(member))
