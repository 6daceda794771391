"""Shared libraries from C sources: for this platform by its own compiler, for others by ziglang
where it is installed.
"""

from __future__ import annotations

import importlib.util
import platform
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from distal.kernels import find_compiler
from distal.kernels.compiler import LOG, SWITCHED_OFF

ZIG_TARGETS = {
    "x86_64-linux": "x86_64-linux-gnu.2.17",
    "aarch64-linux": "aarch64-linux-gnu.2.17",
    "x86_64-windows": "x86_64-windows-gnu",
    "x86_64-darwin": "x86_64-macos",
    "aarch64-darwin": "aarch64-macos",
}
"""Platform by FMI's name → target by zig's name. On Linux it is for an old C library, 2.17, so that
the binary runs on every Linux in use.
"""

SUFFIX = {"linux": ".so", "darwin": ".dylib", "windows": ".dll"}
"""Operating system → ending of a shared library's name."""

_FLAGS = (
    "-std=c99",
    "-O2",
    "-ffp-contract=off",
    "-fno-math-errno",
    "-fvisibility=hidden",
    "-fPIC",
    "-shared",
)


def this_platform() -> str:
    """Return FMI's name of the platform on which this program runs."""
    machine = platform.machine().lower()
    architecture = {"amd64": "x86_64", "arm64": "aarch64", "i386": "x86", "i686": "x86"}.get(
        machine, machine
    )
    return f"{architecture}-{ {'win32': 'windows'}.get(sys.platform, sys.platform) }"


def binaries_of(sources: Mapping[str, str], everywhere: bool) -> tuple[dict[str, bytes], str]:
    """Return platform → shared library compiled from C sources, and a text that says why platforms
    are missing.

    The text is empty where none is missing.

    Args:
        sources: name of a file → its text.
        everywhere: whether the platforms of `ZIG_TARGETS` are wanted, too.
    """
    compiler = find_compiler()
    here = this_platform()
    if compiler == SWITCHED_OFF:
        return {}, compiler
    commands: dict[str, Sequence[str]] = {}
    reasons = [compiler] if isinstance(compiler, str) else []
    if everywhere and importlib.util.find_spec("ziglang") is None:
        others = ", ".join(other for other in ZIG_TARGETS if other != here)
        reasons.append(f"{others} need ziglang: pip install ziglang")
    elif everywhere:
        zig = [sys.executable, "-m", "ziglang", "cc", "-s", "-target"]
        commands = {where: [*zig, target] for where, target in ZIG_TARGETS.items()}
    if not isinstance(compiler, str) and here.split("-")[1] in SUFFIX:
        commands[here] = compiler.command
    with tempfile.TemporaryDirectory() as folder:
        for file, text in sources.items():
            Path(folder, file).write_text(text, encoding="utf-8")
        files = [file for file in sources if file.endswith(".c")]
        with ThreadPoolExecutor() as pool:
            made = dict(
                zip(
                    commands,
                    pool.map(
                        lambda at: _made(folder, [*commands[at], *_FLAGS], files, at), commands
                    ),
                )
            )
    reasons += [f"{where}: {reason}" for where, reason in made.items() if isinstance(reason, str)]
    return {where: code for where, code in made.items() if isinstance(code, bytes)}, "; ".join(
        reasons
    )


def _made(folder: str, command: Sequence[str], files: Sequence[str], where: str) -> bytes | str:
    """Return the shared library that a compiler makes in a folder, or the reason why it fails."""
    command = [*command, *files, "-lm", "-o", f"made-{where}"]
    try:
        done = subprocess.run(
            command, cwd=folder, capture_output=True, text=True, errors="replace", timeout=600
        )
    except (OSError, subprocess.SubprocessError) as problem:
        return f"the C compiler did not run ({type(problem).__name__})"
    LOG.info("%s is done", where)
    if done.returncode != 0:
        return f"the C compiler failed: {(done.stderr.strip().splitlines() or ['no message'])[0]}"
    return Path(folder, f"made-{where}").read_bytes()
