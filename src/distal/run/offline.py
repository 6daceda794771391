"""Run an estimator over a whole log, or over many: on all cores, several runs side by side in
vector lanes, with only the current logs in memory; and a fixed-interval smoother, whose
estimates use the samples after them too.
"""

from __future__ import annotations

import os
import warnings
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import chain, count
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Floats
from distal.errors import DistalError, DistalWarning, DivergedError, EstimationError
from distal.estimators import (
    LARGEST_ANGLE,
    WILD,
    AdaptiveFilter,
    KernelEstimator,
    RegressionEstimator,
    StateKind,
    make_estimator,
    state_units,
    usual_estimator,
)
from distal.homing import Run, check_homing, home, homed, with_prior_maps, with_references
from distal.kernels import AT_ONCE, Feed, advance, covariance_of, in_order, mean_of, variances_of
from distal.logs import (
    LARGEST_READING,
    Episode,
    Log,
    Source,
    frozen,
    read_log,
    true_angles,
    true_torques,
)
from distal.logs.log import sealed
from distal.machine_limits import one_blas_thread
from distal.results import Estimate
from distal.rig import Rig, as_rig
from distal.run.exchanged_or_late import Redundancy


def samples_of(
    log: Log, channels: Sequence[str], name: str = "estimator", needed: int | None = None
) -> Floats:
    """Return the values of some channels of a log, (k, n_channels), wild ones taken as missing.

    Args:
        needed: number of leading channels that must have values; None: all of them.

    Raises:
        EstimationError: a channel is not in the log, or is needed and has no value at all, or the
            log has fewer than two samples.
    """
    if len(log) < 2:
        raise EstimationError(
            f"{log.source}: {len(log)} sample came; an estimate over time needs at least two"
        )
    for k, channel in enumerate(channels):
        if channel not in log.channels:
            names = ", ".join(log.channels) or "none"
            raise EstimationError(
                f"{log.source}: {name} needs the sensor '{channel}', which is not in the log (it "
                f"has {names})"
            )
        is_needed = needed is None or k < needed
        if is_needed and not np.any(np.isfinite(log.channels[channel])):
            raise EstimationError(
                f"{log.source}: sensor '{channel}' has no value at all; remove it from the rig, "
                "or mend the log"
            )
    samples = np.column_stack([log.channels[channel] for channel in channels])
    wild = np.abs(samples) > LARGEST_READING
    for channel, rows in zip(channels, wild.T):
        if rows.any():
            warnings.warn(
                f"{log.source}: sensor '{channel}' has {int(rows.sum())} wild "
                f"value{'s' if rows.sum() > 1 else ''}, the "
                f"first at {log.time[rows.argmax()]:g} s, taken as missing ({WILD})",
                DistalWarning,
                stacklevel=3,
            )
    samples[wild] = np.nan
    return samples


def estimate(
    log: Log | Source,
    rig: Rig | str | Path,
    estimator: str | KernelEstimator | None = None,
    truth: str | Path | None = None,
    *,
    compiled: bool = True,
    homing: float | None = None,
    covariances: bool = True,
    every: bool = True,
) -> Estimate:
    """Estimate the joint angle over a log.

    The belief before the first sample is `KernelEstimator.initial` with the first value of each
    channel.

    Args:
        log: values of sensors over time: a `Log`, the path of a file, or a polars or pandas frame
            (see `read_log`).
        rig: the description, or a shipped rig's name, or a path.
        estimator: a name (see `ESTIMATORS`), or one from `make_estimator`; None: the rig's usual
            one.
        truth: column or file of the true angle, if `log` is not a `Log`.
        compiled: compile kernels where possible.
        homing: for how long the true angle is used as a reference [s]; afterwards the estimate is
            only compared with it. `adaptive` reads it as a sensor, `regression` learns from it, all
            others are shifted by their mean error.
        covariances: whether the covariances of all states are kept; without them a log of a million
            samples takes a gigabyte less.
        every: whether all states are kept; else, and without covariances, only angles and torques
            from outside are, and of the others the beginning and the end (`Estimate.ends`).

    Raises:
        EstimationError: the log lacks a sensor, the estimator cannot run on this rig or diverges,
            or homing has no reference.
        LogError: the file cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = as_rig(rig)
    if isinstance(log, Log) and truth is not None:
        raise EstimationError(
            "truth is for logs that are read; a Log has its own (Log(…, truth={'theta': …}))"
        )
    log = log if isinstance(log, Log) else read_log(log, rig, truth)
    chosen = estimator_for(log, rig, estimator, compiled, homing)
    run = prepared(log, chosen, homing)
    if not covariances:
        return without_covariances(run, every=every)
    means, matrices, innovations, variances = run.estimator.scan(run.start, log.time, run.samples)
    spreads = np.diagonal(matrices, axis1=1, axis2=2)
    check_bounds(run, means, spreads)
    return finished(run, means, spreads, innovations, variances, matrices)


def references_of(chosen: KernelEstimator) -> dict[str, int]:
    """Return channel → index of the joint, for each sensor of a joint's angle that the estimator
    reads.
    """
    joints = chosen.rig.joint_names
    sensors = {sensor.name: joints.index(sensor.of) for sensor in chosen.rig.sensors_of("angle")}
    return {channel: sensors[channel] for channel in chosen.channels if channel in sensors}


def estimator_for(
    log: Log,
    rig: Rig,
    estimator: str | KernelEstimator | None,
    compiled: bool = True,
    homing: float | None = None,
) -> KernelEstimator:
    """Return the estimator to run over a log; with `homing` [s], `adaptive` reads the reference and
    `regression` will learn from it.

    Raises:
        EstimationError: it is no estimator, or cannot run on this rig, or homing has no reference.
    """
    if estimator is None:
        estimator = usual_estimator(rig)
    if not isinstance(estimator, (str, KernelEstimator)):
        raise EstimationError(
            f"an estimator is a name or one from make_estimator, {estimator!r} came"
        )
    if homing is not None:
        rig, references = with_references(rig, known_early(log, homing))
        check_homing(homing, log, rig.joint_names)
        if estimator == "adaptive":
            return AdaptiveFilter(with_prior_maps(rig), compiled, references=references)
        if estimator == "regression":
            return RegressionEstimator(rig, compiled, homing=True)
    return make_estimator(estimator, rig, compiled) if isinstance(estimator, str) else estimator


def known_early(log: Log, homing: float) -> Log:
    """Return the log with the true angles of only those joints that have one in the first `homing`
    s; unchanged if there are none.
    """
    early = log.time - log.time[0] < homing
    truths = {
        name: angles for name, angles in log.truth.items() if np.isfinite(angles[early]).any()
    }
    return replace(log, truth=truths) if truths else log


def prepared(log: Log, chosen: KernelEstimator, homing: float | None = None) -> Run:
    """Return a log and its estimator, ready to run; the true angle is the reference for the first
    `homing` s.

    Raises:
        EstimationError: the log lacks a sensor.
    """
    read = log
    if homing is not None:
        if isinstance(chosen, RegressionEstimator):
            chosen = chosen.after_homing(log, homing)
        truths = check_homing(homing, log, chosen.rig.joint_names)
        early = log.time - log.time[0] < homing
        for channel, joint in references_of(chosen).items():
            read = with_channel(read, channel, np.where(early, truths[:, joint], np.nan))
    samples = samples_of(read, chosen.channels, chosen.name, chosen.bridged or None)
    start = chosen.beginning(log.time, samples)
    run = Run(log, chosen, samples, start, homing)
    if homing is not None and isinstance(chosen, AdaptiveFilter) and references_of(chosen):
        return home(chosen, run, truths, homing)
    return run


def without_covariances(
    run: Run,
    pieces: Iterable[tuple[Floats, ...]] | None = None,
    *,
    every: bool = True,
) -> Estimate:
    """Return the estimate of a run, of whose covariances only the variances are kept.

    Args:
        pieces: what `KernelEstimator.pieces` yields, where it is there already.
        every: whether all states are kept, or only angles and torques from outside.

    Raises:
        DivergedError: see `check_bounds`.
    """
    chosen = run.estimator
    time = run.log.time
    if pieces is None:
        step = 1 + AT_ONCE // chosen.kernel.sizes.kernel_state
        parts = (slice(begin, begin + step) for begin in range(0, len(time), step))
        pieces = chosen.pieces(run.start, ((time[part], run.samples[part]) for part in parts))
    reported = (StateKind.ANGLE, StateKind.EXTERNAL_TORQUE)
    kept = [i for i, kind in enumerate(chosen.state_kinds) if every or kind in reported]
    widths = (len(kept), len(kept), len(chosen.measured), len(chosen.measured))
    whole = [np.empty((len(time), width)) for width in widths]
    ends = list[list[Floats]]()
    begin = 0
    for means, spreads, *compared in pieces:
        check_bounds(run, means, spreads, begin)
        part = slice(begin, begin + len(means))
        for array, values in zip(whole, (means[:, kept], spreads[:, kept], *compared)):
            array[part] = values
        ends.append([values[[0, -1]] for values in (means, spreads, *compared)])
        begin = part.stop
    # nobody else holds these arrays, so that they need no copies
    means, spreads, innovations, variances = map(sealed, whole)
    made = finished(run, means, spreads, innovations, variances, kept=kept)
    if every:
        return made
    two = np.array([0, len(time) - 1])
    short = replace(run, log=run.log.select(two), samples=run.samples[two])
    means, spreads, innovations, variances = (
        np.vstack([first[0], last[1]]) for first, last in zip(ends[0], ends[-1])
    )
    return replace(made, ends=finished(short, means, spreads, innovations, variances))


def check_bounds(run: Run, means: Floats, spreads: Floats, begin: int = 0) -> None:
    """Raise an error if an estimate diverged.

    Args:
        run: with log and estimator, for the message.
        means: of the states, (k, n).
        spreads: their variances, (k, n).
        begin: index of the first row in the log.

    Raises:
        DivergedError: the message says when it diverged.
    """
    bad = out_of_bounds(means, spreads, len(run.estimator.rig.joints))
    if len(bad):
        row = begin + int(bad[0])
        learned = run.estimator.rig.map
        has_map = learned is not None and learned.readings
        instead = ", or take the estimator regression, whose map is in the rig file"
        instead = instead if has_map else ""
        raise DivergedError(
            f"{run.log.source}: {run.estimator.name} left all bounds at {run.log.time[row]:g} s; "
            "check the units of the log and the rig's stiffness and masses, shorten "
            f"stepping.largest_step{instead}"
        )


def finished(
    run: Run,
    means: Floats,
    spreads: Floats,
    innovations: Floats,
    variances: Floats,
    covariances: Floats | None = None,
    kept: Sequence[int] | None = None,
) -> Estimate:
    """Return the estimate of a run.

    Args:
        means: of the states, (k, n).
        spreads: their variances, (k, n).
        innovations: of the compared channels, (k, m).
        variances: of the innovations, (k, m).
        covariances: of the states, (k, n, n), or None where they are not kept.
        kept: indices of the states that are there; None: all.
    """
    log = run.log
    chosen = run.estimator
    joints = tuple(chosen.rig.joint_names)
    truths = true_angles(log, joints)
    torques = true_torques(log, joints)
    references = references_of(chosen)
    if run.homing is not None and truths is not None:
        early = log.time - log.time[0] < run.homing
        if not (references or isinstance(chosen, RegressionEstimator)):
            means = means.copy()
            means[:, : len(joints)] = homed(means[:, : len(joints)], truths, early)
        later = np.where(early[:, None], np.nan, truths)
        truths = frozen(later) if np.isfinite(later).any() else None
        torques = None if torques is None else frozen(np.where(early[:, None], np.nan, torques))
    # innovations of a reference are left out of the estimate
    columns = [i for i, name in enumerate(chosen.measured) if name not in references]
    if references:
        innovations = innovations[:, columns]
        variances = variances[:, columns]
    measured = tuple(chosen.measured[i] for i in columns)
    units = state_units(chosen)
    kept = [*range(len(units))] if kept is None else [*kept]
    prior_means, prior_stds = (of[kept] for of in priors_of(chosen))
    return Estimate(
        chosen.name,
        chosen.rig.name,
        log.time,
        tuple(chosen.state_names[i] for i in kept),
        frozen(means),
        frozen(spreads),
        measured,
        frozen(innovations),
        frozen(variances),
        is_taught=bool(Redundancy.of(chosen.rig, list(log.channels)).maps),
        truths=truths,
        covariances=None if covariances is None else frozen(covariances),
        joint_names=joints,
        notes=() if chosen.unseen is None else (chosen.unseen,),
        prior_means=prior_means,
        prior_stds=prior_stds,
        stamps=log.stamps,
        torque_truths=torques,
        unseen=chosen.unseen,
        state_kinds=tuple(chosen.state_kinds[i] for i in kept),
        state_parts=tuple(chosen.state_parts[i] for i in kept),
        state_units=tuple(units[i] for i in kept),
    )


def priors_of(chosen: KernelEstimator) -> tuple[Floats, Floats]:
    """Return prior means and stds, (n,) each, NaN for states that are not constants of the rig, as
    are all of an estimator other than `adaptive`.
    """
    if isinstance(chosen, AdaptiveFilter):
        return chosen.priors
    none = np.full(len(chosen.state_names), np.nan)
    return none, none


def with_channel(log: Log, name: str, values: Floats) -> Log:
    """Return the log with the channel `name` added or replaced by the `values` [SI], (k,)."""
    return replace(log, channels={**log.channels, name: values})


def out_of_bounds(means: Floats, spreads: Floats, n_joints: int = 1) -> NDArray[np.intp]:
    """Return the indices of the rows in which an angle in `means`, (k, n), is beyond
    `LARGEST_ANGLE`, a value is not finite, or a variance in `spreads`, (k, n), is negative.
    """
    fine = (np.isfinite(means) & np.isfinite(spreads) & (spreads >= 0.0)).all(axis=1)
    fine &= (np.abs(means[:, :n_joints]) <= LARGEST_ANGLE).all(axis=1)
    return np.flatnonzero(~fine)


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
    pieces: list[list[tuple[Floats, ...]] | None] = [None] * len(runs)
    # a homing move may give a run another kernel (`with_straight_line`)
    if len(runs) > 1 and len(kernels) == 1 and _side_by_side(chosen) > 1:
        # a homing move gives each run parameters of its own; one that fails is run alone
        with suppress(DistalError):
            found = chosen.scan_all(
                [run.start for run in runs],
                [run.log.time for run in runs],
                [run.samples for run in runs],
                [run.estimator.parameters for run in runs],
            )
            pieces = [[chosen.reported(*moments, run.samples)] for run, moments in zip(runs, found)]
    return [_attempt(lambda pair: without_covariances(*pair), pair) for pair in zip(runs, pieces)]


def smooth(log: Log, rig: Rig, compiled: bool = True) -> Estimate:
    """Return the estimate of `adaptive` smoothed backwards over the log (Rauch, Tung and Striebel,
    AIAA Journal 3, 1965).

    G = P_k Φᵀ (P⁻_{k+1})⁻¹, x^s_k = x_k + G (x^s_{k+1} − x⁻_{k+1}), and, written so that it cannot
    be negative, P^s_k = (I − G Φ) P_k (I − G Φ)ᵀ + G (P^s_{k+1} + Q) Gᵀ with Q = P⁻_{k+1} − Φ P_k
    Φᵀ: (28) of docs/reference/adaptive-equations.md. Φ is the whole transition of the filter's own
    prediction: of joints, of states that fade, of plays, and across bridged gaps. Rows of G are
    zero for states that are guards of the filter (`State.smoothed`), and rows and columns for those
    that take a share of the gain (`StateVector.slow`); P^s holds for any G.

    Raises:
        EstimationError: the log lacks a sensor, the sensors do not suffice, or the filter diverged.
    """
    estimator = AdaptiveFilter(rig, compiled, trace=True, name="adaptive, smoothed")
    run = prepared(log, estimator)
    belief = run.start
    rows, last = estimator.checked_rows(belief, log.time, run.samples)
    kernel_states, ys = advance(
        estimator.kernel, Feed(belief.kernel_state, rows, estimator.parameters)
    )
    n = belief.size
    m = len(estimator.measured)
    means = mean_of(kernel_states, n).copy()
    covariances = covariance_of(kernel_states, n).copy()
    check_bounds(run, means[last], variances_of(kernel_states, n)[last])
    predicted = ys[:, 2 * m : 2 * m + n]
    matrices = ys[:, 2 * m + n :].reshape(-1, 2, n, n)
    # CasADi's matrices lie column by column: a covariance is symmetric, a transition has to be
    # transposed
    predicted_covariances = matrices[:, 0]
    transitions = np.swapaxes(matrices[:, 1], 1, 2)
    # each state in its own prior std, so that the inverse is well scaled
    scale = np.maximum(estimator.states.stds, 1e-12)
    # with a share of the gain its equations do not hold: such states stay as the filter had them
    slow = list(estimator.states.slow)
    unsmoothed = [*estimator.states.unsmoothed, *slow]
    quick = np.setdiff1d(np.arange(n), slow)
    for k in range(len(rows) - 2, -1, -1):
        transition = transitions[k + 1]
        before = covariances[k]
        ahead = predicted_covariances[k + 1] / np.outer(scale, scale)
        cross = (before @ transition.T) / scale
        gain = np.zeros((n, n))
        solution, *_ = np.linalg.lstsq(ahead[np.ix_(quick, quick)], cross[:, quick].T, rcond=1e-12)
        gain[:, quick] = solution.T / scale[quick]
        gain[unsmoothed] = 0.0
        means[k] += gain @ (means[k + 1] - predicted[k + 1])
        process = predicted_covariances[k + 1] - transition @ before @ transition.T
        left = np.eye(n) - gain @ transition
        covariance = left @ before @ left.T + gain @ (covariances[k + 1] + process) @ gain.T
        covariances[k] = (covariance + covariance.T) / 2
    if rig.map is not None:
        correct(means, covariances, log, rig, compiled, last)
    spreads = np.einsum("kii->ki", covariances)
    innovations = estimator.innovations_of(ys[last], run.samples)
    return finished(run, means[last], spreads[last], *innovations, covariances[last])


def correct(
    means: Floats, covariances: Floats, log: Log, rig: Rig, compiled: bool, last: NDArray[np.intp]
) -> None:
    """Put the angles by the rig's maps into means and covariances, in place.

    What a map adds to the filter's own angle is not smoothed: a second run of the filter, with
    the map, gives it. Changed are the rows `last`, those of the samples.
    """
    run = prepared(log, AdaptiveFilter(rig, compiled))
    kernel_states, ys = run.estimator.advanced(run.start, log.time, run.samples)
    states = kernel_states[:, : means.shape[1]]
    report = run.estimator.report
    means[last] += report.means(states, ys) - states
    covariances[last] = report.covariances(covariances[last], ys)
