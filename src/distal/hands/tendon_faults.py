"""Faults of tendons and spools that a power-on routine shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from math import degrees
from typing import Literal

import numpy as np

from distal.confidence import BAND, CLEARLY
from distal.errors import FitError
from distal.hands.sweeps import FEWEST_SWEEPS, STRONGEST, Sweep, contacts, is_pair, needed, unsure
from distal.rig import Rig

FaultKind = Literal["side", "slack", "broken", "slipped", "stopped", "file", "zero"]

SLIPPED = 4.0
"""Motion of the end of the travel between sweeps, at the joint, from which on a spool slipped
[deg]. Source: judgement.
"""

TURNS_MOST = degrees(1.0) ** 0.5
"""Travel of all motors, in multiples of what their joints' ranges need, from which on a unit is
wrong [1]. Source: definition (nearer to degrees than to radians).
"""

FREE = "turns freely both ways: its spool slips on its shaft, or all its tendons are off"


@dataclass(frozen=True)
class Fault:
    """One fault of a motor or of its tendons.

    Args:
        kind: of the fault.
        drive: name of the motor.
        sentence: the fault in words.
        values: path by names → value that corrects the file, where that may be wrong.
    """

    kind: FaultKind
    drive: str
    sentence: str
    values: Mapping[str, object] = field(default_factory=dict)


def faults_of(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[Fault, ...]:
    """Return the fault of a motor's tendons that its sweeps show, or none: the most certain where
    there are several.
    """
    motor = rig.drive(drive)
    tendons = rig.tendons_of(drive)
    arms = tendons[0].arms()
    names = ", ".join(arms)
    ratio = tendons[0].total_arm / motor.lever
    pair = is_pair(rig, drive)

    def fault(kind: FaultKind, sentence: str) -> tuple[Fault, ...]:
        return (Fault(kind, drive, f"{drive} ({names}): {sentence}"),)

    if len(sweeps) < FEWEST_SWEEPS:
        return fault("slipped", FREE)
    full = sweeps[1:]
    resisted = {way: [sweep.resisted for sweep in full if sweep.way == way] for way in (1, -1)}
    none = [way for way in (1, -1) if not any(resisted[way])]
    if pair and len(none) == 2:
        return fault("slipped", FREE)
    if pair and none:
        which = " and ".join(tendon.name for tendon in tendons if tendon.winding == none[0])
        words = (
            f"nothing resists {_ways(none)}: {which} is broken, off its spool, or wound the "
            "wrong way round"
        )
        return fault("broken", words)
    if not pair and 1 in none:
        if -1 not in none:
            return fault(
                "side",
                "tightens when it should let out: its tendon is wound the wrong way round",
            )
        return fault("broken", f"nothing resists: {tendons[0].name} is broken or off its spool")
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
            f"the end of the travel moved by {moved:.1f}° between sweeps: its spool slips",
        )
    if not pair:
        return ()
    longer, std = excess(rig, drive, sweeps)
    if longer < -CLEARLY * std:
        share = 100 * (1 + longer / needed(rig, drive))
        return fault(
            "side",
            f"stops after {share:.0f} % of its travel: it is blocked, a tendon is on the wrong "
            "side, or its radii are others",
        )
    return ()


def excess(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[float, float]:
    """Return how much more of its tendons a motor with a pair of them winds, from end to end, than
    its joint's range and their slack need, and the std of that by the rig [m].
    """
    motor = rig.drive(drive)
    up, down = (float(np.mean(contacts(sweeps, way))) for way in (1, -1))
    tendons = rig.tendons_of(drive)
    longer = (up - down) * motor.lever - needed(rig, drive)
    slack = sum(tendon.slack.value for tendon in tendons)
    return longer - slack, unsure(rig, drive, up - down)


def slack_of(found: Rig, rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> tuple[Fault, ...]:
    """Return the pairs of tendons that are slack by their travel, or by the calibrated rig `found`,
    of motors without another fault; `sweeps` are theirs.
    """
    faults = []
    for drive in (name for name in sweeps if is_pair(rig, name)):
        tendons = rig.tendons_of(drive)
        slack = sum(tendon.slack.value for tendon in found.tendons_of(drive))
        more = slack - sum(tendon.slack.value for tendon in tendons)
        of_file, of_fit = (
            np.hypot.reduce([tendon.slack.total_std for tendon in of.tendons_of(drive)])
            for of in (rig, found)
        )
        longer, std = excess(rig, drive, sweeps[drive])
        # what moves the motor stretches both tendons, by half of this each
        level = float(np.median([abs(sweep.level) for sweep in sweeps[drive]]))
        stretch = level / rig.drive(drive).lever / tendons[0].stiffness.value
        if longer > max(CLEARLY * std, BAND * std + stretch) or more > max(
            CLEARLY * of_file, BAND * of_fit
        ):
            line = (
                f"{drive} ({', '.join(tendons[0].joints)}): turns about "
                f"{degrees(max(longer, more) / tendons[0].total_arm):.0f}° further than its range "
                "asks for: its tendons are slack, or its radii are others"
            )
            faults.append(Fault("slack", drive, line))
    return tuple(faults)


def check_units(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]], source: str) -> None:
    """Check that the motors turn, and pull, as far as a hand's can.

    Raises:
        FitError: all motors turn, or pull, so much more or less that a unit is wrong.
    """
    turned = list[float]()
    pulls = list[float]()
    for drive in (drive for drive in rig.drives if sweeps[drive.name]):
        ends = [sweep.contact for sweep in sweeps[drive.name]]
        turned.append(float(np.ptp(ends)) * drive.lever / needed(rig, drive.name))
        pulls.append(max(abs(sweep.level) for sweep in sweeps[drive.name]))
    if min(turned) > TURNS_MOST:
        size = (
            f"all motors turn {min(turned):.0f} times as far as their joints' ranges ask for, "
            "or more"
        )
        raise FitError(f"{source}: {size}; is the unit of their positions right?")
    noise = min(sensor.noise for sensor in rig.sensors_of("force"))
    if not noise / CLEARLY < max(pulls) < STRONGEST:
        size = f"the motors' torques while they move are {max(pulls):.2g} N m at most"
        raise FitError(
            f"{source}: {size}; is the unit of their currents, or the torque constant, right?"
        )


def _ways(ways: Sequence[int]) -> str:
    return " or ".join(
        "as its reading grows" if way > 0 else "as its reading falls" for way in ways
    )
