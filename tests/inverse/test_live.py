"""The inverse in a loop: its guide against a naive twin, a plant that is not the model's, and what
goes wrong in use.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy, deepcopy

import casadi as ca
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Inverse, LiveInverse, load_rig
from distal.errors import CommandError
from distal.inverse import Command, Feedback
from distal.inverse.command_trajectory import followable, sent
from distal.inverse.live_inverse import (
    ACROSS,
    GUIDED,
    LEAVES,
    OF_EACH,
    RESPONDS,
    SMOOTHED,
    guided,
    readings,
)
from tests.learned_maps import constant_map
from tests.support.commands import driven, hunts, inextensible, live_law, run
from tests.support.servo_plants import PERIOD, Ropes

RIG = "paper-2008-observed"


@pytest.fixture(scope="module")
def inverse() -> LiveInverse:
    return LiveInverse(RIG, compiled=False)


@pytest.fixture(scope="module")
def sample(inverse: LiveInverse) -> np.ndarray:
    """Return readings of drives that hold the joint at 0.1 rad."""
    commands = Inverse(RIG, compiled=False)(np.array([0.0, 0.01]), np.full((2, 1), 0.1))
    kinds = {"x": commands.sent[-1], "u": commands.forces[-1]}
    return np.array([kinds[name[0]][int(name[1]) - 1] for name in inverse.channels])


def go(inverse: LiveInverse, begin: int, end: int, desired: float, sample: np.ndarray) -> Command:
    """Step 100 times a second, from one sample to another, and return the last command."""
    for k in range(begin, end):
        command = inverse.step(0.01 * k, [desired], sample)
    return command


def naive_guide(v: dict[str, float]) -> dict[str, float]:
    """Return what the guide of one joint gives, in plain numbers."""
    dt = v["dt"]
    first = v["angles"] if v["trusted"] else v["desired"]
    before = v["reference_before"] if v["started_before"] else first
    wished, fastest = v["wished_before"] if v["started_before"] else first, v["fastest"]
    most = fastest / RESPONDS
    braking = np.sqrt(2 * most * abs(wished - before))
    rate = np.clip((v["desired"] - wished) / dt, -fastest, fastest)
    rate += np.clip((wished - before) / dt, -braking, braking)
    change = np.clip(rate, -fastest, fastest) - v["rate_before"]
    rate = v["rate_before"] + np.clip(change, -most * dt, most * dt)
    step = rate * dt
    share = dt / (dt + SMOOTHED)
    speed = (1 - share) * v["speed_before"] + share * step / dt
    acceleration = (1 - share) * v["acceleration_before"] + share * (speed - v["speed_before"]) / dt
    error = before + step - v["angles"]
    rests = abs(error) < v["deadband"] * (LEAVES if v["rests_before"] else 1.0)
    counted = np.sign(error) * max(abs(error) - v["deadband"], 0.0)
    counted *= v["trusted"] and not rests
    correction = v["correction_before"] + v["winds"] * v["follow"] * counted * dt
    correction = np.clip(correction, -v["correction_limit"], v["correction_limit"])
    turning = (v["angles"] - v["last_before"]) / dt if v["started_before"] else 0.0
    asked = (
        v["proportional"] * counted
        + v["integral"] * v["effort_before"]
        + v["derivative"] * v["trusted"] * (speed - turning)
    )
    pushed = np.clip(asked, -v["torque_limit"], v["torque_limit"])
    return {
        "wished": v["desired"],
        "reference": before + step,
        "rate": rate,
        "speed": speed,
        "acceleration": acceleration,
        "correction": correction,
        "effort": v["effort_before"] + (counted * dt if pushed == asked else 0.0),
        "rests": float(rests),
        "correcting": (correction - v["correction_before"]) / dt,
        "pushed": -pushed,
    }


@given(st.integers(0, 10_000))
def test_the_guide_is_that_of_plain_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    now = ("angles", "desired", "dt", "trusted", "free", "winds")
    before = (*GUIDED, "last", "started")
    names = (*now, *OF_EACH, *(f"{name}_before" for name in before))
    values = {name: float(rng.normal()) for name in names}
    positive = OF_EACH
    switches = ("trusted", "winds", "started_before", "rests_before")
    values |= {name: abs(values[name]) for name in positive} | {"dt": rng.uniform(0.001, 0.02)}
    values |= {name: float(rng.integers(2)) for name in switches}
    reach = values["fastest"] * values["dt"]
    values["wished_before"] = values["reference_before"] + 0.1 * rng.normal() * reach
    values["desired"] = values["wished_before"] + rng.normal() * reach
    values["rate_before"] = rng.normal() * values["fastest"]
    values["angles"] = values["reference_before"] + rng.normal() * values["deadband"]
    was = {name: ca.DM(values[f"{name}_before"]) for name in before}
    gains = {name: ca.DM(values[name]) for name in OF_EACH}
    found = guided(was, gains, **{name: ca.DM(values[name]) for name in now})
    for name, expected in naive_guide(values).items():
        assert float(found[name]) == pytest.approx(expected, rel=1e-9, abs=1e-12), name


def test_on_a_plant_of_others_the_joint_goes_where_it_is_wanted() -> None:
    """Ropes that creep, with backlash and servos that lag: better than lengths alone, and still at
    rest.
    """
    rig, time = Ropes(0).rig, np.arange(600) * PERIOD
    desired = np.where(time < 3.0, 0.4 * np.sin(2.0 * time), 0.4 * np.sin(6.0))[:, None]
    start = Inverse(rig, least_tension=2.0)(time, desired).sent[0]
    late = time >= 0.5
    live = driven(Ropes(0), rig, desired, (0,), start, live_law(rig, Feedback()))
    ratio, _ = run(Ropes(0), inextensible(rig, desired, start))
    errors = [np.sqrt(np.mean((angles - desired)[late] ** 2)) for angles in (live, ratio)]
    assert errors[0] < 0.4 * errors[1]
    assert np.rad2deg(errors[0]) < 0.8
    assert hunts(time, desired, live) == 0


@pytest.mark.parametrize("cloned", [LiveInverse.clone, copy, deepcopy])
def test_a_clone_goes_on_alone(
    inverse: LiveInverse, sample: np.ndarray, cloned: Callable[[LiveInverse], LiveInverse]
) -> None:
    inverse.reset()
    go(inverse, 0, 5, 0.2, sample)
    other, twin = cloned(inverse), cloned(inverse)
    once = go(other, 5, 6, 0.25, sample)
    assert inverse.estimator.time == 0.04
    np.testing.assert_array_equal(once.positions, go(twin, 5, 6, 0.25, sample).positions)
    # a stamp that comes twice leaves the last command as it is
    again = go(cloned(inverse), 4, 5, 0.25, sample)
    assert again.forces.any()
    np.testing.assert_array_equal(again.forces, inverse._y["forces"])
    np.testing.assert_array_equal(again.speeds, inverse._y["speeds"])


def test_nothing_is_sent_before_every_drive_was_read(
    inverse: LiveInverse, sample: np.ndarray
) -> None:
    """A buffer that was never filled is no command: all motors would go to zero."""
    inverse.reset()
    one = sample.copy()
    one[inverse.channels.index("x1")] = np.nan
    for time, lost in ((0.0, np.nan * sample), (0.01, sample[:1]), (np.nan, sample), (0.02, one)):
        command = inverse.step(time, [0.1], lost)
        assert np.isnan([command.positions, command.speeds, command.forces]).all()
        assert "nothing is sent" in command.note
    assert np.isfinite(go(inverse, 3, 4, 0.1, sample).positions).all()
    # once a command was sent, it stays while nothing is read
    assert np.isfinite(go(inverse, 4, 5, 0.1, np.nan * sample).positions).all()


def test_a_late_sample_leaves_the_command(inverse: LiveInverse, sample: np.ndarray) -> None:
    inverse.reset()
    last = go(inverse, 0, 2, 0.12, sample)
    late = inverse.step(0.005, [0.5], sample)
    np.testing.assert_array_equal(late.positions, last.positions)
    assert "late" in late.note
    for time, read in ((np.nan, sample), (0.02, sample[:1])):
        assert "the last command stays" in inverse.step(time, [0.5], read).note
    assert "stays" not in inverse.step(0.02, [0.12], sample).note


def test_a_jump_is_as_fast_as_joints_may_turn_and_no_angle_is_the_one_before(
    inverse: LiveInverse, sample: np.ndarray
) -> None:
    inverse.reset()
    positions = []
    for k in range(60):
        desired = 0.1 if k < 10 else 0.3 if k < 40 else np.nan
        positions.append(inverse.step(0.01 * k, [desired], sample).positions)
    # inertia at the largest acceleration, friction that turns over, and the motion itself
    fastest = np.ptp(inverse.rig.joints[0].travel) / ACROSS
    arm, inertia = 9.53e-3, inverse.rig.joints[0].inertia.value
    stretch = (inertia * fastest / RESPONDS + 2 * 0.03) / arm / 806.0
    assert np.abs(np.diff(positions, axis=0)).max() < 2 * stretch + fastest * 0.01 * arm
    assert np.abs(positions[-1] - positions[9]).max() > 0.15 * arm
    np.testing.assert_allclose(positions[-1], positions[42], atol=2e-4)


def test_what_is_not_known_is_not_fed_back(inverse: LiveInverse, sample: np.ndarray) -> None:
    """All sensors silent for long: the correction stays, commands go on, and it is said."""
    inverse.reset()
    go(inverse, 0, 100, 0.3, sample)  # the readings say 0.1: it is corrected
    silent = go(inverse, 100, 400, 0.3, np.nan * sample)
    (held,) = inverse._kernel_state["correction"].copy()
    assert abs(held) > 0.01
    assert "no feedback" in silent.note
    silent = go(inverse, 400, 401, 0.2, np.nan * sample)
    assert inverse._kernel_state["correction"] == [held]
    assert np.isfinite(silent.positions).all()


@pytest.mark.parametrize("arrives", [True, False])
def test_commands_begin_anew_where_none_arrives(
    inverse: LiveInverse, sample: np.ndarray, arrives: bool
) -> None:
    """The joint did not go where they would have brought it: what was learned of that is wrong."""
    inverse.reset()
    go(inverse, 0, 100, 0.3, sample)
    for k in range(100, 130):
        go(inverse, k, k + 1, 0.3, sample)
        inverse.confirm(arrives)
    corrected = abs(inverse._kernel_state["correction"][0])
    assert corrected > 0.01 if arrives else corrected == 0.0
    if not arrives:
        assert inverse._kernel_state["reference"] == pytest.approx(inverse.estimator.mean[:1])


def test_an_angle_is_commanded_for_when_the_drive_gets_there(sample: np.ndarray) -> None:
    """With a delay of 50 ms, along w = a t²/2: the command is for w at t + 50 ms, the bend
    included.
    """
    late, acceleration = 0.05, 4.0
    rig = load_rig(RIG).with_values({f"drives.{i}.servo": {"delay": late} for i in range(2)})
    inverse = LiveInverse(rig, feedback=Feedback(follow=0.0), compiled=False)
    for k in range(60):
        go(inverse, k, k + 1, 0.1 + acceleration * (0.01 * k) ** 2 / 2, sample)
    desired = 0.1 + acceleration * (0.59 + late) ** 2 / 2
    # differences over 10 ms are half of that late, and smoothed over 5 ms
    behind = late * acceleration * (0.005 + SMOOTHED)
    bend = acceleration * late**2 / 2
    assert float(inverse._y["angles"][0]) == pytest.approx(desired - behind, abs=0.3 * bend)


def test_a_learned_map_is_taken_off_and_a_torque_from_outside_is_held() -> None:
    """A map that adds 0.02 rad: the same places as without it for an angle that is 0.02 rad
    smaller.
    """
    rig = load_rig("capstan-joint")
    learned = constant_map("jaw", ("motor_angle", "motor_torque"), 0.02, 0.01)
    positions = []
    for one, desired in ((rig, 0.1), (rig.with_map(filter=[learned]), 0.12)):
        inverse = LiveInverse(one, feedback=Feedback(follow=0.0), compiled=False)
        sample = np.zeros(len(inverse.channels))
        command = go(inverse, 0, 40, desired, sample)
        assert command.note == ""
        positions.append(command.positions)
    np.testing.assert_allclose(positions[0], positions[1], atol=2e-5)


@pytest.mark.parametrize(("compensates", "share"), [(True, -1.0), (False, 0.0)])
def test_a_torque_that_the_filter_sees_is_held_against_only_where_asked(
    sample: np.ndarray, compensates: bool, share: float
) -> None:
    """τ from outside at rest: the drives make τ less, by their levers, than without it; unless
    asked they do nothing, since what is held would be pressed harder.
    """
    rig = load_rig(RIG).with_values({"joints.link.external_torque.std": 0.05})
    inverse = LiveInverse(
        rig, feedback=Feedback(follow=0.0), compensates=compensates, compiled=False
    )
    at = inverse.estimator.state_names.index("external_torque")
    forces = []
    for torque in (0.0, 0.01):
        inverse.reset()
        go(inverse, 0, 30, 0.1, sample)
        inverse._x["state"][at] = torque
        inverse._loop.step()
        forces.append(inverse._y["tensions"].copy())
    left, right = forces[1] - forces[0]
    assert 9.53e-3 * (left - right) == pytest.approx(
        0.01 * share, rel=0.25
    )  # friction follows the tensions


@pytest.mark.parametrize("touched", [0.0, 0.9])
def test_feedback_does_not_wind_up_against_what_is_touched(
    sample: np.ndarray, touched: float
) -> None:
    inverse = LiveInverse(RIG, feedback=Feedback(follow=1.0, integral=0.1), compiled=False)
    go(inverse, 0, 30, 0.1, sample)
    inverse._x["touched"][:] = touched
    before = {name: inverse._kernel_state[name].copy() for name in ("correction", "effort")}
    for _ in range(20):
        inverse._loop.step()
    for name, value in before.items():
        assert (inverse._kernel_state[name] == value).all() == (touched > 0.5)


def test_nothing_winds_up_against_a_stop_or_the_end_of_a_range() -> None:
    """Wanted far beyond what the rig can: said, the correction stays small, and the joint comes
    back at once.
    """
    for name, why in (("lab-bench", ""), (RIG, "at the end of its range")):
        inverse = LiveInverse(name, feedback=Feedback(follow=5.0), compiled=False)
        command = go(inverse, 0, 200, 3.0, np.zeros(len(inverse.channels)))
        assert why in command.note
        (correction,) = inverse._kernel_state["correction"]
        _, end = inverse.rig.joints[0].stops or (0.0, 3.0)
        assert abs(inverse._kernel_state["reference"][0]) <= end
    assert abs(correction) < 0.5 * Feedback().correction_limit


def test_a_drive_that_follows_speeds_comes_back_to_its_place(
    inverse: LiveInverse, sample: np.ndarray
) -> None:
    """A tenth of a second for what its reading is away, the motion of the place beside it."""
    inverse.reset()
    command = go(inverse, 0, 200, 0.1, sample)
    read = sample[[inverse.channels.index(name) for name in ("x1", "x2")]]
    np.testing.assert_allclose(command.speeds, (command.positions - read) / 0.1, atol=2e-3)


def test_a_reading_is_the_place_and_its_offset() -> None:
    rig = load_rig("paper-2008").with_values({"sensors.x1.bias": {"value": 2e-4, "std": 0.0}})
    positions = np.linspace(-2e-3, 6e-3, 9)
    found = readings(rig, np.column_stack([positions, positions]))
    np.testing.assert_allclose(found[:, 0], positions + 2e-4, atol=1e-7)
    np.testing.assert_allclose(found[:, 1], positions, atol=1e-12)


def test_a_servo_is_where_it_has_to_be_in_time() -> None:
    """u(t) = s(t + T) + ds/dt(t + T)/(2π f) of a sine, and a jump no faster than a drive goes."""
    servo, step, rate = {"bandwidth": 10.0, "delay": 0.02, "fastest": 1.0}, 1e-3, 2 * np.pi * 0.7
    drive = load_rig(RIG).with_values({"drives.0.servo": servo}).drives[0]
    time = np.arange(0.0, 3.0, step)
    late = rate * (time + 0.02)
    expected = 5e-3 * (np.sin(late) + 0.07 * np.cos(late))
    found = sent(time, 5e-3 * np.sin(rate * time), drive)
    np.testing.assert_allclose(found[100:2900], expected[100:2900], atol=1e-5)
    fast = followable(time, np.where(time < 1.5, 0.0, 1.0), drive)
    assert np.abs(np.diff(fast)).max() <= step * (1 + 1e-9)
    assert fast[1500] == pytest.approx(0.5, abs=0.01)  # half of a jump before it, half after


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"least_tension": "3 mm"}, "least_tension"),
        ({"least_tension": -1.0}, "at least 0 N"),
        ({"fastest": 0.0}, "fastest: a speed above 0"),
        ({"feedback": {"elbow": Feedback()}}, "feedback is for the joints link; elbow came"),
    ],
)
def test_a_wrong_setting_is_named(change: dict[str, object], words: str) -> None:
    with pytest.raises(CommandError, match=words):
        LiveInverse(RIG, compiled=False, **change)  # type: ignore[arg-type]


GAINS = ("follow", "deadband", "proportional", "integral", "derivative")


@pytest.mark.parametrize(
    ("name", "wrong", "words"),
    [
        *(
            (gain, wrong, "0 or a finite number above")
            for gain in GAINS
            for wrong in (np.inf, -1.0)
        ),
        ("follow", np.nan, "0 or a finite number above"),
        *(("torque_limit", wrong, "a number above 0") for wrong in (0.0, -1.0, np.nan)),
    ],
)
def test_a_gain_or_a_limit_that_makes_no_sense_is_named(
    name: str, wrong: float, words: str
) -> None:
    with pytest.raises(CommandError, match=rf"feedback\.{name}: {words}"):
        Feedback(**{name: wrong})


@pytest.mark.parametrize("desired", [[0.1, 0.2], {"elbow": 0.1}, []])
def test_wanted_angles_are_those_of_the_joints(
    desired: object, inverse: LiveInverse, sample: np.ndarray
) -> None:
    with pytest.raises(CommandError, match="link"):
        inverse.step(0.0, desired, sample)  # type: ignore[arg-type]
