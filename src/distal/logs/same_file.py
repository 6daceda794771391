"""Find out whether two paths are one file: by links, by different paths to its folder, or by names
that differ only by case.
"""

from __future__ import annotations

import os
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

Key = tuple[int | str, ...]
"""Identity of a file: its device and inode; for a file that does not exist yet, those of the
nearest existing folder and the names below it.
"""


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
        if _ignores_case(folder):
            names = tuple(unicodedata.normalize("NFC", name).casefold() for name in names)
        return (status.st_dev, status.st_ino, *names)
    return None


def _ignores_case(folder: Path) -> bool:
    """Return whether a folder's file system takes names that differ only by case for one file.

    This is tried with the name of something in the folder, or of the folder or one above it.
    """
    for position in _near(folder):
        swapped = position.with_name(position.name.swapcase())
        if swapped != position:
            return (
                os.path.exists(swapped)
                and os.path.exists(position)
                and os.path.samefile(position, swapped)
            )
    return False


def _near(folder: Path) -> Iterator[Path]:
    with suppress(OSError), os.scandir(folder) as entries:
        yield from (Path(entry.path) for entry in entries)
    yield from (position for position in (folder, *folder.parents) if position.name)
