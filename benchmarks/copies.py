"""Copies of the project in which a module is changed and the fast tests are run, by
`benchmarks.mutants`.
"""

from __future__ import annotations

import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

STAGES = {
    "filter": (
        ("tests/estimators/adaptive/test_twin*.py", "tests/run/test_smoothing.py"),
        ("tests/estimators",),
        ("tests", "benchmarks/tests"),
    ),
    "learning": (
        ("tests/regression", "tests/homing"),
        ("tests/fitting", "tests/estimators"),
        ("tests", "benchmarks/tests"),
    ),
    "all": (
        ("tests/{package}", "tests/test_{package}.py"),
        ("tests/cli",),
        ("tests", "benchmarks/tests"),
    ),
}
"""For each part of the package which tests run first, then, and last; what ran before is left out:
its own see most.

`{package}` is that of the changed module.
"""

OMITTED = (
    ".*",
    "__pycache__",
    "build",
    "dist",
    "node_modules",
    "out",
    "*.egg-info",
    "test_mutants.py",
)
"""What a copy of the project does not need; the tests of this tool would see no mistake in a
filter.
"""

CHECK = "import distal, sys; sys.exit(not distal.__file__.startswith(sys.argv[1]))"


class BaselineError(Exception):
    """The unchanged copy does not pass; the message says where and why."""


@dataclass(frozen=True)
class Outcome:
    """What the tests said of one copy.

    Args:
        seen: whether a test failed.
        by: the first test that failed, or what else was seen.
        seconds: how long the tests ran.
    """

    seen: bool
    by: str
    seconds: float


class Processes:
    """Running test processes; all of them can be ended, from any thread."""

    def __init__(self) -> None:
        self._running: set[subprocess.Popen[str]] = set()
        self._lock, self._stopped = threading.Lock(), False

    def run(
        self, command: Sequence[str], folder: Path, environment: dict[str, str], limit: float
    ) -> tuple[int, str]:
        """Return exit code and output of a command, or −1 and "time-out"; its children end with it.

        Args:
            command: with its arguments.
            folder: where it runs.
            environment: its variables.
            limit: longest time [s].
        """
        with self._lock:
            if self._stopped:
                raise KeyboardInterrupt
            process = subprocess.Popen(
                command,
                cwd=folder,
                env=environment,
                stdin=subprocess.DEVNULL,
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
                errors="replace",
                start_new_session=True,
            )
            self._running.add(process)
        try:
            said, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            _end(process)
            process.communicate()
            return -1, "time-out"
        finally:
            # also what a test left behind
            _end(process)
            with self._lock:
                self._running.discard(process)
        if self._stopped:
            raise KeyboardInterrupt
        return process.returncode, said

    def stop(self) -> None:
        """End all that runs; nothing can be started any more."""
        with self._lock:
            self._stopped = True
            for process in self._running:
                _end(process)


def _end(process: subprocess.Popen[str]) -> None:
    """End a process and its group."""
    with suppress(ProcessLookupError, PermissionError):
        os.killpg(process.pid, signal.SIGKILL)


class Copy:
    """A copy of the project in which one module at a time is changed and tested.

    Args:
        root: folder of the project.
        folder: of the copy; it does not exist yet.
        processes: that run the tests.
        data: folder that the copies share: compiled kernels, the compiler's command.
        part: whose stages of tests run.
    """

    def __init__(
        self, root: Path, folder: Path, processes: Processes, data: Path, part: str = "filter"
    ) -> None:
        self.stages = STAGES[part]
        self._package = "*"
        self.folder, self._processes, self._temporary = (
            folder,
            processes,
            data / f"{folder.name}-pytest",
        )
        shutil.copytree(root, folder, symlinks=True, ignore=shutil.ignore_patterns(*OMITTED))
        scratch = data / f"{folder.name}-tmp"
        scratch.mkdir()
        self._environment = {
            **os.environ,
            "PYTHONPATH": os.pathsep.join([str(folder / "src"), str(folder)]),
            "TMPDIR": str(scratch),
            "DISTAL_CACHE": str(data / "kernels"),
            "CC": str(quick_compiler(data)),
            "OMP_NUM_THREADS": "1",
            "OPENBLAS_NUM_THREADS": "1",
        }

    def check(self) -> None:
        """Make sure that the copy is what its tests import.

        Raises:
            BaselineError: it is not.
        """
        code, said = self._processes.run(
            [sys.executable, "-c", CHECK, str(self.folder)], self.folder, self._environment, 120.0
        )
        if code:
            raise BaselineError(
                f"the copy's own package is not the one that is imported: {said.strip()[-300:]}"
            )

    def test(self, stage: int, limit: float) -> Outcome:
        """Run the tests of one stage until one fails.

        Args:
            stage: index in `stages`.
            limit: longest time [s].
        """
        # what the conftest calls the folder of kernels lies beside the base folder: copies share it
        desired, left_out = (
            self._found(stage),
            [each for before in range(stage) for each in self._found(before)],
        )
        if not desired:
            return Outcome(False, "", 0.0)
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "-p",
            "no:cacheprovider",
            "-m",
            "not slow and not more and not stored",
        ]
        command += [
            "--tb=line",
            f"--basetemp={self._temporary}",
            *(f"--ignore={each}" for each in left_out),
            *desired,
        ]
        started = time.monotonic()
        code, said = self._processes.run(command, self.folder, self._environment, limit)
        seconds = time.monotonic() - started
        if code in (0, 5):  # passed, or no test there
            return Outcome(False, "", seconds)
        return Outcome(True, first_failure(code, said), seconds)

    def _found(self, stage: int) -> list[str]:
        patterns = [each.format(package=self._package) for each in self.stages[stage]]
        return sorted(
            str(path.relative_to(self.folder))
            for each in patterns
            for path in self.folder.glob(each)
        )

    @contextmanager
    def changed(self, file: Path, text: str) -> Iterator[None]:
        """Change a module for a while.

        Args:
            file: its path within the project.
            text: what it says meanwhile.
        """
        path = self.folder / file
        before = path.read_text(encoding="utf-8")
        self._package = Path(*file.parts[2:3]).stem
        try:
            self._write(path, text)
            yield
        finally:
            self._write(path, before)
            self._package = "*"

    def _write(self, path: Path, text: str) -> None:
        path.write_text(text, encoding="utf-8")
        # compiled files are told apart by size and second, which two mutants may share
        for compiled in (path.parent / "__pycache__").glob(f"{path.stem}.*.pyc"):
            compiled.unlink()


def quick_compiler(folder: Path) -> Path:
    """Return a C compiler that optimises less: kernels of a mutant are used once, and have the same
    numbers.

    Args:
        folder: where its script is kept.
    """
    script = folder / "cc"
    if not script.exists():
        command = shlex.join(shlex.split(os.environ.get("CC") or "cc"))
        script.write_text(f'#!/bin/sh\nexec {command} "$@" -O1\n', encoding="utf-8")
        script.chmod(0o700)
    return script


def first_failure(code: int, said: str) -> str:
    """Return the test that failed, or what else pytest's output tells.

    Args:
        code: pytest's exit code.
        said: its output.
    """
    if said == "time-out":
        return "time-out: the tests hang"
    found = re.search(r"^(?:FAILED|ERROR) (\S+(?: \S+)*?)(?: - .*)?$", said, re.M)
    if found:
        return found[1]
    last = next((line for line in reversed(said.splitlines()) if line.strip()), "no output")
    return f"pytest ended with {code}: {last.strip()[:150]}"
