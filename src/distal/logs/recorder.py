"""Write a stream to an MCAP file: the samples as received, and the estimates with their health."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from math import isfinite
from pathlib import Path
from typing import Any

from distal.errors import OutputError
from distal.logs.atomic_writes import check_writable
from distal.logs.stamps import LATEST
from distal.rig import angle_names, std_name

SAMPLE_TOPIC = "distal/sample"
"""Topic of the samples."""

ESTIMATE_TOPIC = "distal/estimate"
"""Topic of the estimates."""

LONGEST_STEM = 230
"""Bytes of the output's name that the name of its temporary file keeps, so that the longer name
stays within the 255 bytes of most file systems. Source: judgement.
"""

SAMPLE_SCHEMA = {
    "title": "distal.Sample",
    "description": "What the sensors read at a stamp, in the columns and units of the rig file; "
    "null where missing.",
    "type": "object",
    "additionalProperties": {"type": ["number", "null"]},
}
"""JSON schema of a sample."""


def estimate_schema(joints: Sequence[str], torques: Sequence[str] = ()) -> dict[str, object]:
    """Return the JSON schema of an estimate: stamp, angle and standard deviation of each joint,
    external torques, health and detail.

    Args:
        torques: names of the external torques that are estimated.
    """
    number: dict[str, object] = {"type": ["number", "null"]}
    properties: dict[str, object] = {
        "t": {"type": "number", "description": "stamp of the sample [s]"}
    }
    which = (
        ["joint angle"] if len(joints) == 1 else [f"angle of the joint {joint}" for joint in joints]
    )
    quantities = [
        *(
            (name, f"{of} [rad]; null where the sample was skipped", "rad")
            for name, of in zip(angle_names(joints), which)
        ),
        *(
            (name, "torque on the joint from outside [N m]; null where it was skipped", "N m")
            for name in torques
        ),
    ]
    for name, description, unit in quantities:
        properties[name] = number | {"description": description}
        properties[std_name(name)] = number | {
            "description": f"standard deviation of its error [{unit}]"
        }
    properties["health"] = {"type": "string", "description": "one word: see distal.run.HEALTH"}
    properties["detail"] = {"type": "string", "description": "which sensor, how long"}
    return {
        "title": "distal.Estimate",
        "description": "The joint angle at a stamp, and how it came about.",
        "type": "object",
        "properties": properties,
        "required": list(properties),
    }


class Recorder:
    """Writes an MCAP file.

    The file appears at its path only when it is closed, complete. Where no sample came, the old
    file stays.

    Args:
        joints: names of the joints.
        torques: names of the external torques that are estimated.

    Raises:
        OutputError: the file cannot be written, or the package mcap is missing.
    """

    def __init__(
        self, path: Path, joints: Sequence[str] = ("joint",), torques: Sequence[str] = ()
    ) -> None:
        try:
            from mcap.writer import Writer
        except ImportError:
            raise OutputError(
                f"{path}: MCAP needs the package mcap (pip install '.[mcap]')"
            ) from None
        check_writable(path)
        # a link is followed; a device or a pipe cannot be replaced, and is written as it is
        target = path.resolve()
        self._path = path
        self._target = target
        stem = target.name.encode(errors="ignore")[:LONGEST_STEM].decode(errors="ignore")
        self._part = target.with_name(f".{stem}.{os.getpid()}.part")
        self._direct = target.exists() and not target.is_file()
        if target.is_file() and not os.access(target, os.W_OK):
            raise OutputError(f"{path}: cannot be written (it is read-only)")
        try:
            self._file = (target if self._direct else self._part).open("wb")
        except OSError as problem:
            raise OutputError(f"{path}: cannot be written ({problem.strerror})") from None
        self._writer: Any = Writer(self._file)
        self._writer.start(profile="", library="distal")
        self._channels = {}
        for topic, schema in (
            (SAMPLE_TOPIC, SAMPLE_SCHEMA),
            (ESTIMATE_TOPIC, estimate_schema(joints, torques)),
        ):
            number = self._writer.register_schema(
                str(schema["title"]), "jsonschema", json.dumps(schema).encode()
            )
            self._channels[topic] = self._writer.register_channel(topic, "json", number)
        self._count = 0
        self._samples = 0

    def add(self, topic: str, time: float, message: Mapping[str, object]) -> None:
        """Write a message of `SAMPLE_TOPIC` or `ESTIMATE_TOPIC`; numbers that are not finite become
        null.

        Args:
            time: stamp [s].

        Raises:
            OutputError: the file cannot be written.
        """
        clean = {
            k: None if isinstance(v, float) and not isfinite(v) else v for k, v in message.items()
        }
        stamp = max(0, round(time * 1e9)) if isfinite(time) and abs(time) < LATEST else 0
        self._count += 1
        try:
            self._writer.add_message(
                self._channels[topic], stamp, json.dumps(clean).encode(), stamp, self._count
            )
        except OSError as problem:
            raise OutputError(f"{self._path}: cannot be written ({problem.strerror})") from None
        self._samples += topic == SAMPLE_TOPIC

    def close(self) -> bool:
        """Finish the file and move it to its path; return whether a sample was recorded.

        Raises:
            OutputError: the file cannot be written; the message says where the recorded part is.
        """
        try:
            self._writer.finish()
            self._file.close()
            if self._samples and not self._direct:
                os.replace(self._part, self._target)
        except OSError as problem:
            raise OutputError(
                f"{self._path}: cannot be written ({problem.strerror}); what was recorded until "
                "then is in "
                f"{self._part.name} beside it"
            ) from None
        if not self._samples and not self._direct:
            self._part.unlink(missing_ok=True)
        return self._samples > 0
