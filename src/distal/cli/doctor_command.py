"""`distal doctor`: which versions and kernels are in use, and why."""

from __future__ import annotations

import platform

from distal.cli.console import say
from distal.version import __version__

_PACKAGES = ("numpy", "scipy", "casadi", "pydantic", "pint", "matplotlib")

_EXTRAS = {
    "pyarrow": "parquet",
    "pandas": "pandas",
    "polars": "polars",
    "mcap": "mcap",
    "rosbags": "ros",
    "plotly": "view",
}
"""Packages that are not needed, and the extra that installs each."""


def doctor_command() -> None:
    """Say which versions and which kernels are in use, and why."""
    from importlib.metadata import PackageNotFoundError, version

    from distal.kernels import cache_folder, find_compiler, lanes_here, probe

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
    extras = (installed(name, f" (pip install '.[{extra}]')") for name, extra in _EXTRAS.items())
    say(f"extras: {', '.join(extras)}")
    compiler = find_compiler()
    if isinstance(compiler, str):
        say(f"C compiler: {compiler}")
    else:
        say(f"C compiler: {compiler.version} ({compiler.command[0]})")
    say(f"kernel cache: {cache_folder()}")
    backend, reason, difference = probe()
    say(f"kernels: {backend} ({reason})")
    if backend == "compiled":
        say(f"compiled against interpreted: largest difference {difference:.1e}")
        say(f"batches: {lanes_here()} runs in the vector lanes of each core")
