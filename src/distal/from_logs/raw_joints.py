"""The raw description of a joint: its start, friction, stops, what it needs of its tendons."""

from __future__ import annotations

from collections.abc import Sequence
from math import degrees

import numpy as np

from distal.from_logs.found_parts import FoundDrive, FoundJoint, pulled_both_ways, pulls_of
from distal.from_logs.joint_balance import JointBalance, joint_balance
from distal.from_logs.motion_data import MotionData
from distal.from_logs.raw_values import Raw, about, number
from distal.from_logs.stops import joint_stops
from distal.rig import Guess

NO_STOP = 4.0
"""Angle beyond the logs where a joint has a stop on one side only [rad]. Source: definition (a rig
file has both).
"""


SURE_START = 3.0
"""Logs that begin at one angle do so within this [deg]. Source: judgement."""


SCATTER = 0.5
"""Standard deviation of the first angle per range of the logs' first angles. Source: judgement."""


SPREAD = 0.2
"""Standard deviation of a spring's rest angle per distance from the logs' angles. Source:
judgement.
"""


INERTIA = 1e-5
"""Usual inertia of a joint [kg m²]. Source: judgement (a plastic phalanx of 10 g, 40 mm long)."""


LEAST_INERTIA = 1e-6
"""Least inertia of a joint that is guessed, since smaller ones need many sub-steps [kg m²]. Source:
judgement (a surgical wrist has 1 to 3).
"""


SMALLEST_INERTIA = 1e-7
"""Inertia of a joint below which the logs do not show it [kg m²]. Source: judgement."""


SMALLEST_DAMPING = 1e-6
"""Damping of a joint below which the logs do not show it [N m s/rad]. Source: judgement."""


BEFORE_START = 0.3
"""A spring rests so far before the range of its joint [rad]. Source: judgement."""


AXLE = 2.0
"""Radius of a joint's axle [mm]. Source: judgement (pins of fingers)."""


SURE_FRICTION = 0.3
"""Standard deviation of a joint's friction that logs show, as a share: that of the drives is as
little known [1]. Source: judgement.
"""


def raw_joint(
    j: int,
    joint: FoundJoint,
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
) -> Raw:
    """Return a joint.

    Args:
        j: index of the joint.
        joint: its column.
        drives: all of them.
        logs: all of them.
    """
    balance = joint_balance(j, joint.noise, pulls_of(j, drives), logs)
    raw: Raw = {"name": joint.name, "parent": "base", **_dynamics(balance)}
    if joint.follows is not None:
        return raw | {"coupled": {"joint": joint.follows, "ratio": number(joint.ratio)}}
    raw["initial"] = _initial(j, logs)
    raw["friction"] = _friction(pulls_of(j, drives), balance)
    raw |= _stops(j, drives, logs)
    spring = _spring(j, drives, logs, balance)
    return raw if spring is None else raw | {"spring": spring}


def _stops(j: int, drives: Sequence[FoundDrive], logs: Sequence[MotionData]) -> Raw:
    """Return the stops of a joint; where the logs show one, the other is far beyond them."""
    low, high = joint_stops(j, drives, logs)
    if low is None and high is None:
        return {}
    angles = np.concatenate([log.angles[:, j] for log in logs])
    ends = (
        float(np.nanmin(angles)) - NO_STOP if low is None else low,
        float(np.nanmax(angles)) + NO_STOP if high is None else high,
    )
    stops: object = [number(degrees(angle), "deg") for angle in ends]
    if low is None or high is None:
        stops = Guess(stops, f"the {'lower' if low is None else 'upper'} stop of a joint")
    return {"stops": stops, "stops_std": "0.5 deg"}


def _friction(pulls: Sequence[tuple[FoundDrive, float]], balance: JointBalance | None) -> object:
    """Return the friction of a joint on its axle. Tendons press it there; the preload is what else
    does, such as a spring.
    """
    if not pulled_both_ways(pulls):
        tension = float(np.median([drive.sizes.tension for drive, _ in pulls]))
        guess: Raw = {
            "coefficient": {"value": 0.1, "std": 0.08},
            "radius": "3 mm",
            "preload": {"value": number(tension, "N"), "std": "60 %"},
        }
        return Guess(guess, "friction of joints")
    friction: Raw = {
        "coefficient": {"value": 0.2, "std": 0.1},
        "radius": number(AXLE, "mm"),
        "preload": {"value": "1 N", "std": "1 N"},
    }
    if balance is None or balance.friction == 0.0:
        return Guess(friction, "friction of joints")
    load = sum(drive.sizes.load / drive.sizes.lever for drive, _ in pulls)
    coefficient = balance.friction / (1e-3 * AXLE * load)
    return friction | {"coefficient": about(coefficient, SURE_FRICTION)}


def _initial(j: int, logs: Sequence[MotionData]) -> Raw:
    """Return where logs begin, with how much that differs from log to log."""
    firsts = [log.angles[np.isfinite(log.angles[:, j]), j][:1] for log in logs]
    angles = np.degrees(np.concatenate(firsts))
    return {
        "value": number(float(np.mean(angles)), "deg"),
        "std": number(max(SURE_START, SCATTER * float(np.ptp(angles))), "deg"),
    }


def _dynamics(balance: JointBalance | None) -> Raw:
    """Return inertia and damping of a joint, as the logs show them or as guesses."""
    raw: Raw = {
        "inertia": Guess(number(INERTIA, "kg m^2"), "inertia of joints"),
        "damping": Guess({"value": "2e-4 N m s", "std": "80 %"}, "damping of joints"),
    }
    if balance is None:
        return raw
    if balance.inertia > SMALLEST_INERTIA:
        raw["inertia"] = about(balance.inertia, 1.0, "kg m^2")
    elif balance.most_inertia < INERTIA:
        likely = max(balance.most_inertia / 2.0, LEAST_INERTIA)
        raw["inertia"] = about(likely, 1.0, "kg m^2")
    if balance.damping > SMALLEST_DAMPING:
        raw["damping"] = about(balance.damping, 1.0, "N m s")
    return raw


def _spring(
    j: int,
    drives: Sequence[FoundDrive],
    logs: Sequence[MotionData],
    balance: JointBalance | None,
) -> object:
    """Return the spring of a joint that tendons pull one way only; None for others, at which
    tendons that stiffen would be taken for one.
    """
    pulls = pulls_of(j, drives)
    if pulled_both_ways(pulls):
        return None
    angles = np.concatenate([log.angles[:, j] for log in logs])
    low = float(np.nanmin(angles))
    high = float(np.nanmax(angles))
    side = 1.0 if pulls[0][1] > 0.0 else -1.0
    nearest, farthest = (low, high) if side > 0.0 else (high, low)
    if balance is not None and balance.stiffness > 0.0:
        rest_angle = -balance.offset / balance.stiffness
        holds = side * (nearest - rest_angle) > 0.0
        if holds:
            spread = max(SPREAD * abs(degrees(nearest - rest_angle)), 5.0)
            angle = {"value": number(degrees(rest_angle), "deg"), "std": number(spread, "deg")}
            return {"stiffness": about(balance.stiffness, 0.4, "N m/rad"), "rest_angle": angle}
    tension = float(np.median([drive.sizes.tension for drive, _ in pulls]))
    rest_angle = nearest - side * BEFORE_START
    stiffness = abs(pulls[0][1]) * tension / max(abs(farthest - rest_angle), 0.1)
    guess = {
        "stiffness": about(stiffness, 0.6, "N m/rad"),
        "rest_angle": {"value": number(degrees(rest_angle), "deg"), "std": "15 deg"},
    }
    return Guess(guess, "springs that bring joints back")
