"""The reasons not to trust a fit, one sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.estimators import Robustness
from distal.fitting.fitted_parameter import FittedParameter
from distal.fitting.likelihood import Innovations
from distal.fitting.likelihood_search import Optimum, search
from distal.fitting.problem import Problem

LARGEST_NIS = 5.0
"""Mean ν²/S from which on a log does not look like its rig."""

LARGEST_LACK = 100.0
"""The same where equations are asked: smoothed motion alone leaves several times a sensor's noise.
"""

LARGEST_NOISE_GROWTH = 4.0
"""If a sensor's noise has to grow by this factor, the sensor is not the cause."""

LARGEST_UNMODELLED_GROWTH = 6.0
"""If unmodelled motion has to grow by this factor, it explains most of the motion."""

FAR_FROM_PRIOR = 4.0
"""A value this many prior standard deviations away from its prior is reported."""

FAR_FROM_FACTOR = 2.0
"""The same for a number known within a factor: a change by the square of that factor is improbable.
"""

CONTRADICTORY = 2.0
"""Logs contradict each other if the innovations of one are this much larger than with numbers of
its own.
"""

FEW_ITERATIONS = 4

ADVICE = (
    "the rig lacks physics that these logs have, or a column, unit or sign of a sensor is wrong "
    "(distal estimate says "
    "which disagrees)"
)

NOT_CONVERGED = (
    "the search stopped before it converged, so that no standard error is known; start closer "
    "(--start), or fix what "
    "the logs cannot tell (hold = true)"
)


def nis_of(problem: Problem, z: Floats) -> tuple[float, ...]:
    """Return the mean of ν²/S per channel over all logs at coordinates z, (n,)."""
    ratios = np.vstack([run.values**2 / run.variances for run in problem.at(z)])
    return tuple(
        float(np.nanmean(column)) if np.isfinite(column).any() else float("nan")
        for column in ratios.T
    )


def doubts_of(problem: Problem, z: Floats, nis: Sequence[float]) -> list[str]:
    """Return sentences on where logs still do not agree with the rig at the end z of a fit, with
    such mean ν²/S (`nis`).
    """
    references = {sensor.name for sensor in problem.filter.references}
    limit = LARGEST_LACK if problem.asks_equations else LARGEST_NIS
    doubts = [
        f"the logs do not look like this rig: innovations of '{name}' are {np.sqrt(ratio):.3g} "
        "times larger than expected "
        f"even after the fit; {ADVICE}"
        for name, ratio in zip(problem.measured, nis)
        if ratio > limit and name not in references
    ]
    for (part, _), at in zip(problem.parts, z):
        if not (part.noise and part.has_prior):
            continue
        growth = part.value(float(at)) / part.start
        text = (
            f"the logs do not look like this rig: {part.name} had to become {growth:.1f} times "
            "what the rig says"
        )
        if part.paths[0].endswith(".unmodelled") and growth > LARGEST_UNMODELLED_GROWTH:
            doubts.append(f"{text}, so that the joint hardly follows the model; {ADVICE}")
        if (
            part.paths[0].startswith("sensors.")
            and not part.kept_by_file
            and growth > LARGEST_NOISE_GROWTH
        ):
            doubts.append(f"{text}; {ADVICE}")
    return doubts


def far_from_priors(parameters: Sequence[FittedParameter], problem: Problem) -> list[str]:
    """Return warnings on values far from their priors, or at a bound."""
    free_by_name = {part.name: part for part in problem.free}
    lines = []
    for part in parameters:
        if part.noise:
            continue
        free = free_by_name[part.name]
        away = abs(free.coordinate(part.value)) / free.spread if part.prior_std > 0.0 else 0.0
        if away > (FAR_FROM_FACTOR if free.logarithmic else FAR_FROM_PRIOR):
            lines.append(
                f"{part.name} = {part.value:.4g} {part.si} is {away:.1f} standard deviations from "
                "what the rig file "
                f"expected ({part.start:.4g} ± {part.prior_std:.2g}); is a unit or a radius "
                "wrong, or the std too small?"
            )
        elif part.value <= free.low or part.value >= free.high:
            lines.append(
                f"{part.name} = {part.value:.4g} {part.si} is at its bound; another number of the "
                "rig may be wrong"
            )
    return lines


def parameter_contradictions(problem: Problem, optimum: Optimum) -> list[str]:
    """Return a doubt about logs that can be explained only with their own parameters: one sentence,
    or none.

    A log is fitted alone, begun at the optimum of all, its noise as it is.
    """
    worst = CONTRADICTORY
    sentences = list[str]()
    for j, data in enumerate(problem.data):
        alone = problem.among([j])
        at = problem.columns(j)
        start = optimum.z[[at[problem.free.index(part)] for part, _ in alone.parts]]
        noise = np.array([part.noise for part, _ in alone.parts])
        alone_optimum = search(alone.assessed(start), start, most=FEW_ITERATIONS, fixed=noise)
        if alone_optimum.interrupted:
            raise KeyboardInterrupt  # the caller has the numbers of all logs
        with np.errstate(invalid="ignore", divide="ignore"):
            ratio = float(
                np.nanmax(
                    _sizes(alone.at(start)[0]) / _sizes(alone.at(alone_optimum.z)[0]), initial=0.0
                )
            )
        if ratio > worst:
            limits = np.where(np.isfinite(alone.prior_stds), alone.prior_stds, 1.0)
            k = int(np.argmax(np.abs(alone_optimum.z - start) / limits))
            part, _ = alone.parts[k]
            worst = ratio
            desired = f"{part.name} = {part.value(alone_optimum.z[k]):.4g} {part.si}".rstrip()
            sentences = [
                f"contradictory logs: {Path(data.log.source).name} fits {ratio:.1f} times better "
                "with numbers of its own "
                f"({desired}, all logs together {part.value(start[k]):.4g}); was something changed "
                "between the logs? Fit "
                "them apart, or give each its own with --per-log"
            ]
    return sentences


def _sizes(run: Innovations) -> Floats:
    """Return the RMS innovation per channel, outliers limited."""
    limited = np.minimum(run.values**2, Robustness().wild_force * run.variances)
    return np.array([np.sqrt(np.nanmean(c)) if np.isfinite(c).any() else np.nan for c in limited.T])
