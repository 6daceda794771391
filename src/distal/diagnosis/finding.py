"""A finding is one statement of the diagnosis; its text is made by one function for each kind."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from distal.diagnosis.causes import UNITS, Cause
from distal.rig import Rig
from distal.rounded import rounded

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

UNIT_WORDS = {
    ("rad", 1): "like degrees",
    ("m", 1): "like millimetres",
    ("m", -1): "1000 times too small",
    ("N", 1): "like millinewtons",
    ("N", -1): "1000 times too small",
    ("N m", 1): "like N mm",
    ("N m", -1): "1000 times too small",
    ("rad", -1): "57.3 times too small (converted from degrees twice?)",
}
"""SI unit, and whether readings are too large or too small by its first unit → what they look
like.
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


def not_white(channels: Sequence[str], correlation: float) -> Finding:
    """Return the finding that some channels' innovations are correlated, by their largest
    `correlation`.
    """
    several = ", ".join(channels)
    text = f"innovations of {several} are not white (correlation {correlation:.1f})"
    return Finding("drifts", several, f"{text}: something acts that the rig does not have")


def disagrees_since(channel: str, since: float) -> Finding:
    """Return the finding that a sensor disagrees from the time `since` [s] to the end."""
    text = f"sensor {channel} disagrees from {since:.0f} s on: its innovations are too large"
    return Finding("disagrees", channel, text)


def too_large(channels: Sequence[str], ratio: float) -> Finding:
    """Return the finding that the innovations of channels are too large, by `ratio`, the mean of
    ν²/S over what is normal.
    """
    several = ", ".join(channels)
    verb = "disagrees" if len(channels) == 1 else "disagree"
    text = f"{several} {verb} with the rig: innovations {np.sqrt(ratio):.1f}× larger than normal"
    return Finding("too large", several, text)


def hardly_compared(channel: str, share: float) -> Finding:
    """Return the finding that only a small `share` of a channel's samples is compared."""
    text = (
        f"only {100 * share:.0f} % of {channel} could be compared (missing, or the slider at a "
        "stop)"
    )
    return Finding("hardly compared", channel, text)


def not_tested(channel: str, ratio: float) -> Finding:
    """Return the finding that a channel tests nothing: its innovations are far too small, by
    `ratio`, the mean of ν²/S.
    """
    text = (
        f"not tested by {channel}: its innovations are only {np.sqrt(ratio):.2f} of the "
        "expected size"
    )
    return Finding("not tested", channel, text)


def left_its_prior(state: str, value: float, std: float, prior: float, prior_std: float) -> Finding:
    """Return the finding that a state ends far outside its prior: `value` and `std`, and `prior`
    and `prior_std`, SI.
    """
    text = f"{state} is {value:.3g} ± {std:.1g}, its prior {prior:.3g} ± {prior_std:.1g}"
    return Finding("left its prior", state, text)


def turns_too_far(joint: str, covered: float) -> Finding:
    """Return the finding that a joint has `covered` a larger angle than a joint can [rad]."""
    text = (
        f"the angle of {joint} covers {np.rad2deg(covered):.0f}°, which no joint does: is a gear, "
        "a unit or a radius wrong?"
    )
    return Finding("cannot be there", joint, text)


def friction_undeclared(drive: str, friction: float) -> Finding:
    """Return the finding that a drive has `friction` that the rig does not declare [N, N m]."""
    size = f"friction that the rig does not have: {friction:.2g} at '{drive}' [SI]"
    return Finding("friction", drive, f"{size} (set drives.{drive}.friction, or a hand acts)")


def drive_elsewhere(sensor: str) -> Finding:
    """Return the finding that a displacement is beyond the range of its drive."""
    text = f"{sensor} is where its drive cannot be: wrong unit, zero or side?"
    return Finding("cannot be there", sensor, text)


def stuck(sensor: str, begin: float, end: float) -> Finding:
    """Return the finding that a position stays at one value from `begin` to `end` [s] while its
    drive's force goes on.
    """
    text = (
        f"{sensor} has one value from {begin:.1f} to {end:.1f} s while its force goes on: is it "
        "stuck?"
    )
    return Finding("stuck", sensor, text)


def outside_the_fit(channel: str, share: float, low: float, high: float) -> Finding:
    """Return the finding that a channel left the range of a fit, `low` to `high` [SI], for some
    `share` of the log.
    """
    text = (
        f"{channel} is outside the range of the fit for {100 * share:.0f} % of the log "
        f"({low:.3g} to {high:.3g})"
    )
    return Finding("out of range", channel, text)


def cannot_be_felt(group: str, drives: str) -> Finding:
    """Return the finding that no sensor tests a group of causes of some drives."""
    subject = f"{group} of {drives}"
    text = f"{subject}: an error there changes the angle but no innovation"
    return Finding("cannot test", subject, text)


def outside_the_truth(joint: str, rms: float, share: float) -> Finding:
    """Return the finding that the band of a joint contains the reference angle for only a `share`
    of the samples, with the error `rms` [rad].
    """
    text = (
        f"the truth contradicts: {joint} errs by {rounded(np.rad2deg(rms))}° RMS, "
        f"{100 * share:.0f} % inside the band"
    )
    return Finding("against the truth", joint, text)


def named_cause(kind: Kind, rig: Rig, cause: Cause, x: float) -> Finding:
    """Return the finding that a cause explains a disagreement, by the change `x` that takes it
    off.
    """
    verb = "look" if cause.kind == "swap" else "looks"
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
    for unit in UNITS.get(cause.unit, ()):
        if factor > 0.0 and abs(np.log(factor / unit)) < ALIKE:
            return UNIT_WORDS.get((cause.unit, 1 if unit > 1.0 else -1), "in another unit")
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
