"""Standard errors of a fit, and the reasons not to trust it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from distal.arrays import Bools, Floats
from distal.fitting.free_parameter import FittedParameter
from distal.fitting.likelihood import Derivatives
from distal.fitting.likelihood_search import hessian
from distal.fitting.objective import Problem


def covariance_at(problem: Problem, derivatives: Derivatives, z: Floats) -> Floats:
    """Return the covariance of the coordinates' errors at the end z of a fit, (n,).

    It is H⁻¹ (J + P) H⁻¹ with H = I + P, I Fisher's information, P the prior's and J the long-run
    covariance of the scores, but no less than H⁻¹; the variances of `Free.coarse` are added.
    """
    inverse = np.linalg.pinv(hessian(problem, derivatives), hermitian=True)
    # few spans of time tell too small a variance (MacKinnon and White, J. Econometrics 29, 1985)
    few = derivatives.spans / max(derivatives.spans - problem.size, 1)
    sandwich = inverse @ (few * derivatives.meat + problem.prior_information) @ inverse
    variances = np.maximum(np.diag(sandwich), np.diag(inverse))
    scale = np.sqrt(variances / np.maximum(np.diag(inverse), 1e-300))
    covariance = np.asarray(inverse * np.outer(scale, scale), dtype=np.float64)
    coarse = [
        part.coarse * abs(part.value(c)) / max(part.slope(c), 1e-300)
        for (part, _), c in zip(problem.parts, z)
    ]
    covariance += np.diag(np.square(coarse))
    # no error is larger than the prior's std
    stds = np.maximum(np.sqrt(np.diag(covariance)), 1e-300)
    shrink = np.minimum(1.0, problem.prior_stds / stds)
    covariance *= np.outer(shrink, shrink)
    return covariance


def errors_holding(covariance: Floats, held: Bools) -> Floats:
    """Return the standard errors with this `covariance`, (n, n), if the `held` coordinates are
    taken as known, (n,); 0 for those.
    """
    errors = np.zeros(len(held))
    free = ~held
    across = covariance[np.ix_(free, held)]
    # errors may be exactly correlated: then the covariance has no inverse
    of_held = np.linalg.pinv(covariance[np.ix_(held, held)], hermitian=True)
    left = np.diag(covariance)[free] - np.diag(across @ of_held @ across.T)
    errors[free] = np.sqrt(np.maximum(left, 0.0))
    return errors


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

ADVICE = (
    "the rig lacks physics that these logs have, or a column, unit or sign of a sensor is wrong "
    "(distal estimate says "
    "which disagrees)"
)

NOT_CONVERGED = (
    "the search stopped before it converged, so that no standard error is known; start closer, or "
    "fix what the logs cannot tell (hold = true)"
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
