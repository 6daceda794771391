"""`fit`: a rig's parameters and noise from its own logs."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import FitError, RigError
from distal.fitting.affine import AffineFit, learn_affine
from distal.fitting.agreement import FEW_ITERATIONS, disagreement, staged
from distal.fitting.angle_errors import angle_error, mean_rms, surprise_of
from distal.fitting.checks import check_logs, doubts_of, unknown_joints, warn_of
from distal.fitting.contact import ContactFit, contact_of
from distal.fitting.curves import curves as curves_of
from distal.fitting.discrepancy import DiscrepancyFit, filtered, learned_from, widened
from distal.fitting.fitted import Fitted, assignments
from distal.fitting.free import Free
from distal.fitting.groups import groups_of
from distal.fitting.leaving_out import Compared, leave_out
from distal.fitting.likelihood import Likelihood
from distal.fitting.reference_error import with_reference_error
from distal.fitting.result import Fit
from distal.fitting.search import Found, search
from distal.fitting.selection import choose
from distal.fitting.uncertainty import Uncertainty, uncertainty_at
from distal.homing import added_reference, check_homing, with_references
from distal.logs import Log, read_log, true_angles
from distal.rig import Rig, Sensor, load_rig, number
from distal.sensors import variance

Floats = NDArray[np.float64]

STARTS = 6
"""Points drawn from the priors that are tried as starts beside the priors' mean."""

UNKNOWN_SPREAD = 2.0
"""Spread of those points where there is no prior, in units of the coordinate (a tenth of the value)."""

LEFT, SURER = (0.3, 0.1, 0.0), 0.85
"""Where a fit is in doubt its numbers keep the priors' stds, or these shares of them if the angle's error is then below
`SURER` times that of wider ones (as for sets of terms); 0 holds them."""

UNAIDED = 3.0
"""Mean ν²/S of the angle without its reference from which on a fit with it hides what the angle errs by."""

FINE = 2.0
"""An angle without its reference that errs by less than this times the reference's noise is as good as it can be told."""

HIDDEN = (
    "with the reference as a sensor the fit agrees with itself, and without it the angle errs by more than it says: the "
    "rig lacks physics that these logs have; it was fitted to the angle without the reference"
)

FOR_LEAVING_OUT = 3
"""With so many logs whose angle is known, each is left out once."""

Progress = Callable[[str, int, float], None]


def fit(
    logs: Sequence[Any],
    rig: Rig | str | Path,
    free: Sequence[str] = (),
    per_log: Sequence[str] = (),
    homing: float | None = None,
    noise: bool = True,
    curves: bool = False,
    truth: str | None = None,
    seed: int = 0,
    workers: int = 2,
    compiled: bool = True,
    progress: Progress | None = None,
    units: str | None = None,
    start: Rig | str | Path | None = None,
) -> Fit:
    """Fit a rig's parameters and noise to logs, and learn what the model leaves of the angle.

    −ln p = ½ Σ (ν²/S + ln 2πS) − ln prior, over all logs and channels (prediction-error method; Ljung, 1999, ch. 7). The
    truth of a log that has one is no sensor: it is compared with what the filter makes of the others. With `homing` it is
    a sensor for that long, and what is predicted afterwards is what counts: the fit is to the use. Logs with truth also
    teach the discrepancy of `adaptive` and the map of `affine`; with three or more each is left out once, and how the
    fitted rig, the rig as it came and `affine` do on it is in the outcome. Logs that do not look like the rig, or
    contradict each other, are fitted as well as may be, and the outcome says so.

    Args:
        logs: each a `Log`, a path or a frame (see `read_log`).
        rig: the description where the fit starts; its values and stds are the priors.
        free: paths of what is varied, ``*`` for all parts of a kind; default every parameter with a std.
        per_log: paths of which each log has its own (pre-tension, zero offsets).
        homing: for how long the reference is used [s]; None for wherever it is.
        noise: whether noise is varied too.
        curves: whether the position sensors' systematic curves are learned from logs with truth; only where the same
            sensors, mounted the same way, will be read again.
        truth: where logs are read: the true angle's column.
        seed: of the starts.
        workers: threads; one log each.
        compiled: compile the kernel where possible.
        progress: called with the stage, the iteration and −ln p.
        units: fit a *kind* of rig: a regular expression whose first parenthesis names the unit (an instrument, a pose, a
            day) in a log's name; units are left out as a whole, so that the band is that of a unit not seen.
        start: a fitted rig, whose values the search begins with; the priors are those of `rig`.

    Raises:
        FitError: the logs cannot be fitted; says which and why.
        LogError: a log cannot be read.
        RigError: the rig is unknown or wrong.
    """
    rig = rig if isinstance(rig, Rig) else load_rig(rig)
    if not rig.sensors:
        raise FitError("the rig has no sensors, so that no log can tell of it; describe them in [[sensors]]")
    rig = rig.bare()  # what logs taught beside its numbers is learned anew
    logs = [logs] if isinstance(logs, (Log, str, Path)) else list(logs)
    free, per_log = _listed(free), _listed(per_log)
    if not isinstance(seed, (int, np.integer)) or seed < 0:
        raise FitError(f"seed must be a whole number from 0, {seed!r} came")
    if homing is not None and not isinstance(homing, (int, float)):
        raise FitError(f"homing is a number of seconds, {homing!r} came")
    read = [log if isinstance(log, Log) else read_log(log, rig, truth) for log in logs]
    check_logs(read, rig)
    joints = [joint.name for joint in rig.joints]
    with_truth = [log for log in read if true_angles(log, joints) is not None]
    if homing is not None:
        for log in read:
            if true_angles(log, joints) is None:
                raise FitError(f"{log.source}: has no truth, which a fit with homing needs on every log")
            check_homing(homing, log, joints)
    described, references = with_references(rig, with_truth[0]) if with_truth else _unused_reference(rig, read[0])
    parts = choose(described, references, free, per_log, noise, homing is not None, len(read) > 1)
    if not with_truth:
        parts = tuple(part for part in parts if not _of_references(described, references, part))

    aided = bool(with_truth) and homing is None

    def made(chosen: Sequence[Free], group: Sequence[Log]) -> Likelihood:
        return Likelihood(described, references, chosen, group, homing, compiled, workers, aided)

    likelihood = made(parts, read)
    before = likelihood.cost(np.zeros(likelihood.size))
    if not np.isfinite(before):
        raise FitError(
            f"{rig.name}: the filter leaves all bounds on these logs; check the units of logs and rig (distal estimate)"
        )
    doubts = list[str]()
    if start is None:
        found = _best_of_starts(likelihood, seed, progress)
    else:
        begun = start if isinstance(start, Rig) else load_rig(start)
        found = search(likelihood, _begun(likelihood, begun), staged(progress, "from the fitted rig"))
    if aided and not found.interrupted:
        # a reference that corrects tells most where the model is right; is the angle right without it?
        aided = False
        unaided = made(parts, read)
        surprised, errs = surprise_of(unaided, found.z) > UNAIDED, angle_error(unaided, found.z)
        if surprised or errs > FINE * max(np.sqrt(variance(each)) for each in references):
            alone = search(unaided, found.z, staged(progress, "the angle without its reference"))
            surprised = surprised or angle_error(unaided, alone.z) < SURER * errs
            found = alone if surprised else found
        aided = not surprised
        if surprised:
            doubts.append(HIDDEN)
            likelihood = unaided
    if len(read) > 1 and not found.interrupted:
        doubts += disagreement(likelihood, found, made, read, progress)
    all_free = uncertainty_at(likelihood.derivatives(found.z), found.z, likelihood.parts())
    final, uncertainty, kept = likelihood, all_free, list[Free]()
    while not found.interrupted:
        # what the logs cannot identify stays at its prior, and the others are fitted to that
        at_prior = _unidentified(final, uncertainty)
        if not at_prior or len(at_prior) == len(final.free):
            break
        kept += at_prior
        ahead = np.array([found.z[k] for k, (part, _) in enumerate(final.parts()) if part not in at_prior])
        final = made([part for part in final.free if part not in at_prior], read)
        found = search(final, ahead, staged(progress, "what the logs tell"))
        uncertainty = uncertainty_at(final.derivatives(found.z), found.z, final.parts())
    nis_after = _nis(final, found.z)
    if not found.interrupted:
        doubts += doubts_of(final, found.z, nis_after)
    unknown = unknown_joints(with_truth, rig) if with_truth else []
    if unknown:
        # nothing says how far those joints are off: the band stays as wide as the rig file makes it
        doubts.append(
            f"the angle of {', '.join(unknown)} is known in no log: numbers of the rig are fitted, but no straight line "
            "(affine) and no correction (discrepancy), which are of all joints"
        )
    unsure = found.interrupted or bool(doubts)
    fitted = _fitted(final, found.z, uncertainty, unsure) + [_kept(part) for part in kept]
    warn_of(fitted, final)
    learned = curves_of(final, found.z) if curves else {}
    values = {**assignments(fitted, described), **learned}
    result = described.with_values(values) if values else described
    added = tuple(f"sensors.{i}." for i in range(len(rig.sensors), len(described.sensors)))

    def written(given: Mapping[str, object]) -> Rig:
        return rig.with_values({path: value for path, value in given.items() if not path.startswith(added)})

    if added:
        result = written(values)
    affine, discrepancy, compared, left = None, None, tuple[Compared, ...](), 1.0
    if with_truth and not unknown:
        affine = learn_affine(with_truth, result, homing)
        data, refused = filtered(with_truth, result, homing, compiled)
        if unsure and data and not found.interrupted:
            # numbers that stay as wide as they were are learned anew on every log: is that better than as fitted?
            for share in LEFT:
                surer = written({**assignments(fitted, described, share), **learned})
                as_fitted, _ = filtered(with_truth, surer, homing, compiled)
                if len(as_fitted) == len(data) and mean_rms(as_fitted) < SURER * mean_rms(data):
                    result, data, left = surer, as_fitted, share
        doubts += refused
        if data:
            names = [log.source for log in with_truth]
            groups = groups_of(names, units) if units is not None else [f"{i}" for i in range(len(names))]
            if len(set(groups)) >= FOR_LEAVING_OUT and not found.interrupted:

                def refitted(rest: Sequence[Log]) -> Rig:
                    own = made(final.free, rest)
                    at = _coordinates(final, own, found.z, read, rest)
                    again = search(own, at, staged(progress, "leaving one out"), FEW_ITERATIONS)
                    unsure_again = uncertainty_at(own.derivatives(again.z), again.z, own.parts())
                    return written(assignments(_fitted(own, again.z, unsure_again, unsure), described, left))

                compared, errors = leave_out(with_truth, read, rig, refitted, affine, homing, groups)
            else:
                errors = []
            together = groups if len(groups) == len(data) else None
            discrepancy = widened(learned_from(data, result, homing, together, scored=False), errors)
        if homing is None:
            affine, discrepancy = with_reference_error(affine, discrepancy, rig, with_truth)
    contact = contact_of(read, result, homing, units)
    return Fit(
        rig=_with_learned(result, affine, discrepancy, contact),
        start=rig,
        fitted=tuple(part for part in fitted if not (added and part.name.startswith(added))),
        logs=tuple(log.source for log in read),
        duration=float(sum(log.time[-1] - log.time[0] for log in read)),
        samples=sum(len(log) for log in read),
        homing=homing,
        correlations=uncertainty.correlations,
        combinations=all_free.combinations,
        channels=final.measured,
        nis_before=_nis(likelihood, np.zeros(likelihood.size)),
        nis_after=nis_after,
        cost_before=before,
        cost_after=found.cost,
        iterations=found.iterations,
        converged=found.converged,
        interrupted=found.interrupted,
        curves=learned,
        affine=affine,
        discrepancy=discrepancy,
        compared=compared,
        doubts=tuple(doubts),
        left=left,
        contact=contact,
        evaluations=likelihood.evaluations + (final.evaluations if final is not likelihood else 0),
    )


def _with_learned(
    rig: Rig, affine: AffineFit | None, discrepancy: DiscrepancyFit | None, contact: ContactFit | None
) -> Rig:
    learned: dict[str, object] = {}
    if contact is not None:
        learned["contact"] = contact.contact.model_dump()
    if affine is not None:
        learned["affine"] = affine.affine.model_dump()
    if discrepancy is not None:
        learned["discrepancy"] = discrepancy.discrepancy.model_dump()
    return rig.with_values(learned) if learned else rig


def _coordinates(whole: Likelihood, some: Likelihood, z: Floats, logs: Sequence[Log], rest: Sequence[Log]) -> Floats:
    """Return the coordinates of a likelihood of some of the logs at those of all."""
    start = np.zeros(some.size)
    for j, log in enumerate(rest):
        here = next(i for i, other in enumerate(logs) if other is log)
        start[some.columns(j)] = z[whole.columns(here)]
    return start


def _listed(paths: Sequence[str] | str) -> tuple[str, ...]:
    return (paths,) if isinstance(paths, str) else tuple(paths)


def _unused_reference(rig: Rig, log: Log) -> tuple[Rig, tuple[Sensor, ...]]:
    """Return a rig with a reference that has no value in any log: the filter of a fit always has one."""
    described, reference = added_reference(rig, log.rate)
    return described, (reference,)


def _of_references(rig: Rig, references: Sequence[Sensor], part: Free) -> bool:
    names = [sensor.name for sensor in rig.sensors]
    own = tuple(f"sensors.{names.index(reference.name)}." for reference in references)
    return all(path.startswith(own) for path in part.paths)


def _begun(likelihood: Likelihood, rig: Rig) -> Floats:
    """Return the coordinates at which the numbers are those of a rig; 0 for what it has no number of."""
    z = np.zeros(likelihood.size)
    for k, (part, _) in enumerate(likelihood.parts()):
        try:
            value = number(rig, part.paths[0]).value
        except RigError:
            continue  # the reference is a sensor of the fit only
        if not part.logarithmic:
            z[k] = (value - part.start) / part.scale
        elif value > 0.0:
            z[k] = np.log(value / part.start)
        z[k] = np.clip(z[k], *part.bounds)
    return z


def _best_of_starts(likelihood: Likelihood, seed: int, progress: Progress | None) -> Found:
    """Return the best of two searches: from the priors' mean, and from the best of some points drawn from the priors."""
    rng = np.random.default_rng(seed)
    spreads = np.array(
        [0.0 if part.noise else part.spread if part.has_prior else UNKNOWN_SPREAD for part, _ in likelihood.parts()]
    )
    bounds = np.array([part.bounds for part, _ in likelihood.parts()])
    drawn = [np.clip(spreads * rng.normal(size=likelihood.size), *bounds.T) for _ in range(STARTS)]
    first = search(likelihood, np.zeros(likelihood.size), staged(progress, "from the priors"))
    if first.interrupted:
        return first
    costs = [likelihood.cost(z) for z in drawn]
    other = search(likelihood, drawn[int(np.argmin(costs))], staged(progress, "from another start"))
    best = other if other.cost < first.cost else first
    return replace(best, interrupted=other.interrupted, iterations=first.iterations + other.iterations)


def _unidentified(likelihood: Likelihood, uncertainty: Uncertainty) -> list[Free]:
    """Return the shared parameters that the logs do not identify and that have a prior to stay at."""
    return [
        part
        for (part, log), identified in zip(likelihood.parts(), uncertainty.identified)
        if not identified and log is None and part.has_prior and not part.noise
    ]


def _fitted(likelihood: Likelihood, z: Floats, uncertainty: Uncertainty, interrupted: bool) -> list[Fitted]:
    fitted = []
    coordinates = [likelihood.columns(j) for j in range(len(likelihood.data))]
    for k, part in enumerate(likelihood.free):
        places = sorted({columns[k] for columns in coordinates})
        each = np.array([part.value(z[place]) for place in places])
        errors = np.array([uncertainty.errors[place] * part.slope(z[place]) for place in places])
        names = [data.log.source for data in likelihood.data]
        mean = float(each.mean())
        spread = float(np.sqrt(each.var(ddof=1) + np.mean(errors**2))) if len(each) > 1 else float(errors[0])
        if interrupted and part.has_prior:
            spread = max(spread, part.std)  # on the way, slopes say nothing of how far it still is
        share = 1.0 if part.start == 0.0 or len(set(part.starts)) == 1 else 1.0 / part.start
        values = tuple(mean if len(set(part.starts)) == 1 else mean * start * share for start in part.starts)
        fitted.append(
            Fitted(
                part.name,
                part.paths,
                part.si,
                part.start,
                part.std,
                mean,
                spread,
                bool(part.noise or part.per_log or not part.has_prior or uncertainty.identified[places[0]]),
                part.noise,
                values,
                dict(zip(names, map(float, each))) if part.per_log else {},
                part.kept_by_file,
            )
        )
    return fitted


def _kept(part: Free) -> Fitted:
    return Fitted(part.name, part.paths, part.si, part.start, part.std, part.start, part.std, False, False, part.starts)


def _nis(likelihood: Likelihood, z: Floats) -> tuple[float, ...]:
    """Return the mean of ν²/S per channel over all logs."""
    innovations = likelihood.each(z, likelihood.run)
    ratios = np.vstack([values**2 / variances for values, variances in innovations])
    means = [float(np.nanmean(column)) if np.isfinite(column).any() else float("nan") for column in ratios.T]
    return tuple(means)
