"""Inputs of the commands' kernels that come beside the parameters of the equations: limits, ranges,
stds.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi

from distal.confidence import BAND
from distal.inverse.servo import gives_way
from distal.model import Mechanism
from distal.rig import Rig
from distal.rig.drives import Drive

DERIVED = "command."
"""Prefix of the names of these inputs."""


def command_inputs(rig: Rig) -> dict[str, float]:
    """Return the inputs of the commands' kernels beside the equations' parameters: name with the
    prefix `DERIVED` → value.
    """
    return {f"{DERIVED}{name}": value for name, value in _parameters(rig)}


def _parameters(rig: Rig) -> Iterator[tuple[str, float]]:
    yield "lead", _lead(rig)
    for j, joint in enumerate(rig.joints):
        yield from _ends(f"joints.{j}", joint.stops)
    soft, dead = gives_way(rig)
    for d, drive in enumerate(rig.drives):
        path = f"drives.{d}"
        limit = inf if drive.limit is None else drive.limit
        yield from _ends(path, drive.stops)
        yield f"{path}.limit", limit
        yield f"{path}.radius", radius_of(drive)
        yield f"{path}.most_pull", limit / radius_of(drive)
        yield f"{path}.margin", _margin(rig, drive)
        yield f"{path}.soft", float(soft[d])
        yield f"{path}.dead", float(dead[d])
    parameters = Mechanism(rig).parameters
    for name, std in zip(parameters.names, parameters.independent_stds):
        if std > 0.0:
            yield f"{name}.std", float(std)
    for name, (std, _) in parameters.shared.items():
        yield f"shared.{name}.std", std


def _ends(path: str, stops: tuple[float, float] | None) -> Iterator[tuple[str, float]]:
    low, high = stops or (-inf, inf)
    yield f"{path}.low", low
    yield f"{path}.high", high


def _margin(rig: Rig, drive: Drive) -> float:
    """Return the factor by which pulls are commanded above the least tension, so that all but 2.5 %
    of the rigs as built keep that.

    At a given position of a drive, softer tendons pull less, in proportion to their stiffness.
    """
    tendons = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
    return 1.0 + BAND * max(
        tendon.stiffness.total_std / tendon.stiffness.value for tendon in tendons
    )


def _lead(rig: Rig) -> float:
    """Return the lag and delay of the slowest drive by the servos in the rig [s]."""
    servos = [drive.servo for drive in rig.drives if drive.servo is not None]
    lags = [
        (0.0 if servo.bandwidth is None else 1 / (2 * pi * servo.bandwidth)) + servo.delay
        for servo in servos
    ]
    return max(lags, default=0.0)


def radius_of(drive: Drive) -> float:
    """Return how far a drive's motion moves its tendon, per unit of the drive [m/rad, 1]."""
    return drive.radius.value if drive.kind == "capstan" else 1.0
