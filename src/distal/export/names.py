"""Names of exported filters: those that C functions, files and CMake targets may have on every
system.
"""

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
alloca availability availabilitymacros concurrencysal corecrt corecrt_io corecrt_malloc corecrt_math
corecrt_memory corecrt_memcpy_s corecrt_search corecrt_share corecrt_stdio_config corecrt_terminate
corecrt_wio corecrt_wprocess corecrt_wstdio corecrt_wstdlib corecrt_wstring corecrt_wtime crtdefs
endian fcntl features malloc memory newlib picolibc pthread reent sal sched strings swab unistd
vadefs vcruntime vcruntime_new vcruntime_new_debug vcruntime_string yvals yvals_core
"""
"""Headers that those of C include on Linux, macOS, Windows and with newlib."""

TARGETS = """
all all_build clean cmake_check_build_system cmake_force default_target depend edit_cache help
install list_install_components m package package_source preinstall rebuild_cache replay run_tests
test zero_check
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
            "letters, digits and _ can, "
            "a letter first"
        )
    if _taken(name):
        raise ExportError(
            f"'{name}' is the name of a header of C, a target of CMake or a device; give another "
            "one (--name)"
        )
    return name


def _taken(name: str) -> bool:
    return name in TAKEN or DEVICES.fullmatch(name) is not None
