"""What a power-on routine says of tendons and spools that are not as they should be."""

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
"""A joint is jammed where its motor turns less than this share of what its range needs."""

LOOSE = 14.5
TRAVELS = 22.0
"""A pair is slack with more play than the first at the joint, by the fit and by its travel, or
with more than the second by its travel alone, which radii and ranges make unsure [deg]."""

SLIPPED = 4.0
"""A spool slipped where the end of the travel moved by this at the joint between sweeps [deg]."""

UNLIKE = 4.0
"""A spool's radius that is found further from the rig's than so many stds of both is another one.
"""

TURNS_MOST = 5.0
"""No hand's motors all turn so many times as far as their joints' ranges ask for."""

LEAST_PULL = 5e-4
MOST_PULL = 5.0
"""Between these is the largest torque that moves a motor of a hand [N m]."""

FREE = "turns freely both ways: its spool slips on its shaft, or all its tendons are off"


@dataclass(frozen=True)
class Fault:
    """One fault of a motor's tendons: its kind, the number that says so, and a line for people."""

    kind: FaultKind
    drive: str
    size: float
    sentence: str


def faults_of(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[Fault, ...]:
    """Return the faults of a motor's tendons by its sweeps: at most one, the most certain."""
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
    """Raise a `FitError` where all motors turn, or pull, so much more or less than a hand's can
    that a unit is wrong.
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
    """Return by how much further a motor with a pair of tendons turns between its contacts than its
    joint's range and the rig's radii ask for, at the joint [deg].
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
    """Return the pairs of tendons that are slack, by what a calibration found and by their travel:
    with the rig's radii, unless these are clearly others.
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
    """Return whether a spool's radius was found clearly apart from the rig's."""
    if not isinstance(before, Capstan) or not isinstance(after, Capstan):
        return False
    unsure = hypot(before.radius.total_std, after.radius.total_std)
    return abs(after.radius.value - before.radius.value) > UNLIKE * unsure


def motor_travel_of(found: Rig, rig: Rig, drives: Sequence[str]) -> tuple[Fault, ...]:
    """Return the motors whose travel asks for another radius of their spools than the rig has."""
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
    """Return the motors whose routine ended before its end, with why."""
    return tuple(
        Fault("stopped", name, 1.0, f"{name}: its routine ended before its end: {why}")
        for name, why in stopped.items()
    )


def _ways(ways: Sequence[int]) -> str:
    return " or ".join(
        "as its reading grows" if way > 0 else "as its reading falls" for way in ways
    )
