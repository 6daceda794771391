"""The health of a stream as one function, which Python, C, the lab and FMUs share: what is wrong
with a sample.

The function remembers ages and means from sample to sample. Its limits stand here, but for those
that the filter uses too (`dead_after`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from math import degrees
from typing import Literal

import casadi as ca
import numpy as np

from distal.arrays import Floats
from distal.confidence import LARGE_PRIOR
from distal.estimators import TOUCHED, KernelEstimator
from distal.estimators.read_channels import DEAD, dead_after
from distal.expressions import Scalar, Vector
from distal.kernels import Layout
from distal.regression import MOST
from distal.rig import FAR, RangeEnd, Role, measurand_of, position_range, range_ends, step_of
from distal.run.offline import priors_of
from distal.run.redundancy import Redundancy

Health = Literal[
    "ok",
    "untested",
    "missing",
    "gap",
    "outside",
    "touched",
    "disagrees",
    "dead",
    "restarted",
    "late",
    "duplicate",
    "bad",
]

HEALTH: dict[Health, str] = {
    "ok": "all sensors were read, and are as in the logs from which the rig was learned",
    "untested": "all sensors were read and none disagrees, but no log has said what is normal, or "
    "no sensor is compared",
    "missing": "a sensor has no value for longer than its own interval; it is bridged",
    "gap": "samples are missing before this one; they are bridged",
    "outside": "a position is where none of the logs has been from which the rig was learned",
    "touched": "forces are not those of free motion: something touches a joint, or a sensor is "
    "wrong",
    "disagrees": "a sensor is not where it can be, its innovations are too large, the members of "
    "a blend differ too much, or a number of the rig left its prior: do not trust the band",
    "dead": f"a sensor has had no value, or always the same one, for {DEAD:g} s or more",
    "restarted": "the clock jumped, or the filter left all bounds: it begins anew with this sample",
    "late": "the stamp is older than the last one's; skipped, no estimate",
    "duplicate": "the stamp is the last one's; skipped, no estimate",
    "bad": "this is no sample; skipped, no estimate",
}
"""Each health word and its meaning. Where several apply, the last one in this order is reported."""

HURRIED = 1000**-0.5
"""Share of the rig's nominal interval below which the unit of time is probably wrong [1]: half way,
in logarithms, from s to ms. Source: definition.
"""

ROUNDING = 1e-9
"""Possible error of an age [s]. Source: rounding (an age is a sum of intervals)."""

NEVER = 1e30
"""An age that no sensor reaches [s], used as infinity: C has none without a header. Source:
definition (of the exported C).
"""


@dataclass(frozen=True, kw_only=True)
class HealthLimits:
    """What a `Monitor` says a word about; exported filters have the defaults.

    Args:
        longest_gap: longest time without samples, or with samples without any value, after which
            drives are taken to have gone straight to where they are read again [s]. After a longer
            one without samples, and longer than three nominal intervals, the filter begins anew.
        waiting: usual intervals without a sample after which there is a gap [1].
        overdue: a sensor's own intervals without a value after which it is missing [1].
        memory: time constant of the mean of ν²/S, and of the share of time beyond the stops [s].
        large: mean of ν²/S beyond which a sensor disagrees [1], where no log has taught what forces
            are normal.
        unknown: std beyond which the angle is not known [rad].
        lost: std above which nothing is controlled with an angle [rad].
        anywhere: std of the joint's angle where the filter begins anew [rad].
        near: distance before the end of its range from which on a joint counts as being there
            [deg].
        away: distance beyond which it has left it [deg].
    """

    longest_gap: float = 1.5
    waiting: float = 1.5
    overdue: float = 2.5
    memory: float = 1.0
    large: float = 2.5
    unknown: float = 1.0
    lost: float = 0.35
    anywhere: float = 0.5
    near: float = 2.0
    away: float = 10.0


LIMITS = HealthLimits()


@dataclass(frozen=True)
class Watch:
    """The function that judges the samples of an estimator, and the layouts of its vectors.

    Args:
        memory: layout of what is remembered. For each channel: its last value, its age, and for how
            long it has been the same. For each drive's position: the share of time beyond its
            range. For each compared sensor: the mean ν²/S. The pace of the stamps. For each of the
            `ends`, in the current visit: its furthest reading, and how far the joint was beyond it
            [deg]. Then that of the `redundancy`.
        sample: layout of the input: whether it is the first sample, dt, values and mask of the
            channels, stds of the angles, innovations, their mask and their variances, the watched
            states and their variances, and the largest probability that a joint is
            touched.
        findings: layout of the output: the code of the reported word, then 1 where a finding holds:
            gap, hurried, nothing read, untested, unknown, touched by the filter; for each position
            that predicts forces outside, for each part's forces unlike; for each
            channel dead, stuck, missing; for each position wrong; for each compared sensor large;
            for each watched state left. For each of the `ends` it is by how much the joint is
            beyond it [deg].
        placed: indices of the channels that are positions of drives.
        ends: ends of the ranges of motors whose joints have stops.
        watched: indices of the states that are parameters of the rig.
        redundancy: what positions say of forces.
        function: (memory, sample) → (memory⁺, findings).
    """

    memory: Layout
    sample: Layout
    findings: Layout
    placed: tuple[int, ...]
    ends: tuple[RangeEnd, ...]
    watched: tuple[int, ...]
    redundancy: Redundancy
    function: ca.Function


def begun(watch: Watch) -> Floats:
    """Return the memory before the first sample: means are 1, no end was visited, all else is 0."""
    memory = np.zeros(watch.memory.size)
    memory[watch.memory["ratio"]] = 1.0
    memory[watch.memory["furthest"]] = -NEVER
    return memory


def word_code(word: Health) -> int:
    """Return the position of a word in the order of `HEALTH`."""
    return list(HEALTH).index(word)


def watch_of(estimator: KernelEstimator, limits: HealthLimits = LIMITS) -> Watch:
    """Return the function that judges the samples of an estimator, with its layouts."""
    sensors = {sensor.name: sensor for sensor in estimator.rig.sensors}
    chosen = [sensors[name] for name in estimator.channels]
    interval = estimator.interval
    no_prior = np.full(len(estimator.state_names), np.nan)
    means, stds = (no_prior if prior is None else prior for prior in priors_of(estimator))
    # of a fitted rig that lacks physics, numbers stray without end; its forces are tested instead
    redundancy = Redundancy.of(estimator.rig, estimator.channels)
    is_untaught = not redundancy.maps
    tested = (stds > 0.0) & is_untaught
    watched = tuple(np.flatnonzero(np.isfinite(means) & tested).tolist())
    roles = [measurand_of(sensor).role for sensor in chosen]
    placed = tuple(i for i, role in enumerate(roles) if role is Role.POSITION)
    # of what logs taught, they say where it may be and how often it repeats itself
    taught = redundancy.positions
    ends = tuple(
        end
        for end in range_ends(estimator.rig, estimator.channels)
        if estimator.channels[end.position] not in taught
    )
    n = len(chosen)
    m = len(estimator.measured)
    j = len(estimator.rig.joints)
    k = len(watched)
    p = len(placed)
    parts = {
        "last": n,
        "age": n,
        "same": n,
        "outside": p,
        "ratio": m,
        "pace": 1,
        "furthest": len(ends),
        "found": len(ends),
    }
    memory = Layout(**parts)
    sample = Layout(
        first=1,
        dt=1,
        values=n,
        mask=n,
        stds=j,
        innovations=m,
        compared=m,
        variances=m,
        watched=k,
        watched_variances=k,
        touched=1,
    )
    findings = Layout(
        code=1,
        gap=1,
        hurried=1,
        nothing=1,
        untested=1,
        unknown=1,
        touched=1,
        outside=len(redundancy.positions),
        unlike=len(redundancy.maps),
        dead=n,
        stuck=n,
        missing=n,
        wrong=p,
        beyond=len(ends),
        large=m,
        left=k,
    )
    before = ca.SX.sym("memory", memory.size)
    current = ca.SX.sym("sample", sample.size)
    unlike = ca.SX.sym("unlike", len(redundancy.maps))
    was = memory.parts(before)
    came = sample.parts(current)
    first = came["first"]
    dt = came["dt"]
    mask = came["mask"]
    since = ca.if_else(ca.logic_and(dt > 0, dt < limits.longest_gap), dt, interval)
    share = ca.fmin(since / limits.memory, 1)
    # a sensor without a first value is missing from the beginning; a known angle, which homes,
    # never is
    overdue = _column(
        [
            NEVER if role is Role.REFERENCE else limits.overdue / s.rate
            for s, role in zip(chosen, roles)
        ]
    )
    silence = _column(
        [NEVER if role is Role.REFERENCE else dead_after(s) for s, role in zip(chosen, roles)]
    )
    age = ca.if_else(mask, 0, ca.if_else(first, 1.01 * overdue, was["age"] + dt))
    moved = ca.logic_or(first, ca.logic_and(mask, came["values"] != was["last"]))
    same = ca.if_else(moved, 0, was["same"] + dt)
    # a sensor with noise does not say the same twice for long
    noisy = _column(
        [
            s.noise > step_of(s) and role is not Role.REFERENCE and s.name not in taught
            for s, role in zip(chosen, roles)
        ]
    )
    dead = age >= silence - ROUNDING
    stuck = noisy * mask * (same >= silence - ROUNDING)
    missing = ca.logic_and(age > overdue, ca.logic_not(dead))
    low, high = (
        _column([position_range(estimator.rig, chosen[i])[end] for i in placed]) for end in (0, 1)
    )
    position = came["values"][list(placed)]
    read = mask[list(placed)]
    outside = was["outside"] + share * (
        read * ca.logic_or(position < low, position > high) - was["outside"]
    )
    far = read * (ca.fabs(position - (low + high) / 2) > FAR * (high - low))
    wrong = ca.logic_or(outside > 0.5, far)
    # a touch is no disagreement, since the filter follows it
    square = ca.fmin(came["innovations"] ** 2 / came["variances"], MOST)
    is_touched = came["touched"] > TOUCHED
    square = ca.if_else(is_touched, ca.fmin(square, 1), square)
    ratio = was["ratio"] + ca.if_else(came["compared"], share * (square - was["ratio"]), 0)
    beyond_logs = redundancy.outside(came["values"], mask)
    prior = _column(means[list(watched)])
    allowed = LARGE_PRIOR * _column(stds[list(watched)])
    left = (
        ca.fabs(came["watched"] - prior) - ca.sqrt(ca.fmax(came["watched_variances"], 0)) > allowed
    )
    # stamps of another rate than the rig's are no gaps; before the first interval the pace is 0
    usual_pace = ca.if_else(was["pace"] > 0, was["pace"], ca.fmax(dt / interval, 1))
    change = ca.fmin(dt / interval, 2 * usual_pace) - usual_pace
    pace = ca.if_else(
        first, was["pace"], usual_pace + ca.fmin(ca.fmax(dt, interval) / limits.memory, 1) * change
    )
    flags: dict[str, Vector] = {
        "gap": ca.logic_and(
            ca.logic_not(first), dt > limits.waiting * interval * ca.fmax(usual_pace, 1)
        ),
        "hurried": ca.logic_and(ca.logic_not(first), pace < HURRIED),
        "nothing": ca.logic_not(_any(mask)),
        # where no log said what is normal, innovations may be too large, but never right
        "untested": ca.SX(is_untaught),
        "unknown": ca.logic_and(ca.logic_not(first), _any(came["stds"] > limits.unknown)),
    }
    flags |= {
        "touched": is_touched * is_untaught,
        "outside": beyond_logs,
        "unlike": unlike,
        "dead": dead,
        "stuck": stuck,
        "missing": missing,
        "wrong": wrong,
        "large": (ratio > limits.large) * is_untaught,
        "left": left,
    }
    visits = [
        _at_end(end, was["furthest"][k], was["found"][k], came["values"], mask, limits)
        for k, end in enumerate(ends)
    ]
    furthest, sizes = (
        ca.vertcat(ca.SX(0, 1), *(visit[part] for visit in visits)) for part in (0, 1)
    )
    flags["beyond"] = sizes > 0
    said = {name: word for name, word in WORDS.items() if name != "beyond" or ends}
    code = reduce(ca.fmax, (word_code(word) * _any(flags[name]) for name, word in said.items()))
    last = ca.if_else(mask, came["values"], was["last"])
    remembered = memory.joined(
        last=last,
        age=age,
        same=same,
        outside=outside,
        ratio=ratio,
        pace=pace,
        furthest=furthest,
        found=sizes,
    )
    outputs = [remembered, findings.joined(code=code, **flags | {"beyond": sizes})]
    inputs = [before, current, *([unlike] if redundancy.maps else [])]
    function = redundancy.around(ca.Function("judged", inputs, ca.cse(outputs)), sample)
    memory = Layout(**parts, learned=redundancy.memory)
    return Watch(memory, sample, findings, placed, ends, watched, redundancy, function)


def _at_end(
    end: RangeEnd,
    furthest: Scalar,
    found: Scalar,
    values: Vector,
    mask: Vector,
    limits: HealthLimits,
) -> tuple[Scalar, Scalar]:
    """Return the furthest reading of this visit to an end, and how much further the joint is than
    it can be [deg], or 0.

    The stretch of the tendon by its torque is subtracted. Only readings on the way to the end
    count: on the way back friction hides the tendon's tension.
    """
    read = mask[end.position] * mask[end.torque]
    reading = end.way * values[end.position]
    before = degrees(end.joint) * (reading - end.contact)
    further = ca.logic_and(read, ca.logic_and(before > -limits.near, reading > furthest + end.same))
    over = before - degrees(end.joint * end.give) * ca.fabs(values[end.torque])
    found = ca.if_else(ca.logic_and(further, over > degrees(end.room)), ca.fmax(found, over), found)
    left = ca.logic_and(read, before < -limits.away)
    return ca.if_else(left, -NEVER, ca.if_else(further, reading, furthest)), ca.if_else(
        left, 0, found
    )


WORDS: dict[str, Health] = {
    "untested": "untested",
    "missing": "missing",
    "nothing": "missing",
    "gap": "gap",
    "outside": "outside",
    "touched": "touched",
    "unlike": "touched",
    "beyond": "disagrees",
    "hurried": "disagrees",
    "wrong": "disagrees",
    "large": "disagrees",
    "left": "disagrees",
    "unknown": "disagrees",
    "stuck": "dead",
    "dead": "dead",
}
"""Finding → the health word that reports it."""


def _column(values: Sequence[float] | Floats) -> Vector:
    return ca.DM(np.asarray(values, dtype=np.float64).reshape(-1, 1))


def _any(flags: Vector) -> Scalar:
    """Return 1 where at least one flag is set, else 0."""
    return reduce(ca.fmax, ca.vertsplit(flags), ca.SX(0)) if flags.numel() else ca.SX(0)
