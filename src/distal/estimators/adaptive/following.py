"""Let what moves inside the rig follow the bodies over an interval: plays are pushed by their bounds, tendons creep. (15b)

docs/adaptive.md, section 5, "What moves inside".
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from distal.estimators.adaptive.drive_tracking import Tracks
from distal.estimators.adaptive.play import CREST
from distal.estimators.adaptive.prediction import set_row
from distal.estimators.adaptive.states import StateVector
from distal.estimators.adaptive.states.inside import Played, Strained
from distal.model import clip_moments

TINY_SPREAD = 1e-12
"""Added to the spread of a place, so that its moments stay finite where it is certain [m, rad]."""


def follow(states: StateVector, state: Any, covariance: Any, transition: Any, tracks: Any, x: Any, p: Any) -> None:
    """Move everything inside to where it is at the end of an interval, in place.

    Args:
        states: the state vector.
        state: predicted, (n,).
        covariance: predicted, (n, n).
        transition: Φ, (n, n).
        tracks: of the drives.
        x: the sample.
        p: the model's parameters.
    """
    blocks = {block.name: block for block in states.blocks if isinstance(block, (Played, Strained))}
    for name in _order(states, list(blocks)):
        block = blocks[name]
        at = states.indices(block)[0]
        mean, row, rest = following_function(states, block)(state, covariance[at, at], tracks, x, p)
        across = ca.mtimes(covariance, row)
        own = ca.mtimes(row.T, across) + rest
        state[at] = mean
        set_row(covariance, at, across, own)
        transition[at, :] = ca.mtimes(row.T, transition)


def _order(states: StateVector, names: list[str]) -> list[str]:
    """Return the names in the order in which they move: points of a sheath from end to end and back."""
    mechanism, order = states.setup.mechanism, list[str]()
    still = ca.SX.zeros(mechanism.n_bodies)
    for name in names:
        kind, index, *rest = name.split(".")
        sheath = mechanism.sheath(int(index), still) if kind == "tendons" and rest[0] == "path" else None
        if sheath is None:
            order.append(name)
        elif rest[-1] == "0":
            order += [f"tendons.{index}.path.point.{k}" for k in sheath.order()]
    return order


def following_function(states: StateVector, block: Played | Strained) -> ca.Function:
    """Return (state, variance, tracks, x, p) → (mean, slopes, rest) of one number inside, at the end of an interval.

    A play: the moments of clip(z, a, b) of a normal z (`clip_moments`). A strain: the model's, with its slopes.

    Args:
        states: the state vector.
        block: which.
    """
    setup, n, nd = states.setup, len(states), states.setup.n_drives
    mechanism, nj, p = setup.mechanism, setup.n_joints, setup.mechanism.parameters.symbols
    state, own, x = ca.SX.sym("state", n), ca.SX.sym("P_z"), ca.SX.sym("x", setup.width)
    vector = ca.SX.sym("tracks", Tracks.size(nd))
    tracks, q, dt = Tracks(vector, nd), ca.SX.sym("q", mechanism.n_bodies), ca.SX.sym("dt")
    places = [states.place(i, tracks[i].place, state) for i in range(nd)]
    arguments = [ca.vertcat(state[:nj], *places), states.parameters(state), x[0]]
    at = states.indices(block)[0]
    if isinstance(block, Strained):
        crept = ca.Function("crept", [q, p, dt], [mechanism.crept(q, dt)[block.which]])(*arguments)
        outputs = [crept, ca.jacobian(crept, state).T, ca.SX(0)]
    else:
        bounds = mechanism.bounds(block.which, q)
        reached = [bounds.low, bounds.high]
        by_drives = [ca.jacobian(bound, q)[0, nj:] for bound in reached]
        low, high, *slopes = ca.Function("bounds", [q, p, dt], [*reached, *by_drives])(*arguments)
        noises = [_noise(states, i) for i in range(nd)]
        by_low, by_high = ca.jacobian(low, state), ca.jacobian(high, state)
        low -= CREST * _spread(slopes[0], noises)
        high += CREST * _spread(slopes[1], noises)
        moments = clip_moments(low, high, state[at], ca.sqrt(ca.fmax(own, 0)) + TINY_SPREAD)
        row = moments.by_low * by_low + moments.by_high * by_high
        row[0, at] += moments.by_mean
        pushed = moments.by_low * slopes[0] + moments.by_high * slopes[1]
        noise = sum((pushed[0, i] ** 2 * tracks[i].variance for i in range(nd)), ca.SX(0))
        outputs = [moments.mean, row.T, moments.rest + noise]
    symbols = [state, own, vector, x, p]
    return ca.Function("follow", symbols, ca.cse([ca.densify(entry) for entry in outputs]))


def _noise(states: StateVector, drive: int) -> Any:
    sensor = states.setup.position_sensor(drive)
    return 0 if sensor is None else states.setup.noise(sensor)


def _spread(slopes: Any, noises: list[Any]) -> Any:
    return ca.sqrt(sum((slopes[0, i] ** 2 * noise for i, noise in enumerate(noises)), ca.SX(0)))
