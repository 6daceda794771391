"""A finding is one statement of the diagnosis; its text is made by one function for each kind."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

import numpy as np

from distal.diagnosis.causes import UNITS, Cause
from distal.rig import Rig, Sensor, Tendon
from distal.units import rounded

Silent = Literal["hardly compared", "not tested", "cannot test", "would explain"]
"""Kinds of findings that speak neither against the rig nor for it: what the log does not test, and
what would explain an error that the band allows.
"""

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
    Silent,
]
"""Kinds of findings."""

SCALE = "gear, spool, moment arm, unit or sign"
"""Group of causes that scale the position of a drive alike; nothing proximal tells them apart."""

COMPLIANCE = "stiffness or the force's scale"
"""Group of causes that scale the stretch of tendons alike; nothing proximal tells them apart."""

ZERO = "zero or pre-tension"
"""Group of causes that shift the position of a drive alike; nothing proximal tells them apart."""


@dataclass(frozen=True)
class Thresholds:
    """What a log is diagnosed by where nothing but judgement says how.

    Args:
        alike: difference of the logarithms of a factor and that of a unit, below which the factor
            is that unit [1].
        large_ratio: largest normal mean of ν²/S of a channel [1]; a filter is an approximation, and
            right rigs have up to that.
        seldom: share of a channel's samples that are compared, below which a finding says so [1].
        never_compared: the same share, below which the channel tests nothing [1].
        coloured: correlation of a channel's neighbouring innovations from which on the rig or the
            sensor is doubted [1]; a moment arm that is 20 % wrong on one side of two gives 0.3 to
            0.7.
        noise_ratio: mean of ν²/S above which a channel's innovations are mostly noise [1]; below
            it, S is mostly the uncertainty of the rig's parameters, whose errors last.
        largest_travel: range of an angle above which it is of no joint that tendons pull [rad];
            fingers and wrists turn by 180° at most.
        outside_share: share of a log's samples outside a drive's range, or outside the range of a
            fit, from which on a finding says so [1].
        active: spread of a force, as a share of that elsewhere, from which on it goes on [1].
        nearer: shares of a change that are tried beside it [1].
        likeliest: number of the likeliest causes that are refined; twice as many are tried beside
            the first [1].
        largest_change: largest change of a factor by the score test alone [1]: it is linear.
        frictions_tried: changes of friction and damping that are tried [1]: kinks hide their
            derivatives.
        half: largest share of the error of a joint that a cause may leave [1]: what leaves more
            explains little.
        noise_share: share ε of the band's std that is noise, and not an error of the rig [1]:
            smaller errors are not explained.
    """

    alike: float = 0.15
    large_ratio: float = 1.7
    seldom: float = 0.5
    never_compared: float = 0.1
    coloured: float = 0.3
    noise_ratio: float = 0.5
    largest_travel: float = float(np.deg2rad(270.0))
    outside_share: float = 0.05
    active: float = 0.5
    nearer: tuple[float, ...] = (0.6, 0.85, 1.15, 1.4)
    likeliest: int = 4
    largest_change: float = 0.7
    frictions_tried: tuple[float, ...] = (-0.6, 1.5)
    half: float = 0.5
    noise_share: float = 0.3


THRESHOLDS = Thresholds()
"""Of every diagnosis."""


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
        return self.kind not in get_args(Silent)


def named_cause(kind: Kind, rig: Rig, cause: Cause, x: float) -> Finding:
    """Return the finding that a cause explains a disagreement, by the change `x` that takes it
    off.
    """
    verb = "look" if len(cause.channels) > 1 else "looks"
    named = {"friction": "friction of ", "damping": "damping of "}.get(cause.kind, "")
    subject = f"{named}{cause.subject}"
    return Finding(kind, subject, f"{subject} {verb} {_like(rig, cause, x)}")


def sensor_of(rig: Rig, cause: Cause) -> Sensor:
    """Return the first sensor whose readings a cause changes."""
    return rig.sensors[rig.sensor_names.index(cause.channels[0])]


def tendon_of(rig: Rig, cause: Cause) -> Tendon:
    """Return the first tendon whose parameters a cause changes."""
    return rig.tendons[int(cause.paths[0].split(".")[1])]


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
        return _like_a_stretch(tendon_of(rig, cause).drive, 1.0 / factor)
    if cause.kind in ("friction", "damping"):
        return f"about {factor:.2g} times the rig's"
    return _like_a_scale(rig, cause, 1.0 / factor)


def _like_a_scale(rig: Rig, cause: Cause, factor: float) -> str:
    """Return what readings look like that are `factor` times as large as the rig asks for."""
    for unit, look in UNITS.get(cause.unit, {}).items():
        if factor > 0.0 and abs(np.log(factor / unit)) < THRESHOLDS.alike:
            return look
    size = abs(factor)
    sensor = sensor_of(rig, cause)
    if factor < 0.0:
        by = "" if abs(np.log(size)) < THRESHOLDS.alike else f", and {size:.2g} times too large"
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
