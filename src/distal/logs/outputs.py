"""Files that are written: checked before the work begins, so that no input is overwritten and no
result is lost at the end; each written completely or not at all, and several that belong together
all or none.
"""

from __future__ import annotations

import os
import stat
import tempfile
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from shutil import copyfileobj
from unicodedata import category, normalize

from distal.errors import Content, OutputError

NAME_ROOM = 10
"""Bytes by which the name of the temporary file of `write_whole` is longer than the name of the
file itself. Source: definition (names of temporary files in Python: two dots, eight characters).
"""

ODD = {"Cs": "part of no UTF-8 text"} | dict.fromkeys(("Cc", "Zl", "Zp"), "a control character")
"""Category of a character that no name may hold → what it is."""

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
        kind: what it is, for who checks its ending; empty for any.
    """

    path: Path
    by: str
    folder: Path | None = None
    kind: str = ""


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
        _check_position(output.path, output.folder)
        _try(output.path)


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
        for letter in part.name:
            if fault := ODD.get(category(letter)):
                raise OutputError(
                    f"{shown(path)}: the name holds {shown(letter)}, {fault}; give a name of "
                    "printable characters only"
                )
        most = 255
        with suppress(OSError, ValueError):
            most = os.pathconf(_nearest_folder(part), "PC_NAME_MAX")
        most -= NAME_ROOM if part is path else 0
        size = len(part.name.encode())
        if size > most:
            raise OutputError(
                f"{shown(path)}: the name has {size} bytes; at most {most} are allowed, give a "
                "shorter one"
            )


def _nearest_folder(path: str | Path) -> Path:
    """Return the nearest folder above a path that exists already."""
    return next(folder for folder in Path(os.path.realpath(path)).parents if os.path.isdir(folder))


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


def _check_position(path: Path, folder: Path | None = None) -> None:
    """Raise where no file can stand at a path; the `folder` is made where it does not exist."""
    if folder is not None:
        above = next(p for p in (folder, *folder.absolute().parents) if os.path.lexists(p))
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


def _try(path: Path) -> None:
    """Make a temporary file in an output's folder, or in its nearest existing parent, and remove
    it again.
    """
    if os.path.exists(path) and not os.path.isfile(path):
        return  # a device or a pipe is written as it is
    name = os.path.basename(os.path.realpath(path))
    try:
        handle, temporary = tempfile.mkstemp(dir=_nearest_folder(path), prefix=f".{name}.")
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
        return None if stat.S_ISCHR(status.st_mode) else (status.st_dev, status.st_ino)
    except (OSError, ValueError):
        if isinstance(position, int):
            return None
    with suppress(OSError, ValueError):
        folder = _nearest_folder(position)
        status = os.stat(folder)
        names = Path(os.path.realpath(position)).relative_to(folder).parts
        folded = (normalize("NFC", name).casefold() for name in names)
        return (status.st_dev, status.st_ino, *folded)
    return None


def target_of(path: Path) -> Path | None:
    """Return the file that a path stands for; a link is followed, so that what it points to is
    replaced. A device or a pipe, such as /dev/stdout, cannot be replaced, and is None.

    Raises:
        OutputError: no file can be written there.
    """
    _check_position(path)
    return path.resolve() if path.is_file() or not path.exists() else None


def write_whole(path: str | Path, data: Content) -> None:
    """Write a file completely, or leave the old file of that name unchanged where writing fails;
    see `write_together`.
    """
    write_together({Path(path): data})


def write_together(files: Mapping[Path, Content]) -> None:
    """Write several files that belong together: all of them, or none, so that the old files stay.

    Each content first goes to a temporary file in the folder of its path. The temporary files are
    renamed only after the last one is complete; where a renaming fails, the earlier ones are
    undone. Folders must exist; text is written as UTF-8, and a function writes a content itself.

    Raises:
        OutputError: one of the files cannot be written.
    """
    with ExitStack() as tidied, ExitStack() as undone:
        try:
            moves = [_prepared(path, data, tidied, len(files) > 1) for path, data in files.items()]
            for move in filter(None, moves):
                move(undone)
        except OutputError as problem:
            problem.unsaved = dict(files)
            raise
        undone.pop_all()


def _prepared(
    path: Path, data: Content, tidied: ExitStack, keep: bool
) -> Callable[[ExitStack], None] | None:
    """Write a content to a temporary file beside its path, and return the function that renames it.

    That function puts into an `ExitStack` what undoes it. A device or a pipe, such as /dev/stdout,
    cannot be replaced: it is written at once, and None is returned.

    Args:
        keep: whether a copy of the old file is kept beside it, to be put back.
    """
    with as_output_error(path):
        target = target_of(path)
        if target is None:
            put(path, data)
            return None
        is_there = target.exists()
        temporary = beside(target, data, tidied)
        old = None
        if is_there and keep:
            with target.open("rb") as source:
                old = beside(target, partial(copyfileobj, source), tidied)

    def move(undone: ExitStack) -> None:
        with as_output_error(path):
            os.replace(temporary, target)
        if old is not None:
            undone.callback(put_back, old)
        elif not is_there:
            undone.callback(target.unlink, missing_ok=True)

    def put_back(old: Path) -> None:
        try:
            os.replace(old, target)
        except OSError:
            tidied.pop_all()  # the old file stays beside its path

    return move


def put(path: Path, data: Content) -> None:
    """Write a file; a text may name a file whose name is no UTF-8, and is then written with another
    character in its place.
    """
    with path.open("wb") as file:
        if isinstance(data, str):
            data = data.encode(errors="replace")
        if isinstance(data, bytes):
            file.write(data)
        else:
            data(file)


def beside(target: Path, content: Content, tidied: ExitStack) -> Path:
    """Write a temporary file beside another path, with the rights that a file there has, and return
    its path; it is removed in the end, where it still stands.
    """
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
    path = Path(name)
    tidied.callback(path.unlink, missing_ok=True)
    os.close(handle)
    put(path, content)
    umask = os.umask(0)
    os.umask(umask)
    path.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
    return path


def keep_elsewhere(files: Mapping[Path, Content]) -> Path | None:
    """Write files that could not be written at their paths into a new folder, and return that
    folder.

    The folder is made among the temporary files or, where that fails, in the user's home folder;
    the result is None where both fail.
    """
    for parent in (tempfile.gettempdir(), str(Path.home())):
        with suppress(OSError, RuntimeError):
            folder = Path(tempfile.mkdtemp(prefix="distal-", dir=parent))
            for path, data in files.items():
                put(folder / path.name, data)
            return folder
    return None


@contextmanager
def as_output_error(path: Path) -> Iterator[None]:
    """Turn an error of the file system into an `OutputError` that names the path."""
    try:
        yield
    except OutputError:
        raise
    except OSError as problem:
        raise OutputError(
            f"{shown(path)}: cannot be written ({problem.strerror or problem})"
        ) from None
    except (RuntimeError, ValueError) as problem:
        # a link to itself, a name with a zero byte or with half a character
        raise OutputError(
            f"{shown(path)}: cannot be written ({problem}); give another name"
        ) from None
