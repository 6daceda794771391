"""Do logs agree? Each is fitted on its own too, and its innovations compared."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distal.fitting.free import Free
from distal.fitting.likelihood import Likelihood
from distal.fitting.search import Found, search
from distal.logs import Log

Floats = NDArray[np.float64]
Progress = Callable[[str, int, float], None]

FEW_ITERATIONS = 6
"""So many iterations take a search from the optimum of all logs to that of some of them."""

DISAGREE = 2.0
"""Logs contradict each other if the innovations of one are this much larger than with parameters of its own."""


def staged(progress: Progress | None, stage: str) -> Callable[[int, float], None] | None:
    """Return what a search tells of its progress, with the stage's name.

    Args:
        progress: called with the stage, the iteration and −ln p; None for nothing.
        stage: its name.
    """
    return None if progress is None else lambda iteration, cost: progress(stage, iteration, cost)


def disagreement(
    likelihood: Likelihood,
    found: Found,
    made: Callable[[Sequence[Free], Sequence[Log]], Likelihood],
    logs: Sequence[Log],
    progress: Progress | None,
) -> list[str]:
    """Return what is to be said of logs that only parameters of their own explain: a sentence, or none.

    Args:
        likelihood: of all logs.
        found: where its search ended.
        made: returns the likelihood of some numbers and logs.
        logs: all of them.
        progress: called with the stage, the iteration and −ln p.
    """
    parts = tuple(replace(part, per_log=False) for part in likelihood.free if not part.noise)
    at = [k for k, part in enumerate(likelihood.free) if not part.noise]
    worst: tuple[float, str, str] = (0.0, "", "")
    for j, log in enumerate(logs):
        own = made(parts, [log])
        shared = found.z[likelihood.columns(j)]
        start = shared[at]
        alone = search(own, start, staged(progress, f"does {Path(log.source).name} agree"), FEW_ITERATIONS)
        if alone.interrupted:
            return []
        together, apart = _sizes(own, start), _sizes(own, alone.z)
        ratio = float(np.nanmax(together / apart))
        moved = int(np.argmax(np.abs(alone.z - start) * [1.0 / p.spread if p.has_prior else 1.0 for p in parts]))
        if ratio > worst[0]:
            wanted = f"{parts[moved].name} = {parts[moved].value(alone.z[moved]):.4g} {parts[moved].si}".rstrip()
            worst = (ratio, log.source, f"{wanted}, all logs together {parts[moved].value(start[moved]):.4g}")
    if worst[0] <= DISAGREE:
        return []
    return [
        f"contradictory logs: {worst[1]} fits {worst[0]:.1f} times better with parameters of its own ({worst[2]}); was "
        "something changed between the logs? Fit them apart, or give each its own with --per-log"
    ]


def _sizes(likelihood: Likelihood, z: Floats) -> Floats:
    """Return the RMS innovation per channel of a likelihood of one log."""
    values, variances = likelihood.run(0, z)
    limited = np.minimum(values**2, 9.0 * variances)
    return np.array([np.sqrt(np.nanmean(c)) if np.isfinite(c).any() else np.nan for c in limited.T])
