"""Files that are written: checked before the work begins, so that no input is overwritten and no
result is lost at the end; each written completely or not at all. And the memory that reading a
log may take: a small file can ask for more than there is.
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterable, Iterator, Mapping
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path

from distal.errors import Content, OutputError


def check_outputs(
    outputs: Iterable[Path], inputs: Iterable[str | Path] = (), *, makes_folder: bool = False
) -> None:
    """Raise where an output would replace an input or another output, or cannot be written.

    Nothing is made or changed. Files are compared by what they are, not by their names: hard and
    symbolic links are followed.

    Args:
        outputs: paths of what will be written.
        inputs: paths of what is read.
        makes_folder: whether their folder is made where it does not exist yet.

    Raises:
        OutputError: an output is an input, or two are the same file; it is a folder; its folder is
            missing, no folder, or read-only.
    """
    taken = {
        _identity(Path(path)): f"is an input of this command ({shown(path)}); give another name"
        for path in inputs
    }
    for path in outputs:
        with as_output_error(path):
            identity = _identity(path)
            if identity in taken:
                raise OutputError(f"{shown(path)}: {taken[identity]}")
            _check_position(path, makes_folder)
        taken[identity] = "is asked for twice; give two names"


def _identity(path: Path) -> tuple[int, int] | Path:
    """Return what is the same for all names of a file: its device and inode where it exists."""
    if not path.exists():
        # of a name with a zero byte or a link to itself who reads or writes it says so
        with suppress(ValueError, RuntimeError):
            return path.resolve()
        return path
    status = path.stat()
    return status.st_dev, status.st_ino


def shown(path: str | Path) -> str:
    """Return a path in a form that fits on one printed line: unprintable characters are escaped,
    and the middle of a long path is left out.
    """
    text = "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in str(path))
    return text if len(text) <= 200 else f"{text[:60]}…{text[-20:]}"


def _check_position(path: Path, makes_folder: bool = False) -> None:
    """Raise where no file can stand at a path, see `check_outputs`."""
    if path.is_dir():
        raise OutputError(f"{shown(path)}: is a folder; give the name of a file")
    if _is_device(path):
        return
    above = path.resolve().parent
    if makes_folder:
        above = next(folder for folder in (above, *above.parents) if folder.exists())
    if not above.exists():
        raise OutputError(
            f"{shown(path)}: the folder '{shown(above)}' does not exist; make it first"
        )
    if not above.is_dir():
        raise OutputError(
            f"{shown(path)}: cannot stand in '{shown(above)}', which is a file; give another name"
        )
    if not all(os.access(file, os.W_OK) for file in (above, path) if file.exists()):
        raise OutputError(f"{shown(path)}: cannot be written (it is read-only); give another place")


def _is_device(path: Path) -> bool:
    """Return whether a path is a device or a pipe, such as /dev/stdout, which is written as it
    is.
    """
    return path.exists() and not path.is_file()


def write_whole(path: str | Path, data: Content) -> None:
    """Write a file completely, or leave the old file of that name unchanged where writing fails;
    see `write_together`.
    """
    write_together({Path(path): data})


def write_together(files: Mapping[Path, Content]) -> None:
    """Write several files that belong together: where one cannot be written, the old files stay.

    Each content first goes to a temporary file in the folder of its path. The temporary files are
    renamed only after the last one is complete. Folders must exist; text is written as UTF-8, and a
    function writes a content itself. A link is followed.

    Raises:
        OutputError: one of the files cannot be written.
    """
    with ExitStack() as tidied:
        temporaries = dict[Path, Path]()
        for path, data in files.items():
            with as_output_error(path):
                _check_position(path)
                if _is_device(path):
                    put(path, data)
                else:
                    temporaries[path] = beside(path.resolve(), data, tidied)
        for path, temporary in temporaries.items():
            with as_output_error(path):
                os.replace(temporary, path.resolve())


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
    handle, name = tempfile.mkstemp(dir=target.parent, prefix=".distal-")
    path = Path(name)
    tidied.callback(path.unlink, missing_ok=True)
    os.close(handle)
    put(path, content)
    umask = os.umask(0)
    os.umask(umask)
    path.chmod(target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
    return path


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
