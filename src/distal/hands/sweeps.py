"""Sweeps of a power-on routine: each motor goes slowly from one end of its travel to the other,
several times.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Floats
from distal.errors import LogError
from distal.logs import Log
from distal.rig import Capstan, Rig, Tendon

TURNED = 0.05
"""Way back after which a motor has turned back, as a share of its travel, in the log or as the
joints' ranges need it [1]. Source: judgement.
"""

FEWEST_SWEEPS = 3
"""Least number of sweeps of a motor. Source: definition (one each way after the first, which begins
anywhere).
"""

RISEN = 1.6
"""Torque at the end of a sweep from which on it met an end, in multiples of the torque that moves
the motor [1]; six stds of its noise come on top. Source: judgement.
"""

MIDDLE = (0.35, 0.7)
"""Range of a sweep, in shares of its travel, in which the motor moves freely [1]. Source:
judgement.
"""

LOADED = (0.3, 0.95)
"""Range of the torque's rise at the end, in shares of it, in which its slope is taken [1]. Source:
judgement.
"""

STRONGEST = 5.0
"""Largest torque of a motor of a hand [N m]; a larger one is in another unit. Source: judgement."""


@dataclass(frozen=True)
class Sweep:
    """One sweep of a motor, in the direction `way`, +1 or −1, up to the sample `end`.

    Args:
        level: torque that moves the motor, positive in the direction of the sweep [N m].
        noise: std of the torque about that level [N m].
        contact: where the torque begins to rise at the end, or else where the sweep ends [rad].
        resisted: whether the sweep met an end.
    """

    way: int
    end: int
    level: float
    noise: float
    contact: float
    resisted: bool


def sweeps_of(log: Log, rig: Rig, drive: str) -> tuple[Sweep, ...]:
    """Return the sweeps of a motor in a log, of which the first begins anywhere; a motor that meets
    no end either way may have two.

    Raises:
        LogError: its angle or torque is not in the log, or it sweeps less than `FEWEST_SWEEPS`
        times.
    """
    position, torque = sweep_channels_of(rig, drive)
    positions = log.channels[position]
    torques = log.channels[torque]
    known = np.isfinite(positions) & np.isfinite(torques)
    if not known.any():
        raise LogError(f"{log.source}: '{position}' and '{torque}' are never there together")
    rows = np.flatnonzero(known)
    ends = [int(rows[k]) for k in _turning(positions[rows], travel_of(rig, drive))]
    sweeps = [
        _sweep(positions[begin : end + 1], torques[begin : end + 1], end)
        for begin, end in itertools.pairwise(ends)
    ]
    if len(sweeps) > 1:
        last = sweeps[-1]
        reached = max(last.way * sweep.contact for sweep in sweeps if sweep.way == last.way)
        if last.way * last.contact < reached - TURNED * float(
            np.nanmax(positions) - np.nanmin(positions)
        ):
            sweeps = sweeps[:-1]  # it went to rest
    if len(sweeps) < FEWEST_SWEEPS and (len(sweeps) < 2 or any(sweep.resisted for sweep in sweeps)):
        raise LogError(
            f"{log.source}: motor '{drive}' sweeps {len(sweeps)} times to an end of its travel; a "
            "power-on routine has at "
            f"least {FEWEST_SWEEPS} sweeps of each (see distal.hands.Routine)"
        )
    return tuple(sweeps)


def is_pair(rig: Rig, drive: str) -> bool:
    """Return whether a motor holds one joint by two tendons."""
    return len(rig.tendons_of(drive)) == 2


def needed(rig: Rig, drive: str) -> float:
    """Return the length that the joints' ranges take up of a motor's tendon [m]."""
    arms = rig.tendons_of(drive)[0].arms()
    return float(
        sum(
            abs(arms[joint.name]) * np.ptp(joint.travel)
            for joint in rig.joints
            if joint.name in arms
        )
    )


def travel_of(rig: Rig, drive: str) -> float:
    """Return the turn of a motor that its joints' ranges need [rad]; of a slider, the way [m]."""
    return needed(rig, drive) / rig.drive(drive).lever


def unsure(rig: Rig, drive: str, turned: float) -> float:
    """Return the std, by the rig, of the length of tendon that a motor winds from end to end [m],
    where it has `turned` so far [rad].
    """
    part = rig.drive(drive)
    tendons = rig.tendons_of(drive)
    arms = tendons[0].arms()
    # both ends are off, each by its own error
    stds = [np.sqrt(2) * arms[j.name] * j.stops_std for j in rig.joints if j.name in arms]
    stds += [tendon.slack.total_std for tendon in tendons]
    if isinstance(part, Capstan):
        stds.append(part.radius.total_std * turned)
    return float(np.hypot.reduce(stds))


def contacts(sweeps: Sequence[Sweep], way: int) -> tuple[float, ...]:
    """Return where full sweeps in one direction met the end of the travel, or else ended [rad]."""
    return tuple(sweep.contact for sweep in sweeps[1:] if sweep.way == way)


def winds_to(rig: Rig, tendon: Tendon, sweeps: Sequence[Sweep]) -> tuple[float, float, float]:
    """Return where a tendon's motor met the end of its travel [rad], and the length that the rig
    has it wind from zero until there, less slack, with its std [m].

    An end that was not met is anywhere beyond.
    """
    lever = rig.drive(tendon.drive).lever
    arms = tendon.arms()
    joints = [joint for joint in rig.joints if joint.name in arms]
    of = [sweep for sweep in sweeps[1:] if sweep.way == tendon.winding]
    met = [sweep.contact for sweep in of if sweep.resisted]
    beyond = 0.0 if met else needed(rig, tendon.drive)
    at = np.mean(met or [sweep.contact for sweep in of]) + tendon.winding * beyond / lever
    # some part of what moves the motor stretches the tendon before the joint moves
    level = np.median([abs(sweep.level) for sweep in sweeps])
    stretch = level / lever / tendon.stiffness.value
    stops = [arms[joint.name] * joint.travel[arms[joint.name] > 0] for joint in joints]
    stds = [arms[joint.name] * joint.stops_std for joint in joints]
    std = np.hypot.reduce([*stds, stretch / np.sqrt(12), beyond])
    return float(at), float(sum(stops) + stretch / 2), float(std)


def sweep_channels_of(rig: Rig, drive: str) -> tuple[str, str]:
    """Return the names of the sensors of a drive's angle and of its torque.

    Raises:
        LogError: one of them is missing in the rig.
    """
    names = []
    for measures in ("position", "force"):
        found = [sensor.name for sensor in rig.sensors_of(measures) if sensor.of == drive]
        if not found:
            raise LogError(
                f"'{rig.name}': motor '{drive}' has no sensor of its {measures}; a calibration "
                "needs both"
            )
        names.append(found[0])
    return names[0], names[1]


def _turning(positions: Floats, travel: float) -> list[int]:
    """Return the samples at which a motor's motion begins, turns back, and ends; its joints' ranges
    need a `travel` [rad].
    """
    least = TURNED * max(float(np.ptp(positions)), travel)
    moved = np.flatnonzero(np.abs(positions - positions[0]) > least)
    if not len(moved):
        return []
    way = 1.0 if positions[moved[0]] > positions[0] else -1.0
    ends = [int(np.argmin(way * positions[: moved[0]]))]
    best = 0
    for k, position in enumerate(positions):
        if way * (position - positions[best]) > 0.0:
            best = k
        elif way * (positions[best] - position) > least:
            ends.append(best)
            way = -way
            best = k
    return [*ends, best]


def _sweep(positions: Floats, torques: Floats, end: int) -> Sweep:
    way = 1 if positions[-1] > positions[0] else -1
    known = np.isfinite(positions) & np.isfinite(torques)
    going = way * positions
    pull = way * torques
    low = float(np.nanmin(going))
    high = float(np.nanmax(going))
    first, last = (low + share * (high - low) for share in MIDDLE)
    free = pull[known & (going > first) & (going < last)]
    level = float(np.median(free)) if free.size else 0.0
    noise = float(1.48 * np.median(np.abs(free - level))) if free.size else 0.0
    last_pull = float(np.nanmedian(pull[known][-3:]))
    resisted = last_pull > RISEN * abs(level) + 6.0 * noise
    contact = high
    if resisted:
        rise = last_pull - level
        late = known & (np.arange(len(pull)) > len(pull) // 2)
        line = late & (pull > level + LOADED[0] * rise) & (pull < level + LOADED[1] * rise)
        if np.count_nonzero(line) >= 3 and np.ptp(going[line]) > 0.0:
            slope, beginning = np.polyfit(going[line], pull[line], 1)
            if slope > 0.0:
                contact = float(np.clip((level - beginning) / slope, low, high))
    return Sweep(way, end, level, noise, way * contact, resisted)
