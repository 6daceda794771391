"""Write each file completely or not at all, and several files that belong together all or none."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path

from distal.errors import OutputError
from distal.logs.output_targets import shown


def check_writable(path: Path) -> None:
    """Raise an `OutputError` where a path is a folder, or its folder does not exist."""
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not os.path.isdir(path.parent):
        raise OutputError(f"{path}: the folder '{path.parent}' does not exist")


def write_whole(path: str | Path, data: bytes | str) -> None:
    """Write a file completely, or leave the old file of that name unchanged where writing fails;
    see `write_together`.
    """
    write_together({Path(path): data})


def write_together(files: Mapping[Path, bytes | str]) -> None:
    """Write several files that belong together: all of them, or none, so that the old files stay.

    Each content first goes to a temporary file in the folder of its path. The temporary files are
    renamed only after the last one is complete; where a renaming fails, the earlier ones are
    undone. Folders must exist; text is written as UTF-8.

    Raises:
        OutputError: one of the files cannot be written.
    """
    written: list[_Written] = []
    try:
        for path, data in files.items():
            # a text may name a file whose name is no UTF-8; such bytes are replaced, so that the
            # text is still written
            content = data.encode(errors="replace") if isinstance(data, str) else data
            check_writable(path)
            with _as_output_error(path):
                if path.exists() and not path.is_file():
                    # a device or a pipe, such as /dev/stdout, cannot be replaced
                    path.write_bytes(content)
                else:
                    written.append(_Written(path, content))
        for file in written:
            with _as_output_error(file.path):
                file.move_in(keep=len(written) > 1)
    except BaseException as problem:
        for file in reversed(written):
            file.move_back()
        if isinstance(problem, OutputError):
            problem.unsaved = dict(files)
        raise
    finally:
        for file in written:
            file.tidy()


def keep_elsewhere(files: Mapping[Path, bytes | str]) -> Path | None:
    """Write files that could not be written at their paths into a new folder, and return that
    folder.

    The folder is made among the temporary files or, where that fails, in the user's home folder;
    the result is None where both fail.
    """
    for parent in (tempfile.gettempdir(), str(Path.home())):
        with suppress(OSError, RuntimeError):
            folder = Path(tempfile.mkdtemp(prefix="distal-", dir=parent))
            for path, data in files.items():
                content = data.encode(errors="replace") if isinstance(data, str) else data
                (folder / path.name).write_bytes(content)
            return folder
    return None


@contextmanager
def _as_output_error(path: Path) -> Iterator[None]:
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


class _Written:
    """A file whose content is complete in a temporary file, which `move_in` renames to its path."""

    def __init__(self, path: Path, content: bytes) -> None:
        self.path = path
        # a link is followed, so that what it points to is replaced
        self._target = path.resolve()
        self._backup: str | None = None
        self._moved = False
        self._replaces = self._target.exists()
        if self._replaces and not os.access(self._target, os.W_OK):
            raise OutputError(f"{path}: cannot be written (it is read-only)")
        handle, self._temporary = self._beside()
        try:
            with os.fdopen(handle, "wb") as file:
                file.write(content)
            umask = os.umask(0)
            os.umask(umask)
            os.chmod(
                self._temporary,
                self._target.stat().st_mode & 0o777 if self._replaces else 0o666 & ~umask,
            )
        except BaseException:
            os.unlink(self._temporary)
            raise

    def _beside(self) -> tuple[int, str]:
        return tempfile.mkstemp(dir=self._target.parent, prefix=f".{self._target.name}.")

    def move_in(self, keep: bool) -> None:
        """Rename the temporary file to its path; `keep` says to keep the old file beside it until
        `tidy`.
        """
        if keep and self._replaces:
            handle, backup = self._beside()
            os.close(handle)
            os.unlink(backup)
            try:
                os.link(self._target, backup)
            except OSError:
                os.replace(self._target, backup)  # a file system without hard links
            self._backup = backup
        os.replace(self._temporary, self._target)
        self._moved = True

    def move_back(self) -> None:
        """Put the old file back at its path; where that is not possible, the old file stays beside
        it.
        """
        with suppress(OSError):
            if self._backup is not None:
                os.replace(self._backup, self._target)
                if os.path.exists(
                    self._backup
                ):  # replacing a file by its own hard link does nothing
                    os.unlink(self._backup)
                self._backup = None
            elif self._moved and not self._replaces:
                os.unlink(self._target)

    def tidy(self) -> None:
        """Remove the temporary files that are still beside the path."""
        for path in (self._temporary, self._backup if self._moved else None):
            if path is not None and os.path.exists(path):
                os.unlink(path)
