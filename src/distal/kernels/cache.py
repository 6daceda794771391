"""Where compiled kernels are kept: by content, compiler and CPU, safe for several processes at
once.
"""

from __future__ import annotations

import hashlib
import json
import os
import platform
import stat
import sys
import tempfile
from pathlib import Path


def cache_folder() -> Path:
    """Return the folder for compiled kernels: $DISTAL_CACHE, else the user's cache folder."""
    folder = os.environ.get("DISTAL_CACHE")
    if folder:
        return Path(folder).absolute()
    try:
        home = Path.home()
    except RuntimeError:  # neither $HOME nor an entry in the list of users
        return Path(tempfile.gettempdir()).absolute() / f"distal-{os.getuid()}"
    if sys.platform == "darwin":
        return home / "Library" / "Caches" / "distal"
    return Path(os.environ.get("XDG_CACHE_HOME") or home / ".cache").absolute() / "distal"


def check_own(folder: Path) -> None:
    """Refuse a folder whose libraries somebody else may have put there: what is in it is run.

    Raises:
        PermissionError: it belongs to another user, or others can write to it.
    """
    if not hasattr(os, "geteuid"):
        return
    try:
        status = os.stat(folder)
    except (FileNotFoundError, NotADirectoryError):
        return
    if status.st_uid != os.geteuid():
        raise PermissionError(0, f"it belongs to another user (number {status.st_uid})")
    if status.st_mode & (stat.S_IWGRP | stat.S_IWOTH):
        raise PermissionError(
            0, f"others can write to it (mode {stat.S_IMODE(status.st_mode):o}); chmod go-w helps"
        )


def cpu() -> str:
    """Return what identifies this CPU to a compiler that builds for it."""
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        features = {line for line in lines if line.startswith(("model name", "flags", "Features"))}
        return platform.machine() + "".join(sorted(features))
    except OSError:
        return platform.machine() + platform.processor()


def digest(*parts: str | bytes) -> str:
    """Return a hexadecimal digest of the parts."""
    sha = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        sha.update(len(content).to_bytes(8, "little") + content)
    return sha.hexdigest()


class Cache:
    """A folder of shared libraries; each has a note with its digest, so that a damaged one is never
    loaded.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, key: str) -> Path | None:
        """Return the library kept under `key`, or None if there is none or it is damaged."""
        try:
            note = json.loads((self.folder / f"{key}.json").read_text(encoding="utf-8"))
            library = self.folder / str(note["library"])
            return library if digest(library.read_bytes()) == note["digest"] else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    def work_folder(self) -> tempfile.TemporaryDirectory[str]:
        """Return a temporary folder inside the cache, so that what is built there can be moved in
        at once.

        Raises:
            OSError: the cache cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return tempfile.TemporaryDirectory(dir=self.folder, prefix="build-")

    def keep(self, key: str, built: Path) -> Path:
        """Move a library that was built in a `work_folder` into the cache and return its new path.

        Library and note are each renamed, the note last, so that a reader sees both or none.

        Raises:
            OSError: the cache cannot be written.
        """
        fingerprint = digest(built.read_bytes())
        library = self.folder / f"{key}-{fingerprint[:16]}.so"
        os.replace(built, library)
        note = built.parent / "note.json"
        note.write_text(
            json.dumps({"library": library.name, "digest": fingerprint}), encoding="utf-8"
        )
        os.replace(note, self.folder / f"{key}.json")
        return library
