"""Hysteresis of a drive's transmission in the displacement-driven filter: a play, its noise, and what it leaves out."""

from __future__ import annotations

from typing import Any

import casadi as ca

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.motion import MEMORY
from distal.model import clip_moments
from distal.sensors import variance


def revert(state: Any, covariance: Any, at: int, fade: Any, added: Any) -> None:
    """Let a state fade towards zero over an interval, in place: x⁺ = f x + noise of variance σ² (1 − f²).

    Args:
        state: (n,).
        covariance: (n, n).
        at: index of the state.
        fade: what is left of it, f.
        added: σ² (1 − f²).
    """
    state[at] = fade * state[at]
    set_row(covariance, at, fade * covariance[:, at], fade * fade * covariance[at, at] + added)


def set_row(covariance: Any, at: int, row: Any, own: Any) -> None:
    """Replace a row and a column of a covariance, in place.

    Args:
        covariance: (n, n).
        at: which.
        row: the new one, (n, 1).
        own: what stands on the diagonal.
    """
    covariance[:, at] = row
    covariance[at, :] = row.T
    covariance[at, at] = own


CALM = 8.0
"""The effort that moves a play is smoothed until its noise is below this part of the play's limit."""

CREST = 2.0
"""A play is moved by the crests of the noise: its limits are wider by this many of its standard deviations."""


def calming(augmented: AugmentedState, drive: int) -> float:
    """Return the weight of a new reading of a drive's effort, 1 where its noise is small against the hysteresis.

    Args:
        augmented: the layout of the state.
        drive: its index.
    """
    sensor = sensor_for(augmented.channels.forces, augmented.mechanism.rig.drives[drive].name)
    assert sensor is not None  # else nothing is transmitted
    ratio = min((augmented.hysteresis(drive) / CALM) ** 2 / variance(sensor), 1.0)
    return max(2.0 * ratio / (1.0 + ratio), 0.02)


def calmed(augmented: AugmentedState, drive: int, remembered: Any, x: Any) -> Any:
    """Return a drive's measured effort, smoothed; 0 stands for none yet.

    Args:
        augmented: the layout of the state.
        drive: its index.
        remembered: the last one.
        x: the sample.
    """
    channels = augmented.channels
    sensor = sensor_for(channels.forces, augmented.mechanism.rig.drives[drive].name)
    assert sensor is not None  # else nothing is transmitted
    k = channels.names.index(sensor.name)
    effort = x[1 + k] - augmented.offset(sensor)
    following = remembered + calming(augmented, drive) * (effort - remembered)
    return ca.if_else(x[1 + len(channels.names) + k] > 0, ca.if_else(remembered == 0, effort, following), remembered)


def transmit(
    augmented: AugmentedState,
    drive: int,
    state: Any,
    covariance: Any,
    motions: Any,
    speeds: Any,
    remembered: Any,
    x: Any,
    p: Any,
) -> Any:
    """Let what a drive transmits follow the measured effort by its play, in place; return the effort to remember.

    z⁺ = clip(z, U − b ṡ − h, U − b ṡ + h) of a normal z (`clip_moments`): where it is free, it and its uncertainty stay;
    where it is held at a limit, it is as certain as the limit. Noise of U does not wear it down.

    Args:
        augmented: the layout of the state.
        drive: its index.
        state: predicted, (n,).
        covariance: predicted, (n, n).
        motions: of the drives.
        speeds: of the drives, (n_drives,).
        remembered: effort, smoothed; see `calmed`.
        x: the sample.
        p: the parameters.
    """
    at = augmented.transmitted_at[drive]
    play = play_function(augmented, drive)
    mean, row, rest, there, calm = play(state, covariance[at, at], motions, speeds, remembered, x, p)
    across = ca.mtimes(covariance, row)
    own = ca.mtimes(row.T, across) + rest
    state[at] = mean
    column = ca.if_else(there, across, covariance[:, at])
    set_row(covariance, at, column, ca.if_else(there, own, covariance[at, at]))
    return calm


def play_function(augmented: AugmentedState, drive: int) -> ca.Function:
    """Return (state, variance of z, motions, speeds, effort, x, p) → (z⁺, its slopes, rest, there, effort⁺) of a play.

    Args:
        augmented: the layout of the state.
        drive: its index.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    n, nd, at, width = len(augmented), mechanism.n_drives, augmented.transmitted_at[drive], len(channels.names)
    sensor = sensor_for(channels.forces, mechanism.rig.drives[drive].name)
    assert sensor is not None  # else nothing is transmitted
    k, p = channels.names.index(sensor.name), mechanism.parameters.symbols
    state, own, motions = ca.SX.sym("state", n), ca.SX.sym("P_z"), ca.SX.sym("motions", nd * (MEMORY + 1))
    speeds, remembered, x = ca.SX.sym("speeds", nd), ca.SX.sym("effort"), ca.SX.sym("x", 1 + 2 * width)
    places = [
        state[augmented.places_at[i]]
        if i in augmented.places_at
        else motions[MEMORY * i] - augmented.systematic_error(i, motions[MEMORY * i], state)
        for i in range(nd)
    ]
    q, still = ca.SX.sym("q", mechanism.n_bodies), ca.SX.zeros(mechanism.n_bodies)
    limit = mechanism.hysteresis_limit(drive, q, mechanism.tensions(q, still))
    held = ca.Function("limit", [q, p], [limit])(ca.vertcat(state[0], *places), augmented.model_parameters(state))
    slope = ca.densify(ca.jacobian(held, state))
    effort = calm = calmed(augmented, drive, remembered, x)
    effort = effort - augmented.bias(sensor.name, state)
    effort -= mechanism.dampings()[mechanism.n_joints + drive] * speeds[drive]
    share = calming(augmented, drive)
    left = share / (2 - share) * augmented.noise(sensor)
    held += CREST * ca.sqrt(left)
    std = ca.sqrt(ca.fmax(own, 0)) + 1e-9
    moments = clip_moments(effort - held, effort + held, state[at], std)
    row = (moments.by_high - moments.by_low) * slope
    row[0, at] += moments.by_mean
    ends = moments.by_low + moments.by_high
    if sensor.name in augmented.bias_at:
        row[0, augmented.bias_at[sensor.name]] -= ends
    there = x[1 + width + k] > 0
    outputs = [ca.if_else(there, moments.mean, state[at]), row.T, moments.rest + ends**2 * left, there, calm]
    arguments = [state, own, motions, speeds, remembered, x, p]
    return ca.Function("play", arguments, ca.cse([ca.densify(entry) for entry in outputs]))
