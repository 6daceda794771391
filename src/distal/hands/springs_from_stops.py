"""Springs against one tendon: where the torque of a motor bends says which of its joints came to
its stop.

While a finger closes, the tendon's tension T moves each joint by arm²/k along it; a joint at its
stop moves no more, and the torque grows faster. The mean of the torques on the way there and back
is free of friction, and is compared with the model at rest: T arm_j = k_j (θ_j − rest_j), within
the joints' ranges.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.optimize import OptimizeResult, least_squares

from distal.arrays import Floats
from distal.hands.sweeps import Sweep, sweep_channels_of
from distal.logs import Log
from distal.model import Mechanism
from distal.rig import Capstan, Rig

POSITIONS = 120
"""Positions along the travel at which both ways are compared."""

TENSIONS = 300
MOST = 2.0
"""Points of the model's curve, up to a tension of so many times what is measured."""

MISSED = 0.006
"""Std of what the model misses of a mean torque, as a share of the largest."""

APART = 0.4
TOGETHER = 0.8
TENDON = 0.5
"""Logarithmic stds of what is not known of a spring beside the others, of all of them, and of the
tendon's stiffness.
"""

FACTORS = (0.7, 1.0, 1.4)
"""The search begins with each spring at these times what closes all joints together."""

LIKELY = 6.0
"""A curve errs alike from position to position: an end is e times less likely where its cost is
larger by this [1].
"""

MOST_JOINTS = 4
"""Joints of a tendon: of more, a curve does not tell, and the starts of a search would be many."""

LEAST_SPREAD = 0.1
"""A spring is never better known than this, as a share."""


@dataclass(frozen=True)
class Springs:
    """Path → value of a finger's springs, its tendon's stiffness and its motor's zero, and path →
    std of the springs.
    """

    values: dict[str, float]
    stds: dict[str, float]


def springs_of(log: Log, rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> Springs | None:
    """Return the springs of a motor whose one tendon crosses joints with springs of their own; None
    of any other.
    """
    tendons = [k for k, tendon in enumerate(rig.tendons) if tendon.drive == drive]
    crossed = [
        i for i, joint in enumerate(rig.joints) if joint.name in rig.tendons[tendons[0]].arms()
    ]
    plain = all(rig.joints[i].spring is not None and rig.joints[i].coupled is None for i in crossed)
    if (
        len(rig.drives) != 1
        or len(tendons) != 1
        or not 2 <= len(crossed) <= MOST_JOINTS
        or not plain
    ):
        return None
    motor = rig.drives[0]
    assert isinstance(motor, Capstan)
    positions, torques = _both_ways(log, rig, drive, sweeps)
    if len(positions) < POSITIONS // 2 or torques.max() <= 0.0:
        return None
    paths = [*(f"joints.{i}.spring.stiffness" for i in crossed), f"tendons.{tendons[0]}.stiffness"]
    mechanism = Mechanism(rig, paths)
    position_sensor = sweep_channels_of(rig, drive)[0]
    position = rig.sensor_names.index(position_sensor)
    at = [mechanism.parameters.names.index(path) for path in paths]
    curve = _curve(mechanism, tendons[0], crossed)
    grown = np.gradient(torques, positions)
    stds = np.hypot(MISSED * torques.max(), grown * np.ptp(positions) / POSITIONS)
    guess = np.log(mechanism.parameters.values[at])

    def missed(z: Floats) -> Floats:
        parameters = mechanism.parameters.values.copy()
        parameters[at] = np.exp(z[:-1])
        reached, pulls = (np.array(part).ravel() for part in curve(largest, parameters))
        away = z[:-1] - guess
        apart = away[:-1] - away[:-1].mean()
        together = away[:-1].mean()
        fits = (np.interp(positions - z[-1], reached, pulls, left=0.0) - torques) / stds
        return np.concatenate([fits, apart / APART, [together / TOGETHER, away[-1] / TENDON]])

    largest = MOST * float(torques.max()) / motor.radius.value
    reached, pulls = (
        np.array(part).ravel() for part in curve(largest, mechanism.parameters.values)
    )
    zero = float(positions[-1] - reached[-1])  # all joints are at their stops
    middle = slice(len(positions) // 4, 3 * len(positions) // 4)
    expected = np.interp(positions[middle] - zero, reached, pulls)
    together = float(np.log(max(np.median(torques[middle] / np.maximum(expected, 1e-9)), 0.1)))

    def search(springs: Floats, *others: float) -> OptimizeResult:
        return least_squares(missed, [*springs, *others], loss="soft_l1", x_scale="jac")

    equal = guess[:-1] + together
    ends = [
        search(equal + factors, guess[-1], zero)
        for factors in itertools.product(np.log(FACTORS), repeat=len(crossed))
    ]
    best = min(ends, key=lambda end: float(end.cost)).x
    # the same bends may be those of other joints
    reach = np.log([_reach(rig, tendons[0], i) for i in crossed])
    bends = best[: len(crossed)] + reach
    ends += [
        search(np.array(order) - reach, *best[len(crossed) :])
        for order in itertools.permutations(bends)
    ]
    return _likeliest(ends, paths, f"sensors.{position}.bias")


def _likeliest(ends: Sequence[OptimizeResult], paths: Sequence[str], zero: str) -> Springs:
    """Return the likeliest end of a search, and how far from its springs the other likely ones
    are.
    """
    costs = np.array([end.cost for end in ends])
    springs = np.array([end.x[:-2] for end in ends])
    best = ends[int(np.argmin(costs))].x
    weight = np.exp(-(costs - costs.min()) / LIKELY)
    spreads = np.maximum(np.sqrt(weight @ (springs - best[:-2]) ** 2 / weight.sum()), LEAST_SPREAD)
    values = dict(zip([*paths, zero], [*np.exp(best[:-1]).tolist(), float(best[-1])]))
    return Springs(
        values, {path: float(spread) * values[path] for path, spread in zip(paths, spreads)}
    )


def _both_ways(log: Log, rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[Floats, Floats]:
    """Return positions along a motor's travel and the mean there of its torques on the way there
    and back.
    """
    position, torque = (log.channels[name] for name in sweep_channels_of(rig, drive))
    full = sweeps[1:]
    rows = np.concatenate([np.arange(s.begin, s.end + 1) for s in full if s.way > 0])
    edges = np.linspace(np.nanmin(position[rows]), np.nanmax(position[rows]), POSITIONS + 1)
    means = []
    for way in (1, -1):
        rows = np.concatenate([np.arange(s.begin, s.end + 1) for s in full if s.way == way])
        rows = rows[np.isfinite(position[rows]) & np.isfinite(torque[rows])]
        rows = rows[np.argsort(position[rows])]
        parts = np.split(torque[rows], np.searchsorted(position[rows], edges))[1:-1]
        means.append([float(np.median(part)) if part.size else np.nan for part in parts])
    both = np.mean(means, axis=0)
    middles = (edges[1:] + edges[:-1]) / 2
    known = np.isfinite(both)
    return middles[known], both[known]


def _curve(mechanism: Mechanism, tendon: int, crossed: Sequence[int]) -> ca.Function:
    """Return (largest tension, p) → positions of the drive and its torques as its tension grows to
    that, at rest.

    With the joints' springs linear: T J_j + k_j (θ_j − θ_j0) = τ_j(θ_j0), and the drive turns by
    what the joints and the stretch take, all others at the middle of their ranges.
    """
    rig = mechanism.rig
    nj = mechanism.n_joints
    p = mechanism.parameters.symbols
    largest = ca.SX.sym("largest")
    tension = ca.SX.sym("T")
    travels = [joint.travel for joint in rig.joints]
    middle = ca.DM([sum(travel) / 2 for travel in travels] + [0.0] * mechanism.n_drives)
    jacobian = mechanism.length_jacobian(middle)[tendon, :]
    springs = mechanism.passive_springs(middle)
    q = ca.SX(middle)
    for j in crossed:
        free = middle[j] + (springs[j, 0] - tension * jacobian[j]) / springs[j, 1]
        q[j] = ca.fmin(ca.fmax(free, travels[j][0]), travels[j][1])
    bodies = ca.SX.sym("q", mechanism.n_bodies)
    force = mechanism.elastic_forces(bodies)[tendon]
    at_zero, slope = ca.Function("force", [bodies, p], [force, ca.jacobian(force, bodies)[nj]])(
        q, p
    )
    position = (tension - at_zero) / slope
    point = ca.Function("point", [tension, p], [position, tension * jacobian[nj]])
    tensions = largest * ca.DM(np.linspace(0.0, 1.0, TENSIONS)).T
    reached, pulls = point.map(TENSIONS)(tensions, ca.repmat(p, 1, TENSIONS))
    return ca.Function("curve", [largest, p], [reached, pulls])


def _reach(rig: Rig, tendon: int, joint: int) -> float:
    """Return by how much more tension than stiffness a spring's joint comes to its stop, (θ −
    rest)/arm [rad/m].
    """
    part = rig.joints[joint]
    arm = rig.tendons[tendon].arms()[rig.joints[joint].name]
    assert part.spring is not None
    return max(
        abs(part.travel[1 if arm > 0 else 0] - part.spring.rest_angle.value) / abs(arm), 1e-3
    )
