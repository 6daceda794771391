"""Where the truth of a log comes from: the kind of source, for the program, and its name, for
people.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum


class TruthKind(Enum):
    """The kind of source that a log's truth has."""

    UNKNOWN = "unknown"
    """The kind of source was not given."""

    SENSOR = "sensor"
    """The truth is read by the rig's own reference sensors."""

    HOME = "home"
    """The truth is the known angles of the joints while homing; it counts as readings, see
    `distal.homing`.
    """

    SIMULATION = "simulation"
    """The truth is that of a simulation that has just run."""

    COLUMN = "column"
    """The truth is another column of the log, such as one that a simulation wrote."""

    FILE = "file"
    """The truth is in a file beside the log."""

    @property
    def by_sensor(self) -> bool:
        """Whether the truth of this kind is read by sensors of the rig, with their errors."""
        return self in (TruthKind.SENSOR, TruthKind.HOME)


@dataclass(frozen=True)
class TruthSource:
    """Where a log's truth comes from; `position` names the column, file or mark, for people."""

    kind: TruthKind = TruthKind.UNKNOWN
    position: str = ""

    def __str__(self) -> str:
        """Return the source in words."""
        parts = (self.position, "the reference sensor" if self.kind.by_sensor else "")
        return ", ".join(part for part in parts if part)


NO_SOURCE = TruthSource()
"""The source of a truth that is not there, or whose source was not given."""

FROM_SENSOR = TruthSource(TruthKind.SENSOR)
"""The source of a truth that the rig's own reference sensor reads."""


def truth_source_of(source: TruthSource | str) -> TruthSource:
    """Return the source of a truth; a text becomes a source of unknown kind."""
    return TruthSource(position=source) if isinstance(source, str) else source
