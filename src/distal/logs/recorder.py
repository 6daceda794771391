"""Write a stream to an MCAP file: the samples as received, and the estimates with their health."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from math import isfinite
from pathlib import Path
from typing import Any

from distal.errors import OutputError
from distal.logs.outputs import as_output_error, beside, target_of
from distal.logs.stamps import LATEST
from distal.rig import angle_names, std_name

SAMPLE_TOPIC = "distal/sample"
"""Topic of the samples."""

ESTIMATE_TOPIC = "distal/estimate"
"""Topic of the estimates."""

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
    unit_of = dict.fromkeys(angle_names(joints), "rad") | dict.fromkeys(torques, "N m")
    of = {
        column: f"{text} [{unit}]; null where the sample was skipped"
        for name, unit in unit_of.items()
        for column, text in ((name, name), (std_name(name), f"standard deviation of {name}"))
    }
    texts = {"t": "stamp of the sample [s]"} | of
    properties = {
        name: {"type": ["number", "null"], "description": text} for name, text in texts.items()
    }
    words = {"health": "one word: see distal.run.HEALTH", "detail": "which sensor, how long"}
    properties |= {name: {"type": "string", "description": text} for name, text in words.items()}
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
        self._path = path
        with as_output_error(path):
            self._target = target_of(path)
            # where it ends early, what was recorded until then stays beside the path
            self._part = path if self._target is None else beside(self._target, b"", ExitStack())
            self._file = self._part.open("wb")
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
        """Write a message of `SAMPLE_TOPIC` or `ESTIMATE_TOPIC`; texts that are not finite become
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
        with as_output_error(self._path):
            self._writer.add_message(
                self._channels[topic], stamp, json.dumps(clean).encode(), stamp, self._count
            )
        self._samples += topic == SAMPLE_TOPIC

    def close(self) -> bool:
        """Finish the file and move it to its path; return whether a sample was recorded.

        Raises:
            OutputError: the file cannot be written; the message says where the recorded part is.
        """
        try:
            self._writer.finish()
            self._file.close()
            if self._samples and self._target is not None:
                os.replace(self._part, self._target)
        except OSError as problem:
            raise OutputError(
                f"{self._path}: cannot be written ({problem.strerror}); what was recorded until "
                f"then is in {self._part.name} beside it"
            ) from None
        if not self._samples and self._target is not None:
            self._part.unlink(missing_ok=True)
        return self._samples > 0
