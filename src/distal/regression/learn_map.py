"""How every map is learned: choose its terms by the errors on held-out logs, fit the coefficients,
size the band by the errors on held-out logs.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distal.arrays import Bools, Floats
from distal.confidence import BAND
from distal.errors import FitError
from distal.regression.after_homing import calibrate_window
from distal.regression.band import (
    BETWEEN,
    WEIGHT,
    Errors,
    rms_beyond_noise,
    sized,
    student,
    widened_between,
)
from distal.regression.beyond_homing import extrapolation
from distal.regression.cross_validation import splits
from distal.regression.features import Samples, design, predict
from distal.regression.random_effects import independent, random_effects, row_of, rows_of_groups
from distal.rig import CONSTANT, JointMap, LearnedMap

ENOUGH_LOGS = 5
"""Number of logs, or groups of logs, from which on the variation from log to log counts as known;
with fewer the band is widened. Source: judgement.
"""

AFTER_HELD_OUT = 0.5
"""Power of Student's factor that is left where held-out logs have sized the band: their errors have
part of that scatter already [1]. Source: benchmark (docs/results/from-logs.md).
"""

MOST_SAMPLES = 1000
"""Number of samples to which a long log is thinned for learning, evenly and by a whole step, so
that fewer than twice as many remain. Source: judgement.
"""

SAMPLES_PER_TERM = 20
"""Number of samples for each term that the shortest log must have, so that a set of terms is tried.
Source: judgement.
"""

SPEED_OVER = 0.1
"""Time over which the speeds of readings are differences [s], so that noise counts little. Source:
judgement.
"""


@dataclass(frozen=True)
class Terms:
    """A set of terms that may be tried; see `LearnedMap` for how a term is written.

    Args:
        name: the set in words, for notes and reports.
        terms: the terms, products of readings and of what is made of them.
        width: half-width of the play operators, in standard deviations of each reading.
        of_noise: whether `width` is in standard deviations of each sensor's random error instead.
        corrects: whether the map changes the estimate; else only its band is sized.
        pooled: whether the mean of the coefficients is fitted to all samples together, see
            `random_effects`.
    """

    name: str
    terms: tuple[str, ...]
    width: float = 0.5
    of_noise: bool = False
    corrects: bool = True
    pooled: bool = False


@dataclass(frozen=True)
class Kind:
    """The kind of map that is learned.

    Args:
        form: class of the map's description.
        name: name of the map's table in a rig file.
        channels: names of the sensors, (m,).
        joints: names of the joints.
        noise: standard deviation of each sensor's random error [SI], (m,).
        sets: the sets of terms that may be tried, fewer terms first.
        better: a set with more terms is taken where its error on held-out logs is below this share
            of the error with fewer.
        by_motion: whether residuals count as correlated for as long as the motion itself, see
            `calibrate_window`.
        unknown_outside: whether outside the learned range the variance grows by the mean square of
            what is mapped; else by that of the residual alone.
        by_group: whether each group of logs, not each log, counts as one draw of the coefficients
            where Student's factor widens their covariance. A prior that is much too wide would let
            a short homing window overrule the logs.
        moves: those channels that are positions, for `LearnedMap.moves`; none for a map after which
            nothing stays.
    """

    form: type[LearnedMap]
    name: str
    channels: tuple[str, ...]
    joints: tuple[str, ...]
    noise: Floats
    sets: tuple[Terms, ...]
    better: float
    by_motion: bool = False
    unknown_outside: bool = True
    by_group: bool = False
    moves: tuple[str, ...] = ()


def learn_map(
    logs: Sequence[Samples],
    kind: Kind,
    folds: Sequence[int],
    homing: float | None,
    partly: Mapping[int, Samples] | None = None,
) -> tuple[LearnedMap, Terms]:
    """Return the map that is learned from logs, and the terms that were chosen for it.

    The terms are chosen and the band is sized by the errors on held-out logs.

    Args:
        logs: the samples of each log.
        kind: what is mapped, and the sets of terms to choose from.
        folds: the fold of each log; logs of one fold are held out together.
        homing: length of the homing move after which the map will be used [s], or None.
        partly: by index, some of the logs after a homing move that covers half of their range.
            Their errors beyond that half determine `LearnedMap.extrapolation`.
    """
    chosen = choose_terms(logs, kind, folds, homing)
    learned = calibrate_band(logs, kind, chosen, folds, homing)
    if partly and homing is not None and len(set(folds)) > 1:
        calibrated = {name: getattr(learned, name) for name in ("band", "own", "between")}

        def without(i: int) -> LearnedMap | None:
            remaining = [logs[k] for k in next(left for out, left in splits(folds) if i in out)]
            if not _all_known(remaining, kind, chosen):
                return None
            return fit_coefficients(remaining, kind, chosen).model_copy(update=calibrated)

        costs = extrapolation(partly, without, len(kind.joints), homing, kind.by_motion)
        learned = learned.model_copy(update={"extrapolation": costs})
    return learned, chosen


def choose_terms(
    logs: Sequence[Samples], kind: Kind, folds: Sequence[int], homing: float | None
) -> Terms:
    """Return the set of terms with which the map errs least on held-out logs, fewer terms
    preferred.

    A set with more terms must bring the error below `Kind.better` of the error with fewer. Where
    all logs are of one fold, the two halves of each log are held out in turn. With a `homing` move
    [s] the errors after it count, see `errors_of`.
    """
    sets = kind.sets
    if len(sets) == 1:
        return sets[0]
    if len(set(folds)) < 2:
        if not sets[0].corrects and _honest(logs):
            return sets[0]  # one log cannot show which errors recur, and the band held these
        folds = [0, 1] * len(logs)
        logs = _halves(logs)
        homing = None
    shortest = min(len(log.time) for log in logs)
    noise = max(log.reference_std for log in logs)
    best = sets[0]
    least = float("inf")
    for candidate in sets:
        if len(candidate.terms) * SAMPLES_PER_TERM > shortest:
            continue
        if candidate.pooled and homing is not None:
            continue  # after a homing move each log has coefficients of its own
        errors = left_out_errors(logs, kind, candidate, folds, homing)
        # the mean of the logs' own RMS: a log that is unlike the others does not decide
        rms = rms_beyond_noise(errors)
        if np.isnan(rms):
            return sets[0]  # no log can be held out: each alone knows some joint
        if not candidate.corrects and rms < noise:
            return (
                candidate  # what is less than the reference's own error is not worth a correction
            )
        rms = rms_beyond_noise(errors, noise)
        if rms < kind.better * least or (len(candidate.terms) == len(best.terms) and rms < least):
            best = candidate
            least = rms
    return best


HELD = 0.8
"""Share of the samples of a single log: where the filter's own band holds this share or more, no
correction is learned from this log alone. Source: judgement.
"""


def _honest(logs: Sequence[Samples]) -> bool:
    """Return whether the filter's own band holds at least `HELD` of the errors on some logs."""
    errors = np.concatenate([log.targets.ravel() for log in logs])
    stds = np.sqrt(np.concatenate([log.variances.ravel() for log in logs]))
    finite = np.isfinite(errors)
    return float(np.mean(np.abs(errors[finite]) <= BAND * stds[finite])) >= HELD


def _halves(logs: Sequence[Samples]) -> list[Samples]:
    firsts = [np.arange(len(log.time)) < len(log.time) // 2 for log in logs]
    return [log.part(rows) for log, first in zip(logs, firsts) for rows in (first, ~first)]


def fit_coefficients(logs: Sequence[Samples], kind: Kind, chosen: Terms) -> LearnedMap:
    """Return the map that some logs teach with a set of terms, by `random_effects`; its band is not
    sized yet.

    Raises:
        FitError: for some joint no log has more samples with a known target than there are terms.
    """
    learned, columns = frame(logs, kind, chosen)
    designs = [_thinned(design(learned, log)) for log in logs]
    joints = []
    times = []
    spreads = []
    stays = []
    plain = [at for at, i in enumerate(columns) if chosen.terms[i] in (CONSTANT, *kind.channels)]
    for j, joint in enumerate(learned.joints):
        parts = []
        for log, phi in zip(logs, designs):
            target = _thinned(log.targets[:, j])
            rows = np.isfinite(target)
            if rows.sum() > len(columns):
                parts.append(
                    (phi[rows][:, columns], target[rows], log.interval * _step(len(log.time)))
                )
        if not parts:
            raise FitError(
                f"{kind.name}: the truth that it needs of '{joint.joint}' is known in no log"
            )
        fit, time = random_effects(joint, columns, parts, chosen.pooled)
        if not chosen.corrects:  # a mean error need not recur: it widens the variance
            square = fit.covariance[0][0] + fit.coefficients[0] ** 2
            fit = fit.model_copy(update={"coefficients": (0.0,), "covariance": ((square,),)})
        if kind.moves:
            stays.append(_bent(parts, plain))
        joints.append(fit)
        times.append(time)
        squares = [float(np.mean(target**2)) for _, target, _ in parts]
        spreads.append(float(np.sqrt(np.mean(squares))) if kind.unknown_outside else 0.0)
    return learned.model_copy(
        update={
            "joints": tuple(joints),
            "correlation_time": max(times),
            "spread": tuple(spreads),
            "stays": tuple(stays),
        }
    )


def _bent(parts: Sequence[tuple[Floats, Floats, float]], plain: Sequence[int]) -> float:
    """Return the RMS by which targets leave the straight line of their `plain` columns: as much as
    friction, play and curves make in the logs.
    """
    phi = np.vstack([columns[:, plain] for columns, _, _ in parts])
    target = np.concatenate([values for _, values, _ in parts])
    left = target - phi @ np.linalg.lstsq(phi, target, rcond=None)[0]
    return float(np.sqrt(np.mean(left**2)))


def frame(logs: Sequence[Samples], kind: Kind, chosen: Terms) -> tuple[LearnedMap, list[int]]:
    """Return a map with the scales and the learned range of some logs, its coefficients zero, and
    the indices of the terms to learn.

    A sensor that is constant, or follows from others, has no linear term.
    """
    every = np.vstack([log.every for log in logs])
    m = len(kind.channels)
    size = len(chosen.terms)
    centre = every.mean(axis=0)
    spread = every.std(axis=0)
    alone = independent(every[:, :m] - centre[:m], kind.noise)
    scale = np.where(spread > 1e-12, spread, 1.0)
    z = ((every[:, :m] - centre[:m]) / scale[:m])[:, alone]
    distance = np.zeros((m, m))
    if alone.any():
        distance[np.ix_(alone, alone)] = np.linalg.pinv(z.T @ z / len(z), rcond=1e-6)
    reach = float(
        np.sqrt(np.max(np.sum(z @ distance[np.ix_(alone, alone)] * z, axis=1), initial=1.0))
    )
    room = np.zeros(len(centre))
    room[:m] = np.where(alone, 0.0, 3.0 * kind.noise)
    zero = JointMap(
        joint="joint", coefficients=(0.0,) * size, covariance=((0.0,) * size,) * size, std=1.0
    )
    learned = kind.form(
        terms=chosen.terms,
        channels=kind.channels,
        centre=row_of(centre),
        scale=row_of(scale),
        low=row_of(np.minimum(every.min(axis=0), centre - room)),
        high=row_of(np.maximum(every.max(axis=0), centre + room)),
        rate=row_of(_speeds(logs)),
        width=row_of(
            np.maximum(
                chosen.width * (kind.noise / scale[:m] if chosen.of_noise else np.ones(m)), 1e-9
            )
        ),
        distance=rows_of_groups(distance),
        reach=reach,
        correlation_time=logs[0].interval,
        spread=(0.0,) * len(kind.joints),
        moves=kind.moves,
        band=(1.0,) * len(kind.joints),
        logs=len(logs),
        dropped=tuple(
            f"{kind.channels[i]}: "
            f"{'was constant' if spread[i] <= 1.5 * kind.noise[i] else 'follows from the others'}"
            for i in np.flatnonzero(~alone)
        ),
        joints=tuple(zero.model_copy(update={"joint": joint}) for joint in kind.joints),
    )
    silent = {kind.channels[i] for i in np.flatnonzero(~alone)}
    return learned, [i for i, term in enumerate(chosen.terms) if term not in silent]


def _speeds(logs: Sequence[Samples]) -> Floats:
    """Return the RMS speed of each reading and each angle over some logs [SI/s]."""
    squares = np.zeros(logs[0].every.shape[1])
    count = 0
    for log in logs:
        lag = max(1, round(SPEED_OVER / log.interval))
        if len(log.time) > lag:
            every = log.every
            changes = (every[lag:] - every[:-lag]) / (log.time[lag:] - log.time[:-lag])[:, None]
            squares = squares + np.sum(changes**2, axis=0)
            count = count + len(changes)
    return np.sqrt(squares / max(count, 1))


def _step(count: int) -> int:
    return max(1, count // MOST_SAMPLES)


def _thinned(values: Floats) -> Floats:
    return values[:: _step(len(values))]


def errors_of(
    learned: LearnedMap, out: Samples, kind: Kind, homing: float | None, among: Bools | None = None
) -> list[Errors]:
    """Return, for each joint, the errors of a map on a held-out log, the variances of the map, and
    those of the filter that count beside it (`Errors`).

    With a `homing` window [s] the map is updated by it first, and only the samples after it count.
    Of these only the ones in `among`, (k,), count; None stands for all.
    """
    late = np.ones(len(out.time), dtype=bool) if among is None else among
    if homing is not None:
        late = late & (out.time >= homing)
        learned, _ = calibrate_window(learned, out, out.window(homing), kind.by_motion)
    errors = []
    for j in range(len(learned.joints)):
        predicted = predict(learned, out, j)
        target = out.targets[:, j]
        rows = late & np.isfinite(target)
        errors.append(
            (
                (predicted.values - target)[rows],
                predicted.variances[rows],
                predicted.filter_variances[rows],
            )
        )
    return errors


def left_out_errors(
    logs: Sequence[Samples], kind: Kind, chosen: Terms, folds: Sequence[int], homing: float | None
) -> list[list[Errors]]:
    """Return, for each held-out log, the errors of the map that the logs of the other folds teach.

    With a `homing` window [s] only the errors after it count.
    """
    held = held_out(logs, kind, chosen, folds)
    return [errors_of(learned, log, kind, homing) for learned, log in held]


HeldOut = tuple[LearnedMap, Samples]
"""A held-out log, after the map that the logs of the other folds teach."""


def held_out(
    logs: Sequence[Samples], kind: Kind, chosen: Terms, folds: Sequence[int]
) -> list[HeldOut]:
    """Return each log after the map that the logs of the other folds teach.

    A fold is passed over where the other logs do not know every joint.
    """
    held = list[HeldOut]()
    for out, left in splits(folds):
        remaining = [logs[i] for i in left]
        if _all_known(remaining, kind, chosen):
            learned = fit_coefficients(remaining, kind, chosen)
            held += [(learned, logs[i]) for i in out]
    return held


def _all_known(logs: Sequence[Samples], kind: Kind, chosen: Terms) -> bool:
    """Return whether for every joint some log has more samples with a known target than there are
    terms.
    """
    enough = [np.isfinite(_thinned(log.targets)).sum(axis=0) > len(chosen.terms) for log in logs]
    return bool(enough) and bool(np.all(np.any(enough, axis=0))) and len(kind.joints) > 0


def calibrate_band(
    logs: Sequence[Samples], kind: Kind, chosen: Terms, folds: Sequence[int], homing: float | None
) -> LearnedMap:
    """Return the map that logs teach with a set of terms, its band `sized` by `left_out_errors`.

    With fewer than `ENOUGH_LOGS` logs or groups the spread of the coefficients is widened by
    Student's factor. `homing` [s] is as in `learn_map`.
    """
    held = held_out(logs, kind, chosen, folds) if len(set(folds)) > 1 else []
    return sized_by(fit_coefficients(logs, kind, chosen), kind, folds, held, homing)


def sized_by(
    learned: LearnedMap,
    kind: Kind,
    folds: Sequence[int],
    held: Sequence[HeldOut],
    homing: float | None = None,
) -> LearnedMap:
    """Return a map that logs taught, its band sized by the errors on `held` logs.

    The coefficients' part in it is the share of `BETWEEN` that makes the narrowest band. With few
    logs it is widened by Student's factor, with `held` logs by less. With a `homing` window [s]
    only the errors after it count, and the factor is whole: the part is the window's prior.
    """
    count = len(set(folds))
    # a scatter that is estimated from few logs follows Student's distribution
    draws = count if kind.by_group else learned.logs
    wider = 1.0 if draws >= ENOUGH_LOGS else student(draws - 1)
    if held and homing is None:
        wider = wider**AFTER_HELD_OUT
    best = learned
    narrowest = np.inf
    for share in BETWEEN if held else ():
        errors = [errors_of(_with_share(fold, share), log, kind, homing) for fold, log in held]
        candidate, width = sized(_with_share(learned, share), errors, count >= ENOUGH_LOGS)
        if width < WEIGHT * narrowest:
            best = candidate
            narrowest = width
    return widened_between(best, wider)


def _with_share(learned: LearnedMap, share: float) -> LearnedMap:
    return learned.model_copy(update={"between": share})
