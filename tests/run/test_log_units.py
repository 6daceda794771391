"""What a user logs as samples in SI: units, encoders that wrap, temperatures, wrong values."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from distal import LogUnits, Rig, load_rig
from distal.errors import EstimationError
from distal.rig import motor_range


def rig_of(counts: int | None = 4096, sign: int = 1, stops: float = radians(40)) -> Rig:
    """Return a joint with a motor whose encoder has so many counts, or counts its turns in radians;
    its travel, of which `stops` are the ends, is below a turn.
    """
    reads = {"unit": "count", "counts_per_turn": counts} if counts else {"unit": "rad"}
    encoder = {**reads, "resolution": 2 * pi / (counts or 4096), "sign": sign}
    current = {"unit": "mA", "torque_constant": 0.5, "column": "current"}
    values = {f"sensors.motor_angle.{key}": value for key, value in encoder.items()}
    values |= {f"sensors.motor_torque.{key}": value for key, value in current.items()}
    return load_rig("capstan-joint").with_values({"joints.jaw.stops": (-stops, stops), **values})


def test_counts_and_milliamperes_become_si_by_name_and_in_order() -> None:
    units = LogUnits(rig_of(sign=-1))
    assert units.columns == ("motor_angle", "current")
    for values in ({"current": 40, "motor_angle": 100}, [100, 40.0]):
        units.reset()
        assert units.sample(0.0, values) == pytest.approx([-100 * 2 * pi / 4096, 0.02])
    assert np.isnan(units.sample(0.0, {"motor_angle": 100})[1])
    assert np.isnan(units.sample(0.1, [None, 3])[0])


def test_a_goal_goes_back_to_what_the_log_holds() -> None:
    units = LogUnits(rig_of(sign=-1))
    position = units.sample(0.0, {"motor_angle": 4000})[0]
    assert units.logged("motor_angle", position) == pytest.approx(4000)


@pytest.mark.parametrize("doubting", [True, False])
@pytest.mark.parametrize("bits", [12, 16])
@pytest.mark.parametrize("way", [1, -1])
def test_an_encoder_is_followed_over_its_turn(bits: int, way: int, doubting: bool) -> None:
    counts = 2**bits
    units = LogUnits(rig_of(counts), doubting=doubting)
    true = np.floor(way * np.linspace(0.0, 1.9 * counts, 400))
    read = [units.sample(0.01 * k, [value % counts, 0.0])[0] for k, value in enumerate(true)]
    # the turn in which it begins is a matter of the joint's range
    assert np.ptp(read - true * 2 * pi / counts) < 1e-9


def test_it_begins_in_the_turn_in_which_the_joint_can_be() -> None:
    for raw, position in ((10, 10), (4090, -6)):
        assert LogUnits(rig_of()).sample(0.0, [raw, 0.0])[0] == pytest.approx(
            position * 2 * pi / 4096
        )


@pytest.mark.parametrize(
    ("stops", "first", "gap", "last", "remarks"),
    [
        (radians(40), 4000, 0.25, 100, []),
        (radians(40), 4000, 3.0, 100, []),
        (6.0, 100, 3.0, 2000, ["'motor_angle' may have turned without a value for 3 s"]),
    ],
)
def test_a_gap_is_solved_by_little_motion_or_by_the_joints_range_or_named(
    stops: float, first: int, gap: float, last: int, remarks: list[str]
) -> None:
    units = LogUnits(rig_of(stops=stops))
    units.sample(0.0, [first, 0.0])
    assert units.sample(gap, [last, 0.0])[0] == pytest.approx(last * 2 * pi / 4096)
    assert [remark.text for remark in units.remarks] == remarks


def test_a_hot_motor_has_less_torque() -> None:
    units = LogUnits(rig_of())
    cold = units.sample(0.0, [0, 100.0])[1]
    hot = units.sample(0.01, [0, 100.0], {"motor": 75.0})[1]
    assert hot / cold == pytest.approx(1 - 0.0011 * 50)


@pytest.mark.parametrize(
    ("values", "temperatures", "says"),
    [
        ({"motor_angel": 3}, {}, "did you mean 'motor_angle'"),
        ({"current": "3"}, {}, "'current' must be a number, '3' came"),
        ({"current": True}, {}, "'current' must be a number"),
        ({"current": float("inf")}, {}, "'current' is infinite"),
        ({"motor_angle": 1e300}, {}, "'motor_angle' cannot be 1e.300"),
        ([1.0], {}, "2 values .motor_angle, current., 1 came"),
        ([0, 0], {"m": 20.0}, "no motor 'm'"),
        ([0, 0], {"motor": 900}, "cannot have 900 °C"),
    ],
)
def test_a_value_that_cannot_be_is_named(
    values: object, temperatures: dict[str, float], says: str
) -> None:
    with pytest.raises(EstimationError, match=says):
        LogUnits(rig_of()).sample(0.0, values, temperatures)  # type: ignore[arg-type]


@pytest.mark.parametrize("turns", [1, -2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_motor_that_counts_its_turns_may_count_anew_after_a_restart(
    turns: int, sign: int
) -> None:
    """In radians; a place that no turn brings into the joint's range is passed on as it is."""
    units = LogUnits(rig_of(None, sign), doubting=False)
    away = 2 * pi * turns
    for time, values, position, restarts in (
        (0.0, {"motor_angle": 0.3}, 0.3, ()),
        (0.1, {}, np.nan, ()),
        (0.2, {"motor_angle": 0.4 + away}, 0.4, ("motor",)),
        (0.3, {"motor_angle": 0.5 + away}, 0.5, ()),
    ):
        assert units.sample(time, values)[0] == pytest.approx(sign * position, nan_ok=True)
        assert units.restarts == restarts
    assert units.logged("motor_angle", sign * 0.6) == pytest.approx(0.6 + away)
    for time, position in ((0.4, 0.2), (0.5, pi)):
        assert units.sample(time, {"motor_angle": position})[0] == pytest.approx(sign * position)


def test_a_first_turn_that_is_a_guess_is_in_doubt_until_motion_tells_it() -> None:
    """The motor goes up from −200° to the top of its range: only one turn is left long before."""
    plain = rig_of()
    arm = plain.tendons[0].insertion.radius.value
    units = LogUnits(rig_of(stops=1.4 * pi * plain.drives[0].radius.value / arm))
    low, high = motor_range(units.rig, units.rig.sensors[0])
    assert 2 * pi < high - low < 4 * pi
    true, doubted, read = np.linspace(-3.5, 4.0, 400), [], []
    for k, position in enumerate(true):
        read.append(units.sample(0.01 * k, [position / (2 * pi) * 4096 % 4096, 0.0])[0])
        doubted.append(units.in_doubt != ())
    assert doubted[0]
    assert not doubted[-1]
    settled = doubted.index(False)
    np.testing.assert_allclose(read[settled:], true[settled:], atol=1e-9)


def test_what_was_read_beyond_a_turn_counts_its_turns() -> None:
    """After a silence it is where it says, not in the nearest turn."""
    units = LogUnits(rig_of(stops=6.0), doubting=False)
    for k in range(200):
        units.sample(0.01 * k, [25.0 * k, 0.0])
    assert units.sample(4.0, [1000.0, 0.0])[0] == pytest.approx(1000 * 2 * pi / 4096)


def test_before_a_power_on_routine_the_range_changes_no_reading() -> None:
    """A motor with a broken tendon goes on beyond its range: its readings are what limits it."""
    units = LogUnits(rig_of(), ranged=False)
    turns = np.linspace(0.0, 3.0, 300)
    read = [units.sample(0.01 * k, [4096 * turn % 4096, 0.0])[0] for k, turn in enumerate(turns)]
    np.testing.assert_allclose(read, 2 * pi * turns, atol=1e-9)
    assert units.in_doubt == ()
    after = units.followed_by(rig_of()).sample(3.01, [0.0, 0.0])
    assert after[0] == pytest.approx(6 * pi)


def test_a_restart_stays_undone_when_readings_span_a_turn() -> None:
    """A motor that counts from another turn reads more than a turn, and moved by a tenth."""
    units = LogUnits(rig_of(None))
    for k, away in enumerate([0.0, *[2 * pi] * 20]):
        angle = 0.3 + 0.01 * k
        came = units.sample(0.2 + 0.01 * k - 0.2 * (k == 0), {"motor_angle": angle + away})[0]
        assert came == pytest.approx(angle)
    assert units.restarts == ()


@pytest.mark.parametrize(("gap", "restarted"), [(0.01, False), (0.2, True)])
def test_a_motor_that_was_not_silent_did_not_restart(gap: float, restarted: bool) -> None:
    """What leaps by a turn between two samples is a wrong reading, and no goal may follow it."""
    units = LogUnits(rig_of(None))
    units.sample(0.0, {"motor_angle": 0.3})
    units.sample(gap, {"motor_angle": 0.3 + 2 * pi})
    assert units.restarts == (("motor",) if restarted else ())
    assert units.logged("motor_angle", 0.3) == pytest.approx(0.3 + 2 * pi * restarted)
