"""`distal doctor`: what is in use and why."""

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
    "pooch": "data",
    "plotly": "view",
}
"""Packages that are not needed, and the extra that installs each."""


def doctor_command() -> None:
    """Say which versions and which kernels are in use, and why."""
    from importlib.metadata import PackageNotFoundError, version

    from distal.kernels import cache_folder, find_compiler, lanes_here, probe

    say(f"distal {__version__}, Python {platform.python_version()}, {platform.system()} {platform.machine()}")
    found = []
    for name in _PACKAGES:
        try:
            found.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            found.append(f"{name} not installed")
    say(f"packages: {', '.join(found)}")
    extras = []
    for name, extra in _EXTRAS.items():
        try:
            extras.append(f"{name} {version(name)}")
        except PackageNotFoundError:
            extras.append(f"{name} not installed (pip install '.[{extra}]')")
    say(f"extras: {', '.join(extras)}")
    compiler = find_compiler()
    say(f"C compiler: {compiler if isinstance(compiler, str) else f'{compiler.version} ({compiler.command[0]})'}")
    say(f"kernel cache: {cache_folder()}")
    backend, reason, difference = probe()
    say(f"kernels: {backend} ({reason})")
    if backend == "compiled":
        say(f"compiled against interpreted: largest difference {difference:.1e}")
        say(f"batches: {lanes_here()} runs in the vector lanes of each core")
