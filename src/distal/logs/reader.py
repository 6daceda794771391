"""The process that reads binary logs for `distal.logs.reader_process`: requests come on standard input, tables go out."""

from __future__ import annotations

import io
import json
import os
import sys
import warnings
from pathlib import Path
from typing import Literal, TypedDict

from distal.errors import DistalWarning, LogError
from distal.logs.memory import how_to_allow, memory_limit
from distal.logs.parquet_files import read_parquet
from distal.logs.recordings import open_recording
from distal.logs.targets import shown


class Request(TypedDict, total=False):
    """What to read: a table, or with `time` and `unit` a recording."""

    read: Literal["parquet", "recording"]
    path: str
    columns: list[str] | None
    time: str
    unit: float
    folder: str


class Answer(TypedDict, total=False):
    """What was read: names of all columns and the size of the table that follows, or an error."""

    names: list[str]
    warnings: list[str]
    error: str
    bytes: int


def serve() -> None:
    """Answer requests, a JSON line each, until there are no more: a JSON line and a table as Arrow IPC."""
    # whatever a library prints must not stand between the answers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin.buffer:
        limit_memory(memory_limit())
        answer, payload = answer_to(json.loads(line))
        answers.write(json.dumps({**answer, "bytes": len(payload)}).encode() + b"\n" + payload)
        answers.flush()


def limit_memory(size: int) -> None:
    """Let this process have no more than `size` more bytes of memory; where the system has no such limit, nothing is done.

    Args:
        size: in bytes.
    """
    try:
        import resource

        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").split()
        # RLIMIT_DATA counts what is reserved, too, and that is VmData
        reserved = 1024 * int(status[status.index("VmData:") + 1])
        resident = 1024 * int(status[status.index("VmRSS:") + 1])
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = reserved + max(size - resident, 0)
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard < 0 else min(most, hard), hard))
    except (ImportError, OSError, ValueError, AttributeError):
        return


def answer_to(request: Request) -> tuple[Answer, bytes]:
    """Return the answer to a request: names and warnings, or an error; and the table.

    Args:
        request: what to read, as `distal.logs.reader_process` asks.
    """
    said: list[str] = []
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        try:
            buffer, names = io.BytesIO(), list[str]()
            if "folder" in request:
                os.chdir(request["folder"])  # the caller may have gone elsewhere since
            if request["read"] == "parquet":
                frame, names = read_parquet(Path(request["path"]), request["columns"])
            else:
                import polars

                path = Path(request["path"])
                frame, stamps = open_recording(path, request["columns"] or (), request["time"], request["unit"])
                frame = frame.hstack([polars.Series(f"stamps of {len(frame.columns)}", stamps)])
            frame.write_ipc(buffer)
        except LogError as problem:
            return {"error": str(problem), "warnings": said}, b""
        except MemoryError:
            return {"error": f"{shown(request['path'])}: takes too much memory to read; {how_to_allow()}"}, b""
        except Exception as problem:
            what = f"{type(problem).__name__}: {str(problem).splitlines()[0][:120] if str(problem) else ''}"
            return {"error": f"{shown(request['path'])}: cannot be read ({what}); the file is damaged"}, b""
        finally:
            said += [str(one.message) for one in caught if issubclass(one.category, DistalWarning)]
    return {"names": names, "warnings": said}, buffer.getvalue()
