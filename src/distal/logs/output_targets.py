"""Check the paths of all outputs before the work begins, so that no input is overwritten and no
result is lost at the end.
"""

from __future__ import annotations

import os
import stat
import tempfile
import unicodedata
from collections.abc import Iterable
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from distal.errors import OutputError

ROOM = 10
"""Bytes by which the name of the temporary file of `write_whole` is longer than the name of the
file itself. Source: definition (names of temporary files in Python: two dots, eight characters).
"""


Key = tuple[int | str, ...]
"""Identity of a file: its device and inode; for a file that does not exist yet, those of the
nearest existing folder and the names below it.
"""


@dataclass(frozen=True)
class Output:
    """A file that will be written.

    Args:
        by: option that asks for it, such as ``--out``.
        folder: folder that is made for it where it does not exist yet; None where none is made.
    """

    path: Path
    by: str
    folder: Path | None = None


def outputs_in(folder: str | Path, names: Iterable[str], by: str) -> list[Output]:
    """Return the outputs of the given names in a folder, which is made where it does not exist yet.

    Args:
        by: option that asks for them, such as ``--out``.
    """
    return [Output(Path(folder) / name, by, Path(folder)) for name in names]


def check_outputs(
    outputs: Iterable[Output],
    inputs: Iterable[tuple[str, str | Path | int]] = (),
    streams: Iterable[tuple[str, int]] = (),
) -> None:
    """Raise where an output would replace an input or another output, or cannot be written.

    Nothing is made or changed. Files are compared by what they are, not by their names: hard and
    symbolic links are followed, and new names that differ only by case are one.

    Args:
        inputs: label, e.g. ``--rig``, and path or file descriptor of what is read.
        streams: label and file descriptor of where text is printed, e.g. ``("standard output",
            1)``.

    Raises:
        OutputError: an output is an input, or two are the same file; it is a folder; its name has a
            character or a length that cannot be written; its folder is missing, no folder, or
            read-only.
    """
    outputs = list(outputs)
    for output in outputs:
        _check_name(output.path)
    _check_apart(outputs, _held(inputs, streams))
    for output in outputs:
        _check_position(output)
    _try(outputs)


def shown(path: str | Path) -> str:
    """Return a path in a form that fits on one printed line: unprintable characters are escaped,
    and the middle of a long path is left out.
    """
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(path))
    return text if len(text) <= 200 else f"{text[:60]}…{text[-20:]}"


def _check_name(path: Path) -> None:
    """Raise where a name cannot be written; folders that exist already need no check."""
    for part in (path, *path.parents):
        if part is not path and os.path.isdir(part):
            return
        odd = next(
            (c for c in part.name if unicodedata.category(c) in ("Cc", "Cs", "Zl", "Zp")), None
        )
        if odd is not None:
            fault = (
                "part of no UTF-8 text"
                if unicodedata.category(odd) == "Cs"
                else "a control character"
            )
            raise OutputError(
                f"{shown(path)}: the name holds {shown(odd)}, {fault}; give a name of printable "
                "characters only"
            )
        size = len(part.name.encode())
        most = _longest_name(part) - (ROOM if part is path else 0)
        if size > most:
            raise OutputError(
                f"{shown(path)}: the name has {size} bytes; at most {most} are allowed, give a "
                "shorter one"
            )


def _longest_name(path: Path) -> int:
    """Return the longest name of a file that the file system of a path allows [bytes]."""
    for folder in path.parents:
        with suppress(OSError, ValueError):
            return os.pathconf(folder, "PC_NAME_MAX")
    return 255


def _held(
    inputs: Iterable[tuple[str, str | Path | int]], streams: Iterable[tuple[str, int]]
) -> dict[Key, str]:
    """Return the files that no output may replace: key → what the file is, in words."""
    held: dict[Key, str] = {}
    for label, position in inputs:
        name = label if isinstance(position, int) else f"{label} {shown(position)}"
        key = file_key(position)
        if key is not None:
            held.setdefault(key, f"an input of this command ({name})")
    printed: dict[Key, str] = {}
    for label, number in streams:
        key = file_key(number)
        if key is None or not stat.S_ISREG(os.fstat(number).st_mode):
            continue
        if key in held:
            raise OutputError(f"{label}: goes to {held[key]}; let it go elsewhere")
        printed.setdefault(key, f"where {label} goes")
    return held | printed


def _check_apart(outputs: list[Output], held: dict[Key, str]) -> None:
    """Raise where an output is an input, two outputs are the same file, or one is the other's
    folder.
    """
    files: dict[Key, str] = {}
    for output in outputs:
        key = file_key(output.path)
        if key is None:
            continue
        if key in held:
            raise OutputError(f"{shown(output.path)}: is {held[key]}; give another name")
        if key in files:
            raise _twice(output.path, files[key], output.by)
        files[key] = output.by
    seen = set[Path]()
    for output in outputs:
        above = Path(os.path.realpath(output.path)).parents
        for folder in (output.folder or above[0], *above):
            if folder in seen:
                continue
            seen.add(folder)
            key = file_key(folder)
            if folder == output.folder and key in held:
                raise OutputError(f"{shown(folder)}: is {held[key]}; give another folder")
            if key in files:
                raise _twice(folder, files[key], output.by)


def _twice(path: Path, first: str, second: str) -> OutputError:
    return OutputError(
        f"{shown(path)}: is asked for twice, by {first} and {second}; give two names"
    )


def _check_position(output: Output) -> None:
    """Raise where no file can stand at an output's path."""
    path = output.path
    folder = output.folder
    if folder is not None:
        above = next(
            position
            for position in (folder, *folder.absolute().parents)
            if os.path.lexists(position)
        )
        if not os.path.isdir(above):
            fault = (
                "is a file"
                if above == folder
                else f"cannot be made, since '{shown(above)}' is a file"
            )
            raise OutputError(f"{shown(folder)}: {fault}; give the name of a folder")
    try:
        mode = os.stat(path).st_mode
    except (FileNotFoundError, NotADirectoryError):
        # a link may point to what is not there yet; a file is then made where it points to
        home = Path(os.path.realpath(path)).parent
        if folder is None and not home.is_dir():
            parent = home if os.path.islink(path) else path.parent
            fault = f"the folder '{shown(parent)}' does not exist; make it first"
            if os.path.exists(parent):
                fault = f"cannot stand in '{shown(parent)}', which is a file; give another name"
            raise OutputError(f"{shown(path)}: {fault}") from None
        return
    except OSError as problem:
        raise OutputError(f"{shown(path)}: cannot be written ({problem.strerror})") from None
    if stat.S_ISDIR(mode):
        raise OutputError(f"{shown(path)}: is a folder; give the name of a file")
    if not (stat.S_ISREG(mode) or stat.S_ISFIFO(mode) or stat.S_ISCHR(mode)):
        raise OutputError(f"{shown(path)}: is no file; give the name of a file")
    if not os.access(path, os.W_OK):
        raise OutputError(f"{shown(path)}: cannot be written (it is read-only); give another name")


def _try(outputs: list[Output]) -> None:
    """Make a temporary file for the longest name in each output's folder, or in its nearest
    existing parent, and remove it again.
    """
    longest: dict[Path, tuple[str, Path]] = {}
    for output in outputs:
        if os.path.exists(output.path) and not os.path.isfile(output.path):
            continue  # a device or a pipe is written as it is
        real = Path(os.path.realpath(output.path))
        if len(real.name.encode(errors="replace")) > len(
            longest.get(real.parent, ("", real))[0].encode()
        ):
            longest[real.parent] = real.name, output.path
    for folder, (name, path) in longest.items():
        nearest = next(
            position for position in (folder, *folder.parents) if os.path.isdir(position)
        )
        try:
            handle, temporary = tempfile.mkstemp(dir=nearest, prefix=f".{name}.")
            os.close(handle)
            os.unlink(temporary)
        except OSError as problem:
            raise OutputError(
                f"{shown(path)}: cannot be written ({problem.strerror}); give another place"
            ) from None


def file_key(position: str | Path | int) -> Key | None:
    """Return the identity of the file at a path or file descriptor, the same for all its names.

    A file that does not exist yet has one, too; a character device has None.
    """
    try:
        status = os.stat(position)
    except (OSError, ValueError):
        return None if isinstance(position, int) else _key_to_be(position)
    return None if stat.S_ISCHR(status.st_mode) else (status.st_dev, status.st_ino)


def _key_to_be(path: str | Path) -> Key | None:
    """Return the identity of a file that does not exist yet: that of the nearest existing folder,
    and the names below it.
    """
    try:
        real = Path(os.path.realpath(path))
    except (OSError, ValueError):
        return None
    for folder in real.parents:
        try:
            status = os.stat(folder)
        except OSError:
            continue
        names = real.relative_to(folder).parts
        folded = (unicodedata.normalize("NFC", name).casefold() for name in names)
        return (status.st_dev, status.st_ino, *folded)
    return None
