"""What a column of a log is found to be."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

from distal.from_logs.column_names import Role
from distal.from_logs.column_values import ValueEvidence

Sureness = Literal["sure", "likely", "a guess", "assumed"]
"""How sure something is. An assumed unit is that of a scale that no log tells, as of a load in
percent.
"""


@dataclass(frozen=True)
class ColumnRole:
    """What a column is.

    Args:
        header: as the logs have it.
        role: time, position or effort of a drive, angle of a joint, command, or other.
        part: name of the drive or joint, empty for time and other.
        unit: of its values, as a rig file has it; empty where it has none.
        si: SI unit of its dimension; "count" for an encoder's counts.
        sureness: of the role.
        unit_sureness: of the unit.
        evidence: why, in a line.
        values: what its values say.
    """

    header: str
    role: Role
    part: str
    unit: str
    si: str
    sureness: Sureness
    unit_sureness: Sureness
    evidence: str
    values: ValueEvidence

    @property
    def in_words(self) -> str:
        """All of it in a line."""
        of = f" of {self.part}" if self.part else ""
        unit = f" in {self.unit}" if self.unit else ""
        if self.unit_sureness == "assumed":
            return (
                f"{self.header}: {self.role}{of} of an assumed scale, {self.sureness}: "
                f"{self.evidence}"
            )
        doubt = "" if self.unit_sureness == "sure" or not self.unit else f" ({self.unit_sureness})"
        return f"{self.header}: {self.role}{of}{unit}{doubt}, {self.sureness}: {self.evidence}"


@dataclass(frozen=True)
class Overrides:
    """What a user says of columns.

    Args:
        truth: headers of joints' reference angles.
        drives: header of a drive's position → its unit, or empty.
        ignore: headers that are none of this.
    """

    truth: tuple[str, ...] = ()
    drives: Mapping[str, str] = field(default_factory=dict)
    ignore: tuple[str, ...] = ()
