"""What commands take from the rig beside the parameters of the equations: limits, ranges, stds and
servos.
"""

from __future__ import annotations

from collections.abc import Iterator
from math import inf

from distal.confidence import BAND
from distal.model import Mechanism
from distal.rig import Rig
from distal.rig.drives import Drive

DERIVED = "command."
"""Prefix of the names of these inputs."""


def command_inputs(rig: Rig) -> dict[str, float]:
    """Return the inputs of the commands' kernels beside the equations' parameters: name with the
    prefix `DERIVED` → value.
    """
    return {f"{DERIVED}{name}": value for name, value in _inputs(rig)}


def _inputs(rig: Rig) -> Iterator[tuple[str, float]]:
    # the slowest drive sets how far ahead angles are commanded
    yield "lead", max((drive.servo.lag for drive in rig.drives if drive.servo), default=0.0)
    for j, joint in enumerate(rig.joints):
        yield from _ends(f"joints.{j}", joint.stops)
    for d, drive in enumerate(rig.drives):
        path = f"drives.{d}"
        limit = inf if drive.limit is None else drive.limit
        servo = drive.servo
        yield from _ends(path, drive.stops)
        yield f"{path}.limit", limit
        yield f"{path}.radius", drive.lever
        yield f"{path}.most_pull", limit / drive.lever
        yield f"{path}.margin", _margin(rig, drive)
        # a servo of stiffness K and dead band δ, with the force F in the direction d, is at
        # s = u − F/K − δ d
        yield f"{path}.soft", 0.0 if servo is None or not servo.stiffness else 1 / servo.stiffness
        yield f"{path}.dead", 0.0 if servo is None else servo.dead_band
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
    return 1.0 + BAND * max(
        tendon.stiffness.total_std / tendon.stiffness.value for tendon in rig.tendons_of(drive.name)
    )
