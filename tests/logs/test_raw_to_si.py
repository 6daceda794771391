"""The conversion of readings: what registers, encoders and drivers do is undone alike for a table, a
stream of lines or messages, and values that are given one by one.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from math import pi, radians

import numpy as np
import polars as pl
import pytest

from distal import LogUnits, Rig, load_rig, read_log
from distal.arrays import Floats
from distal.errors import DistalWarning
from distal.logs import MessageReader
from distal.rig import build_rig
from tests.learned_maps import drawn_map

N = 1200
TIME = 0.005 * np.arange(N)
ROWS = np.arange(N)
CHANNELS = ("angle", "current")


@pytest.fixture(scope="module")
def rig() -> Rig:
    """Return a joint with an encoder of 4096 counts on its motor, and a current in mA."""
    raw = load_rig("capstan-joint").model_dump()
    raw["joints"][0]["stops"] = (radians(-60), radians(60))
    encoder, current, *others = (dict(sensor) for sensor in raw["sensors"])
    encoder |= {
        "name": "angle",
        "column": "angle",
        "unit": "count",
        "counts_per_turn": 4096,
        "resolution": 2 * pi / 4096,
    }
    current |= {"name": "current", "column": "current", "unit": "mA", "torque_constant": 0.5}
    return build_rig({**raw, "sensors": [encoder, current, *others]}, "counting joint")


@pytest.fixture(scope="module")
def good() -> Floats:
    """Return counts and milliamperes, whole numbers with noise, (N, 2)."""
    rng = np.random.default_rng(3)
    position = 400.0 * np.sin(2.0 * TIME) + rng.normal(0.0, 1.0, N)
    current = 200.0 * np.sin(2.0 * TIME + 1.0) + rng.normal(0.0, 8.0, N)
    return np.round(np.column_stack([position, current]))


def frame(angle: Floats, current: Floats, **more: Floats) -> pl.DataFrame:
    return pl.DataFrame({"t": TIME, "angle": angle, "current": current, **more})


def by_table(rig: Rig, logged: Floats) -> Floats:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistalWarning)
        log = read_log(frame(*logged.T), rig)
    return np.column_stack([log.channels[name] for name in CHANNELS])


def by_lines(rig: Rig, logged: Floats) -> Floats:
    reader = MessageReader(rig, CHANNELS)
    reader.header("t,angle,current")
    return np.array([reader.csv(f"{t:.3f},{a:.0f},{c:.0f}")[1] for t, (a, c) in zip(TIME, logged)])


def by_messages(rig: Rig, logged: Floats) -> Floats:
    reader = MessageReader(rig, CHANNELS)
    rows = frame(*logged.T).iter_rows(named=True)
    return np.array([reader.json(json.dumps(row))[1] for row in rows])


def one_by_one(rig: Rig, logged: Floats) -> Floats:
    units = LogUnits(rig, CHANNELS)
    return np.array([units.sample(float(t), row) for t, row in zip(TIME, logged)])


Entry = Callable[[Rig, Floats], Floats]
BOTH = (by_table, one_by_one)
"""Lines and messages become values that are given one by one: that is shown once."""


def negative(logged: Floats, change: Callable[[Floats], Floats], *columns: int) -> Floats:
    result = logged.copy()
    for i in columns:
        below = result[:, i] < 0
        result[below, i] = change(result[below, i])
    return result


TURN_OFF = 4096 * (1.0 * np.isin(ROWS, [640]) - np.isin(ROWS, [200, 201]))
DECODED: dict[str, Callable[[Floats], Floats]] = {
    "16 bits without a sign": lambda logged: negative(logged, lambda x: x + 2**16, 0, 1),
    "32 bits without a sign": lambda logged: negative(logged, lambda x: x + 2**32, 0, 1),
    "sign in bit 15": lambda logged: negative(logged, lambda x: 2**15 - x, 0, 1),
    "sign in bit 10": lambda logged: negative(logged, lambda x: 2**10 - x, 1),
    "one turn only": lambda logged: np.column_stack([logged[:, 0] % 4096, logged[:, 1]]),
    "half a turn either way": lambda logged: np.column_stack(
        [(logged[:, 0] + 2048) % 4096 - 2048, logged[:, 1]]
    ),
    # a servo's driver reads −1 as −4096, and 1 as 4097; two in a row are no motion either
    "a turn off": lambda logged: logged + np.outer(TURN_OFF, [1, 0]),
}


@pytest.mark.parametrize("entry", [*BOTH, by_lines, by_messages])
@pytest.mark.parametrize("kind", DECODED)
def test_registers_and_turns_are_undone(kind: str, entry: Entry, rig: Rig, good: Floats) -> None:
    np.testing.assert_allclose(entry(rig, DECODED[kind](good)), entry(rig, good), atol=1e-12)


def moved(*parts: tuple[int, float]) -> Floats:
    """Return a position that moves for ten samples from each row on, by so much in each."""
    steps = np.zeros(N)
    for row, step in parts:
        steps[row : row + 10] = step
    return np.cumsum(steps)


CURRENT = np.round(100.0 * np.cos(0.1 * np.arange(N)))


@pytest.mark.parametrize("entry", BOTH)
@pytest.mark.parametrize(
    ("fields", "position", "known"),
    [
        ({"counts_per_turn": 1024, "gear": 29}, moved((40, 400), (200, -700), (300, 650)), [0]),
        ({"counts_per_turn": 1024, "gear": 29}, moved((1, -700), (100, 650)), [60, 100, 110]),
        # a jump of more than half a turn looks like a wrap until the encoder reads more than a turn
        (
            {"unit": "deg", "counts_per_turn": None, "gear": 30},
            moved((10, 228), (300, -228)) + np.round(np.sin(0.1 * np.arange(N))),
            [15],
        ),
        *(
            (
                {"counts_per_turn": counts, "gear": gear, "resolution": 2 * pi / counts},
                np.round(0.3 * counts * np.sin(3.0 * TIME)),
                [0],
            )
            for counts, gear in ((48, 298), (512, 100), (4096, 50))
        ),
    ],
)
def test_an_encoder_before_the_gear_counts_its_turns(
    entry: Entry, rig: Rig, fields: dict[str, object], position: Floats, known: list[int]
) -> None:
    """It moves by more than half a turn between samples, after a rest beyond a turn or at once;
    between two samples it goes to the nearest turn. The rows are those in which it is known.
    """
    geared = with_encoder(rig, **{"resolution": 0.0, "noise": 0.0, **fields})
    came = entry(geared, np.column_stack([position, CURRENT]))[:, 0]
    turn = 360.0 if "unit" in fields else fields["counts_per_turn"]
    for part in np.split(np.arange(N), known)[1::2]:
        expected = position[part] * 2 * pi / turn / fields["gear"]  # type: ignore[operator]
        np.testing.assert_allclose(came[part], expected, atol=1e-9)


def with_encoder(rig: Rig, **fields: object) -> Rig:
    encoder, *others = rig.model_dump()["sensors"]
    return build_rig({**rig.model_dump(), "sensors": [{**encoder, **fields}, *others]}, "encoder")


def with_camera(rig: Rig) -> Rig:
    """Return the rig with another reference, of degrees in the column `deg`."""
    camera = {"name": "camera", "measures": "angle", "of": "jaw", "unit": "deg", "column": "deg"}
    sensors = [sensor.model_dump() for sensor in rig.sensors if sensor.measures != "angle"]
    return rig.with_values({"sensors": [*sensors, camera]})


DEGREES = {"unit": "deg", "counts_per_turn": None}


@pytest.mark.parametrize(
    ("fields", "turn", "step", "least"),
    [
        *(({"counts_per_turn": counts}, counts, 1.0, 0.0) for counts in (2048, 4096, 65_536)),
        (DEGREES, 360.0, 0.1, 0.0),
        ({"counts_per_turn": 3600}, 3600.0, 1.0, 0.0),
        ({"counts_per_turn": 3600}, 3600.0, 1.0, -1800.0),
    ],
)
def test_an_encoder_within_a_turn(
    rig: Rig, fields: dict[str, object], turn: float, step: float, least: float
) -> None:
    """Its wrap is no sign of a register. A rounded one may read both ends of its turn: of 359.97
    and 0.02 it makes 360.0 and 0.0, of 179.97 and −179.98 180.0 and −180.0.
    """
    rounded = with_encoder(rig, resolution=step * 2 * pi / turn, **fields)
    position = turn / 120.0 * np.sin(2.0 * TIME) + step / 10.0 + least
    read = np.round(((position - least) % turn + least) / step) * step
    assert least + turn in read or turn == 65_536
    came = one_by_one(rounded, np.column_stack([read, CURRENT]))[:, 0] * turn / (2 * pi)
    off = came - position
    np.testing.assert_allclose(off, np.round(off[0] / turn) * turn, atol=0.51 * step)


def test_one_number_alone_shows_no_flag(rig: Rig) -> None:
    """A counter that begins in the middle of its register counts on, and is not turned over."""
    counts = 33100.0 + np.round(300.0 * np.sin(2.0 * TIME))
    came = one_by_one(rig, np.column_stack([counts, 8.0 * np.sin(9.0 * TIME)]))[:, 0]
    np.testing.assert_allclose(np.diff(came), np.diff(counts) * 2 * pi / 4096, atol=1e-9)


@pytest.mark.parametrize("end", [65_535.0, 32_767.0, -32_768.0, 2.0**31 - 1])
def test_the_end_of_a_register_is_missing(rig: Rig, good: Floats, end: float) -> None:
    logged = good.copy()
    logged[200:240] = end
    came = one_by_one(rig, logged)
    assert np.isnan(came[200:240]).all()
    assert np.isfinite(came[:200]).all()
    units = LogUnits(rig, CHANNELS)
    units.sample(0.0, [100.0, 5.0])
    units.sample(0.005, [end, 6.0])
    assert [remark.kind for remark in units.remarks] == ["full"]


def test_an_encoder_within_a_turn_of_16_bits_may_be_at_its_end(rig: Rig) -> None:
    fine = with_encoder(rig, counts_per_turn=65_536, resolution=2 * pi / 65_536)
    units = LogUnits(fine, CHANNELS)
    for k, count in enumerate((65_533.0, 65_534.0, 65_535.0, 0.0, 1.0)):
        came = units.sample(0.005 * k, [count, 10.0])[0]
        assert came == pytest.approx((k - 3) * 2 * pi / 65_536)


def rests_and_moves(seed: int) -> Floats:
    """Return a log from rest to rest, whose current is read in steps that are wider than its noise:
    the first rests teach that it rests.
    """
    rng = np.random.default_rng(seed)
    phase = np.cumsum(np.where((np.arange(N) // 150) % 2 == 0, 0.02, 0.0))
    current = 90.0 * np.sin(phase + 1.0) + rng.normal(0.0, 3.0, N)
    return np.column_stack([400.0 * np.sin(phase), 20.0 * np.round(current / 20.0)])


HUNTS = 300.0 * np.sin(0.5 * TIME) + 3.0 * (-1.0) ** np.arange(N)
# rounding in motion looks like noise of up to half a step; at rest it repeats
COARSE = np.where(TIME < 3.0, 150.0 * np.sin(2.0 * TIME), 150.0 * np.sin(6.0))
HONEST = {
    "it hunts by some counts": (np.column_stack([HUNTS, CURRENT]), 0),
    "coarse readings rest": (np.column_stack([COARSE, 0.5 * COARSE]), 0),
    **{f"a coarse current rests, {seed}": (rests_and_moves(seed), N // 2) for seed in range(3)},
}


@pytest.mark.parametrize("entry", BOTH)
@pytest.mark.parametrize("kind", HONEST)
def test_what_a_drive_may_do_is_not_missing(kind: str, entry: Entry, rig: Rig) -> None:
    logged, first = HONEST[kind]
    assert not np.isnan(entry(rig, np.round(logged))[first:]).any()


@pytest.mark.parametrize(("stops", "middle"), [((-1.0, 1.0), 0.0), (None, 165.0)])
@pytest.mark.parametrize("least", [0.0, 180.0, -180.0])
def test_a_reference_that_wraps_is_in_the_turn_of_its_joint(
    rig: Rig, good: Floats, stops: object, middle: float, least: float
) -> None:
    """Without stops it is in that of its first value, and goes to the nearest turn after a gap."""
    angle = middle + 30.0 * np.sin(2.0 * TIME)
    wrapped = (angle - least) % 360.0 + least
    wrapped[20:100] = np.nan
    known = with_camera(rig).with_values({"joints.0.stops": stops})
    truth = np.rad2deg(read_log(frame(*good.T, deg=wrapped), known).truth["theta"])
    there = np.isfinite(truth)
    assert there[100:].all()
    turn = 0.0 if stops else np.round((wrapped - angle)[0])
    np.testing.assert_allclose(truth[there], angle[there] + turn, atol=1e-3)


@pytest.mark.parametrize("entry", BOTH)
def test_no_position_is_left_out_however_fast_its_drive_is(
    entry: Entry, rig: Rig, good: Floats
) -> None:
    """What it is worth the filter knows: one that is wild, one that jumps and stays, two sources in
    turn.
    """
    odd = good.copy()
    odd[[300, 700], 0] += [900, -700]
    odd[400:500, 0] += 700
    odd[800:1000:2, 0] += 120
    np.testing.assert_allclose(entry(rig, odd), odd * [2 * pi / 4096, 0.5e-3], atol=1e-12)


@pytest.mark.parametrize("entry", BOTH)
def test_readings_that_repeat_exactly_are_missing(entry: Entry, rig: Rig, good: Floats) -> None:
    """The position alone may rest between two counts, the current with its noise may not."""
    repeated = good.copy()
    repeated[500:600] = repeated[499]
    came, usual = entry(rig, repeated), entry(rig, good)
    assert np.isnan(came[506:600]).all()
    np.testing.assert_allclose(came[600:], usual[600:], atol=1e-12)
    repeated[:, 1] = good[:, 1]
    assert not np.isnan(entry(rig, repeated)).any()


def test_what_was_done_is_said(rig: Rig, good: Floats) -> None:
    below = DECODED["sign in bit 15"](good)
    with pytest.warns(DistalWarning, match=r"'current' holds negative.*readings.*at 0 s"):
        read_log(frame(good[:, 0], below[:, 1]), rig)


def test_how_long_a_motor_was_silent_is_said(rig: Rig, good: Floats) -> None:
    """A rig whose joint may turn far does not say in which turn its motor is after a gap."""
    wide = rig.with_values({"joints.0.stops": (-6.0, 6.0)})
    angle = good[:, 0] % 4096
    angle[200:800] = np.nan
    with pytest.warns(DistalWarning, match=r"without a value for 3 s \(1 readings, the first at 4"):
        read_log(frame(angle, good[:, 1]), wide)


def test_a_number_beyond_all_sensors_is_passed_on(rig: Rig, good: Floats) -> None:
    """The estimator takes it as missing, and says so; what comes after it is as before."""
    reader = MessageReader(rig, CHANNELS)
    reader.header("t,angle,current")
    for k, (t, (a, c)) in enumerate(zip(TIME, good)):
        text = {300: "inf", 301: "-1e300"}.get(k, f"{a:.0f}")
        _, sample = reader.csv(f"{t:.3f},{text},{c:.0f}")
        expected = float(text) * 2 * pi / 4096
        assert sample[0] == pytest.approx(expected)


def test_a_log_in_radians_begins_where_it_says(rig: Rig, good: Floats) -> None:
    """A zero that is wrong is not taken for another turn: only a hand sets its motors so."""
    radians_rig = with_encoder(rig, unit="rad", counts_per_turn=None, bias={"value": 0.0})
    position = 8.0 + good[:, 0] * 2 * pi / 4096
    read = read_log(frame(position, good[:, 1]), radians_rig)
    np.testing.assert_allclose(read.channels["angle"], position, atol=1e-5)


def test_before_a_power_on_routine_no_range_says_where_an_encoder_is(
    rig: Rig, good: Floats
) -> None:
    logged = frame(4000 + np.round(good[:, 0] / 10), good[:, 1])
    ranged = read_log(logged, rig).channels["angle"]
    as_read = read_log(logged, rig, ranged=False).channels["angle"]
    np.testing.assert_allclose(as_read - ranged, 2 * pi, atol=1e-9)
    assert as_read[0] > pi > ranged[0]


@pytest.mark.parametrize("entry", BOTH)
@pytest.mark.parametrize("turns", [-2, 1])
def test_logs_that_taught_a_rig_say_in_which_turn_it_is(
    entry: Entry, rig: Rig, good: Floats, turns: int
) -> None:
    """A motor that counts from another turn, whose joint has no stops."""
    free = rig.with_values({"joints.0.stops": None})
    reach = 2 * pi / 4096 * float(np.ptp(good[:, 0])) / 2
    learned = drawn_map((free.joint_names[0],), CHANNELS, False).model_copy(
        update={"low": (-reach, -1.0), "high": (reach, 1.0)}
    )
    came = entry(free.with_map(readings=[learned]), np.add(good, [4096 * turns, 0]))
    np.testing.assert_allclose(came, entry(free, good), atol=1e-9)
