"""The inverse in a loop: its guide against a naive twin, a plant that is not the model's, and what
goes wrong in use.
"""

from __future__ import annotations

from copy import copy, deepcopy

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from distal import Inverse, LiveInverse, Rig, load_rig
from distal.errors import CommandError
from distal.inverse import Feedback
from distal.inverse.command_trajectory import followable, sent
from distal.inverse.feedforward import LEAVES
from distal.inverse.live_inverse import ACROSS, RESPONDS, SMOOTHED, guide_function, readings
from tests.learned_maps import constant_map
from tests.support.commands import driven, hunts, inextensible, live_law, run
from tests.support.servo_plants import PERIOD, Ropes

RIG = "paper-2008-observed"


@pytest.fixture(scope="module")
def inverse() -> LiveInverse:
    return LiveInverse(RIG, compiled=False)


def with_delay(delay: float) -> Rig:
    """Return the rig whose drives follow places so late."""
    return load_rig(RIG).with_values({f"drives.{i}.servo": {"delay": delay} for i in range(2)})


def sample_of(inverse: LiveInverse) -> np.ndarray:
    """Return readings of drives that hold the joint at 0.1 rad."""
    commands = Inverse(RIG, compiled=False)(np.array([0.0, 0.01]), np.full((2, 1), 0.1))
    sensors = {sensor.name: sensor for sensor in inverse.rig.sensors}
    drives = [drive.name for drive in inverse.rig.drives]
    kinds = {"position": commands.sent[-1], "force": commands.forces[-1]}
    return np.array(
        [kinds[sensors[name].measures][drives.index(sensors[name].of)] for name in inverse.channels]
    )


def naive_guide(v: dict[str, float]) -> dict[str, float]:
    """Return what the guide of one joint gives, in plain numbers."""
    dt = v["dt"]
    first = v["angles"] if v["trusted"] else v["desired"]
    before = v["reference_before"] if v["started_before"] else first
    wished, fastest = v["wished_before"] if v["started_before"] else first, v["fastest"]
    most = fastest / RESPONDS
    braking = np.sqrt(2 * most * abs(wished - before))
    rate = max(-fastest, min(fastest, (v["desired"] - wished) / dt)) + np.clip(
        (wished - before) / dt, -braking, braking
    )
    rate = float(
        np.clip(
            np.clip(rate, -fastest, fastest),
            v["rate_before"] - most * dt,
            v["rate_before"] + most * dt,
        )
    )
    step = rate * dt
    share = dt / (dt + SMOOTHED)
    speed = (1 - share) * v["speed_before"] + share * step / dt
    acceleration = (1 - share) * v["acceleration_before"] + share * (speed - v["speed_before"]) / dt
    error = before + step - v["angles"]
    rests = abs(error) < v["deadband"] * (LEAVES if v["rests_before"] else 1.0)
    counted = (
        0.0 if rests or not v["trusted"] else np.sign(error) * max(abs(error) - v["deadband"], 0.0)
    )
    correction = max(
        -v["correction_limit"],
        min(
            v["correction_limit"],
            v["correction_before"] + v["winds"] * v["follow"] * counted * dt,
        ),
    )
    turning = (v["angles"] - v["last_before"]) / dt if v["started_before"] else 0.0
    asked = (
        v["proportional"] * counted
        + v["integral"] * v["effort_before"]
        + v["derivative"] * v["trusted"] * (speed - turning)
    )
    pushed = max(-v["torque_limit"], min(v["torque_limit"], asked))
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


@settings(max_examples=60, deadline=None)
@given(st.integers(0, 10_000))
def test_the_guide_is_that_of_plain_numbers(seed: int) -> None:
    rng = np.random.default_rng(seed)
    guide = guide_function(1)
    values = {name: float(rng.normal()) for name in guide.name_in()}
    positive = ("fastest", *vars(Feedback()))
    values |= {name: abs(values[name]) for name in positive} | {"dt": rng.uniform(0.001, 0.02)}
    values |= {
        name: float(rng.integers(2))
        for name in ("trusted", "winds", "started_before", "rests_before")
    }
    values["wished_before"] = (
        values["reference_before"] + 0.1 * rng.normal() * values["fastest"] * values["dt"]
    )
    values["desired"] = values["wished_before"] + rng.normal() * values["fastest"] * values["dt"]
    values["rate_before"] = rng.normal() * values["fastest"]
    values["angles"] = values["reference_before"] + rng.normal() * values["deadband"]
    found = guide(**values)
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


@pytest.mark.usefixtures("as_users_compile")
def test_with_and_without_a_compiler_it_is_the_same() -> None:
    compiled, interpreted = LiveInverse(RIG), LiveInverse(RIG, compiled=False)
    sample = sample_of(compiled)
    for k in range(20):
        desired = [0.1 + 0.01 * k]
        both = [one.step(0.01 * k, desired, sample) for one in (compiled, interpreted)]
        np.testing.assert_allclose(both[0].positions, both[1].positions, rtol=0, atol=1e-12)
        np.testing.assert_allclose(both[0].speeds, both[1].speeds, rtol=0, atol=1e-9)
        np.testing.assert_allclose(both[0].forces, both[1].forces, rtol=0, atol=1e-9)


def test_a_clone_goes_on_alone(inverse: LiveInverse) -> None:
    inverse.reset()
    sample = sample_of(inverse)
    for k in range(5):
        inverse.step(0.01 * k, {"link": 0.1 + 0.02 * k}, sample)
    for cloned in (LiveInverse.clone, copy, deepcopy):
        other = cloned(inverse)
        once = other.step(0.05, [0.25], sample)
        assert inverse.estimator.time == 0.04
        np.testing.assert_array_equal(
            once.positions, cloned(inverse).step(0.05, [0.25], sample).positions
        )
        # a stamp that comes twice leaves the last command as it is
        again, own = (one.step(0.04, [0.25], sample) for one in (cloned(inverse), inverse.clone()))
        assert again.forces.any()
        np.testing.assert_array_equal(again.forces, inverse._y["forces"])
        np.testing.assert_array_equal(own.speeds, inverse._y["speeds"])


def test_nothing_is_sent_before_every_drive_was_read(inverse: LiveInverse) -> None:
    """A buffer that was never filled is no command: all motors would go to zero."""
    inverse.reset()
    sample = sample_of(inverse)
    for k, lost in enumerate((np.full_like(sample, np.nan), sample[:1], sample)):
        time = float("nan") if k == 2 else 0.01 * k
        command = inverse.step(time, [0.1], lost)
        for values in (command.positions, command.speeds, command.forces):
            assert np.isnan(values).all()
        assert "nothing is sent" in command.note
    one = sample.copy()
    one[inverse.channels.index(inverse.rig.sensors_of("position")[0].name)] = np.nan
    assert np.isnan(inverse.step(0.02, [0.1], one).positions).all()
    assert np.isfinite(inverse.step(0.03, [0.1], sample).positions).all()
    # once a command was sent, it stays while nothing is read
    kept = inverse.step(0.04, [0.1], np.full_like(sample, np.nan))
    assert np.isfinite(kept.positions).all()


def test_a_late_sample_leaves_the_command(inverse: LiveInverse) -> None:
    inverse.reset()
    sample = sample_of(inverse)
    inverse.step(0.0, [0.1], sample)
    last = inverse.step(0.01, [0.12], sample)
    late = inverse.step(0.005, [0.5], sample)
    np.testing.assert_array_equal(late.positions, last.positions)
    assert "late" in late.note
    assert "the last command stays" in inverse.step(float("nan"), [0.5], sample).note
    assert "the last command stays" in inverse.step(0.02, [0.5], sample[:1]).note
    assert "stays" not in inverse.step(0.02, [0.12], sample).note


def test_a_jump_is_as_fast_as_joints_may_turn_and_no_angle_is_the_one_before(
    inverse: LiveInverse,
) -> None:
    inverse.reset()
    sample, positions = sample_of(inverse), []
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


def test_what_is_not_known_is_not_fed_back(inverse: LiveInverse) -> None:
    """All sensors silent for long: the correction stays, commands go on, and it is said."""
    inverse.reset()
    sample = sample_of(inverse)
    for k in range(100):
        inverse.step(0.01 * k, [0.3], sample)  # the readings say 0.1: it is corrected
    at = inverse._layouts.kernel_state["correction"]
    for k in range(100, 400):
        silent = inverse.step(0.01 * k, [0.3], np.full(len(sample), np.nan))
    held = inverse._loop.kernel_state[at].copy()
    assert abs(held[0]) > 0.01
    assert "no feedback" in silent.note
    silent = inverse.step(4.0, [0.2], np.full(len(sample), np.nan))
    np.testing.assert_array_equal(inverse._loop.kernel_state[at], held)
    assert np.isfinite(silent.positions).all()


@pytest.mark.parametrize("arrives", [True, False])
def test_commands_begin_anew_where_none_arrives(inverse: LiveInverse, arrives: bool) -> None:
    """The joint did not go where they would have brought it: what was learned of that is wrong."""
    inverse.reset()
    sample = sample_of(inverse)
    for k in range(100):
        inverse.step(0.01 * k, [0.3], sample)
    for k in range(100, 130):
        inverse.step(0.01 * k, [0.3], sample)
        inverse.confirm(arrives)
    corrected = abs(inverse._kernel_state["correction"][0])
    assert corrected > 0.01 if arrives else corrected == 0.0
    if not arrives:
        assert inverse._kernel_state["reference"] == pytest.approx(inverse.estimator.mean[:1])


def test_an_angle_is_commanded_for_when_the_drive_gets_there() -> None:
    """With a delay of 50 ms, along w = a t²/2: the command is for w at t + 50 ms, the bend
    included.
    """
    late, acceleration = 0.05, 4.0
    inverse = LiveInverse(with_delay(late), feedback=Feedback(follow=0.0), compiled=False)
    for k in range(60):
        inverse.step(0.01 * k, [0.1 + acceleration * (0.01 * k) ** 2 / 2], sample_of(inverse))
    desired = 0.1 + acceleration * (0.59 + late) ** 2 / 2
    # differences over 10 ms are half of that late, and smoothed over 5 ms
    behind = acceleration * 0.59 * 0.0 + late * acceleration * (0.005 + SMOOTHED)
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
        for k in range(80):
            command = inverse.step(0.005 * k, [desired], sample)
        assert command.note == ""
        positions.append(command.positions)
    np.testing.assert_allclose(positions[0], positions[1], atol=2e-5)


@pytest.mark.parametrize(("compensates", "share"), [(True, -1.0), (False, 0.0)])
def test_a_torque_that_the_filter_sees_is_held_against_only_where_asked(
    compensates: bool, share: float
) -> None:
    """τ from outside at rest: the drives make τ less, by their levers, than without it; unless
    asked they do nothing, since what is held would be pressed harder.
    """
    rig = load_rig(RIG).with_values({"joints.link.external_torque.std": 0.05})
    inverse = LiveInverse(
        rig, feedback=Feedback(follow=0.0), compensates=compensates, compiled=False
    )
    sample, at = sample_of(inverse), inverse.estimator.state_names.index("external_torque")
    forces = []
    for torque in (0.0, 0.01):
        inverse.reset()
        for k in range(30):
            inverse.step(0.01 * k, [0.1], sample)
        inverse._x["state"][at] = torque
        inverse._loop.step()
        forces.append(inverse._y["tensions"].copy())
    arm = 9.53e-3
    change = arm * ((forces[1] - forces[0])[0] - (forces[1] - forces[0])[1])
    assert change == pytest.approx(0.01 * share, rel=0.25)  # friction follows the tensions


@pytest.mark.parametrize("touched", [0.0, 0.9])
def test_feedback_does_not_wind_up_against_what_is_touched(touched: float) -> None:
    inverse = LiveInverse(RIG, feedback=Feedback(follow=1.0, integral=0.1), compiled=False)
    sample = sample_of(inverse)
    for k in range(30):
        inverse.step(0.01 * k, [0.1], sample)
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
        sample, joint = np.zeros(len(inverse.channels)), inverse.rig.joints[0]
        for k in range(200):
            command = inverse.step(0.01 * k, [3.0], sample)
        assert why in command.note
        correction = float(
            inverse._loop.kernel_state[inverse._layouts.kernel_state["correction"]][0]
        )
        assert (
            abs(float(inverse._loop.kernel_state[inverse._layouts.kernel_state["reference"]][0]))
            <= (joint.stops or (0.0, 3.0))[1]
        )
    assert abs(correction) < 0.5 * Feedback().correction_limit


def test_a_drive_that_follows_speeds_comes_back_to_its_place(inverse: LiveInverse) -> None:
    """A tenth of a second for what its reading is away, the motion of the place beside it."""
    inverse.reset()
    sample = sample_of(inverse)
    for k in range(200):
        command = inverse.step(0.01 * k, [0.1], sample)
    read = np.array([sample[inverse.channels.index(name)] for name in ("x1", "x2")])
    np.testing.assert_allclose(command.speeds, (command.positions - read) / 0.1, atol=2e-3)


def test_a_reading_is_the_place_and_its_offset() -> None:
    rig = load_rig("paper-2008").with_values({"sensors.x1.bias": {"value": 2e-4, "std": 0.0}})
    positions = np.linspace(-2e-3, 6e-3, 9)
    found = readings(rig, np.column_stack([positions, positions]))
    np.testing.assert_allclose(found[:, 0], positions + 2e-4, atol=1e-7)
    np.testing.assert_allclose(found[:, 1], positions, atol=1e-12)


def test_a_servo_is_where_it_has_to_be_in_time() -> None:
    """A drive with lag and delay that is sent what `sent` says follows a sine; alone it would be 10
    % behind.
    """
    rig = load_rig(RIG).with_values(
        {"drives.0.servo": {"bandwidth": 10.0, "delay": 0.02, "fastest": 1.0}}
    )
    step = 1e-3
    time = np.arange(0.0, 3.0, step)
    positions = 5e-3 * np.sin(2 * np.pi * 0.7 * time)
    for given_positions, most in ((sent(time, positions, rig.drives[0]), 0.01), (positions, 0.2)):
        late, position, error = (
            np.interp(time - 0.02, time, given_positions),
            float(positions[0]),
            [],
        )
        for k in range(len(time)):
            position += (1 - np.exp(-2 * np.pi * 10.0 * step)) * (late[k] - position)
            error.append(position - positions[k])
        away = np.abs(error[1000:2500]).max() / 5e-3
        assert away < most
        assert away > most / 10
    quick = rig.with_values({"drives.0.servo": {"fastest": 2.0}}).drives[0]
    fast = followable(time, np.where(time < 1.5, 0.0, 1.0), quick)
    assert np.abs(np.diff(fast)).max() <= 2.0 * step * (1 + 1e-9)
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


@pytest.mark.parametrize("gain", ["follow", "deadband", "proportional", "integral", "derivative"])
@pytest.mark.parametrize("wrong", [np.nan, np.inf, -1.0])
def test_a_gain_that_makes_no_sense_is_named(gain: str, wrong: float) -> None:
    with pytest.raises(CommandError, match=rf"feedback\.{gain}: 0 or a finite number above"):
        Feedback(**{gain: wrong})


@pytest.mark.parametrize("limit", [0.0, -1.0, np.nan])
def test_a_limit_of_torque_is_above_zero(limit: float) -> None:
    with pytest.raises(CommandError, match=r"feedback\.torque_limit: a number above 0"):
        Feedback(torque_limit=limit)


@pytest.mark.parametrize("desired", [[0.1, 0.2], {"elbow": 0.1}, []])
def test_wanted_angles_are_those_of_the_joints(desired: object, inverse: LiveInverse) -> None:
    with pytest.raises(CommandError, match="link"):
        inverse.step(0.0, desired, sample_of(inverse))  # type: ignore[arg-type]
