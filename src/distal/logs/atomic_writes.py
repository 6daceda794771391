"""Write each file completely or not at all, and several files that belong together all or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from functools import partial
from pathlib import Path
from shutil import copyfileobj

from distal.errors import Content, OutputError
from distal.logs.output_targets import shown


def check_writable(path: Path) -> None:
    """Raise an `OutputError` where a path is a folder, or its folder does not exist."""
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not os.path.isdir(path.parent):
        raise OutputError(f"{path}: the folder '{path.parent}' does not exist")


def target_of(path: Path) -> Path | None:
    """Return the file that a path stands for; a link is followed, so that what it points to is
    replaced. A device or a pipe, such as /dev/stdout, cannot be replaced, and is None.

    Raises:
        OutputError: no file can be written there.
    """
    check_writable(path)
    if path.exists() and not path.is_file():
        return None
    target = path.resolve()
    if target.exists() and not os.access(target, os.W_OK):
        raise OutputError(f"{path}: cannot be written (it is read-only)")
    return target


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
