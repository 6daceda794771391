"""Faults of tendons and spools that a power-on routine shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from math import degrees, hypot
from typing import Literal

import numpy as np

from distal.errors import FitError
from distal.hands.starts import contacts, is_pair
from distal.hands.sweeps import FEWEST, Sweep
from distal.rig import Capstan, Rig, Slider

FaultKind = Literal["side", "slack", "broken", "slipped", "travel", "stopped"]

JAMMED = 0.55
"""Share of the travel that a joint's range needs, below which the motor's joint counts as blocked
[1]. Source: judgement.
"""

LOOSE = 14.5
"""Play at the joint, by the fit and by the travel, from which on a pair of tendons is slack [deg].
Source: judgement.
"""

TRAVELS = 22.0
"""Play at the joint, by the travel alone, from which on a pair of tendons is slack [deg]; unsure
radii and ranges change the travel too. Source: judgement.
"""

SLIPPED = 4.0
"""Motion of the end of the travel between sweeps, at the joint, from which on a spool slipped
[deg]. Source: judgement.
"""

UNLIKE = 4.0
"""Difference between a spool's radius that was found and the rig's, in stds of both, from which on
it is another radius [1]. Source: judgement.
"""

TURNS_MOST = 5.0
"""Travel of all motors, in multiples of what their joints' ranges need, from which on a unit is
wrong [1]. Source: judgement.
"""

LEAST_PULL = 5e-4
"""Least torque that is plausible as the largest one of a moving hand [N m]. Source: judgement."""

MOST_PULL = 5.0
"""Largest torque that is plausible as the largest one of a moving hand [N m]. Source: judgement."""

FREE = "turns freely both ways: its spool slips on its shaft, or all its tendons are off"


@dataclass(frozen=True)
class Fault:
    """One fault of a motor or of its tendons.

    Args:
        kind: of the fault.
        drive: name of the motor.
        size: of the fault, in a unit that its kind has.
        sentence: the fault in words.
    """

    kind: FaultKind
    drive: str
    size: float
    sentence: str


def faults_of(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[Fault, ...]:
    """Return the fault of a motor's tendons that its sweeps show, or none: the most certain where
    there are several.
    """
    motor = next(part for part in rig.drives if part.name == drive)
    assert isinstance(motor, Capstan)
    tendons = [tendon for tendon in rig.tendons if tendon.drive == drive]
    arms = tendons[0].arms()
    joints = {joint.name: joint for joint in rig.joints}
    names = ", ".join(arms)
    need = (
        sum(abs(arm) * float(np.ptp(joints[name].travel)) for name, arm in arms.items())
        / motor.radius.value
    )
    ratio = sum(abs(arm) for arm in arms.values()) / motor.radius.value
    pair = is_pair(rig, drive)

    def fault(kind: FaultKind, size: float, sentence: str) -> tuple[Fault, ...]:
        return (Fault(kind, drive, size, f"{drive} ({names}): {sentence}"),)

    if len(sweeps) < FEWEST:
        return fault("slipped", 2.0, FREE)
    full = sweeps[1:]
    resisted = {way: [sweep.resisted for sweep in full if sweep.way == way] for way in (1, -1)}
    none = [way for way in (1, -1) if not any(resisted[way])]
    if pair and len(none) == 2:
        return fault("slipped", 2.0, FREE)
    if pair and none:
        which = " and ".join(tendon.name for tendon in tendons if tendon.winding == none[0])
        words = (
            f"nothing resists {_ways(none)}: {which} is broken, off its spool, or wound the "
            "wrong way round"
        )
        return fault("broken", 1.0, words)
    if not pair and 1 in none:
        if -1 not in none:
            return fault(
                "side",
                -1.0,
                "tightens when it should let out: its tendon is wound the wrong way round",
            )
        return fault(
            "broken", 1.0, f"nothing resists: {tendons[0].name} is broken or off its spool"
        )
    shift = max(
        (
            float(np.ptp(contacts(sweeps, way)))
            for way in (1, -1)
            if all(resisted[way]) and resisted[way]
        ),
        default=0.0,
    )
    if shift > SLIPPED / degrees(1.0) * ratio:
        moved = degrees(shift / ratio)
        return fault(
            "slipped",
            moved,
            f"the end of the travel moved by {moved:.1f}° between sweeps: its spool slips",
        )
    travel = float(np.mean(contacts(sweeps, 1))) - float(np.mean(contacts(sweeps, -1)))
    if pair and travel < JAMMED * need:
        share = 100 * travel / need
        return fault(
            "side",
            share,
            f"stops after {share:.0f} % of its travel: a tendon is on the wrong side, or it is "
            "blocked",
        )
    return ()


def check_units(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]], source: str) -> None:
    """Check that the motors turn, and pull, as far as a hand's can.

    Raises:
        FitError: all motors turn, or pull, so much more or less that a unit is wrong; or none has a
            sweep.
    """
    turned = list[float]()
    pulls = list[float]()
    for drive in (drive for drive in rig.drives if sweeps[drive.name]):
        assert isinstance(drive, Capstan)
        tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
        joints = {joint.name: joint for joint in rig.joints}
        need = sum(
            abs(arm) * float(np.ptp(joints[name].travel)) for name, arm in tendon.arms().items()
        )
        contacts_of = [sweep.contact for sweep in sweeps[drive.name]]
        turned.append((max(contacts_of) - min(contacts_of)) * drive.radius.value / need)
        pulls.append(max(abs(sweep.level) for sweep in sweeps[drive.name]))
    if not turned:
        raise FitError(
            f"{source}: no motor has a sweep that came to its end; run the routine again"
        )
    if min(turned) > TURNS_MOST:
        size = (
            f"all motors turn {min(turned):.0f} times as far as their joints' ranges ask for, "
            "or more"
        )
        raise FitError(f"{source}: {size}; is the unit of their positions right?")
    if not LEAST_PULL < max(pulls) < MOST_PULL:
        size = f"the motors' torques while they move are {max(pulls):.2g} N m at most"
        raise FitError(
            f"{source}: {size}; is the unit of their currents, or the torque constant, right?"
        )


def longer(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> float:
    """Return how much further a motor with a pair of tendons turns between its contacts than its
    joint's range and the rig's radii need, at the joint [deg].
    """
    motor = next(part for part in rig.drives if part.name == drive)
    (name, arm), *_ = next(t for t in rig.tendons if t.drive == drive).arms().items()
    ends = [contacts(sweeps, way) for way in (1, -1)]
    if not isinstance(motor, Capstan) or not all(ends):
        return 0.0
    low, high = next(joint for joint in rig.joints if joint.name == name).travel
    up, down = (float(np.mean(end)) for end in ends)
    return degrees((up - down) * motor.radius.value / abs(arm) - (high - low))


def slack_of(found: Rig, rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> tuple[Fault, ...]:
    """Return the pairs of tendons that are slack, by the calibrated rig `found` and by their
    travel.

    The travel is judged with the radii of the `rig`, or of `found` where these are clearly others.
    """
    faults = []
    for before, after in zip(rig.drives, found.drives):
        name = before.name
        tendons = [t for t in found.tendons if t.drive == before.name]
        if not is_pair(rig, name) or len(sweeps[name]) < FEWEST:
            continue
        joint, arm = next(iter(tendons[0].arms().items()))
        by_travel = longer(found if _unlike(before, after) else rig, name, sweeps[name])
        play = degrees(sum(tendon.slack.value for tendon in tendons) / abs(arm))
        if min(play, by_travel) > LOOSE or by_travel > TRAVELS:
            size = max(play, by_travel)
            line = (
                f"{name} ({joint}): turns about {size:.0f}° further than its range asks for: its "
                "tendons are slack, or its radii are others"
            )
            faults.append(Fault("slack", name, size, line))
    return tuple(faults)


def _unlike(before: Capstan | Slider, after: Capstan | Slider) -> bool:
    """Return whether the radius of a spool that was found is clearly not the rig's."""
    if not isinstance(before, Capstan) or not isinstance(after, Capstan):
        return False
    unsure = hypot(before.radius.total_std, after.radius.total_std)
    return abs(after.radius.value - before.radius.value) > UNLIKE * unsure


def motor_travel_of(found: Rig, rig: Rig, drives: Sequence[str]) -> tuple[Fault, ...]:
    """Return the motors whose travel needs spools of a radius that is clearly not the rig's."""
    faults = []
    for before, after in zip(rig.drives, found.drives):
        if before.name not in drives or not isinstance(before, Capstan):
            continue
        assert isinstance(after, Capstan)
        if not _unlike(before, after):
            continue
        was = before.radius
        now = after.radius
        ratio = now.value / was.value
        joints = next(tendon.joints for tendon in rig.tendons if tendon.drive == before.name)
        why = "stops before its end" if ratio > 1.0 else "has slack tendons"
        known = f"{100 * was.total_std / was.value:.2g} %"
        line = (
            f"{before.name} ({', '.join(joints)}): goes {100 / ratio:.0f} % of its travel by the "
            f"rig's radii, which are known to {known}: it {why}, or the radii are others"
        )
        faults.append(Fault("travel", before.name, ratio, line))
    return tuple(faults)


def stopped_of(rig: Rig, stopped: Mapping[str, str]) -> tuple[Fault, ...]:
    """Return the faults of the motors whose routine ended too early, with the reasons."""
    return tuple(
        Fault("stopped", name, 1.0, f"{name}: its routine ended before its end: {why}")
        for name, why in stopped.items()
    )


def _ways(ways: Sequence[int]) -> str:
    return " or ".join(
        "as its reading grows" if way > 0 else "as its reading falls" for way in ways
    )
