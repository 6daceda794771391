"""How well a controlled joint keeps to its reference."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from math import inf, nan

import numpy as np

from distal.arrays import Floats
from distal.control.closed_loop import ClosedLoop

SETTLED = float(np.deg2rad(2.0))
"""Largest deviation of a joint that has settled from its reference [rad]: 5 % of a step of 40°.
Source: judgement.
"""

HUNTS = float(np.deg2rad(0.3))
"""Motion above which a joint hunts although all references are constant [rad]. Source:
judgement.
"""

FOR = 2.0
"""Time over which this motion is measured, at the end of a part in which references are constant
[s]. Source: judgement.
"""

LONG_ENOUGH = 1.0
"""Shortest time for which a reference must be constant to say how a joint settles [s]. In the
search for hunting, the same time at the begin of a constant part is left out. Source: judgement.
"""


@dataclass(frozen=True)
class Tracking:
    """How one joint keeps to its reference.

    Args:
        rms: of the true angle's deviation from the reference [rad].
        overshoot: largest motion beyond a reference that has become constant, in the direction in
            which the reference came [rad]; NaN where no reference has.
        settling: longest time until the angle stays within 2° of a constant reference [s]; infinite
            where it does not, NaN where no reference is constant.
        effort: RMS of all commands [N or N m].
        estimate_rms: RMS error of the angle that the controller was told [rad].
        hunting: motions of limit cycles, by how much the angle varies although the references are
            constant [rad].
    """

    joint: str
    rms: float
    overshoot: float
    settling: float
    effort: float
    estimate_rms: float
    hunting: tuple[float, ...]


def trackings_of(run: ClosedLoop) -> tuple[Tracking, ...]:
    """Return how each controlled joint that has a reference keeps to it."""
    names = run.rig.joint_names
    effort = float(np.sqrt(np.mean([np.mean(commands**2) for commands in run.commands.values()])))
    # hunting is looked for where all references are constant: a joint that another one shakes does
    # not hunt
    still = constant_parts(run.time, *run.references.values())
    trackings = []
    for name, reference in run.references.items():
        j = names.index(name)
        angle = run.angles[:, j]
        errors = run.estimates[:, j] - run.angles[:, j]
        steps = [
            _step(run.time, reference, angle, *part) for part in constant_parts(run.time, reference)
        ]
        errors = errors[np.isfinite(errors)]
        tracking = Tracking(
            name,
            rms=float(np.sqrt(np.mean((angle - reference) ** 2))),
            overshoot=max((over for over, _ in steps), default=nan),
            settling=max((time for _, time in steps), default=nan),
            effort=effort,
            estimate_rms=float(np.sqrt(np.mean(errors**2))) if len(errors) else nan,
            hunting=_hunts(run.time, angle, still),
        )
        trackings.append(tracking)
    return tuple(trackings)


def constant_parts(time: Floats, *references: Floats) -> list[tuple[int, int]]:
    """Return (begin, end), indices with the end excluded, of the parts of `time` in which all
    `references` are constant for at least `LONG_ENOUGH`.
    """
    moves = [np.abs(np.diff(reference)) > 1e-9 for reference in references]
    changes = np.flatnonzero(np.any(moves, axis=0)) + 1
    edges = [0, *changes.tolist(), len(time)]
    return [(a, b) for a, b in pairwise(edges) if b > a and time[b - 1] - time[a] >= LONG_ENOUGH]


def _step(
    time: Floats, reference: Floats, angle: Floats, begin: int, end: int
) -> tuple[float, float]:
    """Return overshoot [rad] and settling time [s] at a constant reference; the time is infinite
    where the joint does not settle.
    """
    error = angle[begin:end] - reference[begin]
    way = np.sign(reference[begin] - (reference[begin - 1] if begin else angle[0]))
    away = np.flatnonzero(np.abs(error) > SETTLED)
    over = max(float(np.max(way * error)), 0.0)
    if not len(away):
        return over, 0.0
    last = begin + int(away[-1]) + 1
    return over, inf if last == end else float(time[last] - time[begin])


def _hunts(time: Floats, angle: Floats, rests: list[tuple[int, int]]) -> tuple[float, ...]:
    motions = []
    for begin, end in rests:
        stamps = time[begin:end]
        if stamps[-1] - stamps[0] < FOR - 1.5 * (stamps[1] - stamps[0]):
            continue
        # the first second belongs to the motion before
        late = stamps >= max(stamps[-1] - FOR, stamps[0] + LONG_ENOUGH)
        motions.append(float(np.ptp(angle[begin:end][late])))
    return tuple(motion for motion in motions if motion > HUNTS)
