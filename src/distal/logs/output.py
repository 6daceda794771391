"""Files written whole or not at all."""

from __future__ import annotations

import os
import tempfile
from pathlib import Path

from distal.errors import OutputError
from distal.logs.targets import shown


def check_writable(path: Path) -> None:
    """Refuse a place where a file cannot be written.

    Raises:
        OutputError: it is a folder, or its folder does not exist.
    """
    if os.path.isdir(path):
        raise OutputError(f"{path}: is a folder; give the name of a file")
    if not os.path.isdir(path.parent):
        raise OutputError(f"{path}: the folder '{path.parent}' does not exist")


def write_whole(path: str | Path, data: bytes | str) -> None:
    """Write a file by way of a temporary one beside it, so that what stood there survives a failure.

    Args:
        path: where; its folder must exist.
        data: what; text is written as UTF-8.

    Raises:
        OutputError: it cannot be written.
    """
    path = Path(path)
    # a byte of a file's name that is no text has no UTF-8 either; it is no reason to lose what is written
    content = data.encode(errors="replace") if isinstance(data, str) else data
    check_writable(path)
    temporary = None
    try:
        if path.exists() and not path.is_file():
            # a device or a pipe, such as /dev/stdout, cannot be replaced
            path.write_bytes(content)
            return
        # a link is followed, so that what it points to is replaced
        target = path.resolve()
        if target.exists() and not os.access(target, os.W_OK):
            raise OutputError(f"{path}: cannot be written (it is read-only)")
        handle, temporary = tempfile.mkstemp(dir=target.parent, prefix=f".{target.name}.")
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        umask = os.umask(0)
        os.umask(umask)
        os.chmod(temporary, target.stat().st_mode & 0o777 if target.exists() else 0o666 & ~umask)
        os.replace(temporary, target)
    except OutputError:
        raise
    except OSError as problem:
        raise OutputError(f"{path}: cannot be written ({problem.strerror or problem})") from None
    except (RuntimeError, ValueError) as problem:
        # a link to itself, a name with a zero byte or with half a character
        raise OutputError(f"{shown(path)}: cannot be written ({problem}); give another name") from None
    finally:
        if temporary is not None and os.path.exists(temporary):
            os.unlink(temporary)
