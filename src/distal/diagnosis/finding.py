"""A finding is one statement of the diagnosis; its text is made by one function for each kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from distal.diagnosis.causes import UNITS, Cause
from distal.rig import Rig
from distal.units import rounded

Kind = Literal[
    "against the truth",
    "disagrees",
    "too large",
    "drifts",
    "friction",
    "left its prior",
    "cannot be there",
    "stuck",
    "looks like",
    "out of range",
    "not free",
    "hardly compared",
    "not tested",
    "cannot test",
    "would explain",
]
"""Kinds of findings. The last four are no contradictions: what the log does not test, and what
would explain an error that the band allows.
"""

SILENT: frozenset[Kind] = frozenset(
    {"hardly compared", "not tested", "cannot test", "would explain"}
)
"""Kinds of findings that speak neither against the rig nor for it."""

ALIKE = 0.15
"""Difference of the logarithms of a factor and that of a unit, below which the factor is that unit
[1]. Source: judgement.
"""

SCALE = "gear, spool, moment arm, unit or sign"
"""Group of causes that scale the position of a drive alike; nothing proximal tells them apart."""

COMPLIANCE = "stiffness or the force's scale"
"""Group of causes that scale the stretch of tendons alike; nothing proximal tells them apart."""

ZERO = "zero or pre-tension"
"""Group of causes that shift the position of a drive alike; nothing proximal tells them apart."""


@dataclass(frozen=True)
class Finding:
    """One statement of the diagnosis: what a log contradicts, or leaves untested.

    Args:
        kind: of the finding.
        subject: sensor, state, drive or parameter that it is about.
        text: the statement in words.
    """

    kind: Kind
    subject: str
    text: str

    @property
    def contradicts(self) -> bool:
        """Whether the finding speaks against the rig, the sensors or the band."""
        return self.kind not in SILENT


def named_cause(kind: Kind, rig: Rig, cause: Cause, x: float) -> Finding:
    """Return the finding that a cause explains a disagreement, by the change `x` that takes it
    off.
    """
    verb = "look" if len(cause.channels) > 1 else "looks"
    named = {"friction": "friction of ", "damping": "damping of "}.get(cause.kind, "")
    subject = f"{named}{cause.subject}"
    return Finding(kind, subject, f"{subject} {verb} {_like(rig, cause, x)}")


def _like(rig: Rig, cause: Cause, x: float) -> str:
    factor = 1.0 + x
    if cause.kind == "swap":
        return "swapped"
    if cause.kind == "delay":
        return f"{abs(x):.2g} s {'late' if x > 0 else 'early'}"
    if cause.kind == "zero":
        size = {"rad": f"{rounded(np.rad2deg(-x))}°", "m": f"{-1e3 * x:.2g} mm"}
        return f"{size.get(cause.unit, f'{-x:.2g} {cause.unit}')} off: its zero, or the pre-tension"
    if cause.kind == "arm":
        return f"as if its moment arm were {factor:.3g} times the rig's"
    if cause.kind == "stiffness":
        tendon = int(cause.paths[0].split(".")[1])
        return _like_a_stretch(rig.tendons[tendon].drive, 1.0 / factor)
    if cause.kind in ("friction", "damping"):
        return f"about {factor:.2g} times the rig's"
    return _like_a_scale(rig, cause, 1.0 / factor)


def _like_a_scale(rig: Rig, cause: Cause, factor: float) -> str:
    """Return what readings look like that are `factor` times as large as the rig asks for."""
    for unit, look in UNITS.get(cause.unit, {}).items():
        if factor > 0.0 and abs(np.log(factor / unit)) < ALIKE:
            return look
    size = abs(factor)
    sensor = next(sensor for sensor in rig.sensors if sensor.name == cause.channels[0])
    if factor < 0.0:
        by = "" if abs(np.log(size)) < ALIKE else f", and {size:.2g} times too large"
        side = ", or the side of its tendon," if sensor.measures == "position" else ""
        return f"as if its sign{side} were wrong{by}"
    if sensor.measures != "position":
        return _like_a_stretch(sensor.of, 1.0 / size)
    gear = float(getattr(sensor, "gear", 1.0))
    if gear != 1.0:
        return f"like a gear of about {gear * size:.3g}, where the rig file has {gear:g}"
    return f"{size:.3g} times too large: gear, spool, unit or moment arm"


def _like_a_stretch(part: str, factor: float) -> str:
    """Return what a force looks like that stretches tendons `factor` times as far as the rig
    says.
    """
    times = f"as if it stretched the tendons of {part} {factor:.2g} times as far"
    return f"{times}: their stiffness, its scale, or friction in it"
