"""`fit`: learn a rig's parameters from logs, and test the result on held-out logs.

`learn`: from logs to angles, without a rig file.
"""

from __future__ import annotations

import warnings
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np

from distal.confidence import BAND
from distal.errors import DistalWarning, DivergedError, EstimationError, FitError
from distal.fitting.candidates import WRITTEN, Judged, Training, groups_among, judge
from distal.fitting.free_parameters import Options, Progress
from distal.fitting.late_reference import delays, reference_lag, said_of_lag, without_lag
from distal.fitting.learn_free_motion import efforts_of, untouched
from distal.fitting.learned_maps import counted_from, logs_read, reference_offset
from distal.fitting.log_checks import check_logs, touched_logs
from distal.fitting.objective import Problem
from distal.fitting.parameter_estimates import by_filter, far_from_priors, problem_of
from distal.fitting.result import Fit
from distal.from_logs import rig_from_logs
from distal.homing import check_homing
from distal.logs import Log, Source, read_log, shown, true_angles
from distal.parallel import one_blas_thread
from distal.regression import FEWEST_LOGS, folds_of, groups_of, servos_of, splits
from distal.rig import LeftOut, Rig, as_rig
from distal.run import estimate

PROMISED = 2.0
"""Ratio of a rig's error, or of its band, on a log that it was learned from to that on logs left
out, and of a filter's error to that of a straight line of the readings, above which it is not
written [1]. Source: definition (of what a fit promises).
"""


@one_blas_thread()
def fit(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig | str | Path,
    free: Sequence[str] | str = (),
    per_log: Sequence[str] | str = (),
    *,
    homing: float | None = None,
    noise: bool = True,
    truth: str | None = None,
    workers: int = 2,
    compiled: bool = True,
    progress: Progress | None = None,
    units: str | None = None,
    lag: float | None = None,
    open_loop: bool = False,
    drafted: bool = False,
) -> Fit:
    """Fit a rig's parameters and noise to logs, learn a map of the angle error that remains, and
    test both on held-out logs.

    The parameters are the most likely ones: they minimise −ln p = ½ Σ w (ν²/(c S) + ln c S) − ln
    prior over all logs and channels, see `Problem` (prediction-error method; Ljung, 1999, ch. 7).
    The filter's angle is compared with the reference angle of a log; where the model explains the
    logs, the filter may read the reference too. With `homing` the filter reads the reference for
    that long, and only the errors afterwards count, as in use. With two logs of known angle or
    more, each way is judged on each of them by what the others tell. Logs that do not agree with
    the rig or with each other are fitted as well as possible, and the result says so.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`).
        rig: the description where the fit starts; its values and stds are the priors.
        free: paths of the parameters to fit, ``*`` for all components of a kind; default every
            parameter with a std.
        per_log: paths of the parameters that have one value for each log (pre-tension, zero
            offsets).
        homing: for how long the reference will be read in use [s]; None: it will not be read.
        noise: whether the sensors' noise is fitted too.
        truth: column of the true angle, where logs are read from files.
        workers: number of threads; the result does not depend on it.
        compiled: whether the filter is compiled; else it is interpreted.
        progress: called with what the fit is doing.
        units: fit a *kind* of rig: a regular expression whose first parenthesis finds the unit (an
            instrument, a pose, a day) in a log's name. The logs of a unit are held out together, so
            that the band is right for a new unit.
        lag: by how much the true angles are later than the drives [s]; None: it is found, and taken
            off where it makes the logs more probable by more than its standard error. A joint that
            follows its drives late looks the same.
        open_loop: whether the rig is for a simulator: its joints then go as in the logs where the
            drives do and no sensor corrects them. It has no maps.
        drafted: whether the rig was drafted from these logs: nothing is then said of values that
            are far from the draft's.

    Raises:
        FitError: the logs cannot be fitted; says which and why.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = (as_rig(rig)).bare()  # maps of an earlier fit are learned anew
    options = Options(
        free=_listed(free),
        per_log=_listed(per_log),
        homing=homing,
        noise=noise,
        units=units,
        workers=workers,
        compiled=compiled,
    )
    read = _read(logs, rig, truth, homing)
    start_rig = rig
    touched = [] if homing is not None or units is not None else touched_logs(read, rig)
    aside = [read[i] for i in touched]
    read = [log for i, log in enumerate(read) if i not in touched]
    if units is not None:
        groups_of([log.source for log in read], units)
    found_lag = _lag(read, rig, units) if lag is None else lag
    if open_loop and all(true_angles(log, rig.joint_names) is None for log in read):
        raise FitError(
            "an open loop is fitted to the joints' angles, and no log has them; log them too, by a "
            "camera or a temporary encoder"
        )
    judged = _judged_at(found_lag, read, rig, options, progress)
    if found_lag and lag is None and not judged.interrupted:
        # what looks late to the readings may be inertia, which the filter knows
        on_time = _judged_at(0.0, read, rig, options, progress)
        if on_time.error < judged.error:
            judged = on_time
            found_lag = 0.0
    read = list(judged.logs)
    measured = {**servos_of(read, rig), **delays(read, rig, found_lag)}
    learned = _followed(judged, read)
    if open_loop and not learned.interrupted:
        learned = _in_open_loop(learned, judged.training, progress)
    doubts = (*said_of_lag(found_lag), *_touched(aside), *learned.doubts)
    added = {**measured, **learned.added}
    parameters = learned.parameters
    for line in () if drafted else far_from_priors(parameters.fitted, parameters.problem):
        warnings.warn(line, DistalWarning, stacklevel=2)
    return replace(learned, start=start_rig, added=added, doubts=doubts)


def _judged_at(
    lag: float, logs: Sequence[Log], rig: Rig, options: Options, progress: Progress | None
) -> Judged:
    """Return the candidates where the reference is later than the drives by a lag [s]."""
    on_time = without_lag(logs, rig, lag)
    measured = {**servos_of(on_time, rig), **delays(on_time, rig, lag)}
    return judge(on_time, rig.with_values(measured), options, progress)


def _followed(judged: Judged, logs: Sequence[Log]) -> Fit:
    """Return what is learned by the best candidate, with its normal forces of free motion; where
    the rig, as it would be written, fails on a log, by the next one, and at last by readings alone.

    Candidates are judged without touches. So a rig that looks for none comes before another one.
    """
    best = judged.chosen
    line = judged.training.line_error
    # why no filter is written; of a filter that others replace nobody asks
    doubts = list[str]()
    with suppress(KeyboardInterrupt):  # what was learned stands
        for candidate in sorted(judged.candidates, key=lambda way: way.error) or [best]:
            if PROMISED * line < candidate.error < np.inf:
                doubts.append(
                    f"the filter of {candidate.name} errs by {np.rad2deg(candidate.error):.2g}° on "
                    f"logs left out, a straight line of the readings by {np.rad2deg(line):.2g}°"
                )
                continue
            learned = _with_free_motion(Fit.of(judged, candidate), judged)
            for rig in dict.fromkeys((learned.rig, untouched(learned.rig))):
                failures = (_failure(rig, log, learned, judged.training) for log in logs)
                failure = next(filter(None, failures), None)
                if failure is None:
                    return replace(learned, rig=rig)
                touches = "" if rig is learned.rig else ", which looks for no touches,"
                doubts.append(f"the filter of {candidate.name}{touches} {failure}")
        doubts.append("no filter is written: the angles are those of the map on readings alone")
        best = replace(best, data={})
        learned = _with_free_motion(Fit.of(judged, best), judged)
        return replace(learned, doubts=(*doubts, *learned.doubts))
    return Fit.of(judged, best)


def _in_open_loop(learned: Fit, training: Training, progress: Progress | None) -> Fit:
    """Return what was learned with the parameters for an open loop in place of those for an
    estimator, and without maps (output-error method; Ljung, System Identification, 1999, ch. 7).
    """
    logs = training.logs
    options = replace(training.options, noise=False)

    def problem(logs: Sequence[Log], rig: Rig) -> Problem:
        return replace(problem_of(logs, rig, options), open_loop=True)

    parameters = by_filter(problem(logs, learned.model), None, progress)
    interrupted = parameters.optimum.interrupted
    errors = list[float]()
    for out, kept in splits(training.folds):
        if not kept or interrupted:
            break
        others = by_filter(problem([logs[i] for i in kept], learned.model), None, progress)
        interrupted = others.optimum.interrupted
        for i in out:
            asked = problem([logs[i]], others.put_into(learned.model))
            (run,) = asked.at(np.zeros(asked.size))
            time = logs[i].time
            counted = run.values[time - time[0] >= counted_from(logs[i], options.homing)]
            if np.isfinite(counted).any():
                errors.append(float(np.nanmean(counted**2)))
    return replace(
        learned,
        rig=parameters.put_into(learned.model),
        parameters=parameters,
        kept=True,
        hold=False,
        maps={},
        compared=(),
        doubts=parameters.doubts,
        interrupted=interrupted,
        open_loop=np.nan if interrupted or not errors else float(np.sqrt(np.mean(errors))),
    )


def _failure(rig: Rig, log: Log, learned: Fit, training: Training) -> str | None:
    """Return in words how a rig fails on a log that it was learned from; None where it does not."""
    options = training.options
    homing = options.homing
    try:
        result = estimate(log, rig, compiled=options.compiled, homing=homing, covariances=False)
    except DivergedError:
        return f"leaves all bounds on {shown(log.source)}"
    scores = {of_log.index: of_log.scores[WRITTEN] for of_log in learned.compared}
    index = next((i for i, known in enumerate(training.logs) if known is log), -1)
    score = scores.get(index)
    if score is None:
        return None
    every = [of_log for of_log in scores.values() if of_log is not None]
    # no score has the zero of the encoder
    mean = np.sqrt(np.mean([of_log.rms**2 for of_log in every]))
    promised = np.hypot(max(score.rms, mean), reference_offset(rig, log))
    late = log.time - log.time[0] >= counted_from(log, homing)
    errors = result.errors().reshape(len(log), -1)[late]
    rms = float(np.sqrt(np.nanmean(errors**2)))
    half = BAND * float(np.mean(result.angle_stds[late]))
    wide = half > PROMISED * max(of_log.half for of_log in every)
    if rms <= PROMISED * promised and not wide:
        return None
    now, before = np.rad2deg((half, score.half) if wide else (rms, score.rms))
    what = "knows the angle to ±" if wide else "errs by "
    return f"{what}{now:.2g}° on {shown(log.source)}, where left out it had {before:.2g}°"


def _lag(logs: Sequence[Log], rig: Rig, units: str | None) -> float:
    """Return the lag of the reference [s]; 0 where the map on readings cannot run."""
    with_reference = [log for log in logs if true_angles(log, rig.joint_names) is not None]
    try:
        groups = groups_among(with_reference, units)
        return reference_lag(with_reference, rig, folds_of(groups))
    except EstimationError:
        return 0.0


def _touched(aside: Sequence[Log]) -> list[str]:
    """Return a sentence that names the logs in which something touches a joint."""
    if not aside:
        return []
    names = ", ".join(shown(log.source) for log in aside)
    return [
        f"in {names} something touches a joint, or holds it: the same positions of the drives go "
        "with other angles than in the other logs. What is learned of the rig is of free motion, "
        "so they are left out; a log of another kind of motion is fitted where there are several"
    ]


def _with_free_motion(learned: Fit, judged: Judged) -> Fit:
    """Return what was learned, with the normal forces of free motion (`efforts_of`), and how well
    the rig did on logs left out, where these are not few.
    """
    folds = folds_of(groups_among(judged.logs, judged.training.options.units))
    rig = learned.rig.with_map(efforts=efforts_of(judged.logs, learned.rig, folds))
    scores = [log.scores[WRITTEN] for log in learned.compared]
    ran = [score for score in scores if score is not None]
    if len(ran) >= FEWEST_LOGS:
        rms = float(np.sqrt(np.mean([score.rms**2 for score in ran])))
        inside = float(np.mean([score.inside for score in ran]))
        left_out = LeftOut(logs=len(ran), rms=rms, inside=inside)
        rig = rig.model_copy(update={"left_out": left_out})
    return replace(learned, rig=rig)


def _read(
    logs: Sequence[Log | Source] | Log | str | Path,
    rig: Rig,
    truth: str | None,
    homing: float | None,
) -> list[Log]:
    """Return the logs, read and checked."""
    if not rig.sensors:
        raise FitError(
            "the rig has no sensors, so no log can be used for a fit; describe them in [[sensors]]"
        )
    if homing is not None and not isinstance(homing, (int, float)):
        raise FitError(f"homing is a number of seconds, {homing!r} came")
    read = logs_read(logs, rig, truth)
    check_logs(read, rig)
    joints = rig.joint_names
    if homing is not None:
        for log in read:
            if true_angles(log, joints) is None:
                raise FitError(
                    f"{log.source}: has no truth; a fit with homing needs one on every log"
                )
            check_homing(homing, log, joints)
    return read


def _listed(paths: Sequence[str] | str) -> tuple[str, ...]:
    return (paths,) if isinstance(paths, str) else tuple(paths)


def learn(
    logs: Sequence[Source],
    *,
    truth: Sequence[str] = (),
    drives: Mapping[str, str] | None = None,
    ignore: Sequence[str] = (),
    rate: float | None = None,
    lag: float | None = None,
    progress: Progress | None = None,
) -> Fit:
    """Learn from logs alone how well the joints can be known from the motors: which columns are
    what, the structure of the rig, its parameters and its maps.

    `Fit.answer` says how well, `Fit.save` writes the rig file, and `estimate` takes `Fit.rig`.

    Args:
        logs: paths or frames with the same columns; three of 20 to 40 s with the joints' angles are
            enough.
        truth: columns of joints' reference angles, where names do not say so.
        drives: column of a drive's position → its unit, or empty.
        ignore: columns that are none of this.
        rate: of evenly spaced rows, where no column holds their time [Hz].
        lag: by how much the true angles are later than the drives [s]; see `fit`.
        progress: called with what the fit is doing.

    Raises:
        LogError: a log cannot be read, or has no time.
        RigError: no drive or no joint can be found; says what would help.
        FitError: the logs cannot be fitted.
    """
    draft = rig_from_logs(logs, truth=truth, drives=drives, ignore=ignore, rate=rate)
    read = [read_log(source, draft.rig) for source in logs]
    result = fit(read, draft.rig, progress=progress, lag=lag, drafted=True)
    return replace(result, text=draft.text)
