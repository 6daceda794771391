"""`distal stream`: estimates while the samples arrive."""

from __future__ import annotations

import csv
import json
import select
import signal
import socket
import sys
from collections import Counter
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from itertools import chain
from math import degrees, isfinite, nan
from pathlib import Path
from time import monotonic
from typing import TYPE_CHECKING, Annotated

import typer
from typer import Option

from distal.cli.console import warn, working
from distal.cli.paths import check_command_outputs, check_ending, to_file
from distal.cli.shared_options import EstimatorOption, RigOption, SetOption, UnitOption
from distal.errors import LogError, OutputError, printable

if TYPE_CHECKING:
    from collections.abc import Mapping

    from distal.arrays import Floats
    from distal.logs import MessageReader, Recorder
    from distal.run import Monitor, Reading

LONGEST_LINE = csv.field_size_limit()
"""Longest line that is read [bytes], so that a stream without line ends cannot fill the memory.
Source: definition (longest field of Python's csv module).
"""


def stream_command(
    rig: RigOption,
    estimator: EstimatorOption = "adaptive",
    *,
    udp: Annotated[
        int | None,
        Option(min=1, max=65535, help="Read JSON from this UDP port of the loopback, not stdin."),
    ] = None,
    to_udp: Annotated[
        int | None, Option(min=1, max=65535, help="Send estimates as JSON to this UDP port, too.")
    ] = None,
    as_json: Annotated[
        bool, Option("--json", help="Write JSON lines; default: as the input is.")
    ] = False,
    record: Annotated[
        Path | None, Option(help="Write samples and estimates to this MCAP file.")
    ] = None,
    idle: Annotated[
        float | None,
        Option(min=0.0, max=1e6, help="End after so many seconds without a message (UDP)."),
    ] = None,
    unit: UnitOption = "rad",
    set_: SetOption = None,
) -> None:
    """Read samples as CSV or JSON lines from stdin, write an estimate for each, with a word on its
    health.

    Columns and units are those that the rig's sensors name. CSV begins with a header. Each line is
    answered at once: t, theta and theta_std in rad (or --unit deg; recordings are in rad), where
    the rig's joint may be touched external_torque and external_torque_std in N m and contact, how
    probable it is that something touches it, health, detail.
    """
    from distal.logs import MessageReader, Recorder
    from distal.rig import load_rig
    from distal.run import LiveEstimator, Monitor

    if idle is not None and udp is None:
        raise OutputError("--idle is for --udp; standard input ends by itself")
    if (udp is None and sys.stdin is None) or sys.stdout is None:
        raise OutputError("standard input or output is closed")
    if udp is not None and udp == to_udp:
        raise OutputError(f"--to-udp {to_udp}: is the port that --udp reads; give another port")
    check_command_outputs(to_file("--record", record), rig=rig, stdin=udp is None)
    check_ending(record, "a recording")
    described = load_rig(rig, set_ or ())
    with working("preparing the filter"):
        live = LiveEstimator(described, estimator)
    monitor = Monitor(live)
    reader = MessageReader(described, live.channels)
    with ExitStack() as stack:
        source = stack.enter_context(_bound(udp)) if udp is not None else None
        target = (
            stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM))
            if to_udp is not None
            else None
        )
        joints = described.joint_names
        recorder = Recorder(record, joints, live.torque_names) if record is not None else None
        session = Session(
            monitor, reader, recorder, target, to_udp or 0, as_json or udp is not None, unit
        )
        session.csv = False if udp is not None else None
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, session.stop)
        try:
            for line in _datagrams(source, idle) if source is not None else _lines():
                session.take(line)
        finally:
            for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
                signal.signal(number, signal.SIG_IGN)  # no signal interrupts closing the recording
            session.end(record)
    if session.csv is None and session.no_header is not None:
        raise session.no_header
    if session.lost:
        raise typer.Exit(2)


class Session:
    """One stream, from its first line to its last."""

    def __init__(
        self,
        monitor: Monitor,
        reader: MessageReader,
        recorder: Recorder | None,
        target: socket.socket | None,
        port: int,
        as_json: bool,
        unit: str,
    ) -> None:
        self._monitor = monitor
        self._reader = reader
        self._recorder = recorder
        self._target = target
        self._port = port
        self._json = as_json
        from distal.rig import angle_names, std_name

        self._joints = monitor.rig.joint_names
        names = angle_names(self._joints)
        self._torques = monitor.torque_names
        units = {**dict.fromkeys(names, unit), **dict.fromkeys(self._torques, "N m")}
        self._units = {
            column: unit for name, unit in units.items() for column in (name, std_name(name))
        }
        self._units |= dict.fromkeys(monitor.contact_names, "1")
        self._names = list(self._units)
        self.csv: bool | None = None  # not known before the first line
        self.no_header: LogError | None = None
        self.lost = False
        self._counts: Counter[str] = Counter()
        self._started = monotonic()
        self._busy = False
        self._stopped = False

    def stop(self, *_: object) -> None:
        """End the stream after the present sample, so that a recording stays complete; a second
        call ends it at once.
        """
        first = not self._stopped
        self._stopped = True
        if not first or not self._busy:  # a second signal does not wait for the sample
            raise KeyboardInterrupt

    def take(self, line: bytes) -> None:
        """Read a line and write the answer to it.

        Where the header of a CSV stream is read, the answer is the header of the output.
        """
        self._busy = True
        self._take(line)
        self._busy = False
        if self._stopped:
            raise KeyboardInterrupt

    def _take(self, line: bytes) -> None:
        from distal.logs import header
        from distal.run import Reading

        # a tab at the end of a line may be an empty last cell
        text = line.decode("utf-8", "replace").strip("\r\n ").removeprefix("\ufeff").strip("\r\n ")
        if not text.strip() or (self.csv is None and text.startswith("#")):
            return
        if self.csv is None:
            # a logger that is joined midway may begin with half an object
            self.csv = not text.startswith(("{", "[")) and not text.endswith("}")
            if self.csv:
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
                    headers = [
                        header(name, unit) for name, unit in {"t": "s", **self._units}.items()
                    ]
                    self._write(",".join([*headers, "health", "detail"]))
                return
        try:
            if len(line) >= LONGEST_LINE:
                raise LogError("the line is too long")
            time, sample = self._reader.csv(text) if self.csv else self._reader.json(text)
        except LogError as problem:
            nothing = (nan,) * len(self._joints)
            untouched = (nan,) * len(self._torques)
            self._answer(
                Reading(nan, nothing, nothing, "bad", str(problem), untouched, untouched), None
            )
            return
        self._answer(self._monitor.take(time, sample), sample)

    def _answer(self, reading: Reading, sample: Floats | None) -> None:
        self._counts[reading.health] += 1
        values = chain(
            *zip(reading.angles, reading.angle_stds),
            *zip(reading.torques, reading.torque_stds),
            (contact.probability for contact in reading.contacts),
        )
        message = {
            "t": _finite(reading.time),
            **dict(zip(self._names, map(_finite, values))),
            "health": reading.health,
            "detail": printable(reading.detail),
        }
        self._record(reading, sample, message)
        for name, number in message.items():
            if self._units.get(name) == "deg" and isinstance(number, float):
                message[name] = degrees(number)
        if self._json or not self.csv:
            self._write(json.dumps(message))
        else:
            line = ",".join(
                "" if value is None else repr(value) for value in list(message.values())[:-2]
            )
            detail = printable(reading.detail).replace('"', "'")
            self._write(
                f'{line},{reading.health},"{detail}"' if detail else f"{line},{reading.health},"
            )
        if self._target is not None:
            sent = json.dumps({"timestamp": message["t"], **message}).encode()
            with suppress(OSError):  # it is no error where no program listens
                self._target.sendto(sent, ("127.0.0.1", self._port))

    def _record(
        self, reading: Reading, sample: Floats | None, message: Mapping[str, object]
    ) -> None:
        """Record a sample and its estimate; where recording fails, a warning is printed and the
        estimates go on.
        """
        from distal.logs import ESTIMATE_TOPIC, SAMPLE_TOPIC

        if self._recorder is None or not isfinite(reading.time) or self.lost:
            return
        try:
            if sample is not None and reading.health not in ("late", "duplicate", "bad"):
                self._recorder.add(
                    SAMPLE_TOPIC, reading.time, self._reader.message(reading.time, sample)
                )
            self._recorder.add(ESTIMATE_TOPIC, reading.time, message)
        except OutputError as problem:
            self.lost = True
            warn(f"{problem}; recording ends here, estimates go on")

    def _write(self, text: str) -> None:
        sys.stdout.write(text + "\n")
        sys.stdout.flush()

    def end(self, path: Path | None) -> None:
        """Close the recording, and print on stderr how many samples came in which time, with their
        health words.
        """
        total = sum(self._counts.values())
        seconds = max(monotonic() - self._started, 1e-9)
        words = ", ".join(f"{count} {word}" for word, count in self._counts.most_common())
        print(f"{total} samples in {seconds:.1f} s{': ' + words if words else ''}", file=sys.stderr)
        if self._recorder is not None and not self._recorder.close():
            print(f"nothing was recorded: {path} is as it was", file=sys.stderr)


def _finite(value: float) -> float | None:
    return float(value) if isfinite(value) else None


def _lines() -> Iterator[bytes]:
    """Yield the lines of stdin as they arrive; a line that is too long is cut, so that it is
    refused.
    """
    source = sys.stdin.buffer
    while line := source.readline(LONGEST_LINE):
        yield line
        while len(line) >= LONGEST_LINE and not line.endswith(b"\n"):
            line = source.readline(LONGEST_LINE)


def _bound(port: int) -> socket.socket:
    """Return a socket that receives what is sent to a port of the loopback."""
    receiver = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
    try:
        receiver.bind(("127.0.0.1", port))
    except OSError as problem:
        receiver.close()
        raise OutputError(
            f"UDP port {port}: cannot be read ({problem.strerror}); is another program there?"
        ) from None
    return receiver


def _datagrams(source: socket.socket, idle: float | None) -> Iterator[bytes]:
    """Yield the lines of datagrams as they arrive, until none arrived for `idle` seconds."""
    while select.select([source], [], [], idle)[0]:
        yield from source.recv(65536).splitlines() or [b""]
