"""What a user logs as samples in SI: units, encoders that wrap, temperatures, wrong values."""

from __future__ import annotations

from math import pi, radians

import numpy as np
import pytest

from distal import LogUnits, Rig, load_rig
from distal.errors import EstimationError
from distal.rig import build_rig, motor_range


def rig_of(counts: int = 4096, sign: int = 1) -> Rig:
    """Return a joint with a motor whose encoder has so many counts; its travel is below a turn."""
    raw = load_rig("capstan-joint").model_dump()
    raw["joints"][0]["stops"] = (radians(-40), radians(40))
    encoder, current = (dict(sensor) for sensor in raw["sensors"][:2])
    encoder |= {
        "unit": "count",
        "counts_per_turn": counts,
        "resolution": 2 * pi / counts,
        "sign": sign,
    }
    current |= {"unit": "mA", "torque_constant": 0.5, "column": "current"}
    return build_rig({**raw, "sensors": [encoder, current, *raw["sensors"][2:]]}, "counting joint")


def in_radians(sign: int = 1) -> Rig:
    """Return the same with a motor that reads radians and counts its turns."""
    raw = rig_of(sign=sign).model_dump()
    encoder, *others = raw["sensors"]
    encoder = encoder | {"unit": "rad", "counts_per_turn": None}
    return build_rig({**raw, "sensors": [encoder, *others]}, "radians")


def test_counts_and_milliamperes_become_si_by_name_and_in_order() -> None:
    units = LogUnits(rig_of(sign=-1))
    assert units.columns == ("motor_angle", "current")
    by_name = units.sample(0.0, {"current": 40, "motor_angle": 100})
    assert by_name == pytest.approx([-100 * 2 * pi / 4096, 0.02])
    units.reset()
    assert units.sample(0.0, [100, 40.0]) == pytest.approx(by_name)
    units.reset()
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
    true = way * np.linspace(0.0, 1.9 * counts, 400)
    read = np.array(
        [units.sample(0.01 * k, [float(np.floor(v) % counts), 0.0])[0] for k, v in enumerate(true)]
    )
    expected = np.floor(true) * 2 * pi / counts
    assert (
        np.ptp(read - expected) < 1e-9
    )  # the turn in which it begins is a matter of the joint's range


def test_it_begins_in_the_turn_in_which_the_joint_can_be() -> None:
    for raw, position in ((10, 10), (4090, -6)):
        assert LogUnits(rig_of()).sample(0.0, [raw, 0.0])[0] == pytest.approx(
            position * 2 * pi / 4096
        )


def test_a_gap_with_less_than_half_a_turn_of_motion_changes_nothing() -> None:
    units = LogUnits(rig_of())
    units.sample(0.0, [4000, 0.0])
    after = units.sample(0.25, [100, 0.0])[0]
    assert after == pytest.approx(100 * 2 * pi / 4096)
    assert units.remarks == ()


def test_a_long_gap_is_solved_by_the_joints_range_or_named() -> None:
    units = LogUnits(rig_of())
    units.sample(0.0, [4000, 0.0])
    assert units.sample(3.0, [100, 0.0])[0] == pytest.approx(100 * 2 * pi / 4096)
    assert units.remarks == ()
    wide = rig_of().with_values({"joints.jaw.stops": (-6.0, 6.0)})
    units = LogUnits(wide)
    units.sample(0.0, [100, 0.0])
    units.sample(3.0, [2000, 0.0])
    (remark,) = units.remarks
    assert remark.text == "'motor_angle' may have turned without a value for 3 s"


def test_a_hot_motor_has_less_torque() -> None:
    units = LogUnits(rig_of())
    cold = units.sample(0.0, [0, 100.0])[1]
    hot = units.sample(0.01, [0, 100.0], {"motor": 75.0})[1]
    assert hot / cold == pytest.approx(1 - 0.0011 * 50)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ({"motor_angel": 3}, "did you mean 'motor_angle'"),
        ({"current": "3"}, "'current' must be a number, '3' came"),
        ({"current": True}, "'current' must be a number"),
        ({"current": float("inf")}, "'current' is infinite"),
        ({"motor_angle": 1e300}, "'motor_angle' cannot be 1e.300"),
        ([1.0], "2 values .motor_angle, current., 1 came"),
    ],
)
def test_a_value_that_cannot_be_is_named(values: object, says: str) -> None:
    with pytest.raises(EstimationError, match=says):
        LogUnits(rig_of()).sample(0.0, values)  # type: ignore[arg-type]


def test_wrong_temperatures_are_named() -> None:
    with pytest.raises(EstimationError, match="no motor 'm'"):
        LogUnits(rig_of()).sample(0.0, [0, 0], {"m": 20.0})
    with pytest.raises(EstimationError, match="cannot have 900 °C"):
        LogUnits(rig_of()).sample(0.0, [0, 0], {"motor": 900})


@pytest.mark.parametrize("turns", [1, -2])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_motor_that_counts_its_turns_may_count_anew_after_a_restart(
    turns: int, sign: int
) -> None:
    """In radians; a place that no turn brings into the joint's range is passed on as it is."""
    units = LogUnits(in_radians(sign), doubting=False)
    assert units.sample(0.0, {"motor_angle": 0.3})[0] == pytest.approx(sign * 0.3)
    assert np.isnan(units.sample(0.1, {})[0])
    assert units.restarts == ()
    assert units.sample(0.2, {"motor_angle": 0.4 + 2 * pi * turns})[0] == pytest.approx(sign * 0.4)
    assert units.restarts == ("motor",)
    assert units.sample(0.3, {"motor_angle": 0.5 + 2 * pi * turns})[0] == pytest.approx(sign * 0.5)
    assert units.restarts == ()
    assert units.logged("motor_angle", sign * 0.6) == pytest.approx(0.6 + 2 * pi * turns)
    assert units.sample(0.4, {"motor_angle": 0.2})[0] == pytest.approx(sign * 0.2)
    assert units.sample(0.5, {"motor_angle": pi})[0] == pytest.approx(sign * pi)


def wide_rig() -> Rig:
    """Return the same with a travel of more than a turn of its motor, less than two."""
    raw = rig_of().model_dump()
    arm, radius = (
        raw["tendons"][0]["insertion"]["radius"]["value"],
        raw["drives"][0]["radius"]["value"],
    )
    raw["joints"][0]["stops"] = (-1.4 * pi * radius / arm, 1.4 * pi * radius / arm)
    return build_rig(raw, "wide joint")


def test_a_first_turn_that_is_a_guess_is_in_doubt_until_motion_tells_it() -> None:
    """The motor goes up from −200° to the top of its range: only one turn is left long before."""
    units = LogUnits(wide_rig())
    low, high = motor_range(units.rig, units.rig.sensors[0])
    assert 2 * pi < high - low < 4 * pi
    true, doubted, read = np.linspace(-3.5, 4.0, 400), [], []
    for k, position in enumerate(true):
        count = (position / (2 * pi) * 4096) % 4096
        read.append(units.sample(0.01 * k, [float(count), 0.0])[0])
        doubted.append(units.in_doubt != ())
    assert doubted[0]
    assert not doubted[-1]
    settled = doubted.index(False)
    np.testing.assert_allclose(read[settled:], true[settled:], atol=1e-9)


def test_what_was_read_beyond_a_turn_counts_its_turns() -> None:
    """After a silence it is where it says, not in the nearest turn."""
    wide = rig_of().with_values({"joints.jaw.stops": (-6.0, 6.0)})
    units = LogUnits(wide, doubting=False)
    for k in range(200):
        units.sample(0.01 * k, [25.0 * k, 0.0])
    assert units.sample(4.0, [1000.0, 0.0])[0] == pytest.approx(1000 * 2 * pi / 4096)


def test_before_a_power_on_routine_the_range_changes_no_reading() -> None:
    """A motor with a broken tendon goes on beyond its range: its readings are what limits it."""
    rig = rig_of()
    units = LogUnits(rig, ranged=False)
    turns = np.linspace(0.0, 3.0, 300)
    read = [units.sample(0.01 * k, [4096 * turn % 4096, 0.0])[0] for k, turn in enumerate(turns)]
    np.testing.assert_allclose(read, 2 * pi * turns, atol=1e-9)
    assert units.in_doubt == ()
    after = units.followed_by(rig)
    assert after.sample(3.01, [0.0, 0.0])[0] == pytest.approx(6 * pi)


def test_a_restart_stays_undone_when_readings_span_a_turn() -> None:
    """A motor that counts from another turn reads more than a turn, and moved by a tenth."""
    units = LogUnits(in_radians())
    units.sample(0.0, {"motor_angle": 0.3})
    assert units.sample(0.2, {"motor_angle": 0.4 + 2 * pi})[0] == pytest.approx(0.4)
    assert units.restarts == ("motor",)
    for k in range(1, 20):
        came = units.sample(0.2 + 0.01 * k, {"motor_angle": 0.4 + 0.01 * k + 2 * pi})[0]
        assert came == pytest.approx(0.4 + 0.01 * k)


@pytest.mark.parametrize(("gap", "restarted"), [(0.01, False), (0.2, True)])
def test_a_motor_that_was_not_silent_did_not_restart(gap: float, restarted: bool) -> None:
    """What leaps by a turn between two samples is a wrong reading, and no goal may follow it."""
    units = LogUnits(in_radians())
    units.sample(0.0, {"motor_angle": 0.3})
    units.sample(gap, {"motor_angle": 0.3 + 2 * pi})
    assert units.restarts == (("motor",) if restarted else ())
    assert units.logged("motor_angle", 0.3) == pytest.approx(0.3 + 2 * pi * restarted)
