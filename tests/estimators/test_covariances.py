"""Every reported covariance is positive semidefinite to rounding: estimators, rigs, learned maps,
missing readings.
"""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from distal import LiveEstimator, Log, Rig, estimate, load_rig, make_estimator, shipped_rigs
from distal.errors import EstimationError
from distal.estimators import ESTIMATORS
from distal.run import samples_of
from tests.learned_maps import with_drawn

ROUNDING = -1e-9
"""Least eigenvalue of a matrix of correlations that is semidefinite but for rounding."""


def least_eigenvalue(covariances: np.ndarray) -> float:
    """Return the least eigenvalue of the correlations, of states that are not certain."""
    least = 0.0
    for covariance in covariances:
        sure = np.sqrt(np.diagonal(covariance))
        kept = sure > 0.0
        correlations = covariance[np.ix_(kept, kept)] / np.outer(sure[kept], sure[kept])
        least = min(
            least, float(np.linalg.eigvalsh((correlations + correlations.T) / 2).min(initial=0.0))
        )
    return least


def motion(rig: Rig, missing: float) -> Log:
    """Return readings of every sensor that move, with a share of them missing; fewer of a rig with
    many joints.
    """
    rng, count = np.random.default_rng(3), 150 if len(rig.joints) < 10 else 20
    rate = max(sensor.rate for sensor in rig.sensors)
    time = np.arange(count) / rate
    channels = {}
    for i, sensor in enumerate(rig.sensors):
        size = 0.002 if sensor.si == "m" else 0.3 if sensor.measures == "position" else 0.05
        if sensor.si == "N":
            size = 2.0
        level = 2.0 * size if sensor.si == "N" else 0.0
        values = level + size * np.sin(2 * np.pi * 2.0 * time + i)
        channels[sensor.name] = np.where(rng.random(count) < missing, np.nan, values)
        channels[sensor.name][0] = values[0]
    return Log(time, channels)


def with_maps(rig: Rig) -> Rig:
    """Return the rig with drawn maps of its angles and of the torques on them."""
    torques = {f"joints.{j}.external_torque.std": 0.02 for j in range(len(rig.joints))}
    touched = with_drawn(rig.with_values(torques), size=0.3)
    assert touched.map is not None
    return touched.with_map(torque=touched.map.readings)


@pytest.mark.parametrize("rig_name", shipped_rigs())
@pytest.mark.parametrize("name", ["adaptive", "regression", "elastic", "inextensible"])
def test_a_reported_covariance_is_one(rig_name: str, name: str) -> None:
    """With every reading there, and with a third of them missing."""
    assert name in ESTIMATORS
    rig = load_rig(rig_name)
    if name == "regression" and rig.map is None:
        with pytest.raises(EstimationError, match="has no map"):
            estimate(motion(rig, 0.0), rig, name, compiled=False)
        return
    estimator = make_estimator(name, rig, compiled=False)
    for missing in (0.0, 0.3):
        result = estimate(motion(rig, missing), rig, estimator)
        assert result.covariances is not None
        assert least_eigenvalue(result.covariances) > ROUNDING


@pytest.mark.parametrize("rig_name", ["capstan-joint", "finger-2n"])
def test_maps_keep_it_one_in_logs_and_live(rig_name: str) -> None:
    rig = with_maps(load_rig(rig_name).bare())
    estimator = make_estimator("adaptive", rig, compiled=False)
    log = motion(rig, 0.3)
    result = estimate(log, rig, estimator)
    assert result.covariances is not None
    assert least_eigenvalue(result.covariances) > ROUNDING
    bare = estimate(log, rig.bare(), compiled=False)
    assert np.abs(result.angles - bare.angles).max() > 0.01  # the maps say something
    np.testing.assert_allclose(
        result.innovations, bare.innovations
    )  # and the filter goes on as without them
    live, samples = LiveEstimator(rig, estimator), samples_of(log, estimator.channels)
    for k in range(60):
        live.step(log.time[k], samples[k])
        np.testing.assert_array_equal(live.mean, result.means[k])
        np.testing.assert_allclose(live.covariance, result.covariances[k], rtol=1e-12, atol=1e-300)


def test_the_report_is_g_p_g_plus_u() -> None:
    """Against numpy, of a state in the middle and one whose error is replaced."""
    from distal.estimators.estimator_protocol import Report

    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    covariance, y = root @ root.T, np.array([9.0, 9.0, 0.3, -0.7, 0.5, 0.0, 0.04, 0.09])
    correlation = np.array([[1.0, -0.4], [-0.4, 1.0]])
    report = Report.behind(2, [[1, 3]], [correlation])
    gains = np.diag([1.0, 0.5, 1.0, 0.0])
    expected = gains @ covariance @ gains + np.diag([0.0, 0.04, 0.0, 0.09])
    expected[1, 3] -= 0.4 * 0.2 * 0.3
    expected[3, 1] -= 0.4 * 0.2 * 0.3
    np.testing.assert_allclose(report.covariances(covariance[None], y[None])[0], expected)
    np.testing.assert_allclose(
        report.variances_of(np.diag(covariance)[None], y[None])[0], np.diag(expected)
    )
    np.testing.assert_allclose(report.means(np.zeros((1, 4)), y[None])[0], [0.0, 0.3, 0.0, -0.7])
    assert dataclasses.astuple(report.only([3])) == ((3,), (3,), (5,), (7,), ((1.0,),))


def test_two_maps_are_independent_of_each_other() -> None:
    from distal.estimators.estimator_protocol import Report

    blocks = [np.array([[1.0, 0.5], [0.5, 1.0]]), np.ones((1, 1))]
    report = Report.behind(0, [[0, 1], [2]], blocks)
    np.testing.assert_allclose(report.correlation, [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]])


def test_regression_reports_how_joints_err_together() -> None:
    """Off the diagonal stands the correlation of the joints of one map."""
    rig = with_drawn(load_rig("finger-2n"))
    result = estimate(motion(rig, 0.0), rig, "regression", compiled=False)
    assert result.covariances is not None
    spread = result.covariances[:, :2, :2]
    stds = np.sqrt(np.einsum("kii->ki", spread))
    np.testing.assert_allclose(spread[:, 0, 1] / (stds[:, 0] * stds[:, 1]), 0.3)
