"""Everything that works for one joint, for several: estimators, batches, streams, smoothing,
homing, fits, C.
"""

from __future__ import annotations

import numpy as np
import pytest

from distal import (
    Log,
    Rig,
    at_known_angle,
    estimate,
    load_rig,
    load_scenario,
    simulate,
)
from distal.errors import EstimationError, RigError
from distal.estimators import directions
from distal.estimators.kinematic import unseen_covariance
from distal.rig import build_rig
from tests.chains.scenarios import flexed


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("finger-2n")


@pytest.fixture(scope="module")
def log(rig: Rig) -> Log:
    """Three seconds of a finger through its postures."""
    whole = simulate(rig, load_scenario("finger", ['duration="3 s"']), seed=3)
    assert np.rad2deg(np.ptp(whole.truth["theta_mcp"])) > 30.0
    assert np.rad2deg(np.ptp(whole.truth["theta_pip"])) > 40.0
    return whole


def rms(result: object) -> np.ndarray:
    errors = np.rad2deg(result.angles - result.truths)  # type: ignore[attr-defined]
    return np.sqrt(np.nanmean(errors**2, axis=0))


def test_every_estimator_estimates_every_joint(rig: Rig, log: Log) -> None:
    """`adaptive` is better than tendons alone, and its band holds."""
    errors = {}
    for name, most in {"adaptive": 0.8, "elastic": 3.0, "inextensible": 6.0}.items():
        result = estimate(log, rig, name)
        assert result.joint_names == ("mcp", "pip")
        assert result.state_names[:2] == ("theta_mcp", "theta_pip")
        errors[name] = rms(result)
        assert errors[name].max() < most
        if name == "adaptive":
            assert result.inside_band() > 0.9
            assert result.unseen is None
    assert errors["adaptive"].mean() < 0.35 * errors["inextensible"].mean()


def test_what_is_not_seen_is_named() -> None:
    finger = load_rig("finger-underactuated")
    found = directions(finger)
    assert found.text == (
        "the sensors miss 2 of the joints' directions: springs hold them, as long as nothing "
        "touches the joints"
    )
    np.testing.assert_allclose(found.missed @ [9, 7, 5], 0, atol=1e-12)
    np.testing.assert_allclose(found.missed @ found.missed.T, np.eye(2), atol=1e-12)
    assert len(directions(load_rig("finger-2n")).missed) == 0
    raw = load_rig("finger-n-plus-1").model_dump()
    raw["sensors"] = [sensor for sensor in raw["sensors"] if sensor["of"] in ("t1", "t2")]
    assert directions(build_rig(raw, "two of four")).text == (
        "the sensors miss 1 of the joints' directions: the bands say how far"
    )


def test_the_band_opens_where_nothing_is_seen() -> None:
    """A torque that may occur opens the joints' bands, not that of the sum that the tendon
    tells.
    """
    finger = load_rig("finger-underactuated")
    scenario = flexed(2.0, 0.5)
    log = simulate(finger, scenario, seed=1)
    alone = estimate(log, finger)
    touched = estimate(log, finger.with_values({"joints.*.external_torque.std": "0.03 N m"}))
    weights = np.array([9.0, 7.0, 5.0]) / 21.0
    assert touched.covariances is not None
    sums = np.sqrt(np.einsum("i,kij,j->k", weights, touched.covariances[:, :3, :3], weights))
    assert np.rad2deg(np.median(touched.angle_stds, axis=0)).min() > 5 * np.rad2deg(
        np.median(alone.angle_stds)
    )
    assert np.median(sums) < 0.1 * np.median(touched.angle_stds)
    assert touched.unseen is not None


def test_elastic_finds_the_posture_of_springs() -> None:
    """One flexor, no friction: where the tendon's torque and the springs balance, θ_j = θ_rest +
    r_j T/k_j; its stretch is (T − T_pre)/k.
    """
    raw = load_rig("finger-underactuated").model_dump()
    raw["base"] = {"gravity": (0.0, 0.0, 0.0)}
    raw["tendons"][0]["pretension"] = 4.0
    finger = build_rig(raw, "no weight")
    tension, arms, stiffness = 6.0, np.array([9, 7, 5]) * 1e-3, np.array([0.15, 0.12, 0.1])
    angles = np.deg2rad(-10) + arms * tension / stiffness
    motor = (arms @ angles + (tension - 4.0) / 8000.0) / 6e-3
    n = 100
    log = Log(
        0.005 * np.arange(n),
        {"phi_flexor": np.full(n, motor), "tau_flexor": np.full(n, 6e-3 * tension)},
    )
    result = estimate(log, finger, "elastic")
    np.testing.assert_allclose(result.angles[-1], angles, atol=np.deg2rad(0.05))


def test_least_squares_over_tendons_is_exact_where_they_agree() -> None:
    """Four tendons of three joints at known angles and pulls: elastic finds the angles, with the
    band of its sensors.
    """
    finger = load_rig("finger-n-plus-1")
    angles, pulls = np.deg2rad([30.0, 40.0, 20.0]), np.array([7.0, 9.0, 8.0, 6.0])
    arms = np.array([[8, 7, 6], [7.5, -6.5, -5.5], [-8, 7, 0], [-7.5, -7, 0]]) * 1e-3
    positions, n = arms @ angles + pulls / 1e4, 50
    channels = {f"x_t{i + 1}": np.full(n, positions[i]) for i in range(4)} | {
        f"F_t{i + 1}": np.full(n, pulls[i]) for i in range(4)
    }
    result = estimate(Log(0.005 * np.arange(n), channels), finger, "elastic")
    np.testing.assert_allclose(result.angles[-1], angles, atol=1e-9)
    sensor = np.hypot(5e-6, 0.6e-4)
    expected = sensor * np.sqrt(np.diag(np.linalg.inv(arms.T @ arms)))
    np.testing.assert_allclose(result.angle_stds[-1], expected, rtol=1e-3)


def test_a_star_stands_for_a_list(rig: Rig) -> None:
    with pytest.raises(RigError, match=r"'name' has no '\*'"):
        rig.with_values({"name.*.x": 1.0})


def test_homing_at_one_joint_of_a_log_that_knows_all(rig: Rig, log: Log) -> None:
    """pip stands at a mark; the truth of mcp, which the log has too, is compared with and not
    read. Of which joint it is has to be said.
    """
    with pytest.raises(EstimationError, match=r"name one of mcp, pip .*none was named"):
        at_known_angle(log, rig, 0.5, 0.0)
    marked, described = at_known_angle(log, rig, 0.5, np.deg2rad(25), np.deg2rad(1.0), joint="pip")
    result = estimate(marked, described, homing=0.5)
    assert result.truths is not None
    late = log.time >= 0.5
    assert np.isfinite(result.truths[late]).all()
    assert rms(result).max() < 1.0
    both, _ = at_known_angle(marked, described, 0.5, np.deg2rad(20), np.deg2rad(0.5), joint="mcp")
    assert str(both.truth_source).startswith("pip 25° ± 1° at home, mcp 20° ± 0.5° at home")


def test_elastic_says_what_it_cannot_know() -> None:
    """Two directions of an underactuated finger are not seen: at least 3° there, next to nothing
    along the sum.
    """
    covariance = unseen_covariance(load_rig("finger-underactuated"))
    weights = np.array([9.0, 7.0, 5.0])
    assert weights @ covariance @ weights < 1e-14
    assert np.rad2deg(np.sqrt(np.trace(covariance) / 2)) == pytest.approx(3.0, rel=1e-6)
    assert not unseen_covariance(load_rig("finger-2n")).any()
