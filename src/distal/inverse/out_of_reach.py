"""What commands cannot do, in words: desired angles beyond stops, drives at the end of their range,
limits of force and speed, slack tendons.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from distal.arrays import Bools, Floats
from distal.inverse.setpoint_function import CommandModel
from distal.inverse.setpoint_inputs import radius_of
from distal.rounded import rounded

NEAR = float(np.deg2rad(0.1))
"""Distance from its desired angle within which a joint has reached it [rad]. Source: judgement."""

NAMED = 3
"""Number of joints that are named as not at their desired angles. Source: layout."""

TINY = 1e-9
"""Difference up to which two positions [m, rad], or two pulls [N], are equal. Source: rounding
(positions and pulls that are equal).
"""

SHARE = 1.02
"""Multiple of a limit from which on it counts as passed [1]. Source: judgement."""


def within_stops(model: CommandModel, time: Floats, desired: Floats) -> tuple[list[str], Floats]:
    """Return which desired angles lie beyond stops, in words, and the angles limited to the stops,
    (k, n_free) [rad].

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
    """
    notes = list[str]()
    held = desired.copy()
    for k, j in enumerate(model.free):
        joint = model.rig.joints[j]
        if joint.stops is None:
            continue
        held[:, k] = np.clip(desired[:, k], *joint.stops)
        beyond = np.abs(held[:, k] - desired[:, k])
        if beyond.max() > NEAR:
            low, high = np.rad2deg(joint.stops)
            notes.append(
                f"{joint.name} is wanted {rounded(np.rad2deg(beyond.max()), 3)}° beyond its "
                "stops "
                f"({low:.4g} to {high:.4g}°), "
                f"first at {time[beyond > NEAR][0]:.4g} s"
            )
    return notes, held


def not_reached(
    model: CommandModel, time: Floats, desired: Floats, reached: Floats, cut: Bools
) -> list[str]:
    """Return which joints do not reach their desired angles, in words, the farthest first.

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        desired: angles of the free joints [rad], (k, n_free).
        reached: angles that the free joints reach with what is sent [rad], (k, n_free).
        cut: where drives cannot do what the desired angles ask for, (k, n_drives).
    """
    joints = [model.rig.joints[j].name for j in model.free]
    away = np.abs(reached - desired)
    far = [k for k in np.argsort(-away.max(axis=0)) if away[:, k].max() > NEAR]
    if not far:
        return []
    each = [
        f"{joints[k]} {rounded(np.rad2deg(away[:, k].max()))}° (first at "
        f"{time[away[:, k] > NEAR][0]:.4g} s)"
        for k in far[:NAMED]
    ]
    more = f" and {len(far) - NAMED} more" if len(far) > NAMED else ""
    names = [model.rig.drives[i].name for i in np.flatnonzero(cut.any(axis=0))]
    why = (
        f"{', '.join(names)} cannot do what is wanted, which leaves joints off by up to"
        if names
        else "fewer drives than joints, these follow their springs, off by up to"
    )
    return [f"{why}: {', '.join(each)}{more}"]


def beyond(
    model: CommandModel,
    time: Floats,
    read: Mapping[str, Floats],
    kernel_states: Floats,
    least: float,
) -> list[str]:
    """Return which limits of drives are passed, and which tendons go slack, in words.

    Args:
        model: the inverse of the rig.
        time: stamps [s], (k,).
        read: part of the kernel's output, such as "forces" → its values, (k, n) each, SI.
        kernel_states: after each sample, (k, n_kernel_state).
        least: least tension of the tendons [N].
    """
    notes = []
    asked = model.kernel_state.view(kernel_states, "positions")
    for i, drive in enumerate(model.rig.drives):
        unit = "N" if drive.kind == "slider" else "N m"
        needed = read["forces"][:, i] + radius_of(drive) * read["short"][:, i]
        largest = float(np.abs(needed).max())
        if drive.limit is not None and largest > SHARE * drive.limit:
            notes.append(
                f"{drive.name} would need {largest:.3g} {unit}, its limit is "
                f"{drive.limit:.3g} {unit}"
            )
        servo = drive.servo
        fastest = float(np.abs(np.gradient(read["positions"][:, i], time)).max())
        if servo is not None and servo.fastest is not None and fastest > SHARE * servo.fastest:
            notes.append(
                f"{drive.name} would need a speed of {fastest:.3g}, it reaches "
                f"{servo.fastest:.3g}: it is late there"
            )
        cut = np.abs(asked[:, i] - read["positions"][:, i]) > TINY
        if drive.stops is not None and cut.any():
            low, high = drive.stops
            notes.append(
                f"{drive.name} would have to go beyond its range [{low:.4g}, {high:.4g}], "
                f"first at {time[cut][0]:.4g} s"
            )
    for i, tendon in enumerate(model.rig.tendons):
        slack = read["tensions"][:, i] < 0.5 * min(least, 1e-3)
        if slack.any():
            notes.append(f"tendon {tendon.name} goes slack, first at {time[slack][0]:.4g} s")
    return notes
