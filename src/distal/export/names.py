"""Names of exports: those that C functions, files and CMake targets may have on every system."""

from __future__ import annotations

import re

from distal.errors import ExportError
from distal.logs import shown

HEADERS = """
assert complex ctype errno fenv float inttypes iso646 limits locale math setjmp signal stdalign
stdarg stdatomic stdbool stdckdint stddef stdint stdio stdlib stdnoreturn string tgmath threads time
uchar wchar wctype
"""
"""Headers of C: a file of the same name would hide them."""

INCLUDED = """
alloca availability corecrt crtdefs endian fcntl features malloc memory newlib picolibc pthread
reent sal sched strings swab unistd vadefs vcruntime yvals
"""
"""Headers that those of C include on Linux, macOS, Windows and with newlib, as far as somebody
might call a filter so.
"""

TARGETS = """
all all_build clean default_target depend help install m package rebuild_cache replay run_tests test
zero_check
"""
"""Names that CMake or the export uses for targets, and ``m``, the mathematics library."""

TAKEN = frozenset((HEADERS + INCLUDED + TARGETS).split())
"""All names that a filter cannot have."""

DEVICES = re.compile(r"con|prn|aux|nul|com[0-9]|lpt[0-9]")
"""Names of devices, which no file can have on Windows."""


def c_name(text: str) -> str:
    """Return a C identifier made from a text, which C names may begin with."""
    plain = re.sub(r"[^a-z0-9]+", "_", text.lower()).strip("_")[:100].rstrip("_")
    if not plain or not plain[0].isalpha() or _taken(plain):
        plain = f"rig_{plain}"[:100].rstrip("_")
    return plain


def checked_name(name: str) -> str:
    """Return the name unchanged, if C names and files may begin with it.

    Raises:
        ExportError: the name is no C identifier of lower-case letters, digits and _, does not begin
            with a letter, or is taken.
    """
    if not re.fullmatch(r"[a-z][a-z0-9_]{0,99}", name):
        raise ExportError(
            f"'{shown(name)}' cannot begin the names of C functions; up to 100 lower-case "
            "letters, digits and _ can, a letter first"
        )
    if _taken(name):
        raise ExportError(
            f"'{name}' is the name of a header of C, a target of CMake or a device; give another "
            "one (--name)"
        )
    return name


def _taken(name: str) -> bool:
    return name in TAKEN or DEVICES.fullmatch(name) is not None
