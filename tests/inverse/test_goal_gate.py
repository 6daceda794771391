"""The contract of the gate through which every goal of a motor goes."""

from __future__ import annotations

from math import nan

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import Rig, load_rig
from distal.inverse.goal_gate import USUAL, GoalGate
from distal.logs import Limits

PERIOD = 0.01
LAG, OLDEST, ARRIVED = USUAL.lag, USUAL.oldest, USUAL.arrived
AHEAD = 2 * ARRIVED
FINGER = np.array([8e-3, 8e-3, 13e-3, 13e-3])
"""How far the drives of `finger-2n` go as its joints turn by 1 rad [m/rad]."""


def two_motors(**values: object) -> Rig:
    """Return a rig of two motors at one joint, and two at another; `values` of all servos."""
    return load_rig("finger-2n").with_values(values)


def moved(gate: GoalGate, speed: float, seconds: float, load: float = 0.0) -> float:
    """Move all motors along a ramp; goals are ahead of them by a lag and a load. Return the end."""
    count = round(seconds / PERIOD)
    for k in range(count):
        position = speed * k * PERIOD
        gate.read(k * PERIOD, np.full(4, position))
        gate.passed(k * PERIOD, np.full(4, position + speed * LAG + load))
    return count * PERIOD


def test_nothing_is_sent_before_the_first_reading_of_a_motor() -> None:
    gate = GoalGate(two_motors())
    gate.read(0.0, np.array([0.0, nan, 0.0, 0.0]))
    sent = gate.passed(0.0, np.full(4, 1e-3))
    assert np.isnan(sent[1])
    assert np.isfinite(sent[[0, 2, 3]]).all()
    assert gate.unread == ["mcp_e"]


def test_what_is_no_number_is_not_sent() -> None:
    gate = GoalGate(two_motors())
    gate.read(0.0, np.zeros(4))
    first = gate.passed(0.0, np.full(4, 1e-3))
    np.testing.assert_array_equal(gate.passed(0.01, np.array([nan, np.inf, -np.inf, 1e-3])), first)


def test_a_goal_stays_within_the_range_and_the_speed() -> None:
    stops = {f"drives.{i}.stops": [-0.01, 0.01] for i in range(4)}
    gate = GoalGate(two_motors(**stops))
    gate.read(0.0, np.zeros(4))
    assert (np.abs(gate.passed(0.0, np.full(4, 5.0))) < 0.02).all()
    free = GoalGate(two_motors())
    free.read(0.0, np.zeros(4))
    free.passed(0.0, np.zeros(4))
    free.read(0.01, np.zeros(4))
    sent = free.passed(0.01, np.full(4, 5.0))
    np.testing.assert_allclose(sent, Limits.fastest * 0.01 + USUAL.agrees * FINGER)


def test_one_lost_read_changes_nothing() -> None:
    gate, twin = GoalGate(two_motors()), GoalGate(two_motors())
    for k in range(100):
        position = np.full(4, 1e-3 * k)
        twin.read(k * PERIOD, position)
        gate.read(k * PERIOD, np.full(4, nan) if k % 5 == 3 else position)
        goals = position + 2e-3
        np.testing.assert_array_equal(
            gate.passed(k * PERIOD, goals), twin.passed(k * PERIOD, goals)
        )


def test_a_sensor_that_is_read_seldom_is_not_lost() -> None:
    """At 4 Hz in a loop of 100 Hz."""
    rig = load_rig("capstan-joint")
    gate = GoalGate(rig.with_values({f"sensors.{rig.sensors[0].name}.rate": 4.0}))
    for k in range(200):
        gate.read(k * PERIOD, np.zeros(1) if k % 25 == 0 else np.full(1, nan))
        assert gate.passed(k * PERIOD, np.full(1, 1e-4 * k)) == pytest.approx([1e-4 * k])


def test_a_motor_without_readings_stands_with_those_of_its_joint() -> None:
    """The goals of the first joint's motors stay, those of the other joint go on."""
    gate = GoalGate(two_motors())
    time = moved(gate, 0.0, 0.2)
    for k in range(40):
        gate.read(time + k * PERIOD, np.array([nan, 0.0, 0.0, 0.0]))
        sent = gate.passed(time + k * PERIOD, np.full(4, 1e-4 * k))
    assert gate.stopped.tolist()[:2] == [True, True]
    assert sent[0] < 1.2e-3
    assert "mcp_f not read" in gate.note
    assert "mcp_e" in gate.note


@pytest.mark.parametrize("load", [0.0, 0.03, -0.03])
def test_a_motor_that_stands_keeps_the_force_that_it_held(load: float) -> None:
    """Its goal is as far ahead of its place as it was: it does not give way."""
    gate = GoalGate(two_motors())
    time = moved(gate, 0.0, 0.3, load)
    for k in range(round(USUAL.patience / PERIOD) - 5):
        gate.read(time + k * PERIOD, np.full(4, nan))
        sent = gate.passed(time + k * PERIOD, np.full(4, nan))
    np.testing.assert_allclose(sent, load, atol=1e-3)


def test_a_moving_motor_is_not_thrown_back() -> None:
    """It comes to rest at most its lag, and the time without a reading, ahead."""
    gate, speed = GoalGate(two_motors()), 2.0
    time = moved(gate, speed, 0.3)
    last = speed * (time - PERIOD)
    for k in range(30):
        gate.read(time + k * PERIOD, np.full(4, nan))
        sent = gate.passed(time + k * PERIOD, np.full(4, speed * (time + k * PERIOD + LAG)))
    assert (sent >= last).all()
    assert (sent <= last + speed * (OLDEST + 2 * LAG) + USUAL.agrees).all()


@pytest.mark.parametrize("when_lost", ["hold", "relax"])
def test_after_its_patience_it_holds_or_relaxes(when_lost: str) -> None:
    gate = GoalGate(two_motors(when_lost=when_lost))
    time = moved(gate, 0.0, 0.3, 0.03)
    for k in range(400):
        gate.read(time + k * PERIOD, np.full(4, nan))
        sent = gate.passed(time + k * PERIOD, np.full(4, nan))
    np.testing.assert_allclose(sent, 0.03 if when_lost == "hold" else 0.0, atol=1e-3)
    assert ("gives way" in gate.note) == (when_lost == "relax")


def test_a_hot_motor_that_stands_gives_way_at_once() -> None:
    gate = GoalGate(load_rig("capstan-joint"))
    gate.heated([load_rig("capstan-joint").drives[0].name])
    for k in range(150):
        lost = k > 30
        gate.read(k * PERIOD, np.full(1, nan if lost else 0.0), np.full(1, 0.2))
        sent = gate.passed(k * PERIOD, np.full(1, nan if lost else 0.04))
        assert lost or sent == pytest.approx([0.04])
    assert sent == pytest.approx([0.0], abs=1e-3)
    assert "is hot and gives way" in gate.note


def test_what_a_hot_motor_let_go_is_not_held_again_before_it_is_read() -> None:
    gate, name = GoalGate(load_rig("capstan-joint")), load_rig("capstan-joint").drives[0].name
    for k in range(250):
        gate.heated([name] if k < 150 else [])
        lost = k > 30
        gate.read(k * PERIOD, np.full(1, nan if lost else 0.0), np.full(1, 0.2))
        sent = gate.passed(k * PERIOD, np.full(1, nan if lost else 0.04))
    assert sent == pytest.approx([0.0], abs=1e-3)
    gate.read(2.5, np.zeros(1), np.full(1, 0.2))
    assert gate.passed(2.5, np.full(1, 0.04)) == pytest.approx([0.04])


@pytest.mark.parametrize("stops", [None, [-0.01, 0.01]])
@pytest.mark.parametrize("wild", [1.0, 1e300])
def test_a_place_that_cannot_be_is_not_where_a_slider_stops(
    wild: float, stops: list[float] | None
) -> None:
    gate = GoalGate(two_motors(**{f"drives.{i}.stops": stops for i in range(4)}))
    time = moved(gate, 0.0, 0.3)
    for k in range(40):
        positions = np.array([wild if k < 8 else nan, 0.0, 0.0, 0.0])
        gate.read(time + k * PERIOD, positions)
        sent = gate.passed(time + k * PERIOD, np.zeros(4))
    assert np.nanmax(np.abs(sent)) < 0.011
    assert gate.stopped[0]


@pytest.mark.parametrize("turn", [2 * np.pi, -2 * np.pi])
def test_a_motor_that_counts_from_another_turn_gets_no_goal(turn: float) -> None:
    """Every goal would be a turn away."""
    rig = load_rig("capstan-joint").with_values({"joints.0.stops": [-0.5, 0.5]})
    gate = GoalGate(rig)
    for k in range(60):
        gate.read(k * PERIOD, np.full(1, turn if k > 30 else 0.0), np.full(1, 0.02))
        sent = gate.passed(k * PERIOD, np.full(1, 1e-3 * k))
        assert np.isnan(sent).all() == (k > 30)
    assert "in doubt" in gate.note


def test_it_holds_no_more_than_it_may_for_hours() -> None:
    rig = load_rig("capstan-joint")
    rig = rig.with_values({f"drives.{rig.drives[0].name}.servo": {"continuous_torque": 0.1}})
    gate, one = GoalGate(rig), np.ones(1)
    for k in range(400):
        lost = k > 30
        gate.read(k * PERIOD, nan * one if lost else 0.0 * one, 0.2 * one)
        sent = gate.passed(k * PERIOD, nan * one if lost else 0.04 * one)
    assert sent == pytest.approx([0.02], abs=1e-3)
    assert gate.holding == pytest.approx([0.1])


def test_a_place_that_leaps_is_in_doubt_until_it_leaps_back() -> None:
    gate, leapt = GoalGate(load_rig("capstan-joint")), np.full(1, 0.5)
    for k in range(20):
        gate.read(k * PERIOD, np.zeros(1))
        gate.passed(k * PERIOD, np.zeros(1))
    for k in range(20, 80):
        assert np.isnan(gate.read(k * PERIOD, leapt)).all()
        assert np.isnan(gate.passed(k * PERIOD, np.full(1, 1e-3))).all()
    assert "in doubt" in gate.note
    assert gate.read(0.8, np.zeros(1)) == [0.0]
    assert np.isfinite(gate.passed(0.8, np.full(1, 1e-3))).all()


def test_a_place_that_leaps_to_where_it_was_sent_is_believed() -> None:
    gate = GoalGate(load_rig("capstan-joint"))
    gate.read(0.0, np.zeros(1))
    sent = gate.passed(0.0, np.full(1, 0.6))
    assert gate.read(0.01, sent) == pytest.approx(sent)


def test_goals_of_a_motor_that_is_deaf_stay_near_it_until_it_moves() -> None:
    """Its place and its torque stay while its goals go on; it is tried, but by little."""
    gate = GoalGate(load_rig("capstan-joint"))
    rng, rows = np.random.default_rng(1), []
    for k in range(100):
        noise = 1e-5 * rng.normal(size=1)
        gate.read(k * PERIOD, noise, 0.01 + noise)
        rows.append(gate.passed(k * PERIOD, np.full(1, 0.02 * k))[0])
        assert k < 40 or "does not follow its goals" in gate.note
    assert max(rows[40:]) <= AHEAD + ARRIVED
    assert max(rows[40:]) > ARRIVED
    for k in range(100, 110):
        position = np.full(1, 0.02 * (k - 99))
        gate.read(k * PERIOD, position, np.full(1, 0.05))
        sent = gate.passed(k * PERIOD, position + 0.5)
    assert sent == pytest.approx(position + 0.5)
    assert gate.note == ""


def test_a_far_goal_is_not_held_where_a_motor_never_moved() -> None:
    """Nothing says yet how far it gives way; no motor gives way by so much."""
    gate = GoalGate(load_rig("capstan-joint"))
    for k in range(60):
        gate.read(k * PERIOD, np.full(1, 0.0 if k < 30 else nan), np.zeros(1))
        sent = gate.passed(k * PERIOD, np.full(1, 0.02 * k))
        assert sent[0] <= AHEAD + ARRIVED
    assert sent[0] <= ARRIVED


def test_goals_that_are_not_sent_are_not_where_motors_go() -> None:
    gate = GoalGate(two_motors())
    time = moved(gate, 0.0, 0.2)
    for k in range(50):
        gate.read(time + k * PERIOD, np.zeros(4))
        sent = gate.passed(time + k * PERIOD, np.full(4, 0.01 * k))
        gate.confirm(False)
    assert (np.abs(sent) < 0.2).all()
    assert gate.stopped.all()
    gate.confirm(True)
    assert not gate.stopped.any()


def test_readings_that_never_change_although_a_motor_has_to_move_are_old() -> None:
    gate, force = GoalGate(load_rig("capstan-joint")), np.full(1, 0.03)
    for k in range(60):
        gate.read(k * PERIOD, np.zeros(1), force)
        sent = gate.passed(k * PERIOD, np.full(1, 0.02 * k))
    assert gate.stopped.all()
    assert sent[0] < 0.5


def test_a_reading_that_a_motor_has_left_behind_is_not_believed() -> None:
    gate, rng, positions = GoalGate(load_rig("capstan-joint")), np.random.default_rng(2), []
    torques = 0.02 + 1e-3 * rng.normal(size=40)
    for k in range(40):
        late = k in (20, 25, 26)
        at = k - 4 if late else k
        read = gate.read(k * PERIOD, np.full(1, 0.04 * at), np.full(1, torques[at]))
        gate.passed(k * PERIOD, np.full(1, 0.04 * k + 0.1))
        assert np.isnan(read).all() == late
        assert (gate.note == "motor answers with an old reading") == late
        positions.append(read)
    assert positions[-1] == pytest.approx(0.04 * 39)


@given(
    st.lists(
        st.tuples(
            st.floats(-3, 3) | st.just(nan),
            st.floats(-1e3, 1e3) | st.sampled_from([nan, np.inf, -np.inf]),
            st.floats(1e-4, 0.5),
        ),
        min_size=1,
        max_size=40,
    )
)
def test_whatever_comes_goals_are_numbers_and_no_faster_than_a_motor(
    rows: list[tuple[float, float, float]],
) -> None:
    """One motor is read and wanted at random; each goal that is sent is near the one before."""
    gate, time, before = GoalGate(two_motors()), 0.0, nan
    for position, goal, dt in rows:
        time += dt
        gate.read(time, np.array([position, 0.0, 0.0, 0.0]))
        sent = gate.passed(time, np.full(4, goal))
        assert not np.isinf(sent).any()
        if np.isfinite(sent[1]) and np.isfinite(before) and not gate.stopped[1]:
            most = Limits.fastest * min(dt, OLDEST) + USUAL.agrees * FINGER[1] + 1e-9
            assert abs(sent[1] - before) <= most or abs(sent[1]) <= max(abs(before), most)
        before = float(sent[1])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_goal_that_ran_away_gives_way_to_where_its_motor_comes_to_rest(way: float) -> None:
    """s + v (age + T), with the age of the reading and the servo's lag, in the way it went."""
    gate, speed = GoalGate(load_rig("capstan-joint")), way * 2.0
    for k in range(40):
        position = speed * max(k - 10, 0) * PERIOD  # it stands at first
        gate.read(k * PERIOD, np.full(1, position))
        gate.passed(k * PERIOD, np.full(1, position + way * 0.9 * (k > 10)))
    last = speed * 29 * PERIOD
    for k in range(40, 70):
        gate.read(k * PERIOD, np.full(1, nan))
        sent = gate.passed(k * PERIOD, np.full(1, nan))
    assert sent == pytest.approx([last + speed * (OLDEST + LAG)], abs=0.03)
