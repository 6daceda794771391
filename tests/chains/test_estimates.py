"""Everything that works for one joint, for several: estimators, batches, streams, smoothing,
homing, fits, C.
"""

from __future__ import annotations

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from distal import (
    Log,
    Rig,
    at_known_angle,
    diagnose,
    estimate,
    estimate_batch,
    fit,
    load_rig,
    load_scenario,
    simulate,
    smooth,
)
from distal.errors import EstimationError, RigError
from distal.estimators import AdaptiveFilter, Robustness, directions
from distal.estimators.adaptive.joint_motion import _acting, _substep
from distal.estimators.kinematic import unseen_covariance
from distal.logs import TruthKind, write_log
from distal.rig import build_rig
from distal.simulation import build_scenario
from tests.helpers import finite_difference
from tests.support.maps import with_learned_map


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


@pytest.mark.parametrize("name", ["adaptive", "elastic", "inextensible"])
def test_every_estimator_estimates_every_joint(name: str, rig: Rig, log: Log) -> None:
    result = estimate(log, rig, name)
    assert result.joint_names == ("mcp", "pip")
    assert result.state_names[:2] == ("theta_mcp", "theta_pip")
    bounds = {"adaptive": 0.8, "elastic": 3.0, "inextensible": 6.0}
    assert rms(result).max() < bounds[name]


def test_adaptive_is_better_than_tendons_alone_and_its_band_holds(rig: Rig, log: Log) -> None:
    found = estimate(log, rig)
    assert rms(found).mean() < 0.35 * rms(estimate(log, rig, "inextensible")).mean()
    assert found.inside_band() > 0.9
    assert found.unseen is None


def test_regression_learns_all_joints(rig: Rig, log: Log) -> None:
    result = estimate(log, with_learned_map([log], rig, "readings"), "regression")
    assert rms(result).max() < 0.5


@pytest.mark.slow
def test_batches_and_smoothing(rig: Rig, log: Log) -> None:
    other = replace(log, source="other")
    alone = estimate(log, rig, "elastic")
    for one in estimate_batch([log, other], rig, "elastic"):
        np.testing.assert_allclose(one.means, alone.means, rtol=0, atol=1e-9)
    smoothed = smooth(log, rig)
    assert rms(smoothed).mean() < 1.2 * rms(estimate(log, rig)).mean()
    assert smoothed.angles.shape == (len(log), 2)


@pytest.mark.slow
def test_diagnosis_names_no_friction_that_is_declared(rig: Rig, log: Log) -> None:
    text = diagnose(estimate(log, rig), log, rig, what_if=False).text
    assert "friction that the rig does not have" not in text


def test_slopes_of_a_sub_step_are_those_of_differences() -> None:
    """∂(θ, ω)⁺ by the joints' motion, parameters and places, against central differences, slipping
    and stuck.
    """
    rig = load_rig("finger-n-plus-1")
    # with a torque the slopes are those of an expectation, see tests of the soft friction
    guards = replace(Robustness.usual(3), opens_torques=False)
    estimator = AdaptiveFilter(rig, compiled=False, robustness=guards)
    states = estimator.states
    context, acting = states.context, _acting(states)
    mechanism, step = context.mechanism, _substep(states)
    p, nj, nd, h = mechanism.parameters, 3, 4, 7e-4
    damped = np.zeros(nj)  # in a chain it follows from the posture
    mean = np.array(states.means)
    state = ca.SX.sym("state", len(states))
    parameters = ca.Function("p", [state, p.symbols], [states.parameters(state)])
    columns = 2 * nj + len(acting) + nd
    identity = np.eye(columns)
    rng, slips = np.random.default_rng(5), set()
    for case in range(8):
        angles, speeds = (
            np.deg2rad(rng.uniform(0, 50, 3)),
            rng.normal(size=3) * (0.05, 1.0, 2.0, 3.0)[case % 4],
        )
        arms = np.array(
            [[tendon.arms().get(joint.name, 0.0) for joint in rig.joints] for tendon in rig.tendons]
        )
        positions = arms @ angles + 8e-4 + rng.normal(size=4) * 3e-4

        def after(x: np.ndarray) -> np.ndarray:
            moved = mean.copy()
            moved[acting] = x[2 * nj : 2 * nj + len(acting)]
            q, v = (
                np.append(x[:nj], x[2 * nj + len(acting) :]),
                np.append(x[nj : 2 * nj], np.zeros(nd)),
            )
            values = parameters(moved, p.values)
            found = step(q, v, np.zeros(nj), h, np.zeros(nj), values, damped, p.values)
            return np.concatenate(
                [np.array(found[0]).ravel()[:nj], np.array(found[1]).ravel()[:nj]]
            )

        at = np.concatenate([angles, speeds, mean[acting], positions])
        sizes = np.concatenate(
            [np.full(3, 1e-7), np.full(3, 1e-6), 1e-3 * states.stds[acting], np.full(4, 1e-9)]
        )
        expected = finite_difference(after, at, sizes)
        q, v = np.append(angles, positions), np.append(speeds, np.zeros(nd))
        values = parameters(mean, p.values)
        found = step(q, v, np.zeros(nj), h, np.zeros(nj), values, damped, p.values)
        by_angle, by_speed, others = (np.array(each).T for each in found[2:5])
        of_speeds = by_angle @ identity[:nj] + by_speed @ identity[nj : 2 * nj] + others
        slopes = np.vstack([identity[:nj] + h * of_speeds, of_speeds])
        slips.add(int(np.count_nonzero(np.array(found[1]).ravel()[:nj])))
        # Coriolis torques are taken in the middle of the kick, their slopes at its start; in units
        # of what is unsure
        unsure = np.concatenate(
            [np.full(3, 1e-2), np.full(3, 0.3), states.stds[acting], np.full(4, 5e-5)]
        )
        slopes, expected = slopes * unsure, expected * unsure
        least = 0.002 * np.abs(expected).max(axis=1, keepdims=True)
        assert np.all(np.abs(slopes - expected) <= 0.02 * np.abs(expected).max(axis=0) + least)
    assert len(slips) > 1  # some of them stuck


@pytest.mark.slow
@pytest.mark.more
def test_homing_of_some_joints(rig: Rig, log: Log) -> None:
    """An encoder of pip alone for half a second; then pip at a mark, and then both."""
    only = replace(log, truth={"theta_pip": log.truth["theta_pip"]})
    result = estimate(only, rig, homing=0.5)
    assert (
        np.rad2deg(result.angle_stds[50, 1])
        < 0.4
        < np.rad2deg(estimate(log, rig).angle_stds[50, 1])
    )
    # of the other joint nothing more is known, and nothing less
    assert result.angle_stds[-1, 0] < 1.1 * estimate(log, rig).angle_stds[-1, 0]
    marked, described = at_known_angle(
        replace(log, truth={}), rig, 0.5, np.deg2rad(25), np.deg2rad(0.5), joint="pip"
    )
    assert [sensor.name for sensor in described.sensors_of("angle")] == ["home_pip"]
    marked, described = at_known_angle(
        marked, described, 0.5, np.deg2rad(20), np.deg2rad(0.5), joint="mcp"
    )
    assert str(marked.truth_source).startswith("pip 25° ± 0.5° at home, mcp 20° ± 0.5° at home")
    assert marked.truth_kind is TruthKind.HOME
    both = estimate(marked, described, homing=0.5)
    assert np.rad2deg(both.angle_stds[50]).max() < 0.7
    with pytest.raises(
        EstimationError,
        match=r"a homing angle is of one joint; name one of mcp, pip \('pip: 0 deg'\); none was named",
    ):
        at_known_angle(log, rig, 0.5, 0.0)


@pytest.mark.more
@pytest.mark.slow
def test_a_fit_of_logs_in_which_one_joint_has_an_encoder(rig: Rig) -> None:
    """The friction of both joints is off by 30 %; mcp alone is known: no narrow band comes of
    it.
    """
    plant = {"joints.*.friction.coefficient": 0.26}
    scenario = load_scenario("finger", ['duration="4 s"']).model_copy(update={"plant": plant})
    logs = [simulate(rig, scenario, seed=seed) for seed in (1, 2)]
    known = [replace(log, truth={"theta_mcp": log.truth["theta_mcp"]}) for log in logs]
    free = ["joints.mcp.friction.coefficient", "joints.pip.friction.coefficient"]
    found = fit(known, rig, free=free)
    assert not found.maps
    assert any("the angle of pip is known in no log" in doubt for doubt in found.doubts)
    fitted = [
        joint.friction.coefficient for joint in found.rig.joints if joint.friction is not None
    ]
    assert abs(fitted[0].value - 0.26) < 0.03
    test = simulate(rig, scenario, seed=9)
    assert estimate(test, found.rig).inside_band() > 0.9


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
    servo = {
        "angle": {"mean": 0.6, "amplitude": 0.5, "frequency": 0.5},
        "stiffness": 5.0,
        "damping": 0.05,
    }
    scenario = build_scenario(
        {"rig": "finger-underactuated", "duration": "2 s", "drives": {"flexor": {"servo": servo}}}
    )
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
    r_j T/k_j.
    """
    raw = load_rig("finger-underactuated").model_dump()
    raw["base"] = {"gravity": (0.0, 0.0, 0.0)}
    finger = build_rig(raw, "no weight")
    tension, arms, stiffness = 6.0, np.array([9, 7, 5]) * 1e-3, np.array([0.15, 0.12, 0.1])
    angles = np.deg2rad(-10) + arms * tension / stiffness
    motor = (arms @ angles + tension / 8000.0) / 6e-3
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


def test_a_star_stands_for_all() -> None:
    finger = load_rig("finger-2n").with_values(
        {"joints.*.external_torque.std": "0.04 N m", "tendons.*.crossings.*.radius.std": "3 %"}
    )
    assert [joint.external_torque.std for joint in finger.joints] == [0.04, 0.04]
    assert finger.tendons[2].crossings[1].radius.std == pytest.approx(0.18e-3)  # type: ignore[union-attr]
    with pytest.raises(RigError, match=r"'name' is no list with items that '\*' could stand for"):
        finger.with_values({"name.*.x": 1.0})
    with pytest.raises(RigError, match="unknown key 'frictoin'"):
        finger.with_values({"joints.*.frictoin": 1.0})


@pytest.mark.slow
def test_a_stream_of_a_finger(rig: Rig, log: Log, tmp_path: Path) -> None:
    """`distal stream`: every joint has its angle and its std in each line."""
    write_log(replace(log, truth={}).select(np.arange(len(log)) < 20), rig, tmp_path / "log.csv")
    text = (tmp_path / "log.csv").read_text(encoding="utf-8")
    command = [sys.executable, "-m", "distal", "stream", "--rig", "finger-2n", "--unit", "deg"]
    done = subprocess.run(
        command, input=text, capture_output=True, text=True, timeout=60, check=True
    )
    header, *lines = done.stdout.splitlines()
    assert len(lines) == 20
    expected = {f"theta_{joint}{what} [deg]" for joint in ("mcp", "pip") for what in ("", "_std")}
    assert expected <= set(header.split(","))


def test_homing_at_one_joint_of_a_log_that_knows_all(rig: Rig, log: Log) -> None:
    """pip stands at a mark; the truth of mcp, which the log has too, is compared with and not
    read.
    """
    marked, described = at_known_angle(log, rig, 0.5, np.deg2rad(25), np.deg2rad(1.0), joint="pip")
    result = estimate(marked, described, homing=0.5)
    assert result.truths is not None
    late = log.time >= 0.5
    assert np.isfinite(result.truths[late]).all()
    assert rms(result).max() < 1.0


def test_elastic_says_what_it_cannot_know() -> None:
    """Two directions of an underactuated finger are not seen: at least 3° there, next to nothing
    along the sum.
    """
    covariance = unseen_covariance(load_rig("finger-underactuated"))
    weights = np.array([9.0, 7.0, 5.0])
    assert weights @ covariance @ weights < 1e-14
    assert np.rad2deg(np.sqrt(np.trace(covariance) / 2)) == pytest.approx(3.0, rel=1e-6)
    assert not unseen_covariance(load_rig("finger-2n")).any()
