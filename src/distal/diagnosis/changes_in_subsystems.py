"""Changes in independent subsystems of a rig: one run of the filter tries one change in each of
them.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import reduce
from itertools import zip_longest
from operator import and_

import numpy as np

from distal.diagnosis.rerun import ModelChange, Outcome, Rerun
from distal.estimators.adaptive.independent_subsystems import Apart


def each_apart(rerun: Rerun, changes: Sequence[ModelChange]) -> Iterator[tuple[int, Outcome]]:
    """Yield the index of each change with the outcome that it would have alone, in any order.

    Args:
        rerun: runs the filter.
        changes: to be tried.
    """
    parts = [_part_of(rerun, change) for change in changes]
    queues = dict[tuple[int, bool], list[int]]()
    runs = list[list[int]]()
    for i, (change, part) in enumerate(zip(changes, parts)):
        if part is None:
            runs.append([i])
        else:
            queues.setdefault((part, change.reads_otherwise), []).append(i)
    for otherwise in (False, True):
        alike = (queue for (_, reads), queue in queues.items() if reads is otherwise)
        runs += [[i for i in run if i is not None] for run in zip_longest(*alike)]
    while runs:
        lost = list[list[int]]()
        made = (reduce(and_, (changes[i] for i in run)) for run in runs)
        for run, outcome in zip(runs, rerun.each(made)):
            if len(run) == 1:
                yield run[0], outcome
            elif not outcome.bounded:
                lost += [[i] for i in run]
            else:
                chosen = ((i, parts[i]) for i in run)
                yield from (
                    (i, _alone(rerun.base, outcome, rerun.estimator.parts[part]))
                    for i, part in chosen
                    if part is not None
                )
        runs = lost


def _part_of(rerun: Rerun, change: ModelChange) -> int | None:
    """Return the index of the independent subsystem that a change concerns alone; None where there
    is none.
    """
    estimator = rerun.estimator
    states = [estimator.state_names.index(name) for name in change.shifts]
    parameters = [estimator.parameter_names.index(path) for path in change.parameters]
    read = {*change.channels, *change.added, *change.later, *change.exchanged}
    for k, part in enumerate(estimator.parts):
        channels = set(part.states.context.channels.names)
        if set(states) <= {*part.at} and set(parameters) <= {*part.parameters} and read <= channels:
            return k
    return None


def _alone(base: Outcome, outcome: Outcome, part: Apart) -> Outcome:
    """Return the outcome of a run as if only one subsystem had been changed."""
    columns = {
        "means": part.at,
        "variances": part.at,
        "innovations": part.compared,
        "innovation_variances": part.compared,
    }
    arrays = {}
    for name, at in columns.items():
        arrays[name] = np.array(getattr(base, name))
        arrays[name][:, at] = getattr(outcome, name)[:, at]
    return Outcome(**arrays, bounded=True)
