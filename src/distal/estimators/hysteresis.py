"""Hysteresis of a drive's transmission in the displacement-driven filter: a play, its noise, and what it leaves out."""

from __future__ import annotations

from typing import Any

import casadi as ca

from distal.estimators.augmented import AugmentedState
from distal.estimators.channels import sensor_for
from distal.estimators.motion import MEMORY
from distal.model import clip_moments
from distal.sensors import variance


def revert(state: Any, covariance: Any, at: int, fade: Any, std: Any) -> None:
    """Let a state fade towards zero over an interval, in place: x⁺ = f x + noise of variance σ² (1 − f²).

    Args:
        state: (n,).
        covariance: (n, n).
        at: index of the state.
        fade: what is left of it, f.
        std: that it has in the long run, σ.
    """
    state[at] *= fade
    row = fade * covariance[at, :]
    covariance[at, :], covariance[:, at] = row, row.T
    covariance[at, at] = fade * row[at] + std**2 * (1 - fade**2)


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
    effort: Any,
    x: Any,
) -> tuple[Any, Any]:
    """Return state and covariance after what a drive transmits has followed the measured effort by its play.

    z⁺ = clip(z, U − b ṡ − h, U − b ṡ + h) of a normal z (`clip_moments`): where it is free, it and its uncertainty stay;
    where it is held at a limit, it is as certain as the limit. Noise of U does not wear it down.

    Args:
        augmented: the layout of the state.
        drive: its index.
        state: predicted, (n,).
        covariance: predicted, (n, n).
        motions: of the drives.
        speeds: of the drives, (n_drives,).
        effort: measured, smoothed; see `calmed`.
        x: the sample.
    """
    mechanism, channels = augmented.mechanism, augmented.channels
    n, at, width = len(augmented), augmented.transmitted_at[drive], len(channels.names)
    sensor = sensor_for(channels.forces, mechanism.rig.drives[drive].name)
    assert sensor is not None  # else nothing is transmitted
    k = channels.names.index(sensor.name)
    symbol = ca.SX.sym("state", n)
    places = [
        symbol[augmented.places_at[i]]
        if i in augmented.places_at
        else motions[MEMORY * i] - augmented.systematic_error(i, motions[MEMORY * i], symbol)
        for i in range(mechanism.n_drives)
    ]
    q, still, p = ca.SX.sym("q", mechanism.n_bodies), ca.SX.zeros(mechanism.n_bodies), mechanism.parameters.symbols
    limit = mechanism.hysteresis_limit(drive, q, mechanism.tensions(q, still))
    limit = ca.Function("limit", [q, p], [limit])(ca.vertcat(symbol[0], *places), augmented.model_parameters(symbol))
    given = [symbol, motions, p]
    held, slope = ca.Function("limits", given, [limit, ca.jacobian(limit, symbol)])(state, motions, p)
    effort = effort - augmented.bias(sensor.name, state)
    effort -= mechanism.dampings()[mechanism.n_joints + drive] * speeds[drive]
    share = calming(augmented, drive)
    left = share / (2 - share) * augmented.noise(sensor)
    held += CREST * ca.sqrt(left)
    std = ca.sqrt(ca.fmax(covariance[at, at], 0)) + 1e-9
    moments = clip_moments(effort - held, effort + held, state[at], std)
    row = (moments.by_high - moments.by_low) * slope
    row[0, at] += moments.by_mean
    ends = moments.by_low + moments.by_high
    if sensor.name in augmented.bias_at:
        row[0, augmented.bias_at[sensor.name]] -= ends
    there = x[1 + width + k] > 0
    following, spread = ca.SX(state), ca.SX(covariance)
    following[at] = ca.if_else(there, moments.mean, state[at])
    across = ca.mtimes(row, covariance)
    own = ca.mtimes(across, row.T) + moments.rest + ends**2 * left
    across[0, at] = own
    across = ca.if_else(there, across, covariance[at, :])
    spread[at, :], spread[:, at] = across, across.T
    return following, spread
