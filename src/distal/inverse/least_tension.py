"""The least tension of the tendons: its default, its range and its check."""

from __future__ import annotations

from math import inf

from distal.errors import CommandError
from distal.inverse.setpoint_function import FARTHEST
from distal.rig import Rig, check_scales
from distal.rounded import rounded
from distal.units import to_si

LEAST_TENSION = 1.0
"""Default of the tension that commands keep in the tendons [N]. Source: judgement."""

SLACKEST = 0.1
"""Least tension that is tried to make a joint stiff [N]. Source: judgement."""

TAUTEST = 500.0
"""Largest tension that is tried to make a joint stiff [N]. Source: judgement."""


def least_tension_of(value: float | str, rig: Rig) -> float:
    """Return a least tension [N], checked for a rig.

    Args:
        value: newtons, or a text with a unit.
        rig: whose tendons shall keep it.

    Raises:
        CommandError: the value is no tension of 0 N or more, stretches a tendon too far, or the
            rig's scale of force was taken.
    """
    check_scales(rig, "a command that keeps tendons taut", "tension")
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
