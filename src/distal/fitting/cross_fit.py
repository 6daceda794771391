"""Cross-fitting: what the filter makes of each log with numbers that have not seen it.

Maps learn what the filter's angle lacks. On logs that its numbers were fitted to it lacks less than on others, so each log
is filtered with the numbers that the other logs tell (level-one data of stacking; Wolpert, Neural Networks 5, 1992).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from distal.fitting.numbers import Numbers, fitted_numbers
from distal.fitting.search import search
from distal.logs import Log

WARM_ITERATIONS = 4
"""The search without some logs begins where that with all of them ended; more iterations gained less than 1 of −ln p on
three of four rigs (docs/results/fits.md)."""


def cross_fit(numbers: Numbers, known: Sequence[Log], folds: Sequence[int]) -> list[Numbers]:
    """Return for each fold the numbers that the logs of the others tell; those of all logs where there is one fold.

    Args:
        numbers: that all logs tell.
        known: logs with a truth.
        folds: of these.
    """
    count = len(set(folds))
    if count < 2 or numbers.found.interrupted:
        return [numbers] * count
    found = list[Numbers]()
    for fold in range(count):
        found.append(without(numbers, [log for log, own in zip(known, folds) if own == fold]))
        if found[-1].found.interrupted:
            return [found[-1]] * count  # the caller ends there
    return found


def without(numbers: Numbers, logs: Sequence[Log]) -> Numbers:
    """Return the numbers that the other logs tell; which of them are fitted, and their stds, stay those of all logs.

    Args:
        numbers: that all logs tell.
        logs: that are left out.
    """
    problem, found, known = numbers.problem, numbers.found, numbers.uncertainty
    out = [any(data.log is log for log in logs) for data in problem.data]
    rest = replace(problem, data=tuple(data for data, gone in zip(problem.data, out) if not gone))
    own = np.array([k for k, (_, log) in enumerate(problem.parts) if log is None or not out[log]])
    at = rest.summed([one for one, gone in zip(found.derivatives.of_logs, out) if not gone], found.z[own])
    again = search(rest, found.z[own], most=WARM_ITERATIONS, fixed=numbers.left[own], known=at, central=False)
    square = np.ix_(own, own)
    errors = replace(known, covariance=known.covariance[square], told=known.told[own], together=known.together[own])
    left, held = numbers.left[own], numbers.held[own]
    fitted = tuple(fitted_numbers(rest, replace(again, converged=found.converged), errors, left, held))
    return replace(numbers, problem=rest, found=again, uncertainty=errors, fitted=fitted, left=left, held=held)
