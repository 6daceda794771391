"""The power-on routine on plants of others: what it moves, what it finds, what it says of
faults.
"""

from __future__ import annotations

from functools import lru_cache
from math import isnan, nan

import numpy as np
import pytest

from distal.errors import CommandError, FitError, LogError
from distal.hands import Calibrated, Fault, Routine, RoutineOptions, calibrate
from distal.hands.calibrate import faults_of, slack_of
from distal.hands.power_on_routine import OF_PAIR, sweeps_of
from distal.logs import Log
from distal.rig import Capstan, Rig, number
from tests.support.hands import Driven, calibrated, rig_of, routines_of
from tests.support.servo_hands import Hands, Known, orca_like

JOINTS = ("index_mcp", "ring_abd")


def hand(seed: int = 3) -> tuple[Known, Hands]:
    """Return a hand of two joints."""
    return orca_like([seed], JOINTS)


def known_rig() -> Rig:
    return rig_of(hand()[0])


@lru_cache
def routine_log() -> tuple[Calibrated, Log]:
    """Return a calibration and its log; shared, since it takes seconds."""
    known, hands = hand()
    return calibrated(known, hands, rig_of(known))[0]


def test_each_motor_meets_both_ends_and_only_one_moves_at_a_time() -> None:
    _, log = routine_log()
    known, rig = hand()[0], known_rig()
    for motor in known.motors:
        sweeps = sweeps_of(log, rig, motor)
        assert [sweep.way for sweep in sweeps] == [1, -1, 1, -1, 1]
        assert all(sweep.resisted for sweep in sweeps)
    moving = [
        np.abs(np.gradient(log.channels[f"{motor}_position"])) > 1e-3 for motor in known.motors
    ]
    assert np.count_nonzero(moving[0] & moving[1]) < 10  # the first comes to rest


def test_no_parameter_of_a_pair_stays_at_its_prior() -> None:
    found, _ = routine_log()
    for drive in found.rig.drives:
        for path in (f"drives.{drive.name}.friction.load", f"tendons.{drive.name}_plus.stiffness"):
            value, start = (number(rig, path).value for rig in (found.rig, found.start))
            assert value != start, path


def test_no_torque_goes_far_beyond_the_limit() -> None:
    _, log = routine_log()
    assert max(np.abs(log.channels[f"m{i}_current"]).max() for i in (1, 2)) < 2 * 0.15


@pytest.mark.slow
def test_numbers_are_those_of_the_plant_within_their_errors() -> None:
    found, _ = routine_log()
    known, hands = hand()
    d = hands.d
    for k, drive in enumerate(found.rig.drives):
        assert isinstance(drive, Capstan)
        arm = known.arms[k, k]
        # what counts is the ratio of the radii, here with the arm that the rig takes as exact
        true = d.spools[0, k, k] / d.arms[0, k, k] * arm
        # what the model misses of a torque: some of what moves the motor
        assert 3e-3 < found.rig.sensors_of("force")[k].noise < d.gear_friction[0, k]
        assert abs(drive.radius.value - true) < 3 * drive.radius.std
        tendons = [tendon for tendon in found.rig.tendons if tendon.drive == drive.name]
        pair = float(d.slack[0, k] + d.slack[0, k + 2])
        slack = sum(tendon.slack.value for tendon in tendons)
        assert abs(slack - max(pair, 0.0)) < 0.35e-3  # 2.5 degrees of play


def faults_after(known: Known, hands: Hands) -> list[tuple[Fault, ...]]:
    """Return the faults of both motors of a hand by the log of its routine."""
    rig = rig_of(known)
    (routine,) = routines_of(known, hands, rig, together=True)
    assert routine.aborted == ""
    log = routine.log()
    return [faults_of(rig, motor, sweeps_of(log, rig, motor)) for motor in known.motors]


@pytest.mark.parametrize(
    ("part", "at", "value", "says"),
    [
        ("broken", (0, 2), True, "m1_minus is broken"),
        ("spools", (0, 2, 0), 7e-3, "the wrong way round"),
        ("slips", (0, 0), 0.07, "spool slips"),
    ],
)
def test_a_fault_is_found_at_its_motor_and_at_no_other(
    part: str, at: tuple[int, ...], value: float, says: str
) -> None:
    known, hands = hand(7)
    (hands.d.spools if part == "spools" else getattr(hands, part))[at] = value
    (fault,), others = faults_after(known, hands)
    assert says in fault.sentence
    assert "index_mcp" in fault.sentence
    assert others == ()


def test_a_joint_that_is_blocked_is_named() -> None:
    known, hands = hand(7)
    hands.d.low[0, 0], hands.d.high[0, 0] = -0.2, 0.2
    (fault,), _ = faults_after(known, hands)
    assert fault.kind == "side"
    assert "% of its travel" in fault.sentence


def test_what_a_sound_hand_says_is_nothing() -> None:
    found, _ = routine_log()
    assert found.faults == ()
    assert found.notes == ()


def read(position: float, torque: float) -> dict[str, float]:
    """Return a sample in which the second motor stands."""
    first = {"m1_position": position, "m1_current": torque}
    return first | {"m2_position": 2.0, "m2_current": 0.0}


@pytest.mark.parametrize(
    ("position", "torque", "seconds", "why"),
    [
        (1.0, 0.0, 0.55, "stands still"),
        (1.0, nan, 0.55, "nothing to go by"),
        (nan, nan, 0.55, "nothing to go by for 0.5"),
        (1.0, 0.9, 0.05, "a torque of 0.90 N m; its limit is 0.15"),
    ],
)
def test_a_motor_that_does_not_move_ends_its_part_at_once(
    position: float, torque: float, seconds: float, why: str
) -> None:
    """0.29 s until the goal is as far ahead as it may be, and 0.2 s in which it stands."""
    routine, k = Routine(known_rig()), 0
    goals = routine.step(0.0, read(1.0, torque))
    while not routine.failed:
        k += 1
        goals = routine.step(0.01 * k, read(position, torque))
    assert 0.01 * k < seconds
    assert why in routine.failed["m1"]
    assert goals["m1"] == pytest.approx(1.0, abs=0.1 * isnan(position))
    routine.step(0.01 * k + 0.01, read(position, torque))
    assert routine.moving == ("m2",)  # its turn has come


@pytest.mark.parametrize("wobble", [0.0, 0.02])
def test_the_next_motor_moves_when_one_stands_or_never_does(wobble: float) -> None:
    """Motors follow their goals between stops at ±1 rad; after their sweeps they may tremble."""
    routine = Routine(known_rig(), RoutineOptions(longest=5.0))
    goals = {"m1": 0.0, "m2": 0.0}
    k = 0
    while not routine.done and k < 12_000:
        k += 1
        sample = {}
        for name, goal in goals.items():
            stop = float(np.clip(goal, -1.0, 1.0))
            there = stop + 0.2 * (goal - stop) + 1e-4 * (k % 3)
            swept = routine._motors[name].done >= 5
            sample[f"{name}_position"] = there + (wobble * (-1) ** k if swept else 0.0)
            sample[f"{name}_current"] = 2.0 * (goal - stop) + 1e-3 * (k % 5)
        sent = routine.step(0.01 * k, sample)
        goals |= {name: goal for name, goal in sent.items() if np.isfinite(goal)}
    assert routine.done
    assert set(routine.failed) == ({"m1", "m2"} if wobble else set())


@pytest.mark.parametrize("current", [0.0, nan])
def test_without_a_current_no_motor_pushes_into_its_stop(current: float) -> None:
    """The plant says for how long."""
    known, hands = hand()
    routine, driven = Routine(rig_of(known)), Driven(hands)
    (positions,), torques = hands.positions + hands.d.zeros * driven.signs, [np.zeros(2)]
    while not routine.done and len(torques) < 4000:
        sample = dict(zip(("m1_position", "m2_position"), positions))
        sample |= {"m1_current": current, "m2_current": current}
        goals = routine.step(0.01 * len(torques), sample)
        (positions,), (torque,) = driven.read([[goals["m1"], goals["m2"]]])
        torques.append(np.abs(torque))
    assert set(routine.failed) == {"m1", "m2"}
    pushed = 0.01 * np.count_nonzero(np.array(torques) > OF_PAIR, axis=0)
    assert pushed.max() < 0.2


def test_it_can_be_aborted_at_any_time() -> None:
    routine = Routine(known_rig())
    routine.step(0.0, read(1.0, 0.0))
    routine.abort("the user said so")
    assert routine.done
    assert routine.aborted == "the user said so"
    assert routine.moving == ()


def test_an_order_names_joints_or_motors_and_what_is_left_comes_after() -> None:
    for order, moving in (([["ring_abd"]], ("m2",)), ([["m1", "ring_abd"]], ("m1", "m2"))):
        assert Routine(known_rig(), RoutineOptions(order=order)).moving == moving


@pytest.mark.parametrize(
    ("swing", "says"),
    [
        (0.0, "motor 'm2' sweeps 0 times"),
        (1.0, "no motor meets an end of its travel; is it the log of a"),
    ],
)
def test_a_log_that_is_none_of_a_routine_says_what_it_needs(swing: float, says: str) -> None:
    """Motors stand, or go to and fro and nothing ever resists."""
    time = np.arange(0.0, 20.0, 0.01)
    noise, channels = np.random.default_rng(1).normal(size=len(time)), {}
    for i in (1, 2):
        angle = swing * np.sin(2.0 * time + i)
        channels[f"m{i}_position"] = angle
        channels[f"m{i}_current"] = 0.03 * np.sign(np.gradient(angle)) + 2e-3 * noise
    with pytest.raises(LogError, match=says):
        calibrate(Log(time, channels), known_rig())


@pytest.mark.parametrize("ratio", [0.75, 1.2])
def test_a_travel_that_the_range_does_not_need_is_said(ratio: float) -> None:
    """The motor goes as it did, on a spool that is smaller or larger by the rig."""
    _, log = routine_log()
    rig = known_rig()
    radius = rig.drives[0].radius
    other = {"value": ratio * radius.value, "std": ratio * radius.std}
    wrong = rig.with_values({"drives.m1.radius": other})
    sweeps = {name: sweeps_of(log, wrong, name) for name in ("m1", "m2")}
    before = [fault for name in sweeps for fault in faults_of(wrong, name, sweeps[name])]
    after = slack_of(wrong, wrong, sweeps)
    ((fault,), none) = (before, after) if ratio < 1.0 else (after, before)
    assert len(none) == 0
    assert fault.drive == "m1"
    assert fault.kind == ("side" if ratio < 1.0 else "slack")
    assert "or its radii are others" in fault.sentence
    (size,) = (float(word.rstrip("°")) for word in fault.sentence.split() if word[0].isdigit())
    play = np.rad2deg((ratio - 1) * np.ptp(rig.joints[0].travel))
    assert size == pytest.approx(100 * ratio if ratio < 1.0 else play, abs=6)


def test_slack_that_was_found_is_said_where_the_travel_says_little() -> None:
    found, log = routine_log()
    rig = known_rig()
    sweeps = {name: sweeps_of(log, rig, name) for name in ("m1", "m2")}
    assert slack_of(found.rig, rig, sweeps) == ()
    (tendon, other) = (t for t in rig.tendons if t.drive == "m2")
    more = 3.1 * np.hypot(tendon.slack.std, other.slack.std)
    changed = {
        f"tendons.{tendon.name}.slack": {"value": tendon.slack.value + more, "std": 1e-4},
        f"tendons.{other.name}.slack": {"value": other.slack.value, "std": 1e-4},
    }
    (fault,) = slack_of(rig.with_values(changed), rig, sweeps)
    assert (fault.drive, fault.kind) == ("m2", "slack")
    assert f"about {np.rad2deg(more / tendon.total_arm):.0f}° further" in fault.sentence


def test_a_rig_of_sliders_is_refused() -> None:
    with pytest.raises(FitError, match="left, right are sliders"):
        calibrate(Log(0.01 * np.arange(3), {}, {}, "none"), "paper-2008")


@pytest.mark.parametrize(
    ("change", "says"),
    [
        ({"limits": 50.0}, r"limit of motor 'm1' \[N m\] must be from 0.001 to 5, 50.0 came"),
        ({"limits": {"n1": 0.1}}, "limits: there is no motor 'n1'"),
        ({"limits": {"m1": -1.0}}, "limit of motor 'm1'"),
        ({"order": [["thumb"]]}, "'thumb' is no motor and no joint"),
        ({"limits": "x"}, "limit of motor 'm1' .* must be from 0.001 to 5, 'x' came"),
        ({"speed": -1.0}, r"speed \[rad/s\] must be from 0.05 to 20, -1.0 came"),
        ({"sweeps": 2}, "sweeps must be from 3 to 1000, 2 came"),
        ({"longest": 0.0}, r"longest \[s\] must be from 1 to 3600"),
    ],
)
def test_options_that_cannot_be_are_refused_before_anything_moves(
    change: dict[str, object], says: str
) -> None:
    with pytest.raises(CommandError, match=says):
        Routine(known_rig(), RoutineOptions(**change))  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("positions", "torques", "says"),
    [
        (
            180 / np.pi,
            1.0,
            "turn [0-9]+ times as far as their joints' ranges ask for, or more; is the unit of "
            "their positions",
        ),
        (1.0, 1e-3, "torques while they move are .* N m at most; is the unit of their currents"),
        (1.0, 1e3, "is the unit of their currents"),
    ],
)
def test_wrong_units_are_named_instead_of_broken_tendons(
    positions: float, torques: float, says: str
) -> None:
    _, log = routine_log()
    channels = {
        name: values * (positions if name.endswith("position") else torques)
        for name, values in log.channels.items()
    }
    with pytest.raises(FitError, match=says):
        calibrate(Log(log.time, channels), known_rig())
