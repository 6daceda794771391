"""How twin and filter are held against each other."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from distal import Rig
from distal.arrays import Floats
from distal.estimators import AdaptiveFilter, Robustness, StateKind
from distal.rig import named
from tests.estimators.adaptive.twin import Twin

TOLERANCE = 1e-10
"""Largest difference, relative to each number's size (see `sizes`).

Both do the same arithmetic in another order. That leaves about 1e-13 after a hundred samples, more
where a stiff joint shakes by many times its prior's standard deviation. Any mistake in an equation
shows at 1e-7 or more.
"""


@dataclass(frozen=True)
class Course:
    """What a filter made of a log: means (k, n), covariances (k, n, n), innovations and their
    variances (k, m).
    """

    means: Floats
    covariances: Floats
    innovations: Floats
    variances: Floats
    prior: Floats


def filtered(
    rig: Rig, log: tuple[Floats, Floats], guards: Robustness
) -> tuple[AdaptiveFilter, Course]:
    """Return the filter and its course over a log."""
    time, samples = log
    found = AdaptiveFilter(
        rig, compiled=False, robustness=guards, references=rig.sensors_of("angle")
    )
    belief = found.initial(time[0], samples[0])
    prior = np.sqrt(np.diag(belief.covariance))
    return found, Course(*found.scan(belief, time, samples), prior)


def course_of(twin: Any, log: tuple[Floats, Floats]) -> Course:
    """Return the twin's course over a log."""
    found = twin.run(*log)
    columns = [
        np.array([getattr(s, f) for s in found])
        for f in ("mean", "covariance", "innovations", "variances")
    ]
    return Course(*columns, twin.prior_stds)


def sizes(course: Course) -> Floats:
    """Return by what differences of each state are divided, (k, n).

    It is the prior's standard deviation, or the state's own std or size at that sample where a wild
    reading has made it larger.
    """
    own = np.sqrt(np.einsum("kii->ki", course.covariances))
    return np.maximum(np.maximum(course.prior, own), np.abs(course.means))


def difference(twin: Course, other: Course) -> float:
    """Return the largest difference of means, covariances, innovations and variances, relative to
    their sizes.

    It is infinite where another innovation is left out.
    """
    if not np.array_equal(np.isnan(twin.innovations), np.isnan(other.innovations)):
        return float("inf")
    scale = sizes(other)
    spread = np.sqrt(other.variances)
    parts = [
        np.abs(twin.prior - other.prior) / other.prior,
        np.abs(twin.means - other.means) / scale,
        np.abs(twin.covariances - other.covariances) / (scale[:, :, None] * scale[:, None, :]),
        np.abs(twin.innovations - other.innovations)
        / np.maximum(spread, np.abs(other.innovations)),
        np.abs(twin.variances - other.variances) / other.variances,
    ]
    return max(float(np.nanmax(part, initial=0.0)) for part in parts)


def agree(rig: Rig, log: tuple[Floats, Floats], guards: Robustness, *needed: str) -> Twin:
    """Assert that twin and filter agree, and that the log went through the named branches; return
    the twin.
    """
    found, course = filtered(rig, log, guards)
    twin = Twin(rig, guards, rig.sensors_of("angle"))
    numbered = zip(found.state_names, found.state_kinds, found.state_parts)
    paths = [part if kind is StateKind.PARAMETER else name for name, kind, part in numbered]
    assert [named(rig, state.name) for state in twin.states] == paths
    assert difference(course_of(twin, log), course) < TOLERANCE
    for branch in needed:
        assert twin.taken[branch] > 0, f"'{branch}' was not taken: {dict(twin.taken)}"
    return twin
