"""The process that reads binary logs for `distal.logs.reader_process`.

Requests come on its standard input, and tables go out on its standard output.
"""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from collections.abc import Iterable, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TypedDict

import numpy as np

from distal.errors import DistalWarning, LogError
from distal.logs.cells import Column
from distal.logs.formats import format_of
from distal.logs.header_units import needed
from distal.logs.memory_limit import how_to_allow, memory_limit
from distal.logs.output_targets import shown
from distal.logs.recordings import open_recording


class Request(TypedDict, total=False):
    """What to read: columns of a table, or with `time` and `unit` those of a recording.

    The keys are the arguments of `table_by_process` and `recording_by_process`; `folder` is the
    caller's working folder.
    """

    path: str
    columns: list[str] | None
    time: str
    unit: float
    folder: str


class ReaderAnswer(TypedDict, total=False):
    """What was read, or an error.

    The keys: `names` of all columns of the file, `held` those of the columns that follow,
    `warnings`, `error`, and `bytes` the size of what follows.
    """

    names: Sequence[str]
    held: list[str]
    warnings: list[str]
    error: str
    bytes: int


def serve() -> None:
    """Answer requests until standard input ends.

    A request is a line of JSON; its answer is a line of JSON and the columns in the form of
    `packed`.
    """
    # whatever a library prints must not stand between the answers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin.buffer:
        limit_memory(memory_limit())
        answer, payload = answer_to(json.loads(line))
        answers.write(json.dumps({**answer, "bytes": len(payload)}).encode() + b"\n" + payload)
        answers.flush()


def limit_memory(size: int) -> None:
    """Allow this process `size` bytes of memory, where the operating system has such a limit."""
    with suppress(ImportError, OSError, ValueError, AttributeError):
        import resource

        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").split()
        # RLIMIT_DATA counts what is reserved, too, and that is VmData
        reserved = 1024 * int(status[status.index("VmData:") + 1])
        resident = 1024 * int(status[status.index("VmRSS:") + 1])
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = reserved + max(size - resident, 0)
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard < 0 else min(most, hard), hard))


def answer_to(request: Request) -> tuple[ReaderAnswer, bytes]:
    """Return the answer to a request, and the columns in the form of `packed`."""
    messages: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        try:
            if "folder" in request:
                os.chdir(request["folder"])  # the caller may have gone elsewhere since
            held: dict[str, Column]
            path = Path(request["path"])
            columns = request["columns"]
            read = format_of(path).read
            if read is None:
                recorded, stamps = open_recording(
                    path, columns or (), request["time"], request["unit"]
                )
                names = tuple(recorded)
                held = {**recorded, STAMPS: stamps}
            else:
                cells = read(path, columns)
                names = cells.names
                held = {name: cells.column(name) for name in names if needed(name, columns)}
            payload = packed(held.values())
        except LogError as problem:
            return {"error": str(problem), "warnings": messages}, b""
        except MemoryError:
            return {
                "error": f"{shown(request['path'])}: takes too much memory to read; "
                f"{how_to_allow()}"
            }, b""
        except Exception as problem:
            reason = (
                f"{type(problem).__name__}: "
                f"{str(problem).splitlines()[0][:120] if str(problem) else ''}"
            )
            return {
                "error": f"{shown(request['path'])}: cannot be read ({reason}); the file is damaged"
            }, b""
        finally:
            messages += [
                str(warning.message)
                for warning in caught
                if issubclass(warning.category, DistalWarning)
            ]
    return {"names": names, "held": [*held], "warnings": messages}, payload


STAMPS = "stamps [ns]"
"""Name of the column that holds a recording's stamps, beside the columns that were asked for."""


def packed(columns: Iterable[Column]) -> bytes:
    """Return columns as bytes, one after the other: arrays in NumPy's format, text as an array of
    the bytes of its JSON.
    """
    buffer = io.BytesIO()
    for column in columns:
        text = isinstance(column, list)
        array = np.frombuffer(json.dumps(column).encode(), np.uint8) if text else column
        buffer.write(b"t" if text else b"n")
        np.save(buffer, array, allow_pickle=False)
    return buffer.getvalue()


def unpacked(payload: bytes, names: Iterable[str]) -> dict[str, Column]:
    """Return the columns that `packed` turned into bytes."""
    buffer = io.BytesIO(payload)
    columns = dict[str, Column]()
    for name in names:
        text = buffer.read(1) == b"t"
        array = np.load(buffer, allow_pickle=False)
        columns[name] = json.loads(array.tobytes()) if text else array
    return columns
