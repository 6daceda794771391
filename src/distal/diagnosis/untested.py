"""What the sensors of a log cannot test, in at most three groups: scales of positions, scales of
forces, and zeros.

Gear, spool, unit and moment arm of a drive are one scale between its position and its joint.
Stiffness and the scale of the force are one scale between its pull and its stretch. Zero and
pre-tension both shift the position. Nothing proximal tells the members of a group apart. A group is
named if a change of it contradicts nothing and moves an angle by more than half of its band in a
tenth of the samples.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import zip_longest

import numpy as np

from distal.confidence import BAND
from distal.diagnosis import finding_texts as texts
from distal.diagnosis.changes_in_subsystems import each_apart
from distal.diagnosis.finding import Finding, Kind
from distal.diagnosis.rerun import ModelChange, Outcome, Rerun
from distal.diagnosis.what_if import contradictions

FACTORS = (0.5, 0.67, 0.9, 1.1, 1.5, 2.0)
"""Factors on scales that are tried [1]; a scale in the rig that is wrong by one of them is right
with its inverse. Source: judgement.
"""

GROSS = (-1.0, 57.3, 1 / 57.3)
"""Further factors on channels that are tried [1]: a wrong sign, and degrees for radians; where
these are noticed, larger ones are too. Source: definition (degrees per radian).
"""

ZERO = 0.1
"""Shift of a position that is tried, as a share of its range in the log [1]. Source: judgement."""

SHARE = 0.5
"""Motion of an angle by a change, as a share of its band, above which a sample counts as moved [1].
Source: judgement.
"""

OFTEN = 0.1
"""Share of samples in which a change has to move an angle so that it counts [1]. Source: judgement.
"""


def untestable(rerun: Rerun) -> list[Finding]:
    """Return the groups of parameters that cannot be tested, each with the drives of which that is
    so.
    """
    of_base = contradictions(rerun, rerun.base)
    drives = rerun.estimator.rig.drive_names
    found: dict[str, list[str]] = {}
    kinds: dict[tuple[str, tuple[str, ...]], list[ModelChange]] = {}
    for group, concerned, change in _changes(rerun):
        kinds.setdefault((group, concerned), []).append(change)
        found.setdefault(group, [])
    # the first change of each kind is run, then the second, unless its group is named by then
    for changes in zip_longest(*kinds.values()):
        tried = [
            (group, concerned, change)
            for (group, concerned), change in zip(kinds, changes)
            if change is not None and not set(concerned) <= set(found[group])
        ]
        for i, outcome in each_apart(rerun, [change for _, _, change in tried]):
            group, concerned, _ = tried[i]
            if _unseen(rerun, outcome, of_base):
                found[group] += [drive for drive in concerned if drive not in found[group]]
    groups = {group: named for group, named in found.items() if named}
    return [
        texts.cannot_be_tested(f"{group} of {_listed(named, drives)}")
        for group, named in groups.items()
    ]


def _listed(named: Sequence[str], drives: Sequence[str]) -> str:
    if len(named) == len(drives) > 1:
        return "all drives"
    return ", ".join(sorted(named, key=drives.index))


def _changes(rerun: Rerun) -> Iterator[tuple[str, tuple[str, ...], ModelChange]]:
    """Yield a group, the drives that a change concerns (one or all), and the change."""
    estimator = rerun.estimator
    rig = estimator.rig
    channels = estimator.channels
    arms = dict[str, list[str]]()
    springs = dict[str, list[str]]()
    for i, tendon in enumerate(rig.tendons):
        paths = [f"tendons.{i}.{at}.radius" for at, _ in tendon.shapes()]
        arms.setdefault(tendon.drive, []).extend(
            path for path in paths if path in estimator.parameter_names
        )
        path = f"tendons.{i}.stiffness"
        springs.setdefault(tendon.drive, []).extend(
            [path] if path in estimator.parameter_names else []
        )
    for drive in rig.drives:
        read = {
            s.measures: s.name for s in rig.sensors if s.of == drive.name and s.name in channels
        }
        position = read.get("position")
        force = read.get("force")
        for factor in (*FACTORS, *GROSS) if position is not None else ():
            yield texts.SCALE, (drive.name,), ModelChange(channels={str(position): factor})
        for factor in FACTORS:
            for path in arms.get(drive.name, ()):
                yield texts.SCALE, (drive.name,), ModelChange(parameters={path: factor})
        for factor in (*FACTORS, *GROSS) if force is not None else ():
            yield texts.COMPLIANCE, (drive.name,), ModelChange(channels={str(force): factor})
        for factor in FACTORS if springs.get(drive.name) else ():
            yield (
                texts.COMPLIANCE,
                (drive.name,),
                ModelChange(parameters=dict.fromkeys(springs[drive.name], factor)),
            )
        for sign in (1.0, -1.0) if position is not None else ():
            shift = sign * ZERO * rerun.covered(str(position))
            yield texts.ZERO, (drive.name,), ModelChange(added={str(position): shift})
    for group, paths_of in ((texts.SCALE, arms), (texts.COMPLIANCE, springs)):
        together = [path for paths in paths_of.values() for path in paths]
        for factor in FACTORS if together else ():
            yield (
                group,
                tuple(rig.drive_names),
                ModelChange(parameters=dict.fromkeys(together, factor)),
            )


def _unseen(rerun: Rerun, outcome: Outcome, base_contradictions: set[tuple[Kind, str]]) -> bool:
    """Return whether a change moved an angle by a good share of its band, and contradicts nothing
    new.
    """
    base = rerun.base
    joints = len(rerun.estimator.rig.joints)
    if not outcome.bounded:
        return False
    moved = np.abs(outcome.means - base.means)[:, :joints] > SHARE * BAND * np.sqrt(
        base.variances[:, :joints]
    )
    if np.all(moved.mean(axis=0) <= OFTEN):
        return False
    if base.squares.size:
        compared = np.isfinite(base.squares) & np.isfinite(outcome.squares)
        if compared.sum() < 0.5 * np.isfinite(base.squares).sum():
            return False
    return contradictions(rerun, outcome) <= base_contradictions
