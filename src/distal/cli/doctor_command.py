"""`distal doctor`: versions of what is installed, the C compiler, and where kernels are kept."""

from __future__ import annotations

import platform

from distal.cli.shared_options import say
from distal.version import __version__

_PACKAGES = ("numpy", "scipy", "casadi", "pydantic", "pint", "matplotlib")


def doctor_command() -> None:
    """Say which versions are in use, and with which compiler and where kernels are built."""
    from importlib.metadata import PackageNotFoundError, version

    from distal.kernels import cache_folder, find_compiler
    from distal.logs.formats.format import EXTRAS

    say(
        f"distal {__version__}, Python {platform.python_version()}, {platform.system()} "
        f"{platform.machine()}"
    )

    def installed(name: str, advice: str = "") -> str:
        try:
            return f"{name} {version(name)}"
        except PackageNotFoundError:
            return f"{name} not installed{advice}"

    say(f"packages: {', '.join(map(installed, _PACKAGES))}")
    extras = (installed(name, f" (pip install '.[{extra}]')") for name, extra in EXTRAS.items())
    say(f"extras: {', '.join(extras)}")
    found = find_compiler()
    compiler = found if isinstance(found, str) else f"{found.version} ({found.command[0]})"
    say(f"C compiler: {compiler}")
    say(f"kernel cache: {cache_folder()}")
