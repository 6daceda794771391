"""Which names are one file: links of both kinds, other ways to a folder, and names that differ by
case only.
"""

from __future__ import annotations

import os
import stat
import unicodedata
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

Key = tuple[int | str, ...]
"""Device and number of a file; of one that is not there yet, those of the nearest folder and the
names below it.
"""


def file_key(position: str | Path | int) -> Key | None:
    """Return what all names of a path or file descriptor have in common, also before it is there;
    None for a device.
    """
    try:
        status = os.stat(position)
    except (OSError, ValueError):
        return None if isinstance(position, int) else _key_to_be(position)
    return None if stat.S_ISCHR(status.st_mode) else (status.st_dev, status.st_ino)


def _key_to_be(path: str | Path) -> Key | None:
    """Return the key of a file that is not there yet: the nearest folder that is there, and the
    names below it.
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
    """Return whether a folder takes names that differ by case for the same, seen from what is in it
    or above it.
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
