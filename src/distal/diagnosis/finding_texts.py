"""The text of every finding: one function for each, called where it is found."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.diagnosis.finding import Finding
from distal.rounded import rounded


def all_drift(channels: Sequence[str]) -> Finding:
    """Return the finding that all channels' innovations are correlated."""
    several = ", ".join(channels)
    why = "something acts that the rig does not have (a hand: external_torque; friction at a drive)"
    return Finding("drifts", several, f"innovations of {several} drift: {why}")


def some_drift(channels: Sequence[str], correlation: float) -> Finding:
    """Return the finding that some channels' innovations are correlated, by their largest
    `correlation`.
    """
    several = ", ".join(channels)
    text = f"innovations of {several} are not white (correlation {correlation:.1f})"
    return Finding("drifts", several, f"{text}: geometry, stiffness or friction is off")


def disagrees_since(channel: str, since: float) -> Finding:
    """Return the finding that a sensor disagrees from the time `since` [s] to the end."""
    text = (
        f"sensor {channel} disagrees from {since:.1f} s on: its innovations are too large to "
        "the end"
    )
    return Finding("disagrees", channel, text)


def one_too_large(channel: str, ratio: float) -> Finding:
    """Return the finding that the innovations of one channel are too large, by `ratio`, the mean of
    ν²/S.
    """
    text = f"sensor {channel} disagrees: innovations {np.sqrt(ratio):.1f}× larger than expected"
    return Finding("too large", channel, text)


def several_too_large(channels: Sequence[str], ratio: float) -> Finding:
    """Return the finding that the innovations of several channels are too large, by `ratio`, the
    mean of ν²/S.
    """
    text = (
        f"innovations {np.sqrt(ratio):.1f}× larger than expected: the rig's stiffness, "
        "friction or geometry is off"
    )
    return Finding("too large", ", ".join(channels), text)


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


def does_not_settle(state: str, change: float) -> Finding:
    """Return the finding that a state still moves at the end of the log, by its `change` since the
    middle, SI.
    """
    return Finding(
        "left its prior", state, f"{state} does not settle: it moves by {change:.2g} late"
    )


def turns_too_far(joint: str, covered: float) -> Finding:
    """Return the finding that a joint has `covered` a larger angle than a joint can [rad]."""
    degrees = np.rad2deg(covered)
    text = (
        f"the angle of {joint} covers {degrees:.0f}°, which no joint does: is a gear, a unit "
        "or a radius wrong?"
    )
    return Finding("cannot be there", joint, text)


def friction_undeclared(drive: str, friction: float) -> Finding:
    """Return the finding that a drive has `friction` that the rig does not declare [N, N m]."""
    size = f"friction that the rig does not have: {friction:.2g} at '{drive}' [SI]"
    return Finding("friction", drive, f"{size} (set drives.{drive}.friction, or a hand acts)")


def drive_elsewhere(sensor: str) -> Finding:
    """Return the finding that a displacement is beyond the range of its drive."""
    return Finding(
        "cannot be there",
        sensor,
        f"{sensor} is where its drive cannot be: wrong unit, zero or side?",
    )


def outside_the_fit(channel: str, share: float, low: float, high: float) -> Finding:
    """Return the finding that a channel left the range of a fit, `low` to `high` [SI], for some
    `share` of the log.
    """
    text = (
        f"{channel} is outside the range of the fit for {100 * share:.0f} % of the log "
        f"({low:.3g} to {high:.3g})"
    )
    return Finding("out of range", channel, text)


def kinematics_disagree(estimator: str, share: float) -> Finding:
    """Return the finding that a kinematic estimate lies outside both bands for a `share` of the
    log.
    """
    text = (
        f"{estimator} lies outside both bands {100 * share:.0f} % of the time: stiffness, "
        "friction or a zero is off"
    )
    return Finding("other estimate", estimator, text)


def map_disagrees(share: float) -> Finding:
    """Return the finding that `regression` lies outside both bands for a `share` of the log."""
    text = f"regression, learned from logs, lies outside both bands {100 * share:.0f} % of the time"
    return Finding("other estimate", "regression", text)


def looks(subject: str, like: str) -> Finding:
    """Return the finding that a sensor, a drive or a parameter looks `like` something that would
    explain the disagreement.
    """
    return Finding(
        "looks like", subject, f"{subject} {'look' if ' and ' in subject else 'looks'} {like}"
    )


SMALLEST_GEAR = 1.7
"""Least ratio that is called a gear [1]: a smaller one may be friction or stretch, up to 1.1 on
right rigs, since a motor that turns back moves its joint later. Source: judgement.
"""


def like_a_gear(ratio: float, gear: float = 1.0) -> str:
    """Return what a motor looks like that turns `ratio` times as far as the rig, with its `gear`,
    expects.
    """
    if gear != 1.0:
        return f"like a gear of about {gear * ratio:.2g}, where the rig file has {gear:g}"
    if ratio < 1.0:
        return f"about {1 / ratio:.2g} times too small, as if a gear were taken off twice"
    return f"like a gear of about {ratio:.2g} that the rig file does not have"


def looks_geared_at_least(subject: str, ratio: float) -> Finding:
    """Return the finding that a motor would turn its joint `ratio` times as far as the joint can
    turn.
    """
    return looks(
        subject, f"like a gear of {ratio:.2g} or more, or a unit, that the rig file does not have"
    )


SCALE = "gear, spool, moment arm, unit or sign"
"""Group of parameters that scale the position of a drive alike; nothing proximal tells them apart.
"""

COMPLIANCE = "stiffness or the force's scale"
"""Group of parameters that scale the stretch of tendons alike; nothing proximal tells them apart.
"""

ZERO = "zero or pre-tension"
"""Group of parameters that shift the position of a drive alike; nothing proximal tells them apart.
"""


def cannot_be_tested(subject: str) -> Finding:
    """Return the finding that no sensor tests a sensor, a drive or a parameter."""
    return Finding(
        "cannot test", subject, f"{subject}: an error there changes the angle but no innovation"
    )


def hangs_on_the_start(state: str, spread: float, *, is_angle: bool) -> Finding:
    """Return the finding that the angle depends on the start of a state by more than the band
    allows.

    Args:
        state: whose start matters.
        spread: of the angle over starts, in its standard deviations.
        is_angle: whether the state is an angle.
    """
    position = f"{'where' if is_angle else 'what'} {state} is"
    text = (
        f"the band is too narrow: the angle depends {spread:.1f}× as much as it allows on "
        f"{position} at first"
    )
    return Finding("overconfident", state, text)


def outside_the_truth(joint: str, rms: float, share: float) -> Finding:
    """Return the finding that the band of a joint contains the reference angle for only a `share`
    of the samples, with the error `rms` [rad].
    """
    text = (
        f"the truth contradicts: {joint} errs by {rounded(np.rad2deg(rms))}° RMS, "
        f"{100 * share:.0f} "
        "% inside the band"
    )
    return Finding("against the truth", joint, text)


def errs_inside(joint: str, rms: float, share: float) -> Finding:
    """Return the finding that a joint errs by `rms` [rad] though the band contains the reference
    angle for a `share` of the samples.
    """
    text = (
        f"the band holds the truth ({100 * share:.0f} %), but {joint} errs by "
        f"{rounded(np.rad2deg(rms))}° RMS"
    )
    return Finding("errs inside", joint, text)


def like_a_scale(factor: float, gear: float, *, is_capstan: bool) -> str:
    """Return what a drive's readings look like that are `factor` times as large as the joints and
    the `gear` ask for.
    """
    if factor < 0:
        size = "" if abs(np.log(-factor)) < 0.1 else f" (and {-factor:.3g} times too large)"
        return f"as if its sign, or the side of its tendon, were wrong{size}"
    if not is_capstan:
        return f"{factor:.3g} times too large: unit or moment arm"
    if not 1 / SMALLEST_GEAR < factor < SMALLEST_GEAR:
        return like_a_gear(factor, gear)
    return (
        f"{factor:.3g} times too large: gear {gear * factor:.3g} for {gear:g}, its spool, unit "
        "or moment arm"
    )


def like_an_arm(factor: float) -> str:
    """Return what a moment arm looks like that is `factor` times the one of the rig."""
    return f"as if its moment arm were {factor:.3g} times the rig's" + (
        " (wrong side)" if factor < 0 else ""
    )


def like_a_compliance(factor: float, drive: str) -> str:
    """Return what a force looks like that stretches the tendons of a drive `factor` times as far as
    the rig says.
    """
    if factor < 0:
        return "as if its sign were wrong"
    times = f"as if it stretched the tendons of {drive} {factor:.2g} times as far"
    return f"{times}: their stiffness, its scale, or friction in it"


def like_friction(factor: float) -> str:
    """Return what friction looks like that is `factor` times the one of the rig."""
    return f"about {factor:.2g} times the rig's"


def like_a_delay(delay: float) -> str:
    """Return what readings look like that are late by a `delay` [s]."""
    return f"{abs(delay):.2g} s {'late' if delay > 0 else 'early'}"


def like_a_zero(off: float, unit: str) -> str:
    """Return what readings look like that have an offset `off`, in their SI unit."""
    size = f"{rounded(np.rad2deg(off))}°" if unit == "rad" else f"{1e3 * off:.2g} mm"
    return f"{size} off: its zero, or the pre-tension"
