"""Between two slack tendons a joint lies within the play that they leave it, (26b); by hand in
NumPy.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
import pytest

from distal import Rig, load_rig
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.drive_tracking import REMEMBERED, TRACKED
from distal.estimators.adaptive.filter_inputs import Interval
from distal.estimators.adaptive.prediction import slack_pair_function, slack_pairs, within_play
from distal.rig.hand_tables import Row, hand_of
from distal.sensor_models import variance

SPOOL, ARM, SLACK, STIFFNESS, SOFTER, NOISE, FRICTION = 8e-3, 10e-3, 1e-3, 2e4, 1e4, 0.02, 0.03
POSITION = 0.4
"""Of the motor [rad]."""


def rig() -> Rig:
    row = Row(
        joint="knuckle",
        motor="one",
        low=-0.5,
        high=1.5,
        spool_radius=SPOOL,
        joint_radius=ARM,
        back="tendon",
    )
    changes = {
        "drives.0.friction": {"constant": {"value": FRICTION, "std": 0.0}},
        "drives.0.radius": {"value": SPOOL, "std": 0.0},
        "sensors.one_current.noise": NOISE,
        "tendons.*.slack": {"value": SLACK, "std": 0.5e-3},
        "tendons.0.stiffness": {"value": STIFFNESS, "std": 0.0},
        "tendons.1.stiffness": {"value": SOFTER, "std": 0.0},
        "tendons.*.pretension": {"value": 0.0, "std": 0.0},
    }
    return hand_of([row], "hand", "table").rig.bare().with_values(changes)


@pytest.fixture(scope="module")
def estimator() -> AdaptiveFilter:
    return AdaptiveFilter(rig(), compiled=False)


def asked(
    estimator: AdaptiveFilter, angle: float, torque: float, there: float = 1.0, lost: float = 0.0
) -> list[Any]:
    """Return state, tracks, sample and parameters with the joint and the motor somewhere."""
    state = np.array(estimator.states.means)
    state[0] = angle
    tracks = np.zeros(len(TRACKED))
    tracks[0], tracks[REMEMBERED.index("lost")] = POSITION, lost
    force = np.array([name == "one_current" for name in estimator.states.context.channels.names])
    x = np.concatenate([[0.01], torque * force, np.where(force, there, 1.0)])
    return [state, tracks, x, estimator.parameters]


@pytest.mark.parametrize("torque", [0.0, 0.05, -0.05])
@pytest.mark.parametrize("angle", [0.3, 0.35])
def test_a_play_is_as_wide_as_slack_and_the_most_stretch(
    estimator: AdaptiveFilter, torque: float, angle: float
) -> None:
    [(drive, *pair)] = slack_pairs(estimator.states.context)
    given = asked(estimator, angle, torque)
    residual, width, known, slope = slack_pair_function(estimator.states, drive, pair)(*given)
    [sensor] = rig().sensors_of("force")
    most = (abs(torque) + FRICTION + 3 * np.sqrt(variance(sensor))) / SPOOL
    let_in = SPOOL * POSITION - ARM * angle  # of the tendon that the motor winds
    names = [f"slack of tendon {tendon.name}" for tendon in rig().tendons]
    slack = [given[0][estimator.state_names.index(name)] for name in names]
    one, other = let_in - slack[0] - most / STIFFNESS, -let_in - slack[1] - most / SOFTER
    assert float(residual) == pytest.approx((one - other) / 2, rel=1e-6)
    assert float(width) == pytest.approx(-(one + other), rel=1e-6)
    assert float(width) > 2 * SLACK
    assert bool(known)
    by_name = dict(zip(estimator.state_names, np.array(ca.DM(slope)).ravel()))
    assert by_name["theta"] == pytest.approx(-ARM)
    assert [by_name[name] for name in names] == pytest.approx([-0.5, 0.5])


def confined(estimator: AdaptiveFilter, given: list[Any], covariance: Any) -> tuple[Any, Any]:
    state, tracks, x, p = (ca.MX.sym(name, len(value)) for name, value in zip("stxp", given))
    matrix = ca.MX.sym("P", *covariance.shape)
    after = within_play(estimator.states, state, matrix, Interval(tracks, ca.MX(0), x, p))
    mean, matrix_after = ca.Function(
        "within", [state, matrix, tracks, x, p], [ca.MX(part) for part in after]
    )(given[0], covariance, *given[1:])
    return np.array(mean).ravel(), np.array(matrix_after)


def covariance_of(estimator: AdaptiveFilter, std: float) -> Any:
    n = len(estimator.states)
    mixed = 0.2 * np.random.default_rng(3).normal(size=(n, n)) + np.eye(n)
    stds = 0.1 * np.array(estimator.states.stds)
    stds[:2] = std, 0.1
    scaled = mixed @ mixed.T
    stds /= np.sqrt(np.diag(scaled))
    return scaled * np.outer(stds, stds)


def test_who_is_less_sure_than_the_play_becomes_as_sure_as_it(estimator: AdaptiveFilter) -> None:
    """By hand: with V = w²/12, S = g P gᵀ the gain is P g (S − V)/S², of which numbers of the rig
    take none.
    """
    [(drive, *pair)] = slack_pairs(estimator.states.context)
    given, before = asked(estimator, 0.0, 0.0), covariance_of(estimator, 1.0)
    residual, width, _, slope = slack_pair_function(estimator.states, drive, pair)(*given)
    g, most = np.array(ca.DM(slope)).ravel(), float(width) ** 2 / 12
    s = g @ before @ g
    assert s > most
    gain = before @ g * (s - most) / s**2
    identified = [i for i in range(len(g)) if i >= 2 and i not in estimator.states.torque_states]
    gain[identified] = 0.0
    mean, after = confined(estimator, given, before)
    np.testing.assert_allclose(mean, given[0] - gain * float(residual), rtol=1e-9, atol=1e-12)
    # Joseph's form with the noise R for which S + R = S²/(S − V)
    noise = s**2 / (s - most) - s
    kept = np.eye(len(g)) - np.outer(gain, g)
    np.testing.assert_allclose(
        after, kept @ before @ kept.T + noise * np.outer(gain, gain), rtol=1e-7, atol=1e-14
    )
    assert np.sqrt(after[0, 0]) < 0.2
    np.testing.assert_array_equal(mean[identified], given[0][identified])


@pytest.mark.parametrize(
    ("std", "there", "lost"),
    [(0.01, 1.0, 0.0), (1.0, 0.0, 0.0), (1.0, 1.0, 0.1)],
    ids=["it is surer", "its force is not read", "its place is not read"],
)
def test_else_nothing_changes(
    estimator: AdaptiveFilter, std: float, there: float, lost: float
) -> None:
    given = asked(estimator, 0.3, 0.0, there, lost)
    before = np.diag(np.diag(covariance_of(estimator, std)))
    before[2:, 2:] *= 0.01
    mean, after = confined(estimator, given, before)
    np.testing.assert_array_equal(mean, given[0])
    np.testing.assert_array_equal(after, before)


def test_only_pairs_that_may_be_slack_are_asked(estimator: AdaptiveFilter) -> None:
    assert list(slack_pairs(estimator.states.context)) == [(0, 0, 1)]
    taut = rig().with_values({"tendons.*.slack": {"value": 0.0, "std": 0.0}})
    for other in (taut, *map(load_rig, ("paper-2008", "finger-2n", "da-vinci-grasper"))):
        context = AdaptiveFilter(other, compiled=False).states.context
        assert list(slack_pairs(context)) == []
