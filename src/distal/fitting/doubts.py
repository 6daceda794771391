"""The reasons not to trust a fit, one sentence each."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from distal.arrays import Floats
from distal.fitting.free_parameter import FittedParameter
from distal.fitting.likelihood import Innovations
from distal.fitting.likelihood_search import FIRST_ITERATIONS, Optimum, search
from distal.fitting.problem import Problem

LARGEST_NIS = 5.0
"""Mean ν²/S of a channel of the filter, above which the logs do not look like the rig. Source:
judgement.
"""

LARGEST_NOISE_GROWTH = 4.0
"""Factor by which the fit enlarges a sensor's noise, above which the sensor is not the cause.
Source: judgement.
"""

FAR_FROM_PRIOR = 4.0
"""Distance of a value from its prior, in the prior's standard deviations, above which it is
reported. Source: judgement.
"""

FAR_FROM_FACTOR = 2.0
"""The same distance for a parameter that is known within a factor, where a change by the square of
that factor is improbable. Source: judgement.
"""

CONTRADICTORY = 2.0
"""Ratio of a log's median innovation with the parameters of all logs to that with parameters of its
own, above which the logs contradict each other. Source: judgement.
"""

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
    """Return sentences on where logs still do not agree with the rig at the end z of a fit, (n,).

    `nis` is the mean ν²/S there, see `nis_of`; that of the equations says nothing of the angle,
    which logs left out judge.
    """
    references = {sensor.name for sensor in problem.filter.references}
    doubts = [
        f"the logs do not look like this rig: innovations of '{name}' are {np.sqrt(ratio):.3g} "
        "times larger than expected "
        f"even after the fit; {ADVICE}"
        for name, ratio in zip(problem.measured, nis)
        if ratio > LARGEST_NIS and name not in references and not problem.asks_equations
    ]
    for (part, _), at in zip(problem.parts, z):
        if not (part.noise and part.has_prior):
            continue
        growth = part.value(float(at)) / part.start
        text = (
            f"the logs do not look like this rig: {part.name} had to become {growth:.1f} times "
            "what the rig says"
        )
        if part.paths[0].endswith(".unmodelled") and growth > LARGEST_NOISE_GROWTH:
            doubts.append(f"{text}, so that the joint hardly follows the model; {ADVICE}")
        if (
            part.paths[0].startswith("sensors.")
            and not part.kept_by_file
            and growth > LARGEST_NOISE_GROWTH
        ):
            doubts.append(f"{text}; {ADVICE}")
    return doubts


def far_from_priors(parameters: Sequence[FittedParameter], problem: Problem) -> list[str]:
    """Return warnings on fitted parameters that are far from their priors, or at a bound."""
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
    """Return a sentence on the log that contradicts the others most, or nothing.

    Each log is fitted alone, from the optimum of all logs, with its noise as it is there. A log
    contradicts the others where that makes its innovations much smaller.
    """
    worst = CONTRADICTORY
    sentences = list[str]()
    for j, data in enumerate(problem.data):
        alone = problem.among([j])
        at = problem.columns(j)
        start = optimum.z[[at[problem.free.index(part)] for part, _ in alone.parts]]
        noise = np.array([part.noise for part, _ in alone.parts])
        alone_optimum = search(alone.assessed(start), start, most=FIRST_ITERATIONS, fixed=noise)
        if alone_optimum.interrupted:
            raise KeyboardInterrupt  # the caller has the parameters of all logs
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
    """Return the median size of each channel's innovations, (m,), which outliers do not change."""
    sizes = np.abs(run.values)
    return np.array([np.nanmedian(c) if np.isfinite(c).any() else np.nan for c in sizes.T])
