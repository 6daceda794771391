"""The parameters that logs tell without some of them, computed from those of all logs.

Correction maps learn the errors of the filter's angle. On logs that its parameters were fitted to,
the filter errs less than on others, so each log is filtered with the parameters that the other logs
tell (level-one data of stacking; Wolpert, Neural Networks 5, 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distal.fitting.likelihood_search import search
from distal.fitting.parameter_estimates import ParameterEstimates, fitted_parameters
from distal.logs import Log
from distal.regression import splits

NEWTON_STEPS = 1
"""Number of Newton steps from the parameters of all logs, where the slopes of each log are known
(the infinitesimal jackknife). Source: reference (Giordano et al., AISTATS 2019).
"""


def parameters_without(
    parameters: ParameterEstimates, logs: Sequence[Log], folds: Sequence[int]
) -> list[ParameterEstimates]:
    """Return for each fold the parameters that the logs of the other folds tell; with one fold,
    those of all logs.

    The `folds` are those of `logs`, the logs of known angle.
    """
    if len(set(folds)) < 2 or not parameters.optimum.derivatives.of_logs:
        return [parameters] * len(set(folds))
    return [without(parameters, [logs[i] for i in out]) for out, _ in splits(folds)]


def without(parameters: ParameterEstimates, logs: Sequence[Log]) -> ParameterEstimates:
    """Return the parameters that all logs but some tell, `logs`; which of them are fitted, and
    their stds, stay those of all logs.
    """
    problem = parameters.problem
    optimum = parameters.optimum
    uncertainty = parameters.uncertainty
    out = [any(data.log is log for log in logs) for data in problem.data]
    remaining = problem.among([j for j, gone in enumerate(out) if not gone])
    columns = np.array(
        [k for k, (_, log) in enumerate(problem.parts) if log is None or not out[log]]
    )
    of_logs = [
        derivatives for derivatives, gone in zip(optimum.derivatives.of_logs, out) if not gone
    ]
    at = remaining.summed(of_logs, optimum.z[columns])
    again = search(
        remaining,
        optimum.z[columns],
        most=NEWTON_STEPS,
        fixed=parameters.left[columns],
        at_start=at,
    )
    if again.interrupted:
        raise KeyboardInterrupt  # a search that was interrupted judges nothing
    square = np.ix_(columns, columns)
    determined = uncertainty.determined[columns]
    together = uncertainty.together[columns]
    covariance = uncertainty.covariance[square]
    errors = replace(uncertainty, covariance=covariance, determined=determined, together=together)
    left = parameters.left[columns]
    held = parameters.held[columns]
    fitted = tuple(
        fitted_parameters(
            remaining, replace(again, converged=optimum.converged), errors, left, held
        )
    )
    return replace(
        parameters,
        problem=remaining,
        optimum=again,
        uncertainty=errors,
        fitted=fitted,
        left=left,
        held=held,
    )
