"""What is normal of forces in free motion, logs that are touched, and what a filter makes of it."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest

from distal import LiveEstimator, Log, Rig, diagnose, estimate, log_health
from distal.arrays import Floats
from distal.estimators import AdaptiveFilter
from distal.fitting.learned_maps import efforts_of
from distal.fitting.usable_logs import touched_logs
from distal.kernels import Feed, advance
from distal.kernels.layout import READ
from distal.regression import ReportedMap, map_parameters, reporting_function
from distal.rig import LearnedMap, LeftOut
from distal.run import JointContact, Monitor
from distal.run.health import Watch
from tests.learned_maps import drawn_map
from tests.support.pushed_finger import finger, finger_rig

PUSHED = 6.0


@pytest.fixture(scope="module")
def free() -> list[Log]:
    return [finger(seed, 12.0, None)[0] for seed in range(4)]


@pytest.fixture(scope="module")
def rig(free: list[Log]) -> Rig:
    """Return a finger with load cells that says nothing of touches, with the free motion of all
    logs but the last.
    """
    described = finger_rig().with_values({"joints.finger.external_torque.std": 0.0})
    return described.with_map(efforts=efforts_of(free[:3], described, range(3)))


@pytest.fixture(scope="module")
def pushed() -> Log:
    """Return a log in which the finger is pushed from 6 s on."""
    return finger(7, PUSHED + 4.0, PUSHED)[0]


def contacts(rig: Rig, log: Log, touches: bool = True) -> list[JointContact]:
    """Return what a stream says of the one joint: ok until 0.2 s after something `touches` it."""
    monitor = Monitor(LiveEstimator(rig))
    samples = np.column_stack([log.channels[name] for name in monitor.channels])
    readings = [monitor.take(float(t), sample) for t, sample in zip(log.time, samples)]
    before, during = (
        {one.health for one in readings if begin < one.time < end}
        for begin, end in ((0.0, PUSHED), (PUSHED + 0.2, PUSHED + 3.0))
    )
    assert (before, during) == ({"ok"}, {"touched"} if touches else {"ok"})
    return [reading.contacts[0] for reading in readings]


def test_a_push_is_felt_followed_and_forgotten(rig: Rig, pushed: Log) -> None:
    """The angle stays right, the torque is known, nothing is felt before it; 1.5 s
    after it nothing is left.
    """
    found, result = contacts(rig, pushed), estimate(pushed, rig)
    never = estimate(pushed, rig.with_values({"joints.finger.touch": "never"}))
    push = (pushed.time > PUSHED + 0.5) & (pushed.time < PUSHED + 3.0)
    true = pushed.truth["external_torque"]
    first = next(t for t, one in zip(pushed.time, found) if one.since > 0.0)
    assert PUSHED < first < PUSHED + 0.2
    felt = [one for one, is_pushed in zip(found, push) if is_pushed]
    assert all(one.since > 0.0 for one in felt)
    assert np.mean([one.probability > 0.5 for one in felt]) > 0.99
    error, before = (np.sqrt(np.mean(each.errors().ravel()[push] ** 2)) for each in (result, never))
    assert error < 0.5 * before
    wrong = np.array([one.torque for one in found])[push] - true[push]
    assert np.sqrt(np.mean(wrong**2)) < 0.2 * np.abs(true[push]).max()
    stands = [one.since for t, one in zip(pushed.time, found) if push[0] or t < PUSHED + 3.0]
    assert PUSHED + 3.0 - first - 0.02 < max(stands) < 3.0


def test_nothing_is_felt_in_free_motion(rig: Rig, free: list[Log]) -> None:
    found = contacts(rig, free[3], touches=False)
    assert not any(one.since for one in found)


def test_logs_that_are_touched_are_found(free: list[Log]) -> None:
    assert touched_logs(free, finger_rig()) == []
    held = free[2].truth["theta"] - np.deg2rad(12) * (np.sin(0.7 * free[2].time) > 0.3)
    logs = [*free[:3], replace(free[2], truth={"theta": held}), free[3]]
    assert touched_logs(logs, finger_rig()) == [3]


def test_neither_numbers_nor_innovations_accuse_a_rig_that_logs_taught(
    rig: Rig, free: list[Log]
) -> None:
    """Stiffnesses are said to be half of what they are, ± 3 %: the filter leaves them. Only of a
    rig that was not fitted that contradicts the log.
    """
    stiffness = [0.5 * tendon.stiffness.value for tendon in rig.tendons]
    wrong = rig.with_values(
        {"joints.finger.touch": "never"}
        | {
            f"tendons.{i}.stiffness": {"value": value, "std": 0.03 * value}
            for i, value in enumerate(stiffness)
        }
    )
    for described, accused in ((wrong.bare(), True), (wrong, False)):
        assert bool(Watch(LiveEstimator(described).estimator).watched) is accused
        kinds = {finding.kind for finding in diagnose(estimate(free[3], described)).findings}
        assert kinds == ({"too large", "left its prior"} if accused else set())
        assert log_health(free[3], described)[-1] == ("disagrees" if accused else "ok")


def test_what_lasts_learns_nothing_while_touched(rig: Rig, pushed: Log) -> None:
    """Parameters and biases move before the push, and not by a force while it is clear."""
    known = rig.with_values({"sensors.u_flexor.bias.std": "0.3 N"})
    estimator = AdaptiveFilter(known)
    states = np.flatnonzero(estimator.states.lasting)
    samples = np.column_stack([pushed.channels[name] for name in estimator.channels])
    rows, _ = estimator.rows(np.diff(pushed.time, prepend=pushed.time[0]), samples)
    begun = estimator.initial(float(pushed.time[0]), samples[0])
    kernel_states = advance(
        estimator.kernel, Feed(begun.kernel_state, rows, estimator.parameters)
    ).kernel_states
    moved = np.abs(np.diff(kernel_states[:, states], axis=0)).max(axis=1)
    touched = kernel_states[:-1, estimator.contacts["finger"][1]] > 0.0
    assert touched.sum() > 300
    assert moved[touched].max() < 1e-12
    assert moved[~touched].max() > 1e-6


BESIDE = drawn_map()
ALONE = drawn_map(beside_filter=False, seed=3)


def reported(maps: list[LearnedMap], state: list[float], touched: tuple[int, ...] = ()) -> Floats:
    """Return value, gain and variance of the joint as maps report it, after one sample beside a
    filter whose states stay as they are.
    """
    kernel_state, x, p = (ca.MX.sym(name, size) for name, size in (("c", 2), ("x", 5), ("p", 1)))
    inner = ca.Function("inner", [kernel_state, x, p], [kernel_state, ca.MX(1, 1)])
    placed = [ReportedMap(learned, (0, 1), (0,)) for learned in maps]
    state_of, p = ca.MX.sym("state", 2), ca.MX.sym("p", 1)
    none = ca.MX(0, 1)
    as_read = [none, none, ca.MX(0), none, ca.MX.ones(2), ca.MX.zeros(1)]
    tracked = ca.Function("tracked", [state_of, p], as_read)
    function = reporting_function(inner, placed, [None, None], [1], touched, tracked, (), ())
    parameters = np.concatenate([[0.0], *map(map_parameters, maps)])
    start = [*state, *np.zeros(function.size1_in(0) - 2)]
    _, y = function(start, [0.05, 0.1, 0.02, READ, READ], parameters)
    return np.array(y).ravel()[1:]


def test_a_map_beside_a_filter_is_doubted_while_touched() -> None:
    """gain⁺ = (1 − s) gain + s, variance⁺ = variance + s a², and the value stays."""
    value, gain, variance = reported([BESIDE], [0.2, 0.0])
    for share in (0.0, 0.4, 1.0):
        doubted = reported([BESIDE], [0.2, share], touched=(1,))
        doubt = share * (value - 0.2) ** 2
        expected = [value, (1 - share) * gain + share, variance + doubt]
        np.testing.assert_allclose(doubted, expected, rtol=1e-12)


@pytest.mark.parametrize("touched", [(), (1,)])
def test_a_filter_and_readings_alone_are_pooled_by_their_variances(
    touched: tuple[int, ...],
) -> None:
    """Mean and variance of the mixture of both, by its first two moments; while touched both count
    the same, since no log of free motion tells which of them is right then.
    """
    # one number is the share of the touch and the variance of the filter's own angle
    for own in (0.0, 0.04, 1.0):
        a, gain, added = reported([BESIDE], [0.2, own], touched)
        b, none, variance = reported([ALONE], [0.2, own])
        assert none == 0.0
        of_filter = gain**2 * own + added
        share = variance / (of_filter + variance)
        if touched:
            share = (1 - own) * share + 0.5 * own
        pooled = reported([BESIDE, ALONE], [0.2, own], touched)
        mean = share * a + (1 - share) * b
        second = share * (of_filter + a**2) + (1 - share) * (variance + b**2)
        assert pooled[0] == pytest.approx(mean)
        assert pooled[1] ** 2 * own + pooled[2] == pytest.approx(second - mean**2)


def test_how_a_fit_did_is_said() -> None:
    said = LeftOut(logs=4, rms=np.deg2rad(0.5), inside=0.93)
    assert said.in_words() == (
        "on 4 logs left out of its fit the rig errs by 0.5°, 93 % inside the 95 % band"
    )
