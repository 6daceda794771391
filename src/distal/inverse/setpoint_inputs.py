"""The numbers that are inputs of the commands' kernels beside the parameters of the equations."""

from __future__ import annotations

from collections.abc import Iterator
from math import inf, pi

from distal.confidence import BAND
from distal.inverse.servo import gives_way
from distal.model import Mechanism
from distal.rig import Rig
from distal.rig.drives import Drive

DERIVED = "command."
"""Begins their names."""


def command_inputs(rig: Rig) -> dict[str, float]:
    """Return the numbers that commands read beside the equations' parameters, by name."""
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
    """Return by which factor a pull is above what is asked for, for all but 2.5 % of the rigs as
    built to keep it.

    At its position a drive whose tendons are as much softer as the rig file allows pulls so much
    less.
    """
    tendons = [tendon for tendon in rig.tendons if tendon.drive == drive.name]
    return 1.0 + BAND * max(
        tendon.stiffness.total_std / tendon.stiffness.value for tendon in tendons
    )


def _lead(rig: Rig) -> float:
    """Return the lag and delay of the slowest drive as far as its servo is stated [s]."""
    servos = [drive.servo for drive in rig.drives if drive.servo is not None]
    lags = [
        (0.0 if servo.bandwidth is None else 1 / (2 * pi * servo.bandwidth)) + servo.delay
        for servo in servos
    ]
    return max(lags, default=0.0)


def radius_of(drive: Drive) -> float:
    """Return by how much a drive's motion moves its tendon [m per its unit], for the scale of its
    friction.
    """
    return drive.radius.value if drive.kind == "capstan" else 1.0
