"""Setpoints of drives that follow positions: they make up for the speed limit, lag, delay and
compliance of the servos.
"""

from __future__ import annotations

from math import inf, pi

import numpy as np
from scipy.ndimage import uniform_filter1d

from distal.arrays import Floats
from distal.rig import Capstan, Rig, Slider


def followable(time: Floats, positions: Floats, fastest: float) -> Floats:
    """Return a drive's positions, limited to a speed of `fastest`, (k,).

    A jump is spread to both sides of it: the result is the mean of a rate limiter that is run
    forwards and one that is run backwards. Of the jump of a drive at a reversal, which takes up
    stretch, half comes before the joint turns.

    Args:
        time: rising stamps [s], (k,).
        positions: (k,) [m, rad].
        fastest: [m/s, rad/s].
    """
    if fastest == inf:
        return positions
    forth = positions.copy()
    back = positions.copy()
    most = fastest * np.diff(time)
    for k in range(1, len(time)):
        forth[k] = min(max(positions[k], forth[k - 1] - most[k - 1]), forth[k - 1] + most[k - 1])
        i = len(time) - 1 - k
        back[i] = min(max(positions[i], back[i + 1] - most[i]), back[i + 1] + most[i])
    middle: Floats = (forth + back) / 2
    return middle


def sent(time: Floats, positions: Floats, drive: Slider | Capstan) -> Floats:
    """Return the setpoints u(t) = s(t + T) + ds/dt(t + T)/(2π f) of a drive that follows positions,
    (k,).

    Its servo has the bandwidth f and the delay T. Without a servo in the rig the positions s are
    sent as they are.

    Args:
        time: rising stamps [s], (k,).
        positions: s, (k,) [m, rad].
        drive: the drive with its servo.
    """
    servo = drive.servo
    if servo is None:
        return positions
    desired = followable(time, positions, inf if servo.fastest is None else servo.fastest)
    step = float(np.median(np.diff(time)))
    lag = 0.0 if servo.bandwidth is None else 1.0 / (2 * pi * servo.bandwidth)
    # a servo cannot follow a corner: corners are rounded over its lag, so that the lead stays small
    rounded = uniform_filter1d(desired, max(1, 2 * round(lag / step / 2) + 1), mode="nearest")
    ahead = np.interp(time + servo.delay, time, rounded)
    speed = np.interp(time + servo.delay, time, np.gradient(rounded, time))
    command: Floats = ahead + lag * speed
    return command


def gives_way(rig: Rig) -> tuple[Floats, Floats]:
    """Return by how much setpoints are shifted because servos give way, (n_drives,) each: per force
    [rad/(N m), m/N], and in the direction of the last motion [rad, m].

    A servo of stiffness K and dead band δ, with the force F and the direction d, is at s = u − F/K
    − δ d.
    """
    servos = [drive.servo for drive in rig.drives]
    soft = [0.0 if s is None or s.stiffness is None else 1.0 / s.stiffness for s in servos]
    dead = [0.0 if s is None else s.dead_band for s in servos]
    return np.array(soft), np.array(dead)
