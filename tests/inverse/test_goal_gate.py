"""The contract of the gate through which every goal of a motor goes."""

from __future__ import annotations

from math import nan
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal import load_rig
from distal.inverse.motor_safety import AGREES, ARRIVED, LAG, OLDEST, PATIENCE, GoalGate
from distal.logs import Limits

PERIOD = 0.01
AHEAD = 2 * ARRIVED
FOUR = "finger-2n"
"""A rig of two motors at one joint, and two at another."""

FINGER = np.array([8e-3, 8e-3, 13e-3, 13e-3])
"""How far its drives go as its joints turn by 1 rad [m/rad]."""


class Loop:
    """A gate in a loop, of one motor where nothing else is said; `values` are the rig's."""

    def __init__(self, name: str = "capstan-joint", **values: object) -> None:
        rig = load_rig(name).with_values(values)
        self.gate, self.n, self.k = GoalGate(rig), len(rig.drives), 0
        self.believed = list[Any]()

    def run(self, count: int, positions: Any, goals: Any, torques: Any = nan) -> Any:
        """Return what is sent in so many periods, (count, n), where numbers are read and wanted,
        one in all periods, one in each, or rows of all motors.
        """
        read = [
            np.broadcast_to(np.transpose(values), (self.n, count)).T
            for values in (positions, goals, torques)
        ]
        sent = []
        for position, goal, torque in zip(*read):
            self.believed.append(self.gate.read(self.k * PERIOD, position, torque))
            sent.append(self.gate.passed(self.k * PERIOD, goal))
            self.k += 1
        return np.array(sent)


def test_nothing_is_sent_before_the_first_reading_of_a_motor() -> None:
    loop = Loop(FOUR)
    (sent,) = loop.run(1, [[0.0, nan, 0.0, 0.0]], 1e-3)
    assert np.isfinite(sent).tolist() == [True, False, True, True]
    assert loop.gate.unread == "mcp_e"


def test_what_is_no_number_is_not_sent() -> None:
    first, second = Loop(FOUR).run(2, 0.0, [4 * [1e-3], [nan, np.inf, -np.inf, 1e-3]])
    np.testing.assert_array_equal(first, second)


def test_a_goal_stays_within_the_range_and_the_speed() -> None:
    stops = {f"drives.{i}.stops": [-0.01, 0.01] for i in range(4)}
    assert (np.abs(Loop(FOUR, **stops).run(1, 0.0, 5.0)) < 0.02).all()
    _, sent = Loop(FOUR).run(2, 0.0, [0.0, 5.0])
    np.testing.assert_allclose(sent, Limits.fastest * 0.01 + AGREES * FINGER)


def test_one_lost_read_changes_nothing() -> None:
    k = np.arange(100)
    lost = np.where(k % 5 == 3, nan, 1e-3 * k)
    whole, lacking = (Loop(FOUR).run(100, read, 1e-3 * k + 2e-3) for read in (1e-3 * k, lost))
    np.testing.assert_array_equal(whole, lacking)


def test_a_sensor_that_is_read_seldom_is_not_lost() -> None:
    """At 4 Hz in a loop of 100 Hz."""
    k = np.arange(200)
    loop = Loop(**{"sensors.motor_angle.rate": 4.0})
    sent = loop.run(200, np.where(k % 25 == 0, 0.0, nan), 1e-4 * k)
    assert sent[:, 0] == pytest.approx(1e-4 * k)


def test_a_motor_without_readings_stands_with_those_of_its_joint() -> None:
    loop = Loop(FOUR)
    loop.run(20, 0.0, 0.0)
    sent = loop.run(40, [[nan, 0.0, 0.0, 0.0]], 1e-4 * np.arange(40))
    assert loop.gate.stopped.tolist()[:2] == [True, True]
    assert sent[-1, 0] < 1.2e-3
    assert "mcp_f not read" in loop.gate.note
    assert "mcp_e" in loop.gate.note


@pytest.mark.parametrize("load", [0.0, 0.03, -0.03])
@pytest.mark.parametrize("when_lost", ["hold", "relax"])
def test_a_motor_that_stands_keeps_its_force_and_after_its_patience_holds_or_relaxes(
    when_lost: str, load: float
) -> None:
    """Its goal is as far ahead of its place as it was: it does not give way."""
    loop = Loop(FOUR, when_lost=when_lost)
    loop.run(30, 0.0, load)
    sent = loop.run(400, nan, nan)
    np.testing.assert_allclose(sent[: round(PATIENCE / PERIOD) - 5], load, atol=1e-3)
    np.testing.assert_allclose(sent[-1], load if when_lost == "hold" else 0.0, atol=1e-3)
    assert ("gives way" in loop.gate.note) == (when_lost == "relax")


def test_a_hot_motor_that_stands_gives_way_at_once_and_holds_no_more_before_it_is_read() -> None:
    loop = Loop()
    loop.gate.heated(["motor"])
    assert loop.run(31, 0.0, 0.04, 0.2) == pytest.approx(0.04)
    assert loop.run(119, nan, nan, 0.2)[-1] == pytest.approx(0.0, abs=1e-3)
    assert "is hot and gives way" in loop.gate.note
    loop.gate.heated([])
    assert loop.run(100, nan, nan, 0.2)[-1] == pytest.approx(0.0, abs=1e-3)
    assert loop.run(1, 0.0, 0.04, 0.2) == pytest.approx(0.04)


@pytest.mark.parametrize("stops", [None, [-0.01, 0.01]])
@pytest.mark.parametrize("wild", [1.0, 1e300])
def test_a_place_that_cannot_be_is_not_where_a_slider_stops(
    wild: float, stops: list[float] | None
) -> None:
    loop = Loop(FOUR, **{f"drives.{i}.stops": stops for i in range(4)})
    loop.run(30, 0.0, 0.0)
    first = [*8 * [wild], *32 * [nan]]
    sent = loop.run(40, np.column_stack([first, np.zeros((40, 3))]), 0.0)
    assert np.nanmax(np.abs(sent[-1])) < 0.011
    assert loop.gate.stopped[0]


@pytest.mark.parametrize("turn", [2 * np.pi, -2 * np.pi])
def test_a_motor_that_counts_from_another_turn_gets_no_goal(turn: float) -> None:
    """Every goal would be a turn away."""
    loop, k = Loop(**{"joints.0.stops": [-0.5, 0.5]}), np.arange(60)
    sent = loop.run(60, np.where(k > 30, turn, 0.0), 1e-3 * k, 0.02)
    np.testing.assert_array_equal(np.isnan(sent[:, 0]), k > 30)
    assert "in doubt" in loop.gate.note


def test_it_holds_no_more_than_it_may_for_hours() -> None:
    loop = Loop(**{"drives.motor.servo": {"continuous_torque": 0.1}})
    loop.run(31, 0.0, 0.04, 0.2)
    assert loop.run(369, nan, nan, 0.2)[-1] == pytest.approx(0.02, abs=1e-3)
    assert loop.gate.holding == pytest.approx([0.1])


def test_a_place_that_leaps_is_in_doubt_until_it_leaps_back() -> None:
    loop = Loop()
    loop.run(20, 0.0, 0.0)
    assert np.isnan(loop.run(60, 0.5, 1e-3)).all()
    assert np.isnan(loop.believed[20:]).all()
    assert "in doubt" in loop.gate.note
    assert np.isfinite(loop.run(1, 0.0, 1e-3)).all()
    assert loop.believed[-1] == [0.0]


def test_a_place_that_leaps_to_where_it_was_sent_is_believed() -> None:
    loop = Loop()
    sent = loop.run(1, 0.0, 0.6)
    loop.run(1, sent, 0.6)
    assert loop.believed[-1] == pytest.approx(sent[0])


def test_goals_of_a_motor_that_is_deaf_stay_near_it_until_it_moves() -> None:
    """Its place and its torque stay while its goals go on; it is tried, but by little."""
    loop, noise = Loop(), 1e-5 * np.random.default_rng(1).normal(size=100)
    sent = loop.run(100, noise, 0.02 * np.arange(100), 0.01 + noise)[40:]
    assert "does not follow its goals" in loop.gate.note
    assert ARRIVED < sent.max() <= AHEAD + ARRIVED
    moves = 0.02 * np.arange(1, 11)
    assert loop.run(10, moves, moves + 0.5, 0.05)[-1] == pytest.approx(moves[-1] + 0.5)
    assert loop.gate.note == ""


def test_a_far_goal_is_not_held_where_a_motor_never_moved() -> None:
    """Nothing says yet how far it gives way; no motor gives way by so much."""
    k = np.arange(60)
    sent = Loop().run(60, np.where(k < 30, 0.0, nan), 0.02 * k, 0.0)
    assert sent.max() <= AHEAD + ARRIVED
    assert sent[-1] <= ARRIVED


def test_goals_that_are_not_sent_are_not_where_motors_go() -> None:
    loop = Loop(FOUR)
    loop.run(20, 0.0, 0.0)
    for k in range(50):
        sent = loop.run(1, 0.0, 0.01 * k)
        loop.gate.confirm(False)
    assert (np.abs(sent) < 0.2).all()
    assert loop.gate.stopped.all()
    loop.gate.confirm(True)
    assert not loop.gate.stopped.any()


def test_readings_that_never_change_although_a_motor_has_to_move_are_old() -> None:
    loop = Loop()
    assert loop.run(60, 0.0, 0.02 * np.arange(60), 0.03)[-1] < 0.5
    assert loop.gate.stopped.all()


def test_a_reading_that_a_motor_has_left_behind_is_not_believed() -> None:
    loop, k = Loop(), np.arange(40)
    late = np.isin(k, (20, 25, 26))
    torques = 0.02 + 1e-3 * np.random.default_rng(2).normal(size=40)
    for step, at in zip(k, k - 4 * late):
        loop.run(1, 0.04 * at, 0.04 * step + 0.1, torques[at])
        assert (loop.gate.note == "motor answers with an old reading") == late[step]
    assert np.ravel(loop.believed) == pytest.approx(np.where(late, nan, 0.04 * k), nan_ok=True)


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
    gate, time, before = GoalGate(load_rig(FOUR)), 0.0, nan
    for position, goal, dt in rows:
        time += dt
        gate.read(time, np.array([position, 0.0, 0.0, 0.0]), np.full(4, nan))
        sent = gate.passed(time, np.full(4, goal))
        assert not np.isinf(sent).any()
        if np.isfinite(sent[1]) and np.isfinite(before) and not gate.stopped[1]:
            most = Limits.fastest * min(dt, OLDEST) + AGREES * FINGER[1] + 1e-9
            assert abs(sent[1] - before) <= most or abs(sent[1]) <= max(abs(before), most)
        before = float(sent[1])


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_goal_that_ran_away_gives_way_to_where_its_motor_comes_to_rest(way: float) -> None:
    """s + v (age + T), with the age of the reading and the servo's lag, in the way it went."""
    loop, k, speed = Loop(), np.arange(40), way * 2.0
    positions = speed * PERIOD * np.maximum(k - 10, 0)  # it stands at first
    loop.run(40, positions, positions + way * 0.9 * (k > 10))
    sent = loop.run(30, nan, nan)[-1]
    assert sent == pytest.approx(positions[-1] + speed * (OLDEST + LAG), abs=0.03)
