"""`Hand` beside SDKs: its readings, what it sends, lost packets, motors that restart, wrong
hands.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from types import SimpleNamespace
from typing import Any
from unittest.mock import Mock

import numpy as np
import pytest
from examples.hands.aero_motors import AeroMotors

from distal.errors import CommandError, EstimationError, OutputError
from distal.hands import Hand
from distal.hands.hand import OrcaMotors
from distal.rig import Rig, build_rig, load_rig, log_factor, range_ends
from distal.rig.hand_tables import Row, hand_of
from tests.support.hands import Driven, rig_of
from tests.support.servo_hands import TORQUE_CONSTANT, orca_like

JOINTS = ("index_mcp", "ring_abd")


def renamed(rig: Rig) -> Rig:
    """Return the rig with the names that motors by number have."""
    text = rig.model_dump_json().replace("m1", "motor_1").replace("m2", "motor_2")
    return build_rig(Rig.model_validate_json(text).model_dump(), "hand")


def with_zeros(rig: Rig) -> Rig:
    """Return the rig with zeros that are known."""
    zero = {"value": 0.0, "std": 0.02}
    return rig.with_values({f"sensors.{s.name}.bias": zero for s in rig.sensors_of("position")})


def sound_rig() -> Rig:
    """Return the rig of a hand of two joints whose zeros are known."""
    return with_zeros(renamed(rig_of(orca_like([3], JOINTS)[0])))


class Orca:
    """What a hand of orca_core has, on motors that follow at once."""

    def __init__(self) -> None:
        self.config = SimpleNamespace(motor_ids=[1, 2], max_current=300.0)
        self.limits = [300.0, 300.0]
        self.motor_client: Any = None
        self.positions, self.currents, self.sent = np.zeros(2), np.zeros(2), dict[int, float]()
        self.last_read_ok, self.fails, self.temperature = True, False, 40.0

    def get_motor_pos(self) -> Any:
        if self.fails:
            raise OSError("port is gone")
        return self.positions

    def get_motor_current(self) -> Any:
        return self.currents

    def set_max_current(self, current: list[float]) -> None:
        self.limits = current

    def get_motor_temp(self) -> Any:
        return np.array([self.temperature, 35.0])

    def write_motor_pos(self, motor_ids: list[int], positions: Any) -> None:
        self.sent = dict(zip(motor_ids, positions))
        for k, number in enumerate(self.config.motor_ids):
            self.positions[k] = self.sent.get(number, self.positions[k])


@pytest.fixture
def orca() -> Orca:
    return Orca()


@pytest.fixture
def hand(orca: Orca) -> Hand:
    return Hand(orca, sound_rig(), compiled=False)


def go(hand: Hand, begin: int, end: int) -> None:
    """Update a hand 100 times a second, from one sample to another."""
    for k in range(begin, end):
        hand.update(0.01 * k)


def test_angles_are_nan_by_joint_before_the_first_update(hand: Hand) -> None:
    assert np.isnan([hand.get_joint_positions()[name] for name in JOINTS]).all()
    hand.update(0.0)
    assert 0.1 < hand.get_joint_stds()["index_mcp"] < 10.0


def test_lost_packets_and_a_port_that_is_gone_never_end_it(hand: Hand, orca: Orca) -> None:
    for k in range(100):
        orca.last_read_ok, orca.fails = k % 7 != 0, 40 < k < 60
        hand.update(0.01 * k)
    health = hand.health()
    assert health.lost == 19
    assert np.isfinite(list(hand.get_joint_positions().values())).all()
    orca.fails = True
    reading = hand.update(1.0)
    assert reading.health in ("missing", "disagrees", "dead")
    assert hand.health().silent == ("motor_1", "motor_2")
    assert "no answer from motor_1, motor_2" in hand.health().sentence


def test_reads_that_are_lost_after_a_wish_move_nothing(hand: Hand, orca: Orca) -> None:
    """The first goals are sent after the first reading; lost ones before it send nothing."""
    orca.positions[:] = 0.6
    go(hand, 0, 60)
    hand.set_joint_positions(hand.get_joint_positions())
    orca.fails = True
    go(hand, 60, 90)
    assert orca.sent == {}
    orca.fails = False
    hand.update(0.9)
    # as far as play and stretch leave it open where the joints are, and not to a reading of zero
    assert list(orca.sent.values()) == pytest.approx([0.6, 0.6], abs=0.25)


class Aero:
    """What a hand of the Aero SDK has; its motors stand where somebody puts them."""

    def __init__(self) -> None:
        self.positions: list[float | None] = [None, None]
        self.sent: list[list[float]] = []

    def get_actuations(self) -> list[float | None]:
        return self.positions

    def get_actuator_currents(self) -> list[float]:
        return [0.0, 0.0]

    def get_actuator_temperatures(self) -> list[float]:
        return [30.0, 30.0]

    def set_actuations(self, actuations: list[float]) -> None:
        self.sent.append(actuations)


def test_a_motor_without_a_goal_does_not_sink() -> None:
    """A servo gives way under its load: where it is read is not sent to it again and again."""
    aero = Aero()
    motors = AeroMotors(aero, sound_rig())
    motors.write({"motor_1": 10.0})
    assert aero.sent == []  # nobody knows where the other one is
    for sag in (7.0, 6.5, 6.0):
        aero.positions = [9.0, sag]
        motors.read()
        motors.write({"motor_1": 10.0})
    assert aero.sent == 3 * [[10.0, 7.0]]


def moved_to(hand: Hand, angle: float) -> None:
    """Move a joint there, in 150 samples."""
    go(hand, 0, 50)
    hand.set_joint_positions({"index_mcp": angle})
    go(hand, 50, 150)


def test_motors_that_stand_pull_no_more_than_they_did(hand: Hand, orca: Orca) -> None:
    """Reads fail for longer than 0.1 s: goals and torques stay, it is said, and it goes on."""
    moved_to(hand, 40.0)
    before = orca.positions.copy()
    hand.set_joint_positions({"index_mcp": 10.0})
    orca.fails = True
    go(hand, 150, 210)
    assert "motor_1, motor_2 not read" in hand.health().held_back
    assert max(orca.limits) < 300.0
    assert np.abs(orca.positions - before).max() < 0.7
    stood = orca.positions.copy()
    go(hand, 210, 211)
    np.testing.assert_array_equal(orca.positions, stood)
    orca.fails = False
    go(hand, 211, 400)
    assert "stands" not in hand.health().held_back
    assert orca.limits == [300.0, 300.0]
    assert hand.get_joint_positions()["index_mcp"] == pytest.approx(10.0, abs=4.0)
    orca.fails = True
    go(hand, 400, 440)
    assert orca.limits[0] < 300.0
    orca.fails, orca.sent = False, {}
    hand.relax()
    go(hand, 440, 441)
    assert orca.sent == {}
    assert orca.limits == [300.0, 300.0]


def test_a_place_in_doubt_is_so_after_the_hand_was_relaxed(hand: Hand, orca: Orca) -> None:
    moved_to(hand, 30.0)
    orca.positions[0] += 2.0
    orca.write_motor_pos = lambda *_: None  # type: ignore[method-assign]
    go(hand, 150, 151)
    hand.relax()
    go(hand, 151, 152)
    assert "in doubt" in hand.health().sentence


@pytest.mark.parametrize("stamp", [np.nan, np.inf, -np.inf, 1e301])
def test_a_stamp_that_is_none_changes_no_goal(hand: Hand, orca: Orca, stamp: float) -> None:
    moved_to(hand, 30.0)
    before = orca.sent
    hand.update(stamp)
    assert orca.sent == before
    go(hand, 150, 180)
    assert "stands" not in hand.health().held_back
    orca.temperature = 90.0
    go(hand, 350, 351)
    assert "motor_1" in hand.health().hot


def test_after_the_clock_was_set_back_lost_reads_are_noticed(hand: Hand, orca: Orca) -> None:
    moved_to(hand, 30.0)
    go(hand, -10_000, -9900)
    assert "stands" not in hand.health().held_back
    orca.fails = True
    go(hand, -9900, -9870)
    assert "stands" in hand.health().held_back


def test_temperatures_are_read_while_readings_are_lost(hand: Hand, orca: Orca) -> None:
    moved_to(hand, 30.0)
    orca.fails, orca.temperature = True, 90.0
    go(hand, 150, 300)
    assert hand.health().hot == {"motor_1": 90.0}
    assert "hot: motor_1 90 °C" in hand.health().sentence
    assert "motor_1 is hot and gives way" in hand.health().held_back


def test_a_temperature_that_cannot_be_costs_no_reading(orca: Orca) -> None:
    hand = Hand(orca, sound_rig(), compensated=True, compiled=False)
    orca.temperature = 255.0
    moved_to(hand, 30.0)
    assert hand.health().lost == 0
    assert hand.get_joint_positions()["index_mcp"] == pytest.approx(30.0, abs=5.0)


def test_a_motor_whose_turn_is_not_known_gets_no_goal(orca: Orca) -> None:
    """Its encoder wraps, and its joint goes through more than a turn of it."""
    sensor = "sensors.motor_1_position"
    wraps = {"unit": "count", "counts_per_turn": 4096, "resolution": 2 * np.pi / 4096}
    values = {f"{sensor}.{key}": value for key, value in wraps.items()}
    rig = sound_rig().with_values({"joints.index_mcp.stops": (-4.0, 4.0), **values})
    hand = Hand(orca, rig, compiled=False)
    orca.positions[0] = 2000.0  # 176° or −184°
    go(hand, 0, 29)
    reading = hand.update(0.29)
    assert reading.health == "restarted"
    assert "motor_1: in which of its turns" in reading.detail
    with pytest.raises(CommandError, match="in which of its turns motor_1 is, is not known"):
        hand.set_joint_positions({"index_mcp": 10.0})


def test_a_read_that_the_sdk_says_failed_is_none(orca: Orca) -> None:
    """Its client says so in releases of orca_core, which return old values then."""
    del orca.last_read_ok
    orca.motor_client = SimpleNamespace(last_read_ok=True)
    motors = OrcaMotors(orca, sound_rig())
    assert len(motors.read()) == 4
    orca.motor_client.last_read_ok = False
    assert motors.read() == {}


def test_currents_are_limited_by_torques(orca: Orca) -> None:
    """The rig's torque constant turns one into the other; a motor without a limit has the SDK's."""
    rig = sound_rig()
    per_milliampere = log_factor(rig.sensors_of("force")[0])
    OrcaMotors(orca, rig).limit_torques({"motor_1": 100.0 * per_milliampere})
    assert orca.limits == pytest.approx([100.0, 300.0])


def test_an_old_orca_core_is_told_the_least_version(orca: Orca) -> None:
    old = SimpleNamespace(config=orca.config, get_motor_pos=orca.get_motor_pos)
    with pytest.raises(EstimationError, match=r"get_motor_current: it needs orca_core 0\.4\.0"):
        Hand(old, sound_rig(), compiled=False)


def test_one_silent_motor_is_named(hand: Hand, orca: Orca) -> None:
    orca.positions[0] = np.nan
    hand.update(0.0)
    assert hand.health().silent == ("motor_1",)


@pytest.mark.parametrize(
    ("position", "torque", "beyond"),
    [
        (1.95, 0.0, False),
        (2.1, 300.0, False),
        (2.4, 20.0, True),
        (-0.2, 0.0, False),
        (-0.9, 0.0, True),
    ],
)
def test_a_spool_that_slipped_is_named_where_its_joint_should_have_ended(
    hand: Hand, orca: Orca, position: float, torque: float, beyond: bool
) -> None:
    """The joint turns to 100 degrees, which is 110 of the motor; beyond it by stretch alone is no
    fault.
    """
    orca.positions[:], orca.currents[:] = [position, 0.0], [torque, 0.0]
    hand.update(0.0)
    hand.update(0.01)
    health = hand.health()
    assert ("motor_1 goes" in health.detail) == beyond
    assert "motor_2 goes" not in health.detail
    if position == 2.4:
        assert health.word == "disagrees"
        size = float(health.detail.split("motor_1 goes ")[1].split("°")[0])
        # 2.4 rad of the motor are 125 degrees of the joint; stretch and play are allowed
        assert 10.0 < size < 24.0
        assert "its spool slipped" in health.sentence


def test_a_motor_is_beyond_its_range_until_it_leaves_the_end(hand: Hand, orca: Orca) -> None:
    """It is judged on the way there: on the way back friction hides the tension. Away from the end
    all is forgotten.
    """
    ways = [
        (1.9, 50.0, False),
        (2.02, 290.0, False),
        (2.02, 0.0, False),
        (1.2, 0.0, False),
        (2.02, 0.0, True),
        (2.0, 290.0, True),
        (1.2, 0.0, False),
    ]
    for k, (position, torque, beyond) in enumerate(ways):
        orca.positions[:], orca.currents[:] = [position, 0.0], [torque, 0.0]
        hand.update(0.01 * k)
        assert ("motor_1 goes" in hand.health().detail) == beyond


@pytest.mark.parametrize(
    ("desired", "says"),
    [
        ({"index_mpc": 3.0}, "did you mean 'index_mcp'"),
        ({"index_mcp": 300.0}, "turns from -25° to 100°, 300"),
        ({"index_mcp": "3"}, "'3' came"),
        ({"index_mcp": float("nan")}, "nan came"),
    ],
)
def test_angles_that_cannot_be_wanted_are_named(
    hand: Hand, desired: dict[str, Any], says: str
) -> None:
    with pytest.raises(CommandError, match="not known yet"):
        hand.set_joint_positions({"index_mcp": 1.0})
    hand.update(0.0)
    with pytest.raises(CommandError, match=says):
        hand.set_joint_positions(desired)


def test_a_hand_that_was_never_calibrated_is_not_moved(orca: Orca) -> None:
    hand = Hand(orca, renamed(rig_of(orca_like([3], JOINTS)[0])), compiled=False)
    go(hand, 0, 20)
    says = "where motor_1, motor_2 have their zero is not known, so nothing is sent: call"
    with pytest.raises(CommandError, match=says):
        hand.set_joint_positions({"index_mcp": 10.0})
    assert orca.sent == {}


def test_what_is_no_hand_and_what_is_another_hand_are_named(orca: Orca) -> None:
    with pytest.raises(EstimationError, match="str is no hand that distal knows"):
        Hand("hand", sound_rig(), compiled=False)
    orca.config.motor_ids = [1]
    with pytest.raises(EstimationError, match="has a motor 'motor_2' that this hand has not"):
        Hand(orca, sound_rig(), compiled=False)


def test_actuations_in_degrees_are_read_and_sent() -> None:
    degrees = {f"sensors.motor_{i}_position.unit": "deg" for i in (1, 2)}
    rig, aero = sound_rig().with_values(degrees), Aero()
    hand = Hand(AeroMotors(aero, rig), rig, compiled=False)
    for k in range(40):
        aero.positions = [min(1.0 * k, 33.0), 0.0]
        hand.update(0.01 * k)
    assert hand.get_joint_positions()["index_mcp"] == pytest.approx(30.0, abs=5.0)
    hand.set_joint_positions({"index_mcp": 60.0})
    for k in range(40, 200):
        hand.update(0.01 * k)
        aero.positions = [*aero.sent[-1]]
    assert 55.0 < aero.sent[-1][0] < 85.0


class Own:
    """A hand of one's own, whose motors stand, with a clock of its own."""

    def __init__(self) -> None:
        self.goals: Mapping[str, float] = {}
        self.current, self.time = 5.0, 0.0
        self.heat = dict[str, Any]()

    def now(self) -> float:
        self.time += 0.004
        return self.time

    def sleep(self, _: float) -> None:
        pass

    def read(self) -> Mapping[str, float]:
        self.current = 11.0 - self.current
        return {
            "motor_1_position": 0.1,
            "motor_1_current": self.current,
            "motor_2_position": 0.0,
            "something": 1.0,
        }

    def temperatures(self) -> Mapping[str, Any]:
        return self.heat

    def write(self, goals: Mapping[str, float]) -> None:
        self.goals = goals


class Simulated(Own):
    """One on a plant that shares no code with the model."""

    def __init__(self) -> None:
        super().__init__()
        self.known, self.hands = orca_like([3], JOINTS)
        self.driven, self.reads = Driven(self.hands), 0
        self.sent = self.hands.positions + self.hands.d.zeros * self.driven.signs
        self.found = self.driven.read(self.sent)

    def now(self) -> float:
        return self.time

    def sleep(self, seconds: float) -> None:
        for _ in range(max(1, round(seconds / 0.01))):
            self.found = self.driven.read(self.sent)
            self.time += 0.01

    def read(self) -> Mapping[str, float]:
        self.reads += 1
        if self.reads % 50 == 0:
            raise TimeoutError("a packet is lost")
        positions, torques = (values[0].tolist() for values in self.found)
        read = dict(zip(("motor_1_position", "motor_2_position"), positions))
        currents = [1e3 / TORQUE_CONSTANT * torque for torque in torques]
        return read | dict(zip(("motor_1_current", "motor_2_current"), currents))

    def write(self, goals: Mapping[str, float]) -> None:
        self.sent[0] = [goals["motor_1"], goals["motor_2"]]


@pytest.mark.slow
def test_from_power_on_to_live_angles_and_wanted_ones(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A disk that is full at its end costs the record, and not the calibration."""
    own = Simulated()
    hand = Hand(own, renamed(rig_of(own.known)))
    said = list[str]()

    full = Mock(side_effect=OutputError("no space left on device"))
    monkeypatch.setattr("distal.hands.hand.write_log", full)
    record = tmp_path / "routine.csv"
    found = hand.power_on(show=said.append, record=record, sleep=own.sleep, now=own.now)
    assert said[:2] == ["motor_1", "motor_2"]
    assert found.faults == ()
    assert found.notes == ("the record was not kept: no space left on device",)
    found.save(tmp_path / "calibrated.toml")
    assert load_rig(tmp_path / "calibrated.toml") == found.rig == hand.rig
    wanted = {"index_mcp": 50.0, "ring_abd": -10.0}
    for k in range(400):
        hand.update(own.time)
        own.sleep(0.01)
        if k == 100:
            hand.set_joint_positions(wanted)
    true = np.rad2deg(own.hands.angles[0])
    angles = list(hand.get_joint_positions().values())
    assert angles == pytest.approx(true, abs=3.5)
    assert true == pytest.approx(list(wanted.values()), abs=4.0)


def test_an_interruption_anywhere_leaves_the_motors_where_they_are() -> None:
    """Most of the time it comes while the loop waits; the goal of a motor that is held is then far
    ahead of it.
    """
    own, ahead = Own(), list[float]()

    def sleep(_: float) -> None:
        ahead.append(own.goals["motor_1"] - 0.1)
        if len(ahead) == 60:
            raise KeyboardInterrupt

    with pytest.raises(CommandError, match="aborted: interrupted"):
        Hand(own, sound_rig(), compiled=False).power_on(sleep=sleep, now=own.now)
    assert max(ahead) > 0.2
    assert own.goals == pytest.approx({"motor_1": 0.1, "motor_2": 0.0}, abs=1e-9)


def test_an_interruption_holds_though_its_first_goals_are_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own, ahead = Own(), list[float]()
    plain, lost = own.write, list[object]()

    def sleep(_: float) -> None:
        if own.goals["motor_1"] > 0.3:
            ahead.append(own.goals["motor_1"])
            raise KeyboardInterrupt

    def write(goals: dict[str, float]) -> None:
        if ahead and not lost:
            lost.append(goals)
            raise OSError("port is busy")
        plain(goals)

    monkeypatch.setattr(own, "write", write)
    with pytest.raises(CommandError, match="aborted: interrupted"):
        Hand(own, sound_rig(), compiled=False).power_on(sleep=sleep, now=own.now)
    assert len(lost) == 1
    assert own.goals == pytest.approx({"motor_1": 0.1, "motor_2": 0.0}, abs=1e-9)


def test_a_current_is_never_taken_for_the_angle_of_a_motor_that_did_not_answer(orca: Orca) -> None:
    motors = OrcaMotors(orca, sound_rig())
    orca.positions, orca.currents = np.array([0.2, 0.3]), np.array([50.0, 60.0])
    positions = {"motor_1_position": 0.2, "motor_2_position": 0.3}
    assert motors.read() == positions | {"motor_1_current": 50.0, "motor_2_current": 60.0}
    orca.positions = np.array([0.2])
    assert motors.read() == {}


@pytest.mark.parametrize(
    ("heat", "why"),
    [
        ({}, "no motor came to the end of its power-on routine: motor_1: it stands still at"),
        ({"motor_1": 80.0, "motor_2": 30.0}, "motor_1: it is hot, 80 °C"),
    ],
)
def test_an_aborted_routine_says_why(heat: dict[str, float], why: str) -> None:
    own = Own()
    own.heat = heat
    with pytest.raises(CommandError, match=why):
        Hand(own, sound_rig(), compiled=False).power_on(sleep=own.sleep, now=own.now)


def coupled_rig() -> Rig:
    """Return a hand with a joint that follows another."""
    rows = [
        Row(joint="pip", motor="motor_1", low=0.0, high=1.8, spool_radius=7e-3, joint_radius=8e-3),
        Row(joint="dip", low=0.0, high=1.2, follows="pip", ratio=0.67),
        Row(joint="abd", motor="motor_2", low=-0.4, high=0.4, spool_radius=7e-3, joint_radius=7e-3),
    ]
    return with_zeros(hand_of(rows, "hand", "table").rig)


def test_a_joint_that_follows_another_moves_with_it_and_is_not_wanted_by_itself(orca: Orca) -> None:
    hand = Hand(orca, coupled_rig(), compiled=False)
    go(hand, 0, 1)
    hand.set_joint_positions({"pip": 30.0})
    go(hand, 1, 200)
    angles = hand.get_joint_positions()
    assert angles["pip"] == pytest.approx(30.0, abs=8.0)
    assert angles["dip"] == pytest.approx(0.67 * angles["pip"], abs=1e-6)
    with pytest.raises(
        CommandError, match="'dip' follows another joint and is not moved by itself"
    ):
        hand.set_joint_positions({"dip": 20.0})


def test_temperatures_that_are_none_and_columns_of_another_hand(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    own = Own()
    own.heat = {"motor_1": None, "motor_2": 70.0, "other": 90.0}
    monkeypatch.setattr(own, "read", lambda: {"1_position": 0.1})
    hand = Hand(own, sound_rig(), compiled=False)
    assert hand.update(0.0).health == "bad"
    assert hand.health().hot == {"motor_2": 70.0}
    assert "'1_position' was read, no column of the rig: motor_1_position" in hand.health().sentence


def test_a_tendon_under_tension_meets_the_end_before_its_joint() -> None:
    """By its stretch, T/k along the spool; a slack one as much later as it is slack."""
    taut = sound_rig().with_values({"tendons.*.slack": {"value": 0.0, "std": 0.0}})
    names = [sensor.name for sensor in taut.sensors]
    tense, slack = {"value": 5.0, "std": 0.0}, {"value": 1e-3, "std": 0.0}
    rigs = (
        taut,
        taut.with_values({"tendons.*.pretension": tense}),
        taut.with_values({"tendons.*.slack": slack}),
    )
    radius, stiffness = taut.drives[0].radius.value, taut.tendons[0].stiffness.value
    contacts = np.array([[end.contact for end in range_ends(rig, names)] for rig in rigs])
    early, late = (contacts[1:, :2] - contacts[0, :2]) * radius
    assert early == pytest.approx(-5.0 / stiffness)
    assert late == pytest.approx(1e-3)


def test_a_record_that_cannot_be_written_is_refused_before_anything_moves(
    hand: Hand, orca: Orca, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match="does not exist"):
        hand.power_on(record=tmp_path / "none" / "routine.csv")
    assert orca.sent == {}
