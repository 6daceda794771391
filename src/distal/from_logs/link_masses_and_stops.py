"""What a joint needs of its tendons, by least squares over all logs in which all forces are read,
less the friction of the drives. Of a joint alone it is a spring, a weight as far as a spring is
like it, damping and inertia (`joint_balance`):

    Σ r T = K (θ − θ₀) + b dθ/dt + I d²θ/dt² + f sign(dθ/dt)

Both sides are smoothed alike, since else the inertia of fast motions would come out too large.
Samples in which the joint or a drive rests are left out, since friction may then have any value.

Of joints in series it is the masses m of their links, and which way they are heavy:

    Σ r T = Σ_k m_k ∂τ/∂m_k + b dθ/dt + f sign(dθ/dt) + c₀ + c₁ sin θ + c₂ cos θ

with the masses' guess as their prior, above zero. τ is the torque on the joint that a motion of the
links needs (`distal.model`). The terms c stand for weight and for load cells that were tared. With
these masses

    Σ r T = Σ_k m_k ∂τ/∂m_k + g_x ∂τ/∂g_x + g_z ∂τ/∂g_z + b dθ/dt + f sign(dθ/dt)

gives gravity. Where an offset of each joint explains other logs better, as after cells were tared,
there is one. Links of an assumed length are only told where they explain other logs better than an
inertia I d²θ/dt² of each joint's own does.

End stops of joints: a joint turns back again and again at one angle, sharply, wherever its
drives are.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from math import inf, radians
from typing import NamedTuple

import casadi as ca
import numpy as np
from scipy.signal import find_peaks
from scipy.stats import poisson, truncnorm

from distal.arrays import Bools, Floats
from distal.from_logs.drive_and_tendon_sizes import (
    FoundJoint,
    Joints,
    torque_of,
)
from distal.from_logs.motion_data import (
    BETTER,
    CLEAR,
    WITHIN,
    Equations,
    Logs,
    MotionData,
    left_out,
    rms,
    scaled_solution,
    smoothed,
    stacked,
    window_of,
    with_errors,
)
from distal.model import Mechanism
from distal.rig import Rig

MASS = 10.0
"""Mass of a link and its standard deviation [g]. Source: judgement (plastic fingers)."""


@dataclass(frozen=True)
class Links:
    """What logs tell of links.

    Args:
        masses: index of a joint → mass of its link with its standard deviation [g].
        gravity: along x and z of the base [m/s²], by links of the assumed length; 0 where the logs
            do not show it.
    """

    masses: Mapping[int, tuple[float, float]]
    gravity: tuple[float, float]


class _Equations(NamedTuple):
    """One joint on one log, while it and its drives move: the columns of the masses, (k, n_links),
    of gravity at unit masses, (k, 2, n_links), and of the joint's own terms (`_terms`), and its
    torque, (k,), smoothed over a `window` of samples.
    """

    joint: int
    window: int
    masses: Floats
    gravity: Floats
    terms: Floats
    torques: Floats


FRICTION: Sequence[int] = (2, 4)
"""Of a joint's own terms those of damping and friction. Source: layout (`_terms`)."""

WITH_OFFSET = (*FRICTION, 1)
"""The same, with an offset. Source: layout (`_terms`)."""

WITH_WEIGHT = (*WITH_OFFSET, 5, 6)
"""The same, with a weight, by sine and cosine of the angle. Source: layout (`_terms`)."""

INERTIA = 3
"""Of a joint's own terms that of an inertia. Source: layout (`_terms`)."""


def links_of(
    rig: Rig,
    carrying: Sequence[int],
    joints: Joints,
    logs: Logs,
) -> Links | None:
    """Return what logs tell of the links, None where these do not explain other logs better than
    inertias of the joints' own do.

    Args:
        rig: the rig with guessed masses, and gravity along x and z.
        carrying: indices of the joints that have a link.
        joints: in the order of their columns.
        logs: all of them.
    """
    count = len(carrying)
    torques = _torques_of_masses(rig, [joint.name for joint in joints], carrying)
    of_logs = (_equations(log, carrying, joints, torques) for log in logs)
    parts = [part for part in of_logs if part]
    if not parts:
        return None
    rows = [equations for part in parts for equations in part]
    masses, stds = _masses(rows, count)

    def as_links(row: _Equations) -> Floats:
        return np.column_stack([row.masses, row.gravity @ (1e-3 * masses)])

    terms: Sequence[int] = FRICTION
    errors = _errors(parts, as_links, FRICTION)
    if not len(errors):
        return None
    tared = _errors(parts, as_links, WITH_OFFSET)
    if np.mean(tared / errors) < BETTER:
        terms = WITH_OFFSET
        errors = tared
    alone = _errors(parts, lambda row: row.masses[:, :0], (*terms, INERTIA))
    if not np.mean(errors / alone) < BETTER:
        return None
    matrix, target = _system(rows, as_links, terms)
    solution, spreads = with_errors(matrix, target, max(row.window for row in rows))
    x, z = solution[count : count + 2].tolist()
    is_clear = np.hypot(x, z) > CLEAR * np.max(spreads[count : count + 2])
    with_stds = zip(masses.tolist(), stds.tolist())
    return Links(dict(zip(carrying, with_stds)), (x, z) if is_clear else (0.0, 0.0))


def _masses(rows: Sequence[_Equations], count: int) -> tuple[Floats, Floats]:
    """Return the mass of each link and its standard deviation [g], (count,)."""
    matrix, target = _system(rows, lambda row: row.masses, WITH_WEIGHT)
    window = max(row.window for row in rows)
    solution, errors = with_errors(matrix, target, window, [1e-3 * MASS] * count)
    means = 1e3 * solution[:count]
    stds = 1e3 * errors[:count]
    above_zero = truncnorm(-means / stds, np.inf, means, stds)
    return above_zero.mean(), above_zero.std()


def _errors(
    parts: Sequence[Sequence[_Equations]],
    shared: Callable[[_Equations], Floats],
    terms: Sequence[int],
) -> Floats:
    """Return the RMS error of each joint's torque [N m] on logs left out, with such `shared`
    columns and own `terms`; on the logs themselves if there is only one.
    """
    errors = np.concatenate(left_out([_system(rows, shared, terms) for rows in parts]))
    joints = np.concatenate([np.full(len(r.torques), r.joint) for rows in parts for r in rows])
    return np.array([rms(errors[joints == joint]) for joint in np.unique(joints)])


def _system(
    equations: Sequence[_Equations],
    shared: Callable[[_Equations], Floats],
    terms: Sequence[int],
) -> Equations:
    """Return matrix and torques of some equations: `shared` columns, then those of each joint's
    own `terms`.
    """
    joints = sorted({of_joint.joint for of_joint in equations})
    parts = []
    for of_joint in equations:
        blocks = np.kron(np.equal(joints, of_joint.joint), of_joint.terms[:, terms])
        parts.append((np.column_stack([shared(of_joint), blocks]), of_joint.torques))
    return stacked(parts)


def _torques_of_masses(rig: Rig, names: Sequence[str], carrying: Sequence[int]) -> ca.Function:
    """Return the function (q, v, a) → (∂τ/∂m, (n_joints, n_links), without gravity; ∂²τ/∂g_x∂m and
    ∂²τ/∂g_z∂m, the same) of the links of some joints, all in the order of the joints' `names`.
    """
    mechanism = Mechanism(rig)
    assert mechanism.chain is not None
    parameters = mechanism.parameters
    q, v, a = (ca.SX.sym(name, mechanism.n_joints) for name in "qva")
    in_rig = [rig.joint_names.index(name) for name in names]
    in_logs = [names.index(name) for name in rig.joint_names]
    masses = ca.vertcat(*(parameters[f"joints.{in_rig[j]}.link.mass"] for j in carrying))
    torques = mechanism.chain.torques(q[in_logs], v[in_logs], a[in_logs])[in_rig]
    per_mass = ca.jacobian(torques, masses)
    values = ca.DM(parameters.values)
    columns = [per_mass]
    for name in ("base.gravity.0", "base.gravity.2"):
        values[parameters.index(name)] = 0.0
        slope = ca.jacobian(ca.vec(per_mass), parameters[name])
        columns.append(ca.reshape(slope, *per_mass.shape))
    numeric = ca.substitute(columns, [parameters.symbols], [values])
    return ca.Function("torques", [q, v, a], [ca.densify(column) for column in numeric])


def _equations(
    log: MotionData,
    carrying: Sequence[int],
    joints: Joints,
    torques_at: ca.Function,
) -> list[_Equations]:
    """Return the equations of each joint that carries a link, on one log; none of a short one."""
    angles = log.angles[log.is_known]
    window = max(window_of(angles[:, j], log.step, joints[j].noise) for j in carrying)
    if len(angles) < 2 * window:
        return []
    q, v, a = (smoothed(angles, window, log.step, order) for order in range(3))
    parts = torques_at.map(len(q))(q.T, v.T, a.T)
    columns = [np.array(part).reshape(q.shape[1], len(q), -1) for part in parts]
    equations = []
    for link, j in enumerate(carrying):
        terms, torques, moves = _terms(joints[j], log, log.is_known, window)
        equations.append(
            _Equations(
                joint=link,
                window=window,
                masses=columns[0][j, moves],
                gravity=np.stack([of_way[j, moves] for of_way in columns[1:]], axis=1),
                terms=terms,
                torques=torques,
            )
        )
    return equations


@dataclass(frozen=True)
class JointBalance:
    """Stiffness K [N m/rad], rest angle θ₀ [rad], damping b [N m s/rad], inertia I [kg m²] and
    friction f [N m] of a joint, 0 where the logs do not show them. The logs show that inertia is at
    most `most_inertia`, and clearly that there is a spring where `has_spring`.
    """

    stiffness: float = 0.0
    rest: float = 0.0
    damping: float = 0.0
    inertia: float = 0.0
    friction: float = 0.0
    most_inertia: float = inf
    has_spring: bool = False


def joint_balance(joint: FoundJoint, logs: Logs) -> JointBalance:
    """Return what a joint needs of its tendons, as far as the logs show it."""
    if not joint.is_read:
        return JointBalance()
    parts = []
    windows = []
    for log in logs:
        usable = np.isfinite(log.angles[:, joint.index])
        window = window_of(log.angles[usable, joint.index], log.step, joint.noise)
        if usable.sum() >= 2 * window:
            columns, values, _ = _terms(joint, log, usable, window)
            parts.append((columns[:, :5], values))
        windows.append(window)
    if sum(len(torques) for _, torques in parts) < 5:
        return JointBalance()
    matrix, torques = stacked(parts)
    coefficients, stds = with_errors(matrix, torques, max(windows))
    clear = coefficients > CLEAR * stds
    plain = scaled_solution(matrix[:, [0, 1, 4]], torques)
    stiffness, offset = (coefficients if clear[2:4].any() else plain)[:2].tolist()
    damping, inertia, friction = np.where(clear, coefficients, 0.0)[2:].tolist()
    most_inertia = float(max(coefficients[3], 0.0) + WITHIN * stds[3])
    rest = -offset / stiffness if stiffness else 0.0
    return JointBalance(stiffness, rest, damping, inertia, friction, most_inertia, bool(clear[0]))


def _terms(
    joint: FoundJoint, log: MotionData, usable: Bools, window: int
) -> tuple[Floats, Floats, Bools]:
    """Return the columns θ, 1, dθ/dt, d²θ/dt², sign(dθ/dt), sin θ and cos θ of `usable` samples
    and the torques, both smoothed over a `window`, while joint and drives move; and when that is.
    """
    angles = log.angles[usable, joint.index]
    q, v, a = (smoothed(angles, window, log.step, order) for order in range(3))
    ways = smoothed(np.sign(v), window, log.step)
    torque, moves = torque_of(joint, log)
    torques = smoothed(torque[usable], window, log.step)
    read = np.isfinite(torques) & moves[usable]
    columns = np.column_stack([q, np.ones(len(q)), v, a, ways, np.sin(q), np.cos(q)])
    return columns[read], torques[read], read


PARTED = 3.0
"""By the drives' positions, a stopped joint would have turned so many times farther apart than it
did [1]. Source: judgement (a motion that is repeated turns where its drives turn).
"""

SOFT = radians(2.0)
"""Largest difference of angles in one stop [rad]. Source: judgement (pads of rubber)."""

PROMINENCE = radians(1.0)
"""A joint turns back where it goes at least so far on both sides; a way back that is shorter ends
in the same stop [rad]. Source: judgement (above the noise of cameras).
"""

CHANCE = 1e-4
"""Probability below which turning points at one angle are not by chance [1]. Source: definition
(level of the test).
"""

BRISK = 0.6
"""Share of the speed lost around a turning point that a stop takes at once [1]. Source: benchmark
(docs/results/from-logs.md: means of 0.7 to 0.9 at stops, below 0.5 at goals that are reached
again).
"""

CLOSE = radians(0.25)
"""A joint arrives where it comes so close to its turning point [rad]. Source: judgement."""

ARRIVAL = 0.015
"""Time before and after its arrival in which a stop takes the speed of a joint away [s]. Source:
judgement.
"""

BRAKING = 0.1
"""The same for friction and goals that are reached [s]. Source: judgement."""

REST_TIMES = (0.1, 0.3)
"""Time after a turning point in which a joint that stays there rests [s]. Source: judgement."""

FEWEST_OF_TIME = 3
"""Least ratio of these times in samples, below which they tell nothing [1]. Source: judgement."""


class _Turn(NamedTuple):
    """A turning point of a joint.

    Args:
        angle: there [rad].
        by_drives: angle that a straight line of the drives' positions tells there [rad].
        settled: angle at which it then rested [rad], NaN where it went on.
        briskness: speed lost within `ARRIVAL` over that lost within `BRAKING` [1].
        side: 1 where it turned back from a larger angle, else −1.
    """

    angle: float
    by_drives: float
    settled: float
    briskness: float
    side: float


def joint_stops(joint: FoundJoint, logs: Logs) -> tuple[float, float]:
    """Return the lower and the upper stop of a joint [rad], infinite where the logs show none.

    Of n turning points on a range R, k are within w of the outermost by chance Σ e^(−λ) λ^j/j! over
    j ≥ k − 1, with λ = n w/R (Poisson). Where m of them rest within w′, that has the chance
    (w′/w)^(m−1). The share of other turning points that are as brisk is the chance of each one's
    briskness.
    """
    moving = [drive.index for drive, _ in joint.pulls]
    angles = np.concatenate([log.angles[:, joint.index] for log in logs])
    positions = np.vstack([log.positions[:, moving] for log in logs])
    finite = np.isfinite(angles)
    columns = np.column_stack([np.ones(len(angles)), positions])
    line = np.linalg.lstsq(columns[finite], angles[finite])[0]
    turns = [turn for log in logs for turn in _turns_of(log, joint.index, moving, line)]
    return _level(-1.0, turns), _level(1.0, turns)


def _level(side: float, turns: Sequence[_Turn]) -> float:
    """Return where a stop begins on one side, ±1, infinite where there is none."""
    angles, by_drives, settled, briskness, sides = np.reshape(turns, (-1, len(_Turn._fields))).T
    outward = side * angles
    on_side = np.flatnonzero(sides == side)
    order = on_side[np.argsort(-outward[on_side])]
    level = side * inf
    least = CHANCE
    for count in range(2, len(order) // 2 + 1):
        members = order[:count]
        width = float(np.ptp(outward[members]))
        parted = np.ptp(by_drives[members]) > max(PARTED * width, PROMINENCE)
        sharp = np.mean(briskness[members]) > BRISK
        if width > SOFT or not parted or not sharp:
            continue
        chance = poisson.sf(count - 2, len(order) * width / np.ptp(outward))
        rests = settled[members][np.isfinite(settled[members])]
        together = len(rests) > 1 and np.ptp(rests) < min(width, CLOSE)
        if together:
            chance *= (np.ptp(rests) / width) ** (len(rests) - 1)
        elsewhere = np.delete(briskness, members)
        as_brisk = np.sum(elsewhere >= briskness[members, None], axis=1)
        chance *= np.prod((1 + as_brisk) / (1 + len(elsewhere)))
        if chance < least:
            least = chance
            level = float(np.median(rests) if together else angles[members[-1]])
    return level


def _turns_of(log: MotionData, joint: int, drives: Sequence[int], line: Floats) -> list[_Turn]:
    """Return the turning points of a log, by the `line` of the drives' positions."""
    rows = np.flatnonzero(np.isfinite(log.angles[:, joint]))
    if len(rows) < 3:
        return []
    angle = log.angles[rows, joint]
    time = log.time[rows]
    step = float(np.median(np.diff(time)))
    near, far = (max(1, round(time_around / step)) for time_around in (ARRIVAL, BRAKING))
    if far < FEWEST_OF_TIME * near:
        return []
    begin, end = (round(time_after / step) for time_after in REST_TIMES)
    speed = np.gradient(angle, time)
    by_drives = line[0] + log.positions[rows][:, drives] @ line[1:]
    turns = []
    for side in (1.0, -1.0):
        outward = side * angle
        for turn in find_peaks(outward, prominence=PROMINENCE)[0]:
            below = np.flatnonzero(outward[:turn] < outward[turn] - CLOSE)
            arrival = below[-1] + 1 if len(below) else 0
            lost, all_lost = (
                np.ptp(speed[max(arrival - width, 0) : arrival + width + 1])
                for width in (near, far)
            )
            after = angle[turn + begin : turn + end]
            settled = np.nan
            if len(after) and np.ptp(after) < CLOSE:
                settled = float(np.median(after))
            if abs(settled - angle[turn]) > PROMINENCE:
                settled = np.nan
            brisk = lost / max(all_lost, rms(speed))
            turns.append(_Turn(angle[turn], by_drives[turn], settled, brisk, side))
    return turns
