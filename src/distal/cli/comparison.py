"""What several estimators find in one log, beside the truth where it is known."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from math import degrees
from typing import TYPE_CHECKING

from distal.cli.console import continue_on_failure, say, table, working
from distal.confidence import BAND, COVERED_TEXT
from distal.errors import DistalError, DivergedError

if TYPE_CHECKING:
    from distal.logs import Log
    from distal.results import Estimate
    from distal.rig import Rig


@dataclass
class Comparison:
    """What estimators found: estimates, rows of the table of errors, and why others failed."""

    results: list[Estimate] = field(default_factory=list)
    rows: list[tuple[str, ...]] = field(default_factory=list)
    notes: dict[str, None] = field(default_factory=dict)
    failed: dict[str, str] = field(default_factory=dict)


def compared(
    log: Log,
    rig: Rig,
    names: list[str],
    home: float | None,
    unasked: bool,
    smooth: bool,
    every: bool,
) -> Comparison:
    """Return what the estimators find, the smoothed estimate first where it is asked for.

    Where the first estimator fails, the others are still shown before its error is raised. In a
    comparison that was not asked for, only the first estimate stays in memory; with `every` it has
    all states, not only angles and torques.
    """
    from distal.estimators.regression_estimator import NEEDS
    from distal.run import estimate
    from distal.run import smooth as smoothed

    found = Comparison()
    runs: dict[str, Callable[..., Estimate]] = {
        name: partial(estimate, log, rig, name, homing=home, covariances=False, every=every)
        for name in names
    }
    if smooth:
        runs = {"smoothing": partial(smoothed, log, rig)} | runs
    # in a comparison by default, an estimator that cannot run is a row with what it needs
    has_map = rig.map is not None and rig.map.readings
    if unasked and not has_map and home is None and "regression" in runs:
        del runs["regression"]
        found.failed["regression"] = f"regression {NEEDS}"
    lost: DistalError | None = None
    with working("estimating") as show:
        for name, run in runs.items():
            show(f"estimating with {name}")
            try:
                result = run()
            except DistalError as problem:
                # some errors have the name
                found.failed[name] = f"{name}: {str(problem).removeprefix(f'{name}: ')}"
                lost = lost or (problem if name == next(iter(runs)) else None)
                continue
            found.notes |= dict.fromkeys(result.notes)
            if result.truths is not None:
                found.rows.append(_row(result))
            if not (unasked and found.results):
                found.results.append(result)
    if lost is not None:
        if found.rows:
            say_errors(found)
        raise _explained(lost, log, rig, home) if isinstance(lost, DivergedError) else lost
    return found


def _explained(problem: DivergedError, log: Log, rig: Rig, home: float | None) -> DivergedError:
    """Return the error of an estimate that left all bounds, with what would explain it in front, if
    anything would.
    """
    from distal.diagnosis import why_diverged

    causes = ""
    doing = "looking for what made the estimate leave all bounds"
    with continue_on_failure(doing), working(doing):
        causes = "; ".join(finding.text for finding in why_diverged(log, rig, home))
    return DivergedError(f"{causes}: {problem}") if causes else problem


def half_of_band(result: Estimate) -> float:
    """Return the median half-width of an estimate's band [°]."""
    import numpy as np

    return degrees(BAND * float(np.median(result.angle_stds)))


def half_in_words(result: Estimate, digits: int = 3) -> str:
    """Return the median half-width of an estimate's band [°] in words."""
    from distal.results import UNKNOWN

    half = half_of_band(result)
    return f"±{half:.{digits}f}" if half <= UNKNOWN else "not known"


def _row(result: Estimate) -> tuple[str, ...]:
    """Return the cells of an estimate in the table of errors."""
    return (
        result.estimator,
        f"{degrees(result.rms_error()):.3f}",
        f"{degrees(result.max_error()):.3f}",
        f"{100 * result.inside_band():.0f} %",
        half_in_words(result),
    )


def say_errors(comparison: Comparison) -> None:
    """Print the errors of each estimator as a table, and the reasons of those that failed."""
    table(
        "error against truth",
        [
            "estimator",
            "RMS [°]",
            "maximum [°]",
            f"inside {COVERED_TEXT} band",
            "median band [°]",
        ],
        [*comparison.rows, *((name, "–", "–", "–", "–") for name in comparison.failed)],
    )
    for reason in comparison.failed.values():
        say(reason)
