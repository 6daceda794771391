"""How kernels are found: the structure on which one depends, since rigs that agree in it share the
kernel whatever their numbers are; how its function is made; and the folder of compiled ones.

In the folder they are found by what they are made from, the compiler and the CPU; several processes
may use it at once.
"""

from __future__ import annotations

import fcntl
import hashlib
import json
import os
import platform
import stat
import sys
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from threading import RLock

import casadi as ca
from pydantic import BaseModel

from distal.kernels.layout import Sizes
from distal.model import Mechanism
from distal.rig import Parameter, Rig
from distal.rig.joints import Coupling

INPUTS = frozenset(
    {
        "centre",
        "correlation_time",
        "counts_per_turn",
        "curve",
        "delay",
        "error",
        "error_time",
        "gear",
        "gravity",
        "inertia",
        "lag",
        "lever",
        "limit",
        "linearity",
        "noise",
        "offset",
        "orientation",
        "rate",
        "reference",
        "resolution",
        "std",
        "stops",
        "torque_constant",
        "torque_constant_motor",
        "unmodelled",
    }
)
"""Fields of plain numbers that are inputs of kernels, or do not enter them; any other field is
written into a kernel.
"""

APART = frozenset(
    {
        "name",
        "log",
        "when_lost",
        "stepping",
        "map",
        "left_out",
        "touch",
    }
)
"""Fields of a rig that say nothing of its equations, or whose part in a structure is given
separately.
"""


@dataclass(frozen=True)
class Structure:
    """All that a kernel depends on.

    Args:
        kind: of the kernel, such as ``plant``.
        facts: (name, content) of each thing that the kernel is made for.
    """

    kind: str
    facts: tuple[tuple[str, object], ...]

    @cached_property
    def key(self) -> str:
        """Name of the structure in a cache; it changes with the code of the package."""
        return digest(self.kind, repr(self.facts), source_stamp())


def structure_of(kind: str, mechanism: Mechanism, **decisions: object) -> Structure:
    """Return the structure of a kernel that is made from a rig's equations.

    Args:
        kind: of the kernel, such as ``plant``.
        decisions: anything else that it is made for, such as its sub-steps.
    """
    parameters = mechanism.parameters
    facts = {
        "parts": _parts(mechanism.rig),
        "numbers": parameters.names,
        "absent": parameters.constants,
        **{name.replace("_", " "): value for name, value in decisions.items()},
    }
    return Structure(kind, tuple(facts.items()))


def _parts(rig: Rig) -> tuple[object, ...]:
    return tuple(
        (name, _shape(getattr(rig, name))) for name in type(rig).model_fields if name not in APART
    )


def _shape(part: object) -> object:
    """Return a component of a description without its numbers."""
    if isinstance(part, Parameter):
        return None
    if isinstance(part, Coupling):
        return part.model_dump_json()
    if isinstance(part, BaseModel):
        return tuple(
            (name, _of_field(name, getattr(part, name))) for name in type(part).model_fields
        )
    if isinstance(part, tuple):
        return tuple(map(_shape, part))
    return part


def _of_field(name: str, field: object) -> object:
    if name in INPUTS and not isinstance(field, BaseModel):
        return field is None
    return _shape(field)


@lru_cache(maxsize=1)
def source_stamp() -> str:
    """Return a digest of the package's code: kernels of other code are other kernels."""
    files = sorted(Path(__file__).parents[1].rglob("*.py"))
    return digest(*(path.read_bytes() for path in files))


_MAKING = RLock()  # CasADi does not count its symbols safely over threads


class Recipe:
    """A CasADi function (kernel_state, x, p) → (kernel_state⁺, y) that is made at its first use.

    Args:
        make: returns the function.
        structure: all that the function depends on; where it is None, compiled kernels are found by
            their C instead.
    """

    def __init__(self, make: Callable[[], ca.Function], structure: Structure | None = None) -> None:
        self._make = make
        self.structure = structure

    @cached_property
    def function(self) -> ca.Function:
        """The CasADi function, made at the first call."""
        with _MAKING:
            return self._make()

    def written(self, source: Callable[[ca.Function], str]) -> str:
        """Return the C that `source` writes of the function."""
        function = self.function
        with _MAKING:
            return source(function)

    @property
    def sizes(self) -> Sizes:
        """The lengths of the kernel state, x, p and y."""
        function = self.function
        inputs = (function.numel_in(i) for i in range(3))
        return Sizes._make([*inputs, function.numel_out(1)])


def cache_folder() -> Path:
    """Return the folder for compiled kernels: $DISTAL_CACHE, else `distal` in the user's cache
    folder.
    """
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
    """Refuse a folder into which somebody else may have put libraries, since these are executed.

    Raises:
        PermissionError: it belongs to another user, or others can write to it.
    """
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
    """Return a text that identifies the model and features of this CPU, for which a compiler
    builds.
    """
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        features = {line for line in lines if line.startswith(("model name", "flags", "Features"))}
        return platform.machine() + "".join(sorted(features))
    except OSError:
        return platform.machine() + platform.processor()


def digest(*parts: str | bytes) -> str:
    """Return a hexadecimal digest (SHA-256) of the parts, which tells where one ends and the next
    begins.
    """
    sha = hashlib.sha256()
    for part in parts:
        content = part.encode() if isinstance(part, str) else part
        sha.update(len(content).to_bytes(8, "little") + content)
    return sha.hexdigest()


NOT_NOTED = Sizes(0, 0, 0, 0)
"""Sizes of a kernel that is found by its C. Source: definition (none)."""


@dataclass(frozen=True)
class Library:
    """A shared library with a kernel.

    Args:
        name: of the kernel's function.
        sizes: lengths of its kernel state, x, p and y; zero where they are not noted.
    """

    path: Path
    name: str = ""
    sizes: Sizes = NOT_NOTED


class Cache:
    """A folder of shared libraries. Each library has a note with its digest, so that a damaged one
    is never loaded.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    def find(self, key: str) -> Library | None:
        """Return the library kept under `key`, or None if there is none or it is damaged."""
        try:
            note = json.loads((self.folder / f"{key}.json").read_text(encoding="utf-8"))
            path = self.folder / str(note["library"])
            library = Library(path, str(note["name"]), Sizes._make(map(int, note["sizes"])))
            return library if digest(path.read_bytes()) == note["digest"] else None
        except (OSError, ValueError, KeyError, TypeError):
            return None

    @contextmanager
    def alone(self, key: str) -> Iterator[None]:
        """Let one process at a time build what is kept under `key`; the others wait.

        Raises:
            OSError: the cache cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        lock = self.folder / f"{key}.lock"
        with lock.open("w") as file:
            with suppress(OSError):  # a file system without locks: each process builds its own
                fcntl.flock(file, fcntl.LOCK_EX)
            yield
            # processes that wait for this file, or come later, find the library
            lock.unlink(missing_ok=True)

    def work_folder(self) -> tempfile.TemporaryDirectory[str]:
        """Return a temporary folder inside the cache; what is built in it can be moved into the
        cache in one operation.

        Raises:
            OSError: the cache cannot be written.
        """
        self.folder.mkdir(parents=True, exist_ok=True, mode=0o700)
        return tempfile.TemporaryDirectory(dir=self.folder, prefix="build-")

    def keep(self, key: str, built: Path) -> Library:
        """Move a library that was `built` in a `work_folder` into the cache, and return it from
        there.

        Library and note are each renamed, the note last, so that a reader sees both or none.

        Raises:
            OSError: the cache cannot be written.
        """
        fingerprint = digest(built.read_bytes())
        library = Library(self.folder / f"{key}-{fingerprint[:16]}.so")
        os.replace(built, library.path)
        self.note(key, library)
        return library

    def note(self, key: str, library: Library) -> None:
        """Write the note that a library of this folder is kept under `key`.

        Raises:
            OSError: the cache cannot be written.
        """
        note = {
            "library": library.path.name,
            "digest": digest(library.path.read_bytes()),
            "name": library.name,
            "sizes": library.sizes,
        }
        with self.work_folder() as folder:
            written = Path(folder) / "note.json"
            written.write_text(json.dumps(note), encoding="utf-8")
            os.replace(written, self.folder / f"{key}.json")
