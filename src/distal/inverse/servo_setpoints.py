"""Setpoints of servos: what a drive is sent so that, with its servo's speed limit, lag and delay,
it follows positions.
"""

from __future__ import annotations

import numpy as np
from scipy.ndimage import uniform_filter1d

from distal.arrays import Floats
from distal.rig import Capstan, Slider


def followable(time: Floats, positions: Floats, drive: Slider | Capstan) -> Floats:
    """Return a drive's positions, no faster than its servo can go, (k,).

    A jump is spread to both sides of it: the result is the mean of a rate limiter that is run
    forwards and one that is run backwards. Of the jump of a drive at a reversal, which takes up
    stretch, half comes before the joint turns.

    Args:
        time: rising stamps [s], (k,).
        positions: (k,) [m, rad].
        drive: the drive with its servo.
    """
    if drive.servo is None or drive.servo.fastest is None:
        return positions
    most = drive.servo.fastest * np.diff(time)
    forth = _rate_limited(positions, most)
    back = _rate_limited(positions[::-1], most[::-1])[::-1]
    middle: Floats = (forth + back) / 2
    return middle


def _rate_limited(positions: Floats, most: Floats) -> Floats:
    """Return positions that change by no more than `most` from each sample to the next."""
    limited = positions.copy()
    for k, step in enumerate(most):
        limited[k + 1] = min(max(positions[k + 1], limited[k] - step), limited[k] + step)
    return limited


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
    step = float(np.median(np.diff(time)))
    lag = servo.lag - servo.delay
    # a servo cannot follow a corner: corners are rounded over its lag, so that the lead stays small
    width = max(1, 2 * round(lag / step / 2) + 1)
    rounded = uniform_filter1d(followable(time, positions, drive), width, mode="nearest")
    ahead = np.interp(time + servo.delay, time, rounded)
    speed = np.interp(time + servo.delay, time, np.gradient(rounded, time))
    command: Floats = ahead + lag * speed
    return command
