"""The tension that every tendon keeps."""

from __future__ import annotations

from math import inf

from distal.errors import CommandError
from distal.inverse.setpoint_function import FARTHEST
from distal.rig import Rig
from distal.rounded import rounded
from distal.units import to_si

LEAST_TENSION = 1.0
"""Tension that every tendon keeps where nothing else is asked for [N]."""

SLACKEST = 0.1
TAUTEST = 500.0
"""Between these a tension is looked for that makes a joint stiff [N]."""


def least_tension_of(value: float | str, rig: Rig) -> float:
    """Return a least tension [N].

    Args:
        value: newtons, or a text with a unit.

    Raises:
        CommandError: it is none, or no tendon of the rig can have it.
    """
    try:
        tension = to_si(value, "N")
    except ValueError as problem:
        raise CommandError(f"least_tension: {problem}") from None
    if not 0.0 <= tension < inf:
        raise CommandError(f"least_tension: at least 0 N, {value} came")
    for tendon in rig.tendons:
        most = max(FARTHEST * tendon.stiffness.value, TAUTEST)
        if tension > most:
            raise CommandError(
                f"least_tension: {value} would stretch tendon '{tendon.name}' by more than "
                f"{FARTHEST:g} m; up to {rounded(most, 3)} N can be"
            )
    return tension
