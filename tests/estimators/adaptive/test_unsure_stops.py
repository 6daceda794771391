"""Numbers of the rig are not learned while nobody knows whether a joint is held by its stop,
(24b).
"""

from __future__ import annotations

from collections.abc import Callable, Iterator

import casadi as ca
import numpy as np
import pytest

from distal import Log, load_rig, make_estimator, simulate
from distal.estimators import AdaptiveFilter, StateKind
from distal.estimators.adaptive import filter_function as adaptive_filter
from distal.estimators.adaptive import update
from distal.kernels import forget
from distal.run import samples_of
from distal.simulation import build_scenario

STD = np.deg2rad(2.0)


@pytest.mark.parametrize(
    ("joint", "away", "expected"),
    [
        ("dip", 0.1, 0),
        ("dip", 1.9, 0),
        ("dip", 2.1, 1),
        ("dip", -0.5, 1),
        ("mcp", 1.0, 0),
        ("mcp", 9.0, 1),
    ],
)
@pytest.mark.parametrize("end", [0, 1])
def test_a_joint_just_before_its_stop_may_be_held_by_it(
    joint: str, away: float, expected: int, end: int
) -> None:
    """In the stop, and further away than two standard deviations, it is known."""
    rig = load_rig("finger-underactuated")
    estimator = make_estimator("adaptive", rig)
    assert isinstance(estimator, AdaptiveFilter)
    states, j = estimator.states, [each.name for each in rig.joints].index(joint)
    mean, covariance = np.zeros(len(states)), np.eye(len(states))
    mean[:3], covariance[:3, :3] = 0.5, STD**2 * np.eye(3)
    stops = rig.joints[j].stops
    assert stops is not None
    mean[j] = stops[end] + (1.0, -1.0)[end] * away * STD
    symbols = [
        ca.MX.sym("m", len(mean)),
        ca.MX.sym("P", *covariance.shape),
        ca.MX.sym("p", estimator.parameters.size),
    ]
    (sure,) = update.sure_of_stops(states, *symbols)
    assert (
        float(ca.Function("sure", symbols, [sure])(mean, covariance, estimator.parameters))
        == expected
    )


@pytest.fixture
def built() -> Iterator[Callable[[], AdaptiveFilter]]:
    """Return what builds the filter anew, with what a test has put in its place."""
    adaptive_filter.adaptive_function.cache_clear()
    forget()
    yield lambda: AdaptiveFilter(load_rig("finger-underactuated"), compiled=False)
    adaptive_filter.adaptive_function.cache_clear()
    forget()


@pytest.mark.parametrize("sure", [0.0, 1.0])
def test_an_unsure_joint_teaches_no_numbers(
    sure: float, built: Callable[[], AdaptiveFilter], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(update, "sure_of_stops", lambda *_: [ca.MX(sure)])
    estimator, log = built(), moved()
    parameters = [i for i, kind in enumerate(estimator.state_kinds) if kind is StateKind.PARAMETER]
    samples = samples_of(log, estimator.channels)
    start = estimator.initial(log.time[0], samples[0])
    means, covariances, _, _ = estimator.scan(start, log.time, samples)
    stds = np.sqrt(np.diagonal(covariances, axis1=1, axis2=2))
    assert (np.ptp(means[:, parameters], axis=0).max() > 0.0) == bool(sure)
    # what is not learned stays as unsure as it was
    assert (stds[-1, parameters] < 0.999 * stds[0, parameters]).any() == bool(sure)


def moved() -> Log:
    """Return a log of a finger that is flexed."""
    servo = {"angle": {"points": [[0.0, 1.0], [0.4, 2.0]]}, "stiffness": 20.0, "damping": 0.3}
    description = {
        "rig": "finger-underactuated",
        "duration": 0.5,
        "drives": {"flexor": {"servo": servo}},
    }
    return simulate(load_rig("finger-underactuated"), build_scenario(description, "s"), 1)
