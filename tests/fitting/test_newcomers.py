"""Rigs of a newcomer: plants without inertia, of one joint and of a finger, by code that shares
nothing with the model.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, estimate, fit
from distal.fitting import Fit, Options
from distal.fitting.inverse_dynamics import inverse_problem
from distal.fitting.parameter_search import most_likely, problem_of
from distal.rig import build_rig
from tests.support.drawn_logs import FITTED, logs_of
from tests.support.drawn_rigs import Drawn, drawn_rig

pytestmark = pytest.mark.slow


def drawn(seed: int) -> tuple[Drawn, Rig, list[Log]]:
    described = drawn_rig(seed, False)
    logs, _ = logs_of(described, seed)
    short = [log.select(slice(0, 600)) for log in logs[:FITTED]]
    return described, build_rig(described.raw, f"drawn {seed}"), [*short, *logs[FITTED:]]


@pytest.fixture(scope="module")
def finger() -> tuple[Drawn, Rig, list[Log], Fit]:
    """Two joints, three tendons, no inertia in the plant."""
    described, rig, logs = drawn(0)
    return described, rig, logs, fit(logs[:FITTED], rig)


@pytest.mark.more
def test_a_finger_without_inertia_converges(finger: tuple[Drawn, Rig, list[Log], Fit]) -> None:
    """Nine of ten told numbers within two standard errors, and the angle on logs that were not
    seen.
    """
    described, _, logs, found = finger
    assert found.converged
    close = [
        abs(value - described.truth[path]) <= 2.0 * part.error
        for part in found.fitted
        if not part.noise
        for path, value in zip(part.paths[:1], part.values)
        if path in described.truth
    ]
    assert len(close) >= 10
    assert np.mean(close) >= 0.8
    for log in logs[FITTED:]:
        result = estimate(log, found.rig, compiled=False)
        assert np.rad2deg(result.rms_error()) < 0.1
        assert result.inside_band() >= 0.9


def test_other_starts_end_no_lower() -> None:
    """The equations' −ln p has one end, wherever the search begins within a prior std."""
    _, rig, logs = drawn(0)
    problem = inverse_problem(problem_of(logs[:FITTED], rig, Options()))
    assert problem is not None
    _, found = most_likely(problem, np.zeros(problem.size))
    assert found.converged
    rng = np.random.default_rng(4)
    for _ in range(2):
        begin = np.clip(0.3 * rng.normal(size=problem.size), *problem.bounds.T)
        again, other = most_likely(problem, begin)
        assert again.costs([found.z])[0] > other.cost - 0.5


@pytest.mark.more
def test_a_joint_with_inertia_is_found() -> None:
    described, rig, logs = drawn(1)
    found = fit(logs[:FITTED], rig)
    assert found.converged
    stiffness = found["tendons.*.stiffness"]
    assert stiffness.value == pytest.approx(described.truth["tendons.0.stiffness"], rel=0.02)
    assert (
        max(
            np.rad2deg(estimate(log, found.rig, compiled=False).rms_error())
            for log in logs[FITTED:]
        )
        < 0.12
    )
