"""`distal stream`: estimates while the samples arrive."""

from __future__ import annotations

import csv
import json
import sys
from collections import Counter
from collections.abc import Iterable, Iterator
from itertools import chain, starmap
from math import degrees, isfinite, nan
from time import monotonic
from typing import TYPE_CHECKING, Annotated

from typer import Option

from distal.cli.console import warn, working
from distal.cli.shared_options import (
    EstimatorOption,
    RigOption,
    SetOption,
    UnitOption,
)
from distal.errors import LogError, OutputError, printable

if TYPE_CHECKING:
    from distal.logs import MessageReader
    from distal.run import Monitor, Reading

LONGEST_LINE = csv.field_size_limit()
"""Longest line that is read [bytes], so that a stream without line ends cannot fill the memory.
Source: definition (longest field of Python's csv module).
"""


def stream_command(
    rig: RigOption,
    estimator: EstimatorOption = None,
    *,
    as_json: Annotated[
        bool, Option("--json", help="Write JSON lines; default: as the input is.")
    ] = False,
    unit: UnitOption = None,
    set_: SetOption,
) -> None:
    """Read samples as CSV or JSON lines from stdin, write an estimate for each, with a word on its
    health.

    Columns and units are those that the rig's sensors name. CSV begins with a header. Each line is
    answered at once: t, theta and theta_std in the unit of the log's angles, where the rig's joint
    may be touched external_torque and external_torque_std in N m and contact, how probable it is
    that something touches it, health, detail.
    """
    from distal.logs import MessageReader
    from distal.rig import angle_unit, load_rig
    from distal.run import LiveEstimator, Monitor

    if sys.stdin is None or sys.stdout is None:
        raise OutputError("standard input or output is closed")
    described = load_rig(rig, set_)
    with working("preparing the filter"):
        live = LiveEstimator(described, estimator)
    monitor = Monitor(live)
    reader = MessageReader(described, live.channels)
    session = Session(monitor, reader, unit or angle_unit(described.sensors), as_json)
    try:
        for line in _lines():
            session.take(line)
    finally:
        session.end()
    if session.csv is None and session.no_header is not None:
        raise session.no_header


class Session:
    """One stream, from its first line to its last."""

    def __init__(
        self,
        monitor: Monitor,
        reader: MessageReader,
        unit: str = "rad",
        as_json: bool = False,
    ) -> None:
        from distal.rig import angle_names, std_name

        self._monitor = monitor
        self._reader = reader
        self._json = as_json
        units = dict.fromkeys(angle_names(monitor.rig.joint_names), unit)
        units |= dict.fromkeys(monitor.torque_names, "N m")
        self._units = {"t": "s"} | {
            column: unit for name, unit in units.items() for column in (name, std_name(name))
        }
        self._units |= dict.fromkeys(monitor.contact_names, "1")
        self.csv: bool | None = None  # not known before the first line
        self.no_header: LogError | None = None
        self._counts: Counter[str] = Counter()
        self._started = monotonic()

    def take(self, line: bytes) -> None:
        """Read a line and write the answer to it.

        Where the header of a CSV stream is read, the answer is the header of the output.
        """
        from distal.run import Reading

        # a tab at the end of a line may be an empty last cell
        text = line.decode("utf-8", "replace").strip("\r\n ").removeprefix("\ufeff").strip("\r\n ")
        if not text.strip() or (self.csv is None and text.startswith("#")):
            return
        if self.csv is None:
            # a logger that is joined midway may begin with half an object
            self.csv = not text.startswith(("{", "[")) and not text.endswith("}")
            if self.csv:
                self._begin(text)
                return
        try:
            if len(line) >= LONGEST_LINE:
                raise LogError("the line is too long")
            time, sample = self._reader.csv(text) if self.csv else self._reader.json(text)
            reading = self._monitor.take(time, sample, self._reader.remarks)
        except LogError as problem:
            reading = Reading(nan, (), (), "bad", str(problem))
        self._answer(reading)

    def _begin(self, text: str) -> None:
        """Read the header of a CSV stream, and write that of the answers."""
        from distal.logs import header

        try:
            self._reader.header(text)
        except LogError as problem:
            # a logger may say something else before its header
            if self.no_header is None:
                warn(f"{problem}; waiting for a header")
                self.no_header = problem
            self.csv = None
            return
        if self._reader.absent:
            warn(f"the stream has no column {', '.join(self._reader.absent)}")
        if not self._json:
            self._write_row([*starmap(header, self._units.items()), "health", "detail"])

    def _answer(self, reading: Reading) -> None:
        self._counts[reading.health] += 1
        values = chain(
            (reading.time,),
            *zip(reading.angles, reading.angle_stds),
            *zip(reading.torques, reading.torque_stds),
            (contact.probability for contact in reading.contacts),
        )
        message: dict[str, object] = dict.fromkeys(self._units)
        for (name, unit), value in zip(self._units.items(), values):
            if isfinite(value):
                message[name] = degrees(value) if unit == "deg" else float(value)
        message |= {"health": reading.health, "detail": printable(reading.detail)}
        if self._json or not self.csv:
            print(json.dumps(message), flush=True)
        else:
            self._write_row(message.values())

    def _write_row(self, cells: Iterable[object]) -> None:
        csv.writer(sys.stdout, lineterminator="\n").writerow(cells)
        sys.stdout.flush()

    def end(self) -> None:
        """Print on stderr how many samples came in which time, with their health words."""
        total = sum(self._counts.values())
        seconds = max(monotonic() - self._started, 1e-9)
        words = ", ".join(f"{count} {word}" for word, count in self._counts.most_common())
        print(f"{total} samples in {seconds:.1f} s{': ' + words if words else ''}", file=sys.stderr)


def _lines() -> Iterator[bytes]:
    """Yield the lines of stdin as they arrive; a line that is too long is cut, so that it is
    refused.
    """
    source = sys.stdin.buffer
    while line := source.readline(LONGEST_LINE):
        yield line
        while len(line) >= LONGEST_LINE and not line.endswith(b"\n"):
            line = source.readline(LONGEST_LINE)
