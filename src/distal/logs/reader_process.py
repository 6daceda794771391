"""Read binary logs in a process of its own, with a limit on its memory.

Compiled code of others reads these files: a damaged one may end the process that reads it, and a
small one can ask for more memory than there is. The process is used again for the next file.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
import warnings
from collections.abc import Callable, Sequence
from contextlib import suppress
from importlib import import_module
from io import BufferedReader
from pathlib import Path
from threading import Lock
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalWarning, LogError, UnitError
from distal.logs.cells import Cells, Column, in_memory
from distal.logs.outputs import shown
from distal.units import to_si

MOST_MEMORY = 2_000_000_000
"""Memory that reading a log may take, unless the user sets another limit [bytes]. Source:
judgement.
"""

COPIES = 3
"""Copies of what is read that are in memory while it is turned into numbers. Source: benchmark
(benchmarks/csv_readers).
"""

MEMORY_VARIABLE = "DISTAL_MAX_MEMORY"
"""Name of the environment variable that sets another limit; processes hand it on to those they
start.
"""

_BEGIN = (
    "import sys; sys.path[:] = sys.argv[1:]; from distal.logs.reader_process import serve; serve()"
)

_LOCK = Lock()


def memory_limit() -> int:
    """Return the memory that reading one log may take [bytes]: $DISTAL_MAX_MEMORY where it is set,
    such as ``8 GB``, else `MOST_MEMORY`.

    Raises:
        LogError: $DISTAL_MAX_MEMORY holds no size, or one below 1 MB.
    """
    text = os.environ.get(MEMORY_VARIABLE)
    if not text:
        return MOST_MEMORY
    quantity: float | str = text
    with suppress(ValueError):
        quantity = float(text)  # a bare number is in bytes
    try:
        size = to_si(quantity, "byte")
    except UnitError as problem:
        raise LogError(f"{MEMORY_VARIABLE}: {problem}") from None
    if not 1e6 <= size < 1e18:
        raise LogError(
            f"{MEMORY_VARIABLE}: '{text}' is no size to read logs with; from 1 MB on is allowed, "
            "e.g. 8 GB"
        )
    return int(size)


def check_rows(path: Path, rows: int, columns: int) -> None:
    """Raise a `LogError` where a table takes more memory than is allowed."""
    size = COPIES * rows * columns * np.dtype(np.float64).itemsize
    check_memory(path, size, f"has {rows:,} rows of {columns} columns")


def check_memory(path: Path, needed: float, why: str) -> None:
    """Raise a `LogError` where reading a log needs more memory than is allowed.

    Args:
        needed: memory that reading takes [bytes].
        why: first words of the message, which say what takes this memory.
    """
    if needed > memory_limit():
        raise LogError(
            f"{shown(path)}: {why}, about {needed / 1e9:.1f} GB in memory; {_how_to_allow()}"
        )


def _how_to_allow() -> str:
    """Return a sentence that says how the user allows more memory."""
    return (
        f"{memory_limit() / 1e9:.3g} GB are allowed; if the file is to be trusted, allow more "
        f"with {MEMORY_VARIABLE}=16GB distal …"
    )


Bytes: TypeAlias = NDArray[np.uint8]

Answer: TypeAlias = tuple[str, list[str], Sequence[str], int, dict[str, str]]
"""Error, warnings, names of all columns, row number of the first value, and name → type of NumPy's
of the columns that follow; it is empty for text, which comes as the bytes of its JSON.
"""


def read_apart(read: Callable[..., Cells], path: Path, *arguments: object) -> Cells:
    """Return ``read(path, *arguments)``, called in a process of its own; its warnings are repeated
    here.

    Args:
        read: function of a module, which returns a table that is `in_memory`.
        arguments: what JSON can hold.

    Raises:
        LogError: the file cannot be read, is damaged, or takes too much memory.
    """
    try:
        folder = os.getcwd()
    except FileNotFoundError:  # the folder is gone
        folder = ""
    request = json.dumps([folder, read.__module__, read.__name__, str(path), *arguments])
    with _LOCK:
        try:
            reader = _Reader.current()
        except OSError:  # where no process can be started, such as in an embedded interpreter
            reader = None
        answer, parts = _answer(request) if reader is None else reader.ask(request, path)
    error, messages, names, first_row, types = answer
    for text in messages:
        warnings.warn(text, DistalWarning, stacklevel=4)
    if error:
        raise LogError(error)
    columns: dict[str, Column] = {
        name: part.view(kind) if kind else json.loads(part.tobytes())
        for (name, kind), part in zip(types.items(), parts)
    }
    return in_memory(columns, path, first_row, names)


def _answer(request: str) -> tuple[Answer, list[Bytes]]:
    """Return what a request asks for, and the bytes of its columns."""
    folder, module, function, path, *arguments = json.loads(request)
    error = ""
    cells = in_memory({}, Path(path), 0, ())
    types = dict[str, str]()
    parts = list[Bytes]()
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", DistalWarning)
        try:
            if folder:
                os.chdir(folder)  # the caller may have gone elsewhere since
            cells = getattr(import_module(module), function)(Path(path), *arguments)
            for name, column in cells.held.items():
                if isinstance(column, list):
                    types[name] = ""
                    parts.append(np.frombuffer(json.dumps(column).encode(), np.uint8))
                else:
                    types[name] = column.dtype.str
                    parts.append(np.ascontiguousarray(column).view(np.uint8))
        except LogError as problem:
            error = str(problem)
        except MemoryError:
            error = f"{shown(path)}: takes too much memory to read; {_how_to_allow()}"
        except Exception as problem:
            reason = (str(problem).splitlines() or [""])[0][:120]
            error = (
                f"{shown(path)}: cannot be read ({type(problem).__name__}: {reason}); the file is "
                "damaged"
            )
    messages = [str(each.message) for each in caught if issubclass(each.category, DistalWarning)]
    if error:
        return (error, messages, (), 0, {}), []
    return ("", messages, cells.names, cells.first_row, types), parts


def serve() -> None:
    """Answer requests that come on standard input as lines of JSON, until it ends.

    An answer is a line of JSON, with the sizes of the columns that follow it.
    """
    # whatever a library prints must not stand between the answers
    answers = os.fdopen(os.dup(1), "wb")
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)
    for line in sys.stdin.buffer:
        _limit_memory(memory_limit())
        answer, parts = _answer(line.decode())
        answers.write(json.dumps([answer, [*map(len, parts)]]).encode() + b"\n")
        while parts:
            answers.write(parts.pop(0).data)
        answers.flush()


def _limit_memory(size: int) -> None:
    """Allow this process `size` bytes of memory, where the operating system has such a limit."""
    with suppress(ImportError, OSError, ValueError, AttributeError):
        import resource

        status = Path("/proc/self/status").read_text(encoding="ascii", errors="replace").split()
        # RLIMIT_DATA counts what is reserved, too, and that is VmData
        reserved, resident = (
            1024 * int(status[status.index(name) + 1]) for name in ("VmData:", "VmRSS:")
        )
        _, hard = resource.getrlimit(resource.RLIMIT_DATA)
        most = reserved + max(size - resident, 0)
        resource.setrlimit(resource.RLIMIT_DATA, (most if hard < 0 else min(most, hard), hard))


class _Reader:
    """A process that reads files one after the other, until a file or the caller ends it."""

    _now: _Reader | None = None

    @classmethod
    def current(cls) -> _Reader:
        """Return the running process, or start one; a forked caller starts its own."""
        of = os.getpid(), memory_limit()
        now = cls._now
        if now is None or now._of != of or now._process.poll() is not None:
            if now is not None:
                now.end()
            cls._now = now = cls(of)
        return now

    def __init__(self, of: tuple[int, int]) -> None:
        self._of = of
        # each thread reserves memory, and reading one file needs few threads; a pool of Arrow's own
        # keeps the memory of a file that was read
        few = dict.fromkeys(("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS"), "2")
        few["ARROW_DEFAULT_MEMORY_POOL"] = "system"
        # in a session of its own, so that Ctrl-C reaches only the caller, who ends it
        self._process = subprocess.Popen(
            [sys.executable, "-c", _BEGIN, *sys.path],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            env={**os.environ, **few, "PYTHONWARNINGS": "ignore"},
            start_new_session=True,
        )

    def ask(self, request: str, path: Path) -> tuple[Answer, list[Bytes]]:
        """Return the answer to a request and the bytes of its columns.

        Raises:
            LogError: reading the file at `path` ended the process.
        """
        process = self._process
        assert process.stdin is not None
        assert isinstance(process.stdout, BufferedReader)
        try:
            process.stdin.write(request.encode() + b"\n")
            process.stdin.flush()
            answer, sizes = json.loads(process.stdout.readline())
            parts = [np.empty(size, np.uint8) for size in sizes]
            for part in parts:
                if process.stdout.readinto(part.data) < len(part):
                    raise EOFError
        except (OSError, ValueError, EOFError):
            code = self.end(patience=2.0)
            cause = f"signal {-code}" if code < 0 else f"exit code {code}"
            raise LogError(
                f"{shown(path)}: cannot be read, it ended its reader ({cause}): it is damaged, or "
                f"takes too much memory ({_how_to_allow()})"
            ) from None
        except BaseException:
            self.end()
            raise
        return answer, parts

    def end(self, patience: float = 0.0) -> int:
        """Stop the process, after `patience` [s] in which it may end by itself, and return its exit
        code.
        """
        if self._of[0] != os.getpid():
            return 0  # a forked process leaves its parent's reader alone
        if _Reader._now is self:
            _Reader._now = None
        with suppress(subprocess.TimeoutExpired):
            self._process.wait(patience)
        self._process.kill()
        with suppress(OSError), self._process:  # it closes the pipes and waits
            pass
        return self._process.returncode
