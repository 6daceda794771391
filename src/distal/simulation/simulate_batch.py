"""Many simulations at once, on all cores, with runs of one plant side by side in vector lanes."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator
from pathlib import Path

import numpy as np

from distal.errors import ScenarioError
from distal.kernels import in_order, lanes_here
from distal.logs import Log
from distal.rig import Rig, as_rig
from distal.simulation.plant import PlantMotion
from distal.simulation.scenario import Scenario
from distal.simulation.simulate import Prepared, check_open, motions_of, prepare, sampled

Job = tuple[Scenario | str | Path, int]


def simulate_batch(
    rig: Rig | str | Path,
    jobs: Iterable[Job],
    workers: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> Iterator[Log]:
    """Simulate many scenarios, or one with many seeds, and yield the logs in their order. Each log
    is the one that `simulate` gives.

    The runs are taken in groups, one run for each vector lane. In a group, scenarios of one plant
    run side by side, and a scenario that comes with several seeds moves only once: the motion is
    the same, the sensors' errors differ. Only what is in work is in memory.

    Args:
        jobs: (scenario, seed) of each run; may be a generator.
        workers: number of threads; default one per core.
        progress: called with the number of runs that are done.

    Raises:
        ScenarioError: a scenario does not fit the rig, or its motion left all bounds.
        RigError: the plant's values are wrong.
    """
    rig = as_rig(rig)
    workers = (os.cpu_count() or 1) if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, (int, np.integer)) or workers < 1:
        raise ScenarioError(f"workers must be a whole number from 1, {workers!r} came")
    return _batch(rig, map(_job, jobs), int(workers), progress)


def _job(job: object) -> Job:
    if not isinstance(job, (tuple, list)) or len(job) != 2:
        raise ScenarioError(f"a job is a scenario and a seed, {job!r:.60} came")
    return job[0], job[1]


def _batch(
    rig: Rig, jobs: Iterator[Job], workers: int, progress: Callable[[int], None] | None
) -> Iterator[Log]:
    runs = in_order(jobs, lanes_here(), lambda group: _group(rig, group), workers)
    for done, (_, log) in enumerate(runs, 1):
        if progress is not None:
            progress(done)
        if isinstance(log, Exception):
            raise log
        yield log


def _group(rig: Rig, jobs: list[Job]) -> list[Log | Exception]:
    """Return the logs of some runs: there is one motion for each scenario, and those of the same
    plant are simulated side by side.

    If a job fails, its error stands in the place of its log and ends the list.
    """
    distinct: list[tuple[Scenario | str | Path, Prepared]] = []
    which: list[int] = []
    problem: Exception | None = None
    for scenario, seed in jobs:
        known = (i for i, (before, _) in enumerate(distinct) if before == scenario)
        at = next(known, len(distinct))
        try:
            if at == len(distinct):
                ready = prepare(rig, scenario, seed)
                check_open(ready.scenario)
                distinct.append((scenario, ready))
        except Exception as error:
            problem = error
            break
        which.append(at)
    motions: dict[int, PlantMotion] = {}
    plants = [(ready.plant.rig, ready.dt, ready.count) for _, ready in distinct]
    for i in range(len(distinct)):
        alike = [j for j, plant in enumerate(plants) if j not in motions and plant == plants[i]]
        if alike:
            motions.update(zip(alike, motions_of([distinct[j][1] for j in alike])))
    logs: list[Log | Exception] = [
        sampled(distinct[at][1], motions[at], seed) for at, (_, seed) in zip(which, jobs)
    ]
    return logs if problem is None else [*logs, problem]
