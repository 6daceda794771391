"""Read binary logs in a process of its own, so that a damaged file cannot end the caller's process.

Compiled code reads these files. The process has a limit on its memory, and is used again for the
next file.
"""

from __future__ import annotations

import atexit
import json
import os
import subprocess
import sys
import warnings
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from threading import Lock

from distal.errors import DistalWarning, LogError
from distal.logs.cells import Cells, Column, in_memory
from distal.logs.memory_limit import how_to_allow, memory_limit
from distal.logs.output_targets import shown
from distal.logs.reader import STAMPS, ReaderAnswer, Request, answer_to, unpacked

_BEGIN = (
    "import sys, json; sys.path[:] = json.loads(sys.argv[1]); from distal.logs.reader import "
    "serve; serve()"
)

_LOCK = Lock()


def table_by_process(path: Path, columns: Sequence[str] | None) -> Cells:
    """Return the table that a format's reader reads from a file, in a process of its own.

    Args:
        columns: names of the columns that are needed; None needs all.

    Raises:
        LogError: the file cannot be read, is damaged, or takes too much memory.
    """
    names, held_columns = _asked(
        {"path": str(path), "columns": None if columns is None else [*columns]}
    )
    return in_memory(held_columns, path, 1, names)


def recording_by_process(
    path: Path, columns: Sequence[str], time: str, unit: float
) -> tuple[Cells, Column]:
    """Return the table and the stamps [ns] that `open_recording` reads, in a process of its own.

    Args:
        columns: see `open_recording`.
        time: name of the rig's time column.
        unit: unit of the time column [s].

    Raises:
        LogError: the file cannot be read, is damaged, or takes too much memory.
    """
    names, recorded = _asked({"path": str(path), "columns": [*columns], "time": time, "unit": unit})
    return in_memory(recorded, path, 0, names), recorded[STAMPS]


def _asked(request: Request) -> tuple[list[str], dict[str, Column]]:
    """Return the names of all columns and the columns that were read; the reader's warnings are
    repeated here.

    Raises:
        LogError: the file cannot be read, is damaged, or takes too much memory.
    """
    path = request["path"]
    try:
        path.encode()
    except UnicodeEncodeError:
        raise LogError(f"{shown(path)}: the name is no UTF-8 text; rename the file") from None
    with suppress(FileNotFoundError):  # the folder may be gone
        request["folder"] = os.getcwd()
    with _LOCK:
        try:
            reader = _Reader.current()
        except OSError:  # where no process can be started, such as in an embedded interpreter
            reader = None
        answer, payload = answer_to(request) if reader is None else reader.ask(request)
    for text in answer.get("warnings", ()):
        warnings.warn(text, DistalWarning, stacklevel=5)
    if "error" in answer:
        raise LogError(answer["error"])
    return [*answer["names"]], unpacked(payload, answer["held"])


class _Reader:
    """A process that reads files one after the other, until a file or the caller ends it."""

    _now: _Reader | None = None

    @classmethod
    def current(cls) -> _Reader:
        """Return the running process, or start one; a forked caller starts its own."""
        limit = memory_limit()
        now = cls._now
        if now is None or now._of != (os.getpid(), limit) or now._process.poll() is not None:
            if now is not None and now._of[0] == os.getpid():
                now.end()
            cls._now = now = cls(limit)
        return now

    def __init__(self, limit: int) -> None:
        self._of = (os.getpid(), limit)
        # each thread reserves memory, and reading one file needs few threads
        few = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "2")
        # in a session of its own, so that Ctrl-C reaches only the caller, who ends it
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BEGIN, json.dumps(sys.path)],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **few, "PYTHONWARNINGS": "ignore"},
            start_new_session=True,
        )
        atexit.register(self.end)

    def ask(self, request: Request) -> tuple[ReaderAnswer, bytes]:
        """Return the answer to a request and the bytes of its table.

        Raises:
            LogError: reading ended the process.
        """
        process = self._process
        assert process.stdin is not None
        assert process.stdout is not None
        try:
            process.stdin.write(json.dumps(request).encode() + b"\n")
            process.stdin.flush()
            answer: ReaderAnswer = json.loads(process.stdout.readline())
            payload = process.stdout.read(answer["bytes"])
            if len(payload) < answer["bytes"]:
                raise EOFError
        except (OSError, ValueError, EOFError):
            code = self.end(patience=2.0)
            cause = f"signal {-code}" if code < 0 else f"exit code {code}"
            raise LogError(
                f"{shown(request['path'])}: cannot be read, it ended its reader ({cause}): it is "
                "damaged, "
                f"or takes too much memory ({how_to_allow()})"
            ) from None
        except BaseException:
            self.end()
            raise
        return answer, payload

    def end(self, patience: float = 0.0) -> int:
        """Stop the process, after `patience` [s] in which it may end by itself, and return its exit
        code.
        """
        process = self._process
        if self._of[0] != os.getpid():
            return 0  # a forked process leaves its parent's reader alone
        atexit.unregister(self.end)
        if _Reader._now is self:
            _Reader._now = None
        with suppress(subprocess.TimeoutExpired):
            process.wait(patience)
        process.kill()
        code = process.wait()
        for pipe in (process.stdin, process.stdout):
            with suppress(OSError):
                if pipe is not None:
                    pipe.close()
        return code
