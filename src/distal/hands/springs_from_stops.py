"""Springs against one tendon: the torque of a motor bends where one of its joints comes to its
stop, and these bends say how stiff each joint's spring is.

While a finger closes, a change of the tendon's tension T takes up its length by arm²/k at each
joint. A joint at its stop moves no more, and the torque grows faster. The mean of the torques of
both directions is free of friction. It is compared with the model at rest, T arm_j = k_j (θ_j −
rest_j), within the joints' ranges.
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
"""Number of positions along the travel at which the torques of both directions are compared.
Source: judgement.
"""

TENSIONS = 300
"""Number of points of the model's curve. Source: judgement."""

MOST = 2.0
"""Largest tension of the model's curve, in multiples of the largest measured one [1]. Source:
judgement.
"""

MISSED = 0.006
"""Std of a mean torque about the model's, as a share of the largest [1]. Source: judgement."""

APART = 0.4
"""Prior std of the logarithm of a spring about the mean of all springs [1]. Source: judgement."""

TOGETHER = 0.8
"""Prior std of the mean of the springs' logarithms [1]. Source: judgement."""

TENDON = 0.5
"""Prior std of the logarithm of the tendon's stiffness [1]. Source: judgement."""

FACTORS = (0.7, 1.0, 1.4)
"""Factors of each spring with which the search begins, beside springs that close all joints
together [1]. Source: judgement.
"""

LIKELY = 6.0
"""Difference in cost by which an end of the search is e times less likely [1]: it is above 1 since
errors of neighbouring positions are alike. Source: judgement.
"""

MOST_JOINTS = 4
"""Largest number of joints on a tendon: the curve does not tell more springs apart, and the search
would have many starts. Source: judgement.
"""

LEAST_SPREAD = 0.1
"""Least std of a spring, as a share [1]. Source: judgement."""


@dataclass(frozen=True)
class Springs:
    """Springs of a finger with one tendon.

    Args:
        values: path → value of the springs, the tendon's stiffness and the motor's zero.
        stds: path → std of the springs.
    """

    values: dict[str, float]
    stds: dict[str, float]


def springs_of(log: Log, rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> Springs | None:
    """Return the springs of the joints that a motor's one tendon crosses; None where they cannot be
    found so, as with pairs of tendons or coupled joints.
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
    """Return the likeliest end of the searches, with stds by how far the other likely ends are from
    it.
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
    """Return positions along a motor's travel and, at each, the mean of its torques in both
    directions.
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
    """Return the function (largest tension, p) → positions and torques of the drive at rest, as its
    tension grows up to that.

    The joints' springs are linear, T J_j + k_j (θ_j − θ_j0) = τ_j(θ_j0). The drive turns by what
    the joints and the stretch take up; all other joints are in the middle of their ranges.
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
    """Return the tension per stiffness of its spring at which a joint comes to its stop, (θ −
    rest)/arm [rad/m].
    """
    part = rig.joints[joint]
    arm = rig.tendons[tendon].arms()[rig.joints[joint].name]
    assert part.spring is not None
    return max(
        abs(part.travel[1 if arm > 0 else 0] - part.spring.rest_angle.value) / abs(arm), 1e-3
    )
