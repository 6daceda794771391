"""What a rig may lack: kinds of physics, and numbers with one value per log; each is tested on logs left out."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from distal.errors import DistalError
from distal.fitting.leave_out import Fold, leave_out
from distal.fitting.options import Options
from distal.fitting.progress import Doing, Progress
from distal.logs import Log
from distal.rig import Pulley, Rig, in_words

MOST_PROPOSALS = 3
"""At most this many are reported, best first."""

WORTH_A_WORD = 0.9
"""A change is proposed if its error on logs left out is below this share of the error without it."""

TRIED_LOGS = 2
"""This many logs (or units) are left out for each change: each costs a fit of the others."""


PLAY = {"slider": 2e-4, "capstan": 0.02}
"""Play of a drive that is tried first [m, rad]; its std is as large."""


@dataclass(frozen=True)
class Change:
    """A change that may improve a description.

    Args:
        text: the change, and how to declare it.
        values: path → what is put into the description.
        per_log: paths of which each log is to have its own.
    """

    text: str
    values: Mapping[str, object] = field(default_factory=dict)
    per_log: tuple[str, ...] = ()


@dataclass(frozen=True)
class Proposal:
    """A change that was tried and helps.

    Args:
        change: what.
        before: RMS error on logs left out without it [rad].
        after: with it [rad].
    """

    change: Change
    before: float
    after: float

    @property
    def text(self) -> str:
        """The change, and what it brings, in a sentence."""
        errors = f"{np.rad2deg(self.before):.2g}° to {np.rad2deg(self.after):.2g}°"
        return f"{self.change.text}: tried, it takes the error on logs left out from {errors}"


def changes_of(rig: Rig) -> Iterator[Change]:
    """Yield the changes to try, each applied to all parts of a kind at once.

    Args:
        rig: the description.
    """
    for kind, path in (("tendons", "path.wrap"), ("tendons", "pretension"), ("joints", "gravity.mass")):
        if any(_std_of(part, path) > 0.0 for part in getattr(rig, kind)):
            name = f"{kind}.*.{path}"
            yield Change(f"give each log its own {in_words(rig, name)} (--per-log '{name}')", per_log=(name,))
    round_pulleys = {i: t.insertion for i, t in enumerate(rig.tendons) if isinstance(t.insertion, Pulley)}
    unknown = {"value": 0.0, "std": 0.2}
    arms = {
        f"tendons.{i}.insertion": {"kind": "linkage", "radius": one.radius, "slope": unknown, "curvature": unknown}
        for i, one in round_pulleys.items()
    }
    if arms:
        yield Change("moment arms that change with the angle (insertion.kind = 'linkage', slope and curvature)", arms)
    creep = {"share": {"value": 0.1, "std": 0.1}, "time": {"value": 2.0, "std": 2.0}}
    bends = {"friction": {"value": 0.15, "std": 0.1}, "wrap": np.pi / 2}
    for key, said, values in (
        ("creep", "tendons that go on stretching under load", creep),
        ("path", "friction along the tendons' way", bends),
    ):
        lacking = {f"tendons.{i}.{key}": values for i, t in enumerate(rig.tendons) if getattr(t, key) is None}
        if lacking:
            yield Change(f"{said} ({key} of the tendons)", lacking)
    loose = {
        f"drives.{i}.backlash.width": {"value": PLAY[drive.kind], "std": PLAY[drive.kind]}
        for i, drive in enumerate(rig.drives)
        if drive.backlash is None
    }
    if loose:
        yield Change("play between the drives' sensors and their tendons (backlash of the drives)", loose)


def propose(
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    groups: Sequence[str],
    folds: Sequence[Fold],
    progress: Progress | None = None,
) -> tuple[Proposal, ...]:
    """Try each change, and return those that lower the error on logs left out, best first.

    Args:
        logs: of the fit.
        rig: the original description.
        options: of the fit.
        groups: of each log, which are left out together.
        folds: of the fit without any change.
        progress: called with the progress.
    """
    known, changes, found = {fold.left_out: fold for fold in folds}, list(changes_of(rig)), list[Proposal]()
    for tried, change in enumerate(changes):

        def shown(doing: Doing, tried: int = tried) -> None:
            if progress is not None:
                part, parts = tried * doing.parts + doing.part, len(changes) * doing.parts
                progress(replace(doing, stage=f"proposal {tried + 1} of {len(changes)}", part=part, parts=parts))

        try:
            changed = rig.with_values(change.values) if change.values else rig
            asked = replace(options, per_log=(*options.per_log, *change.per_log))
            after = leave_out(logs, changed, asked, groups, shown, TRIED_LOGS)
        except DistalError:
            continue  # the rig, with its sensors, cannot have it
        if any(fold.learned.numbers.found.interrupted for fold in after):
            break
        before = [known[fold.left_out] for fold in after]
        found.append(Proposal(change, _error(before), _error(after)))
    return best(found)


def best(tried: Sequence[Proposal]) -> tuple[Proposal, ...]:
    """Return the tried changes that help enough to be proposed, best first.

    Args:
        tried: all of them.
    """
    worth = [one for one in tried if one.after < WORTH_A_WORD * one.before]
    return tuple(sorted(worth, key=lambda one: one.after)[:MOST_PROPOSALS])


def _error(folds: Sequence[Fold]) -> float:
    """Return the mean RMS error of the fitted rigs on what was left out [rad]; infinite where one cannot run."""
    return float(np.mean([np.inf if one.fitted is None else one.fitted.rms for fold in folds for one in fold.compared]))


def _std_of(part: object, path: str) -> float:
    """Return the std of a number of a part, 0 where it has none."""
    for name in path.split("."):
        part = getattr(part, name, None)
    return float(getattr(part, "filter_std", 0.0))
