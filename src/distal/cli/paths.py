"""Inputs and outputs of a command, which are checked before it begins; see
`distal.logs.check_outputs`.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Callable, Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from distal.errors import OutputError

if TYPE_CHECKING:
    from distal.logs import Output

BAG = (".db3", ".mcap", ".bag", ".zstd", ".yaml")
"""Endings of the files of a ROS bag."""


def write_each(*writes: Callable[[], object]) -> None:
    """Call each function, also after one that failed, and then raise the first failure.

    This failure lists all that is unsaved.
    """
    failures = []
    for write in writes:
        try:
            write()
        except OutputError as problem:
            failures.append(problem)
    if failures:
        for other in failures[1:]:
            failures[0].unsaved |= other.unsaved
        raise failures[0]


def to_file(option: str, path: Path | None) -> list[Output]:
    """Return the file that an option asks for; none where the option was not given."""
    from distal.logs import Output

    return [] if path is None else [Output(path, option)]


def to_folder(option: str, folder: Path | None, names: Iterable[str]) -> list[Output]:
    """Return the files in the folder that an option asks for; none where the option was not
    given.
    """
    from distal.logs import outputs_in

    return [] if folder is None else outputs_in(folder, names, option)


def check_command_outputs(
    outputs: Sequence[Output],
    *,
    logs: Iterable[Path] = (),
    rig: str | None = None,
    scenario: str | None = None,
    truth: str | None = None,
    stdin: bool = False,
) -> None:
    """Raise where an output would replace an input or another output, or cannot be written.

    Args:
        logs: paths of the logs that are read.
        rig: name of a shipped rig, or a path.
        scenario: name of a shipped scenario, or a path.
        truth: name of a column, or a path.
        stdin: whether standard input is read.

    Raises:
        OutputError: see `distal.logs.check_outputs` and `distal.logs.check_format`.
    """
    from distal import logs as files
    from distal.rig import description_path

    inputs: list[tuple[str, str | Path | int]] = [
        ("log", file) for log in logs for file in _files_of(log)
    ]
    if rig is not None:
        inputs.append(("rig", description_path(rig, "distal.rig")))
    if scenario is not None:
        inputs.append(("scenario", description_path(scenario, "distal.simulation")))
    if truth is not None and (os.path.exists(truth) or Path(truth).suffix.lower() in files.TABLES):
        inputs.append(("truth", truth))
    if stdin and sys.stdin is not None:
        inputs.append(("standard input", 0))
    printed = (("standard output", sys.stdout, 1), ("standard error", sys.stderr, 2))
    streams = [(label, number) for label, stream, number in printed if stream is not None]
    files.check_outputs(outputs, inputs, streams)
    for output in outputs:
        files.check_format(output.path)


def _files_of(log: Path) -> Iterator[Path]:
    """Yield the files from which a log is read; a ROS bag has several in its folder."""
    from distal.logs import is_recording

    yield log
    folder = log.parent if log.suffix.lower() == ".db3" else log
    if is_recording(log) and folder.is_dir():
        yield from (file for file in sorted(folder.iterdir()) if file.suffix.lower() in BAG)


ENDINGS = {
    "a rig file": (".toml",),
    "a page": (".html", ".htm"),
    "a recording": (".mcap",),
    "a table": (".csv", ".txt", ".parquet", ".pq", ""),
}
"""Kind of output → endings of its path; a table may go to a pipe, whose path has none."""


def check_ending(path: Path | None, kind: str) -> None:
    """Raise an `OutputError` where a path does not end as its kind of output does; see
    `ENDINGS`.
    """
    if path is not None and path.suffix.lower() not in ENDINGS[kind]:
        allowed = " or ".join(ending for ending in ENDINGS[kind] if ending)
        raise OutputError(f"{path}: {kind} ends in {allowed}")


def check_new(path: Path) -> None:
    """Raise an `OutputError` where a file exists already, since a user may have edited it."""
    if path.exists():
        raise OutputError(f"{path}: exists already; give another name or remove it")


def check_folder(out: Path, when: str) -> None:
    """Raise an `OutputError` where a folder is a file, or named like one."""
    from distal.logs import TABLES

    if os.path.isfile(out) or out.suffix.lower() in TABLES:
        raise OutputError(f"{out}: is a file, or named like one; {when}, --out is a folder")
