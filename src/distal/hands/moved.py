"""What changed between two calibrations of one hand."""

from __future__ import annotations

from math import hypot

from distal.confidence import CLEARLY
from distal.errors import RigError
from distal.fitting.free_parameter import COMMON
from distal.rig import Rig, in_words, number, parameters_below

WATCHED = ("bias", "slack", "pretension", "stiffness", "constant", "radius")
"""Last words of the references of the parameters that are compared."""


def moved_since(before: Rig, after: Rig) -> tuple[str, ...]:
    """Return a line for each parameter of a hand that differs clearly between two calibrations: |x₂
    − x₁| > 3 √(σ₁² + σ₂²).

    There is a line too where a pair of tendons was slack in one and under tension in the other.
    Parameters that are zero in one of them are not compared.

    Raises:
        RigError: the rigs are of two hands.
    """
    names = [
        tuple(part.name for part in (*rig.joints, *rig.drives, *rig.tendons))
        for rig in (before, after)
    ]
    if names[0] != names[1]:
        raise RigError(
            f"'{before.name}' and '{after.name}' are two hands: their parts have other names"
        )
    lines = list[str]()
    for one, other in zip(before.tendons, after.tendons):
        if one.slack.absent != other.slack.absent:
            lines.append(
                f"{one.name}: was {_state(one.slack.absent)}, is {_state(other.slack.absent)}"
            )
    for kind in ("drives", "tendons", "sensors"):
        paths = [
            path
            for k, part in enumerate(after.components[kind])
            for path, _ in parameters_below(part, f"{kind}.{k}")
        ]
        lines += [
            line
            for path in paths
            if path.rsplit(".", 1)[-1] in WATCHED and (line := _changed(before, after, path))
        ]
    return tuple(lines)


def _changed(before: Rig, after: Rig, path: str) -> str:
    """Return a line on what a parameter was and is; empty where it is not clearly different."""
    try:
        was = number(before, path)
        now = number(after, path)
    except RigError:
        return ""  # one of them has no such part
    error = hypot(was.std, now.std)
    if (
        error == 0.0
        or was.value == 0.0
        or now.value == 0.0
        or abs(now.value - was.value) < CLEARLY * error
    ):
        return ""
    unit, factor = COMMON.get(now.quantity.si, (now.quantity.si, 1.0))
    kind, at, *_ = path.split(".")
    if kind == "sensors" and path.endswith(".bias"):
        factor *= after.sensors[int(at)].sign  # as its motor reads it
    of = in_words(after, path)
    return (
        f"{of}: {factor * was.value:.4g}, now {factor * now.value:.4g} ± "
        f"{2 * abs(factor) * now.std:.2g} {unit}"
    ).rstrip()


def _state(is_stretched: bool) -> str:
    return "under tension" if is_stretched else "slack"
