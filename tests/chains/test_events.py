"""Events in a chain that its rig file does not know: a torque, a zero that jumps, a place that is
silent for a while.
"""

from __future__ import annotations

from dataclasses import replace
from math import exp, sqrt

import casadi as ca
import numpy as np
import pytest

from distal import Log, estimate, load_rig, load_scenario, scenario_rig, simulate
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive import Robustness
from distal.estimators.adaptive.drive_tracking import (
    MEMORY,
    REMEMBERED,
    ForceEvidence,
    Tracks,
    track,
)
from distal.estimators.adaptive.prediction import shifted_variance
from distal.estimators.adaptive.unexplained_force import opened_torque, watched
from distal.estimators.state_kinds import StateKind
from distal.kernels.mask import MISSING, READ
from distal.simulation import build_scenario

CHAIN = Robustness.usual(3)


def test_a_force_opens_a_torque_once_it_stays_unexplained() -> None:
    """Against (29), (30) written out: one outlier opens nothing, several alike open a force, which
    closes again.
    """
    watch, dt, rng = watched(CHAIN), 0.005, np.random.default_rng(0)
    innovations = rng.normal(0, 0.5, 2400)
    innovations[2050] = 80.0
    innovations[2100:2160] += 4.0
    mean = opened = found_mean = found = 0.0
    usual = found_usual = 0.25
    kept = []
    for innovation in innovations:
        variance = 0.8
        fade = exp(-dt / 0.05)
        mean = fade * mean + (1 - fade) * float(np.clip(innovation / sqrt(variance), -3, 3))
        unusual = max(0.7, 4 * sqrt(usual))
        share = max(1 - unusual / max(abs(mean), 1e-9), 0.0)
        opened = max(opened * exp(-2 * dt / 1.2), 196 * share**2 * min(innovation**2, 9 * variance))
        usual = exp(-dt / 2.5) * usual + (1 - exp(-dt / 2.5)) * mean**2
        state = found_mean, found_usual, found
        found_mean, found_usual, found = (
            float(x) for x in watch(*state, innovation, variance, 1, dt)
        )
        assert found_usual == pytest.approx(usual, rel=1e-12)
        assert found == pytest.approx(opened, rel=1e-12)
        kept.append(found)
    assert max(kept[:2100]) == 0.0
    assert min(kept[2120:2160]) > 4.0
    assert min(kept[2120:]) < max(kept)
    assert [float(x) for x in watch(0.9, 0.3, 1.0, 50.0, 1.0, 0, dt)] == pytest.approx(
        [0.9, 0.3, exp(-2 * dt / 1.2)]
    )


def test_what_is_always_a_little_off_opens_nothing() -> None:
    """A mean innovation of 1.2 stds, which the rig has from the start; one that comes after 15 calm
    seconds opens.
    """
    watch = watched(CHAIN)
    always, later = (0.0, 0.25, 0.0), (0.0, 0.25, 0.0)
    for k in range(4000):
        always = tuple(float(x) for x in watch(*always, 1.2, 1.0, 1, 0.005))
        assert always[2] == 0.0
        later = tuple(float(x) for x in watch(*later, 1.2 if k > 3000 else 0.0, 1.0, 1, 0.005))
        if k == 3030:
            assert later[2] > 1.0


def test_guards_of_one_joint_open_nothing() -> None:
    assert [float(x) for x in watched(Robustness.usual(1))(0.9, 0.3, 1.0, 50.0, 1.0, 1, 0.005)] == [
        0.9,
        0.3,
        1.0,
    ]
    kinds = AdaptiveFilter(
        load_rig("finger-2n"), compiled=False, robustness=Robustness.fitting()
    ).state_kinds
    assert StateKind.UNDECLARED_TORQUE not in kinds


def test_a_force_is_a_torque_at_the_moment_arms() -> None:
    """A torque on one of three joints changes the flexor's tension by r_j²/Σ r² of what it would
    alone.
    """
    runner = AdaptiveFilter(load_rig("finger-underactuated"), compiled=False)
    arms, lever, numbers = np.array([9e-3, 7e-3, 5e-3]), 6e-3, ca.MX(ca.DM(runner.numbers))
    for j in range(3):
        opened = opened_torque(runner.states.context, j, [ca.MX(2.5e-5)], numbers)
        found = float(ca.evalf(opened))
        assert found == pytest.approx(2.5e-5 * (np.sum(arms**2) / arms[j] / lever) ** 2, rel=1e-9)
    assert [runner.state_names[i] for i in runner.states.torque_states] == [
        f"undeclared_torque_{name}" for name in ("mcp", "pip", "dip")
    ]


def tracked(
    readings: list[float], dt: float, least: float = 0.5, pulls: float = 0.0, off: float = 0.0
) -> list[dict[str, float]]:
    """Return what is remembered of a drive after each reading; its force rises by `pulls` per m,
    and the model is `off`. One that is NaN is missing.
    """
    memory, reading, effort = ca.SX.sym("memory", MEMORY), ca.SX.sym("z"), ca.SX.sym("U")
    mask = ca.SX.sym("mask")
    force = ForceEvidence(effort + off, ca.SX(READ), ca.SX(2500.0), ca.SX(0.1), effort, least)
    drive = track(
        memory,
        reading,
        mask,
        ca.SX(2.5e-11),
        ca.SX(dt),
        robustness=CHAIN,
        silence=None,
        force_evidence=force,
    )
    step = ca.Function(
        "step",
        [memory, reading, effort, mask],
        [ca.vertcat(*(getattr(drive, name) for name in REMEMBERED))],
    )
    now, found = np.zeros(MEMORY), []
    for value in readings:
        place, seen = (0.0, MISSING) if np.isnan(value) else (value, READ)
        now = np.array(step(now, place, pulls * place, seen)).ravel()
        found.append(dict(zip(REMEMBERED, now)))
    return found


@pytest.mark.parametrize("jump", [3e-3, -3e-3])
def test_a_zero_that_jumps_is_taken_off_until_it_comes_back(jump: float) -> None:
    """No force follows a jump of 3 mm, which would be 7.5 N: the zero jumped, and what is read goes
    on from there.
    """
    found = tracked([0.0, 0.0, jump, jump, jump + 2e-5, jump, 0.0, 0.0], 0.005)
    np.testing.assert_allclose(
        [one["shift"] for one in found], [0, 0, jump, jump, jump, jump, 0, 0], rtol=1e-9
    )
    np.testing.assert_allclose(
        [one["place"] for one in found], [0, 0, 0, 0, 2e-5, 0, 0, 0], atol=2e-6
    )
    assert all(one["shift_std"] == 0.0 for one in found)


def test_what_nothing_can_judge_stays_in_doubt_for_a_while() -> None:
    """Where a joint follows at once, only an interval too short for a drive to start and stop tells
    of the zero.
    """
    found = tracked([0.0, 3e-3, 3e-3, 3e-3], 0.005, least=0.0)
    assert found[1]["shift"] == pytest.approx(3e-3)
    np.testing.assert_allclose(
        [one["shift_std"] for one in found[1:]], 1.5e-3 * np.exp(-np.arange(3) * 0.005 / 1.2)
    )
    assert found[3]["place"] == pytest.approx(0.0, abs=1e-9)
    assert tracked([0.0] + [3e-3] * 8, 0.05, least=0.0)[-1]["place"] == pytest.approx(
        3e-3, rel=1e-3
    )


def test_a_drive_that_moved_while_it_was_not_read_has_not_lost_its_zero() -> None:
    """Within 5 ms no drive starts, moves 6 mm and stops; within the 15 ms since it was read it
    does.
    """
    lost = [np.nan, np.nan]
    assert tracked([0.0, 6e-3], 0.005, least=0.0)[-1]["shift"] == pytest.approx(6e-3)
    found = tracked([0.0, *lost, *[6e-3] * 8], 0.005, least=0.0)
    assert all(one["shift"] == 0.0 for one in found)


def test_a_drive_that_its_force_shows_has_jumped_itself() -> None:
    """It sticks and slips: the force rises by 0.7 of what it would if the joint stood still, though
    the model is off.
    """
    found = tracked([0.0, 3e-3, 3e-3, 3e-3], 0.005, pulls=0.7 * 2500.0, off=-6.0)
    assert all(one["shift"] == 0.0 for one in found)
    assert found[1]["doubt"] > 0.0
    assert all(
        one["shift"] == 0.0 for one in tracked([0.0, 3e-3, 3e-3, 3e-3], 0.005, pulls=0.7 * 2500.0)
    )
    assert tracked([0.0, 3e-4], 0.005)[-1]["shift"] == 0.0  # too little for the force to show it


def test_a_drive_that_moves_on_has_not_lost_its_zero() -> None:
    ramp = [0.0, 1e-3, 2e-3, 3e-3, 4e-3, 5e-3, 6e-3]
    found = tracked(ramp + [6e-3] * 40, 0.005, least=0.0)
    assert found[1]["shift"] == pytest.approx(1e-3)
    assert found[-1]["shift"] == 0.0
    assert found[-1]["place"] == pytest.approx(6e-3, rel=1e-3)


def test_an_angle_is_as_unsure_as_the_zero_of_its_drive() -> None:
    context = AdaptiveFilter(load_rig("wrist-instrument"), compiled=False).states.context
    vector = ca.MX.zeros(Tracks.size(3))
    vector[REMEMBERED.index("shift_std")] = 0.2
    p = ca.MX(ca.DM(context.mechanism.parameters.values))
    found = [float(ca.evalf(shifted_variance(context, j, vector, p))) for j in range(3)]
    np.testing.assert_allclose(found, [(0.2 * 6e-3 / 5e-3) ** 2, 0.0, 0.0], rtol=1e-9)


def finger_log(torque: float) -> Log:
    """Return a finger's log; on pip acts a torque from 3 to 4 s."""
    points = f"[[0, 0.0], [3, 0.0], [3.03, {torque}], [4, {torque}], [4.03, 0.0], [8, 0.0]]"
    scenario = load_scenario("finger", [f"joints.pip.torque={{points={points}}}"])
    return simulate(scenario_rig(scenario), scenario, 4)


@pytest.mark.parametrize("event", ["load", "jump", "silent"])
def test_the_band_holds_through_an_event_and_closes_after_it(event: str) -> None:
    """The plant of the finger's scenario has numbers that the shipped rig does not know."""
    rig, log = load_rig("finger-2n"), finger_log(0.05 if event == "load" else 0.0)
    during = (log.time >= 3.0) & (log.time < 4.0)
    if event != "load":
        values = log.channels["x_pip_f"].copy()
        values[during] += 3e-3 if event == "jump" else np.nan
        log = Log(log.time, {**log.channels, "x_pip_f": values}, log.truth, event, log.truth_source)
    result = estimate(log, rig)
    assert result.truths is not None
    half = BAND * result.angle_stds
    inside = np.abs(result.angles - result.truths) <= half
    since = log.time >= 3.2 if event == "load" else log.time >= 3.0
    assert np.mean(inside[since]) >= 0.88
    before, late = (half[(log.time > t) & (log.time < t + 1)].mean() for t in (2.0, 7.0))
    assert late <= 1.5 * before


def test_a_joint_on_its_stop_stays_known_where_nothing_happens() -> None:
    """A spring holds it there: a torque that nothing tells of does not take it off."""
    rig = load_rig("finger-underactuated").with_values(
        {"joints.mcp.stops": ["25 deg", "95 deg"], "joints.mcp.initial.value": "25 deg"}
    )
    servo = {
        "angle": {"mean": 0.6, "amplitude": 0.05, "frequency": 0.5},
        "stiffness": 5.0,
        "damping": 0.05,
    }
    scenario = build_scenario(
        {"rig": "finger-underactuated", "duration": "3 s", "drives": {"flexor": {"servo": servo}}}
    )
    log = simulate(rig, scenario, seed=1)
    assert np.ptp(log.truth["theta_mcp"]) < 0.05
    stds = []
    for opens in (True, False):
        guards = replace(Robustness.usual(3), opens_torques=opens)
        stds.append(estimate(log, rig, AdaptiveFilter(rig, robustness=guards)).angle_stds[-1, 0])
    assert stds[0] < 1.2 * stds[1]
