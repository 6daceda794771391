"""`distal doctor`: which versions and kernels are in use, and why."""

from __future__ import annotations

import platform
from typing import Annotated

import typer

from distal.cli.console import say
from distal.cli.shared_options import SetOption
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


RigChoice = Annotated[
    str | None,
    typer.Argument(help="A rig: also say what its kernels depend on.", show_default=False),
]
"""Argument that names a rig, or none."""


def doctor_command(rig: RigChoice = None, set_: SetOption = None) -> None:
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
    if rig is not None:
        _say_structure(rig, set_)


def _say_structure(name: str, changes: list[str] | None) -> None:
    """Print what a rig's kernels depend on; all other properties of a rig are inputs of the
    kernels.
    """
    from distal.estimators import AdaptiveFilter
    from distal.estimators.adaptive.friction_doubt import doubted_frictions
    from distal.rig import in_words, load_rig

    rig = load_rig(name, changes or ())
    estimator = AdaptiveFilter(rig, compiled=False)
    states = estimator.states
    context = estimator.states.context
    constants = [path for path, _ in context.mechanism.parameters.constants]
    declaring = [drive.name for i, drive in enumerate(rig.drives) if context.declares_friction(i)]
    lagging = [sensor.name for sensor in context.channels.positions if sensor.lag > 0.0]
    doubted = [rig.joints[joint].name for joint in doubted_frictions(states)]
    maps = [] if rig.map is None else list(rig.map.named())
    say(f"kernels of {name}: all numbers of the rig are inputs; one more is compiled where one of")
    say("these changes:")
    facts = {
        "parts, their kinds, axes and couplings, and who moves whom": rig.count_in_words(),
        "terms that are zero, or one, for certain": in_words(rig, *constants),
        "states (numbers that have a std, and errors of sensors)": str(len(states)),
        "joints whose friction is known to a factor only": ", ".join(doubted),
        "drives that declare friction": ", ".join(declaring),
        "sensors that read a command with a lag": ", ".join(lagging),
        "sub-steps of the joints in a sample": str(estimator.substeps),
        "joints that follow a jump of a drive within a sample": _yes(context.joints_follow),
        "joints that come to rest within a sample": _yes(context.joints_settle),
        "learned maps, by what they read": ", ".join(maps),
    }
    for fact, value in facts.items():
        say(f"  {fact}: {value or 'none'}")


def _yes(is_so: bool) -> str:
    return "yes" if is_so else "no"
