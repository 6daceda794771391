"""Every reported covariance is positive semidefinite to rounding: estimators, rigs, learned maps,
missing readings.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import Log, Rig, estimate, load_rig, make_estimator, shipped_rigs
from distal.estimators import ESTIMATORS
from distal.estimators.estimator_protocol import Report
from tests.learned_maps import with_drawn

ROUNDING = -1e-9
"""Least eigenvalue of a matrix of correlations that is semidefinite but for rounding."""


def assert_semidefinite(covariances: np.ndarray | None) -> None:
    """Assert it of the correlations, of states that are not certain."""
    assert covariances is not None
    for covariance in covariances:
        sure = np.sqrt(np.diagonal(covariance))
        kept = sure > 0.0
        correlations = covariance[np.ix_(kept, kept)] / np.outer(sure[kept], sure[kept])
        np.testing.assert_allclose(correlations, correlations.T, atol=1e-12)
        assert np.linalg.eigvalsh(correlations).min(initial=0.0) > ROUNDING


def motion(rig: Rig, missing: float) -> Log:
    """Return readings of every sensor that move, with a share of them missing; fewer of a rig with
    many joints.
    """
    rng, count = np.random.default_rng(3), 150 if len(rig.joints) < 10 else 20
    time = np.arange(count) / max(sensor.rate for sensor in rig.sensors)
    channels = {}
    for i, sensor in enumerate(rig.sensors):
        size = {"m": 0.002, "N": 2.0, "rad": 0.3}.get(sensor.si, 0.05)
        level = 2.0 * size if sensor.si == "N" else 0.0
        values = level + size * np.sin(2 * np.pi * 2.0 * time + i)
        lost = rng.random(count) < missing
        lost[0] = False
        channels[sensor.name] = np.where(lost, np.nan, values)
    return Log(time, channels)


def with_maps(rig: Rig) -> Rig:
    """Return the rig with drawn maps of its angles and of the torques on them."""
    touched = with_drawn(rig.with_values({"joints.*.external_torque.std": 0.02}), size=0.3)
    assert touched.map is not None
    return touched.with_map(torque=touched.map.readings)


@pytest.mark.parametrize("rig_name", shipped_rigs())
@pytest.mark.parametrize("name", ESTIMATORS)
def test_a_reported_covariance_is_one(rig_name: str, name: str) -> None:
    """With every reading there, and with a third of them missing."""
    if rig_name == "hand" and name.startswith("ekf"):
        pytest.skip("it takes 5 s, and has nothing that chains of three joints have not")
    rig = load_rig(rig_name)
    if name == "regression" and rig.map is None:
        rig = with_drawn(rig)
    estimator = make_estimator(name, rig, compiled=False)
    for missing in (0.0, 0.3):
        result = estimate(motion(rig, missing), rig, estimator)
        assert np.isfinite(result.means).all()
        assert_semidefinite(result.covariances)


@pytest.mark.parametrize("rig_name", ["capstan-joint", "finger-2n"])
def test_maps_keep_it_one(rig_name: str) -> None:
    rig = with_maps(load_rig(rig_name).bare())
    estimator = make_estimator("adaptive", rig, compiled=False)
    log = motion(rig, 0.3)
    result = estimate(log, rig, estimator)
    assert_semidefinite(result.covariances)
    bare = estimate(log, rig.bare(), compiled=False)
    assert np.abs(result.angles - bare.angles).max() > 0.01  # the maps say something
    # and the filter goes on as without them
    np.testing.assert_allclose(result.innovations, bare.innovations)


def test_the_report_is_g_p_g_plus_u() -> None:
    """Against numpy, of a state in the middle and one whose error is replaced."""
    rng = np.random.default_rng(0)
    root = rng.normal(size=(4, 4))
    covariance, y = root @ root.T, np.array([9.0, 9.0, 0.3, -0.7, 0.5, 0.0, 0.04, 0.09])
    correlation = np.array([[1.0, -0.4], [-0.4, 1.0]])
    report = Report.behind(2, [[1, 3]], [correlation])
    gains = np.diag([1.0, 0.5, 1.0, 0.0])
    expected = gains @ covariance @ gains + np.diag([0.0, 0.04, 0.0, 0.09])
    expected[[1, 3], [3, 1]] -= 0.4 * 0.2 * 0.3
    np.testing.assert_allclose(report.covariances(covariance[None], y[None])[0], expected)
    variances = report.variances_of(np.diag(covariance)[None], y[None])[0]
    np.testing.assert_allclose(variances, np.diag(expected))
    np.testing.assert_allclose(report.means(np.zeros((1, 4)), y[None])[0], [0.0, 0.3, 0.0, -0.7])


def test_two_maps_are_independent_of_each_other() -> None:
    report = Report.behind(0, [[0, 1], [2]], [np.array([[1.0, 0.5], [0.5, 1.0]]), np.ones((1, 1))])
    np.testing.assert_allclose(report.correlation, [[1, 0.5, 0], [0.5, 1, 0], [0, 0, 1]])


def test_regression_reports_how_joints_err_together() -> None:
    """Off the diagonal stands the correlation of the joints of one map."""
    rig = with_drawn(load_rig("finger-2n"))
    result = estimate(motion(rig, 0.0), rig, "regression", compiled=False)
    spread = result.covariances[:, :2, :2]
    stds = np.sqrt(np.einsum("kii->ki", spread))
    np.testing.assert_allclose(spread[:, 0, 1] / (stds[:, 0] * stds[:, 1]), 0.3)
