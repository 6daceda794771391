"""What these sensors cannot test, and a band that hangs on where the filter began: both by running it again."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.diagnosis import sentences
from distal.diagnosis.finding import Finding, Kind
from distal.diagnosis.of_estimate import diagnose_estimate
from distal.diagnosis.rerun import Change, Outcome, Rerun
from distal.estimators import AdaptiveFilter, StateKind, state_units
from distal.logs import Log
from distal.results import Estimate
from distal.rig import REFERENCES, Rig, in_words, named
from distal.run.offline import runner_for

UNMOVED = 0.1
"""Change of the mean ν²/S of every channel below which a change of the rig is not seen."""

ARM = 0.2
"""Change of a moment arm, a capstan's radius or a pretension that is tried, where 3 standard deviations are less."""

STIFF = 3.0
"""Factor on the stiffness that is tried."""

TURNS = 57.3
"""Factor on a sensor's scale that is tried: degrees for radians; larger ones are seen where this one is."""

GEAR = 10.0
"""Ratio of a gear that is tried, on a capstan's angle and torque."""

START_FORGOTTEN = 0.5
"""The first moments of a log, in which a start is forgotten, do not count [s]."""

HANGS = 1.1
"""Spread of the angle over starts drawn from the prior, in its standard deviations, that is too much.

Of a filter that is right it is at most 1: the posterior covariance is what the prior leaves plus what noise adds. On random
rigs with more than 90 % inside it is mostly 0.3 to 1.1, on those with less than half inside 1.2 to 6.
"""


def cannot_test(log: Log, rig: Rig, homing: float | None = None, compiled: bool = True) -> tuple[Finding, ...]:
    """Return what the sensors of a log cannot test: changes of the rig that move the angle but no innovation.

    Each moment arm, capstan, pretension, stiffness, each sensor's sign and scale, and the joint's direction is changed,
    the filter is run again, and the change is named where mean ν²/S of all channels moves by less than `UNMOVED`, no new
    finding contradicts, and the angle moves by more than its 95 % band. The truth is used for `homing` [s].

    Raises:
        EstimationError: the filter cannot run on this rig or log.
    """
    runner = runner_for(log, rig, "adaptive", compiled, homing)
    assert isinstance(runner, AdaptiveFilter)
    return tuple(untestable(Rerun(log, runner, homing)))


def untestable(rerun: Rerun) -> list[Finding]:
    """Return what cannot be tested, see `cannot_test`."""
    of_base = contradictions(rerun, rerun.base)
    return [
        sentences.cannot_test(subject)
        for subject, changes in _suspects(rerun)
        if any(_unseen(rerun, rerun(change), of_base) for change in changes)
    ]


def overconfidence(rerun: Rerun) -> list[Finding]:
    """Return whether the angle hangs on where the filter began by more than its band says, and on which numbers.

    Each state that has a prior begins one of its standard deviations above, then below. By linearity the root of the sum
    of squares of what that moves the angle by is the spread of estimates over starts drawn from the prior, which is part
    of the posterior's standard deviation. A start that the log itself rejects counts by its likelihood, min(1, p/p_0).
    """
    runner, base = rerun.runner, rerun.base
    states = runner.states
    joints = len(runner.rig.joints)
    time = rerun.log.time
    settled = time >= time[0] + min(START_FORGOTTEN, 0.1 * float(np.ptp(time)))
    width = np.mean(base.variances[settled, :joints], axis=0)
    moved: dict[str, Floats] = {}
    angles = {name for name, kind in zip(runner.state_names, runner.state_kinds) if kind is StateKind.ANGLE}
    for i, name in enumerate(runner.state_names):
        if states.stds[i] > 0.0 and (states.lasting[i] or name in angles):
            moved[name] = np.zeros(joints)
            for sign in (1.0, -1.0):
                away = rerun(Change(shifts={name: sign * float(states.stds[i])}))
                shift = (away.means - base.means)[settled, :joints]
                if away.bounded:
                    weight = float(np.exp(min(0.0, away.log_likelihood - base.log_likelihood)))
                    moved[name] += 0.5 * weight * np.mean(shift**2, axis=0) / width
    if not moved:
        return []
    total = np.sum(list(moved.values()), axis=0)
    worst = int(np.argmax(total))
    spread = float(np.sqrt(total[worst]))
    if spread <= HANGS:
        return []
    most = max(moved, key=lambda name: float(moved[name][worst]))
    return [sentences.hangs_on_the_start(most, spread, is_angle=most in angles)]


def _suspects(rerun: Rerun) -> Iterator[tuple[str, list[Change]]]:
    """Return what may be wrong, by name, and the changes that stand for it."""
    rig, runner = rerun.runner.rig, rerun.runner
    arms = [f"tendons.{i}.{at}.radius" for i, tendon in enumerate(rig.tendons) for at, _ in tendon.shapes()]
    for path in arms:
        yield in_words(rig, path), _numbers(rerun, [path], 1 - ARM, 1 + ARM)
    if len(arms) > 1:
        yield "all moment arms", _numbers(rerun, arms, 1 - ARM, 1 + ARM)
    for i, drive in enumerate(rig.drives):
        if drive.kind == "capstan":
            path = f"drives.{i}.radius"
            yield in_words(rig, path), _numbers(rerun, [path], 1 - ARM, 1 + ARM)
            sensors = {sensor.measures: sensor.name for sensor in rig.sensors if sensor.of == drive.name}
            pair = {sensors[kind]: power for kind, power in (("position", 1), ("force", -1)) if kind in sensors}
            if set(pair) <= set(runner.channels):
                changes = [Change(channels={k: factor**v for k, v in pair.items()}) for factor in (GEAR, 1 / GEAR)]
                yield f"gear of {drive.name}", changes
    for i, tendon in enumerate(rig.tendons):
        if tendon.pretension.value > 0.0:
            path = f"tendons.{i}.pretension"
            yield in_words(rig, path), _numbers(rerun, [path], 1 - ARM, 1 + ARM)
    springs = [f"tendons.{i}.stiffness" for i in range(len(rig.tendons))]
    yield in_words(rig, *springs), _numbers(rerun, springs, 1 / STIFF, STIFF)
    for sensor in rig.sensors:
        if sensor.name in runner.channels and sensor.measures not in REFERENCES:
            yield f"sign of {sensor.name}", [Change(channels={sensor.name: -1.0})]
            yield f"scale of {sensor.name}", [Change(channels={sensor.name: f}) for f in (TURNS, 1 / TURNS)]


def _numbers(rerun: Rerun, paths: list[str], *factors: float) -> list[Change]:
    """Return changes of numbers of the rig by a factor, of states by as much or by 3 stds."""
    runner, states = rerun.runner, rerun.runner.states
    changes = []
    for factor in factors:
        numbers, shifts = dict[str, float](), dict[str, float]()
        for path in paths:
            part = named(runner.rig, path)
            if part in runner.state_parts:
                i = runner.state_parts.index(part)
                by = max(abs(factor - 1) * abs(float(states.means[i])), 3 * float(states.stds[i]))
                shifts[runner.state_names[i]] = by if factor > 1 else -by
            elif path in runner.parameter_names:
                # where its factor is a state, the number beneath it is moved, and the state would have to undo it
                numbers[path] = factor
        changes.append(Change(numbers=numbers, shifts=shifts))
    return changes


def _unseen(rerun: Rerun, outcome: Outcome, base_contradictions: set[tuple[Kind, str]]) -> bool:
    """Return whether a change moved the angle by more than its band, and nothing that is measured."""
    base, joints = rerun.base, len(rerun.runner.rig.joints)
    if not outcome.bounded:
        return False
    moved = np.sqrt(np.mean((outcome.means - base.means)[:, :joints] ** 2))
    if moved <= BAND * np.sqrt(np.mean(base.variances[:, :joints])):
        return False
    if base.squares.size:
        compared = np.isfinite(base.squares) & np.isfinite(outcome.squares)
        if compared.sum() < 0.5 * np.isfinite(base.squares).sum():
            return False
        change = np.where(compared, outcome.squares - base.squares, 0.0).sum(axis=0)
        if np.max(np.abs(change / np.maximum(compared.sum(axis=0), 1))) >= UNMOVED:
            return False
    return contradictions(rerun, outcome) <= base_contradictions


def contradictions(rerun: Rerun, outcome: Outcome) -> set[tuple[Kind, str]]:
    """Return kind and subject of what contradicts in a run."""
    findings = diagnose_estimate(as_estimate(rerun, outcome)).findings
    return {(finding.kind, finding.subject) for finding in findings if finding.contradicts}


def as_estimate(rerun: Rerun, outcome: Outcome) -> Estimate:
    """Return what a run gave as an estimate without a truth."""
    runner = rerun.runner
    lasting = runner.states.lasting
    return Estimate(
        runner.name,
        runner.rig.name,
        rerun.log.time,
        runner.state_names,
        outcome.means,
        outcome.variances,
        runner.measured,
        outcome.innovations,
        outcome.innovation_variances,
        joint_names=tuple(joint.name for joint in runner.rig.joints),
        prior_means=np.where(lasting, runner.states.means, np.nan),
        prior_stds=np.where(lasting, runner.states.stds, np.nan),
        state_kinds=runner.state_kinds,
        state_parts=runner.state_parts,
        state_units=state_units(runner),
    )
