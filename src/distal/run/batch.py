"""Estimates over many logs: on all cores, several runs side by side in vector lanes, with only the
current logs in memory.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

import numpy as np

from distal.errors import DistalError, EstimationError
from distal.estimators import KernelEstimator
from distal.homing.reference import check_homing
from distal.kernels import in_order
from distal.logs import Episode, Log, Source, read_log
from distal.parallel import one_blas_thread
from distal.results import Estimate
from distal.rig import Rig, as_rig
from distal.run.offline import Run, estimator_for, prepared, without_covariances

Skip = Callable[[str, DistalError], None]
Input = TypeVar("Input")
Output = TypeVar("Output")


def estimate_batch(
    logs: Iterable[Log | Source],
    rig: Rig | str | Path,
    estimator: str | KernelEstimator | None = None,
    truth: str | Path | None = None,
    homing: float | None = None,
    *,
    workers: int | None = None,
    compiled: bool = True,
    progress: Callable[[int], None] | None = None,
    skip: Skip | None = None,
) -> Iterator[Estimate]:
    """Estimate the joint angle over many logs; yield the estimates in order, with the same values
    as `estimate`.

    Several runs go through the compiled kernel side by side, one in each vector lane, on all cores.
    Logs are read when their turn comes, and only the current ones are in memory; covariances are
    not kept (`Estimate.covariances` is None). Arguments that `estimate` has too mean the same
    there.

    Args:
        logs: each as `estimate` takes it; may be a generator.
        truth: column of the true angle, where logs are read.
        homing: for how long the true angle is used as a reference [s].
        workers: number of threads; default one per core.
        progress: called with the number of logs that are done.
        skip: called with source and error of a log that cannot be estimated; with None the error is
            raised.

    Raises:
        EstimationError: a log lacks a sensor, or the estimator cannot run on this rig.
        LogError: a file cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = as_rig(rig)
    workers = (os.cpu_count() or 1) if workers is None else workers
    if isinstance(workers, bool) or not isinstance(workers, (int, np.integer)) or workers < 1:
        raise EstimationError(f"workers must be a whole number from 1, {workers!r} came")
    if isinstance(logs, (Log, str, Path)) or not isinstance(logs, Iterable):
        raise EstimationError("estimate_batch takes several logs; for one there is estimate")

    def load(source: Log | Source) -> Log:
        return source if isinstance(source, Log) else read_log(source, rig, truth)

    def refuse(source: Log | Source, problem: DistalError) -> None:
        if skip is None:
            raise problem
        skip(_named(source), problem)

    def estimates(sources: Iterator[Log | Source]) -> Iterator[Estimate]:
        done = count(1)
        report = progress or (lambda _: None)
        for source in sources:  # the first that can be estimated says how a reference is read
            try:
                first = load(source)
                if homing is not None:
                    check_homing(homing, first, rig.joint_names)
            except DistalError as problem:
                report(next(done))
                refuse(source, problem)
                continue
            chosen = estimator_for(first, rig, estimator, compiled, homing)
            break
        else:
            return

        @one_blas_thread()
        def work(sources: Sequence[Log | Source]) -> list[Estimate | DistalError]:
            runs = [
                _attempt(lambda source: prepared(load(source), chosen, homing), source)
                for source in sources
            ]
            answers = iter(run_all([run for run in runs if isinstance(run, Run)]))
            return [run if isinstance(run, DistalError) else next(answers) for run in runs]

        for source, outcome in in_order(
            chain([first], sources), _side_by_side(chosen), work, workers
        ):
            report(next(done))
            if isinstance(outcome, Estimate):
                yield outcome
            else:
                refuse(source, outcome)

    return estimates(iter(logs))


def _side_by_side(chosen: KernelEstimator) -> int:
    """Return how many runs of an estimator go side by side."""
    return chosen.kernel.side_by_side if chosen.has_kernel else 1


def _named(source: Log | Source) -> str:
    return (
        source.source
        if isinstance(source, Log)
        else str(source)
        if isinstance(source, (str, Path, Episode))
        else "the frame"
    )


def _attempt(function: Callable[[Input], Output], argument: Input) -> Output | DistalError:
    """Return what a function returns, or the error that it raises."""
    try:
        return function(argument)
    except DistalError as problem:
        return problem


def run_all(runs: Sequence[Run]) -> list[Estimate | DistalError]:
    """Return the estimates of some runs of one estimator, or the error of each that has none.

    Runs go side by side where there are vector lanes for that.

    Args:
        runs: at most as many as there are lanes.
    """
    if not runs:
        return []
    chosen = runs[0].estimator
    kernels = {id(run.estimator.kernel) for run in runs if run.estimator.has_kernel}
    # a homing move may give a run another kernel (`with_straight_line`)
    if len(runs) == 1 or len(kernels) > 1 or _side_by_side(chosen) == 1:
        return [_attempt(without_covariances, run) for run in runs]
    try:
        # a homing move gives each run parameters of its own
        found = chosen.scan_all(
            [run.start for run in runs],
            [run.log.time for run in runs],
            [run.samples for run in runs],
            [run.estimator.parameters for run in runs],
        )
    except DistalError:
        return [_attempt(without_covariances, run) for run in runs]
    return [
        _attempt(
            lambda pair: without_covariances(*pair), (run, [chosen.reported(*moments, run.samples)])
        )
        for run, moments in zip(runs, found)
    ]
