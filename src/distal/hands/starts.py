"""Where the search of a calibration begins: parameters of a motor and its joints that agree with
the ends of its sweeps.

A fit of friction and slack has many local minima. Contacts and slopes leave one parameter open, the
slack of a pair or the stiffness of springs. The search begins with several values of it, and the
likeliest end is taken.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from distal.hands.sweeps import Sweep
from distal.rig import Capstan, Rig, Tendon

SLACKS = (0.012, 0.03, 0.055, 0.09, 0.14, 0.21, 0.3, 0.42)
"""Slack of a pair with which searches begin, as a share of the joint's moment arm [1]: 0.7° to 24°
at the joint. Source: judgement.
"""

TENSIONS = (0.006, 0.025)
"""Stretch of a pair under tension with which searches begin, as a share of the moment arm [1].
Source: judgement.
"""

GIVE = 0.012
"""Stretch of a tendon by the joint's own friction, as a share of the moment arm [1]. Source:
judgement.
"""

SHARES = (0.6, 1.0, 1.6)
"""Factors of the springs' stiffness with which searches begin [1]. Source: judgement."""

STIFFER = 1.2
"""Stiffness of a tendon, in multiples of the one by the torque's slope at an end, where stop and
sheath give way too [1]. Source: judgement.
"""

OWN = 0.7
"""Friction of the motor itself, as a share of the torque that moves it [1]. Source: judgement."""

Start = Mapping[str, float]
"""Path → value of a parameter at the start of a search."""


def is_pair(rig: Rig, drive: str) -> bool:
    """Return whether a motor holds one joint by two tendons."""
    return len(_tendons(rig, drive)) == 2


def contacts(sweeps: Sequence[Sweep], way: int) -> tuple[float, ...]:
    """Return where full sweeps in one direction met the end of the travel, or else ended [rad]."""
    return tuple(sweep.contact for sweep in sweeps[1:] if sweep.way == way)


def pair_starts(rig: Rig, drive: str, sweeps: Sequence[Sweep], stretched: bool) -> list[Start]:
    """Return starts for a motor with a pair of tendons: for each slack that is tried, the spool
    with which the travel fits the joint's range.

    Travel between contacts · radius = arm · range + slack + stretch by the joint's friction. If
    `stretched`, the pair is under tension, and its stretch is tried instead of slack.
    """
    at = _index(rig, drive)
    tendons = _tendons(rig, drive)
    joint = next(j for j in rig.joints if j.name == tendons[0][1].joints[0])
    arm = abs(tendons[0][1].arms()[joint.name])
    (low, high) = joint.travel
    up, down = (float(np.mean(contacts(sweeps, way))) for way in (1, -1))
    level = float(np.mean([sweep.level for sweep in sweeps]))
    starts = list[Start]()
    for share in TENSIONS if stretched else SLACKS:
        play = 0.0 if stretched else share * arm
        radius = (arm * (high - low) + play + GIVE * arm) / (up - down)
        start = {
            f"drives.{at}.radius": radius,
            f"drives.{at}.friction.constant": OWN * level,
            f"{_bias(rig, drive)}": (up + down) / 2 - arm / radius * (high + low) / 2,
        }
        stiffness = tendon_stiffness(tendons[0][1], radius, sweeps)
        for k, _ in tendons:
            start[f"tendons.{k}.stiffness"] = stiffness
            if stretched:
                start[f"tendons.{k}.pretension"] = stiffness * share * arm / 2
            else:
                start[f"tendons.{k}.slack"] = play / 2
        starts.append(start)
    return starts


def single_starts(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> list[Start]:
    """Return starts for a motor with one tendon against springs: stiffness of the springs with
    which all joints close together, and factors of it.

    At the top of the travel radius · (position − zero) = Σ arm · high + stretch. In the middle of
    the ranges the springs balance the tension T of moving, k (middle − rest) = arm T.
    """
    at = _index(rig, drive)
    ((k, tendon),) = _tendons(rig, drive)
    motor = rig.drives[at]
    arms = tendon.arms()
    radius = motor.radius.value if isinstance(motor, Capstan) else 1.0
    up = float(np.mean(contacts(sweeps, 1)))
    ups, downs = ([sweep.level for sweep in sweeps if sweep.way == way] for way in (1, -1))
    # friction acts against both directions of motion, the tension against the way up only
    pull = (float(np.mean(ups)) - float(np.mean(downs))) / 2
    rub = (float(np.mean(ups)) + float(np.mean(downs))) / 2
    tension = max(pull, 0.0) / radius
    stiffness = tendon_stiffness(tendon, radius, sweeps)
    joints = [
        (i, joint)
        for i, joint in enumerate(rig.joints)
        if joint.name in arms and joint.spring is not None
    ]
    travels = {joint.name: joint.travel for joint in rig.joints}
    top = sum(arm * travels[name][1 if arm > 0 else 0] for name, arm in arms.items())
    starts = list[Start]()
    for share in SHARES:
        start = {
            f"drives.{at}.friction.constant": OWN * max(rub, 1e-4),
            f"tendons.{k}.stiffness": stiffness,
            f"{_bias(rig, drive)}": up - (top + 1.5 * tension / stiffness) / radius,
        }
        for i, joint in joints:
            assert joint.spring is not None
            middle = sum(joint.travel) / 2 - joint.spring.rest_angle.value
            held = share * abs(arms[joint.name]) * tension / max(middle, 0.1)
            start[f"joints.{i}.spring.stiffness"] = max(held, 1e-4)
        starts.append(start)
    return starts


def tendon_stiffness(tendon: Tendon, radius: float, sweeps: Sequence[Sweep]) -> float:
    """Return the stiffness of a tendon by the slope of the torque at the ends of its motor's
    travel, or else the rig's [N/m].

    Args:
        tendon: of the rig.
        radius: of the spool [m].
        sweeps: of the motor.
    """
    slopes = [sweep.slope for sweep in sweeps if sweep.slope > 0.0]
    return STIFFER * float(np.median(slopes)) / radius**2 if slopes else tendon.stiffness.value


def _index(rig: Rig, drive: str) -> int:
    return rig.drive_names.index(drive)


def _tendons(rig: Rig, drive: str) -> list[tuple[int, Tendon]]:
    return [(k, tendon) for k, tendon in enumerate(rig.tendons) if tendon.drive == drive]


def _bias(rig: Rig, drive: str) -> str:
    at = next(
        k
        for k, sensor in enumerate(rig.sensors)
        if sensor.measures == "position" and sensor.of == drive
    )
    return f"sensors.{at}.bias"
