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
from distal.arrays import Floats
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive import Robustness
from distal.estimators.adaptive.drive_tracking import (
    MEMORY,
    REMEMBERED,
    branches,
    faded,
    track_function,
)
from distal.estimators.adaptive.filter_function import adaptive_function, adaptive_layout
from distal.estimators.adaptive.filter_inputs import Interval, Prediction
from distal.estimators.adaptive.prediction import revert
from distal.estimators.adaptive.touch import (
    CLOSING_TIME,
    FORCE,
    LASTING_TIME,
    TORQUE,
    WEIGHED,
    Remembered,
    evidence_function,
    open_torques,
)
from distal.estimators.estimator_protocol import StateKind
from distal.kernels.layout import READ
from distal.rig import contact_shape
from tests.chains.scenarios import flexed

CHAIN = Robustness.usual(3)


def said(function: ca.Function, kept: dict[str, float], **came: float) -> dict[str, float]:
    """Return what the evidence of a force says after one innovation, and keep what it remembers."""
    outputs = function(kept=[kept[name] for name in FORCE.names], **came)
    found = {name: float(value) for name, value in outputs.items()}
    kept.update({name: found[name] for name in FORCE.names})
    return found


def test_a_force_beyond_what_is_normal_is_evidence_of_a_touch() -> None:
    """Against (29), (30) written out: one outlier is none, several alike are; what is not read
    changes nothing.
    """
    watch, dt, rng = evidence_function(), 0.005, np.random.default_rng(0)
    innovations = rng.normal(0, 0.5, 600)
    innovations[250] = 80.0
    innovations[300:360] += 4.0
    kept, mean, force, usual, excesses = dict.fromkeys(FORCE.names, 0.0), 0.0, 0.0, 0.0, []
    variance, fade, slowly = 0.8, exp(-dt / 0.05), exp(-dt / 2.5)
    for k, innovation in enumerate(innovations):
        used = float(k % 11 != 0)
        normal = max(1.0, 4.0 * sqrt(usual))
        most = normal * max(2.0, 1 / (1 - fade))
        shown = float(np.clip(innovation / sqrt(variance), -most, most))
        if used:
            mean = fade * mean + (1 - fade) * shown
            force = fade * force + (1 - fade) * shown * sqrt(variance)
            usual = slowly * usual + (1 - slowly) * mean**2
        share = max(1 - normal**2 / max(mean**2, 1e-30), 0.0)
        found = said(watch, kept, innovation=innovation, variance=variance, is_used=used, dt=dt)
        assert found["mean"] == pytest.approx(mean, rel=1e-12)
        assert found["force"] == pytest.approx(force, rel=1e-12)
        assert found["normal"] == pytest.approx(normal**2 * variance, rel=1e-12)
        assert found["excess"] == pytest.approx(used * share * force**2, rel=1e-12, abs=1e-30)
        excesses.append(found["excess"])
    assert max(excesses[:300]) == 0.0
    assert np.median(excesses[320:360]) > 1.0


def test_torques_open_by_forces_and_stay_open_by_their_own_size() -> None:
    """Against (31), (32) written out, for the three joints that one tendon moves."""
    rig = load_rig("finger-underactuated")
    estimator = AdaptiveFilter(rig, compiled=False)
    states, lever = estimator.states, 6e-3
    arms, dt, kept_open = np.array([9e-3, 7e-3, 5e-3]), 0.005, np.array([0.0, 4e-4, 1e-6])
    excess, normal = 2.5e-5, 1e-6
    mean = np.zeros(len(states))
    torques = {joint: at for at, joint in states.torque_states.items()}
    mean[torques[2]] = 0.05
    torque = {
        j: dict(zip(TORQUE.names, map(ca.MX, (o, o, 0.5, 0.9, 1.0))))
        for j, o in enumerate(kept_open)
    }
    remembered = Remembered([], {}, torque)
    interval = Interval(ca.MX(), ca.MX(), ca.MX(ca.DM([dt])), ca.MX(ca.DM(estimator.parameters)))
    name = states.context.channels.forces[0].name
    evidence = {name: dict(zip(WEIGHED, map(ca.MX, (excess, normal, 1))))}
    open_torques(states, evidence, remembered, ca.MX(ca.DM(mean)), interval)
    by_torque = lever / arms * arms**2 / np.sum(arms**2)
    shape = contact_shape(rig)
    squares = by_torque @ shape @ by_torque / np.diag(shape)
    z_square = (by_torque[2] * mean[torques[2]]) ** 2 / normal
    for j, torque in remembered.torques.items():
        smallest = normal / squares[j]
        clear = max(
            kept_open[j] * exp(-2 * dt / LASTING_TIME),
            smallest * max(z_square - 9, 0.0),
        )
        assert float(ca.evalf(torque["clear"])) == pytest.approx(clear, rel=1e-9)
        expected = max(
            clear,
            kept_open[j] * exp(-2 * dt / CLOSING_TIME),
            # half of what would open it, since it is half open
            max(4.5 * excess / squares[j], smallest * (z_square - 1)),
        )
        assert float(ca.evalf(torque["opened"])) == pytest.approx(expected, rel=1e-9)
        assert float(ca.evalf(torque["share"])) == pytest.approx(
            expected / (expected + smallest), rel=1e-9
        )
        times = (mean[torques[j]] ** 2 / smallest) ** 2
        probability = float(ca.evalf(torque["probability"]))
        assert probability == pytest.approx(times / (times + 256), rel=1e-9, abs=1e-12)
        lasts = 1.0 + dt if probability > 0.06 else 0.0
        assert float(ca.evalf(torque["since"])) == pytest.approx(lasts)


def test_nothing_opens_in_a_fit_nor_where_nothing_can_touch() -> None:
    fitting = AdaptiveFilter(load_rig("finger-2n"), compiled=False, robustness=Robustness.fitting())
    assert StateKind.EXTERNAL_TORQUE not in fitting.state_kinds
    never = load_rig("finger-2n").with_values({"joints.pip.touch": "never"})
    names = AdaptiveFilter(never, compiled=False).state_names
    assert "external_torque_mcp" in names
    assert "external_torque_pip" not in names


UNJUDGED = track_function(CHAIN, judged=False)
START = np.array([float(name == "real") for name in REMEMBERED])
"""What is remembered of a drive in whose position there is no doubt."""


def tracked(readings: list[float], dt: float, shown: float = 1.0) -> list[dict[str, float]]:
    """Return what is remembered of a drive after each reading, while its force stays as it is."""
    step = track_function(CHAIN, judged=True)
    now, found = START, []
    for value in readings:
        of_force = [0.0, READ, 2500.0, shown, 0.0, 0.1, 0.0]
        given = [value, READ, 2.5e-11, *np.zeros(6), *of_force]
        now = np.array(step(now, given, dt, faded(dt))).ravel()[:MEMORY]
        found.append(dict(zip(REMEMBERED, now)))
    return found


def among_logs(now: Floats, position: float, wandering: float = 0.0) -> Floats:
    """Return what is remembered of a drive that no force judges after a reading, where logs were
    within 1 mm of zero.
    """
    given = [position, READ, 2.5e-11, wandering, wandering, 1e-8, 0.0, 1e-3, 1.0, *np.zeros(7)]
    return np.array(UNJUDGED(now, given, 0.005, faded(0.005))).ravel()[:MEMORY]


def test_a_reading_that_stays_over_a_slow_interval_is_believed() -> None:
    """Where a joint follows at once its force tells nothing."""
    assert tracked([0.0, 3e-3, 3e-3], 0.05, shown=0.0)[-1]["position"] == pytest.approx(3e-3)


def test_of_a_reading_after_one_that_stood_still_nothing_is_told_yet() -> None:
    """A sensor that is stuck since its jump may come back anywhere, its evidence was of that
    value."""
    found = tracked([0.0, 0.0, *[3e-3] * 15, 3e-3 + 1e-5], 0.005)
    assert all(one["real"] < 1e-6 for one in found[2:17])
    assert found[16]["lost"] > 0.05
    assert found[17]["evidence"] == 0.0
    assert found[17]["real"] > 0.9
    moving = tracked([0.0, 0.0, 3e-3, 3e-3 + 1e-5, 3e-3 + 2e-5], 0.005)
    assert moving[-1]["evidence"] < -10.0


def test_of_a_position_that_is_missing_maps_know_by_its_age_alone() -> None:
    """Only one that may be off has a variance beside both positions: where it stands still."""
    at = {name: k for k, name in enumerate(REMEMBERED)}
    memory = np.zeros(MEMORY)
    memory[[at["real"], at["unknown"], at["lost"]]] = 1.0, 4.0, 2.0
    missing = branches(ca.DM(memory))
    assert (float(missing["variance"]), float(missing["believed"])) == (0.0, 0.0)
    memory[[at["shift"], at["real"]]] = 1.0, 0.5
    stands = branches(ca.DM(memory))
    assert float(stands["variance"]) == pytest.approx(4.0 - 0.25)
    assert float(stands["believed"]) == 1.0


def test_a_position_that_stands_still_and_is_off_is_somewhere_in_the_logs() -> None:
    """Its variance grows as that of one that is missing, up to that of two places of the logs."""
    now = START
    for _ in range(400):
        now = among_logs(now, 8e-3, 0.1)
    found = dict(zip(REMEMBERED, now))
    assert found["lost"] > 1.0
    assert found["real"] < 1e-6
    assert found["unknown"] == pytest.approx(2 * 1e-3**2)


def test_where_logs_never_were_a_drive_did_not_jump() -> None:
    """Its chance falls with the normal density beyond two stds of the logs' positions."""
    real = REMEMBERED.index("real")
    chances = np.array([among_logs(START, position)[real] for position in (1e-3, 2e-3, 4e-3)])
    odds = chances / (1.0 - chances)
    assert odds[0] == pytest.approx(odds[1])
    assert odds[2] == pytest.approx(odds[0] * exp(-6.0))


def test_an_angle_is_in_both_places_of_its_drive() -> None:
    """A drive of 6 mm whose joint has 5 mm may have jumped by 0.2: p (1 − p) s² of it, (31)."""
    filtered = AdaptiveFilter(load_rig("wrist-instrument"), compiled=False)
    function = adaptive_function(filtered.states)
    layout = adaptive_layout(filtered.states)
    state = np.zeros(layout.size)
    for name, value in (("position", 0.06), ("shift", 0.2), ("real", 0.3), ("unknown", 0.0084)):
        state[layout["drives"].start + REMEMBERED.index(name)] = value
    told = filtered._tracked(function)(state, filtered.parameters)
    off, real, chance, beside, believed, spreads = (np.array(part).ravel() for part in told)
    assert (off[0], real[0], chance[0], beside[0]) == pytest.approx((0.0, 0.2, 0.3, 0.0), abs=1e-12)
    assert np.all(believed == 1.0)
    assert spreads == pytest.approx([0.21 * (0.2 * 6e-3 / 5e-3) ** 2, 0.0, 0.0], rel=1e-9)


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
    scenario = flexed(3.0, 0.05)
    log = simulate(rig, scenario, seed=1)
    assert np.ptp(log.truth["theta_mcp"]) < 0.05
    stds = []
    for opens in (True, False):
        guards = replace(Robustness.usual(3), opens_torques=opens)
        stds.append(estimate(log, rig, AdaptiveFilter(rig, robustness=guards)).angle_stds[-1, 0])
    assert stds[0] < 1.2 * stds[1]


def test_contacts_of_a_finger_load_the_joints_before_them() -> None:
    """Of three links of 45, 25 and 20 mm on one drive: forces at their ends, across the finger, against
    levers written out; each joint alone where there are as many drives as joints.
    """
    one_drive = load_rig("finger-underactuated")
    shape = contact_shape(one_drive)
    ends = np.array([[45.0, 0.0, 0.0], [70.0, 25.0, 0.0], [90.0, 45.0, 20.0]])
    levers = ends.T @ ends
    assert shape == pytest.approx(levers / levers[0, 0] + 0.01 * np.eye(3))
    assert contact_shape(load_rig("finger-2n")) == pytest.approx(np.eye(2))


def test_torques_that_contacts_make_together_open_together() -> None:
    """The covariance of three torques after 0.1 s against (13b) written out, from none."""
    runner = AdaptiveFilter(load_rig("finger-underactuated"), compiled=False)
    states, dt = runner.states, 0.1
    n, opened = len(states), np.array([4e-4, 1e-4, 9e-6])
    x = ca.MX(ca.DM([dt] + [0.0] * (states.context.width - 1)))
    interval = Interval(ca.MX(), ca.MX(), x, ca.MX(ca.DM(runner.parameters)))
    zeros = (ca.MX(ca.DM.zeros(n)), ca.MX(ca.DM.zeros(n, n)), ca.MX(ca.DM.eye(n).full()))
    prediction = Prediction(*zeros)
    revert(states, prediction, {j: ca.MX(o) for j, o in enumerate(opened)}, interval)
    covariance = np.array(ca.evalf(prediction.covariance))
    at = list(states.torque_states)
    shape = contact_shape(load_rig("finger-underactuated"))
    stds = np.sqrt(opened / np.diag(shape))
    fade = exp(-dt / 0.5)
    expected = (1 - fade**2) * shape * np.outer(stds, stds)
    assert covariance[np.ix_(at, at)] == pytest.approx(expected, rel=1e-9)
