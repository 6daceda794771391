"""The conversion of readings: what registers, encoders and drivers do is undone alike for a table, a
stream of lines or messages, and values that are given one by one.
"""

from __future__ import annotations

import json
import warnings
from collections.abc import Callable
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

from distal import LogUnits, Rig, load_rig, read_log
from distal.arrays import Floats
from distal.errors import DistalWarning
from distal.logs import MessageReader
from distal.rig import build_rig
from tests.learned_maps import drawn_map

N = 1200
TIME = 0.005 * np.arange(N)
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


def by_table(rig: Rig, logged: Floats, folder: Path) -> Floats:
    path = folder / "log.csv"
    rows = [f"{t:.3f},{a:.0f},{c:.0f}" for t, (a, c) in zip(TIME, logged)]
    path.write_text("\n".join(["t,angle,current", *rows]))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DistalWarning)
        log = read_log(path, rig)
    return np.column_stack([log.channels[name] for name in CHANNELS])


def by_lines(rig: Rig, logged: Floats, folder: Path) -> Floats:
    reader = MessageReader(rig, CHANNELS)
    reader.header("t,angle,current")
    return np.array([reader.csv(f"{t:.3f},{a:.0f},{c:.0f}")[1] for t, (a, c) in zip(TIME, logged)])


def by_messages(rig: Rig, logged: Floats, folder: Path) -> Floats:
    reader = MessageReader(rig, CHANNELS)
    return np.array(
        [
            reader.json(json.dumps({"t": t, "angle": a, "current": c}))[1]
            for t, (a, c) in zip(TIME.tolist(), logged.tolist())
        ]
    )


def one_by_one(rig: Rig, logged: Floats, folder: Path) -> Floats:
    units = LogUnits(rig, CHANNELS)
    return np.array([units.sample(float(t), row) for t, row in zip(TIME, logged)])


ENTRIES = (by_table, by_lines, by_messages, one_by_one)


def negative(logged: Floats, change: Callable[[Floats], Floats], *columns: int) -> Floats:
    result = logged.copy()
    for i in columns:
        below = result[:, i] < 0
        result[below, i] = change(result[below, i])
    return result


DECODED: dict[str, Callable[[Floats], Floats]] = {
    "16 bits without a sign": lambda logged: negative(logged, lambda x: x + 2**16, 0, 1),
    "32 bits without a sign": lambda logged: negative(logged, lambda x: x + 2**32, 0, 1),
    "sign in bit 15": lambda logged: negative(logged, lambda x: 2**15 - x, 0, 1),
    "sign in bit 10": lambda logged: negative(logged, lambda x: 2**10 - x, 1),
    "one turn only": lambda logged: np.column_stack([logged[:, 0] % 4096, logged[:, 1]]),
    "half a turn either way": lambda logged: np.column_stack(
        [(logged[:, 0] + 2048) % 4096 - 2048, logged[:, 1]]
    ),
}


@pytest.mark.parametrize("entry", ENTRIES)
@pytest.mark.parametrize("kind", DECODED)
def test_registers_and_turns_are_undone(
    kind: str, entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    np.testing.assert_allclose(
        entry(rig, DECODED[kind](good), tmp_path), entry(rig, good, tmp_path), atol=1e-12
    )


@pytest.mark.parametrize("entry", ENTRIES)
def test_readings_a_turn_off_make_no_counter_of_an_encoder(
    entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    """A servo's driver reads −1 as −4096; two in a row are no motion either."""
    off = good.copy()
    off[[200, 201, 640], 0] -= 4096
    np.testing.assert_allclose(entry(rig, off, tmp_path), entry(rig, good, tmp_path), atol=1e-12)


@pytest.mark.parametrize("entry", ENTRIES)
def test_an_encoder_before_the_gear_counts_its_turns(
    entry: Callable[..., Floats], rig: Rig, tmp_path: Path
) -> None:
    """It moves by more than half a turn between samples, after a rest beyond a turn or at once."""
    geared = with_encoder(rig, gear=29, counts_per_turn=1024, resolution=2 * pi / 1024 / 29)
    steps = np.zeros(N)
    steps[40:53] = 400
    steps[200:210] = -700
    steps[300:310] = 650
    counts = np.cumsum(steps)
    current = np.round(100.0 * np.cos(0.1 * np.arange(N)))
    factor = 2 * pi / 1024 / 29
    came = entry(geared, np.column_stack([counts, current]), tmp_path)[:, 0]
    np.testing.assert_allclose(came, factor * counts, atol=1e-9)
    at_once = counts[200:] - counts[200]
    at_once = np.concatenate([at_once, np.full(200, at_once[-1])])
    came = entry(geared, np.column_stack([at_once, current]), tmp_path)[:, 0]
    np.testing.assert_allclose(came[60:100], factor * at_once[60:100], atol=1e-9)
    np.testing.assert_allclose(came[110:], factor * at_once[110:], atol=1e-9)


def with_encoder(rig: Rig, **fields: object) -> Rig:
    encoder, *others = rig.model_dump()["sensors"]
    return build_rig({**rig.model_dump(), "sensors": [{**encoder, **fields}, *others]}, "encoder")


def with_camera(rig: Rig) -> Rig:
    """Return the rig with another reference, of degrees in the column `deg`."""
    raw = rig.model_dump()
    reference = {"name": "camera", "measures": "angle", "of": "jaw", "si": "rad", "unit": "deg"}
    sensors = [s for s in raw["sensors"] if s["measures"] != "angle"]
    return build_rig({**raw, "sensors": [*sensors, {**reference, "column": "deg"}]}, "known")


@pytest.mark.parametrize("counts", [2048, 4096, 65536])
def test_a_wrap_is_no_sign_of_a_register(rig: Rig, counts: int, tmp_path: Path) -> None:
    fine = with_encoder(rig, counts_per_turn=counts, resolution=2 * pi / counts)
    position = np.round(0.12 * counts * np.sin(3.0 * TIME))
    current = np.round(100.0 * np.cos(0.1 * np.arange(N)))
    came = one_by_one(fine, np.column_stack([position % counts, current]), tmp_path)
    np.testing.assert_allclose(came[:, 0], position * 2 * pi / counts, atol=1e-9)


@pytest.mark.parametrize(("counts", "least"), [(None, 0.0), (3600, 0.0), (3600, -180.0)])
def test_a_rounded_encoder_may_read_both_ends_of_its_turn(
    rig: Rig, counts: int | None, least: float, tmp_path: Path
) -> None:
    """Of 359.97 and 0.02 it makes 360.0 and 0.0, of 179.97 and −179.98 180.0 and −180.0."""
    unit = {"unit": "deg"} if counts is None else {}
    step = np.radians(0.1)
    rounded = with_encoder(rig, counts_per_turn=counts, resolution=step, **unit)
    position = 3.0 * np.sin(2.0 * TIME) + 0.01 + least
    factor = 1.0 if counts is None else 10.0
    turned = (position - least) % 360.0 + least
    read = np.round(turned * factor, 1 if counts is None else 0)
    assert {least * factor, (least + 360.0) * factor} <= {*read}
    current = np.round(100.0 * np.cos(0.1 * np.arange(N)))
    came = one_by_one(rounded, np.column_stack([read, current]), tmp_path)
    turns = (came[:, 0] - np.radians(position)) / (2 * pi)
    np.testing.assert_allclose(
        came[:, 0] - np.round(turns[0]) * 2 * pi, np.radians(position), atol=0.51 * step
    )


def test_a_jump_of_more_than_half_a_turn_leaves_no_turn_behind(rig: Rig) -> None:
    """It looks like a wrap until the encoder reads more than a turn."""
    geared = with_encoder(rig, unit="deg", counts_per_turn=None, gear=30, resolution=0.0)
    steps = np.zeros(N)
    steps[10:20] = 228.0
    steps[300:310] = -228.0
    steps[600:] = 0.3 * np.sin(np.arange(N - 600))
    position = np.cumsum(steps)
    units = LogUnits(geared, CHANNELS)
    came = np.array(
        [
            units.sample(float(t), np.array([x, 100.0 * np.cos(0.1 * k)]))[0]
            for k, (t, x) in enumerate(zip(TIME, position))
        ]
    )
    np.testing.assert_allclose(came[15:], np.radians(position[15:]) / 30, atol=1e-9)


@pytest.mark.parametrize(("counts", "gear"), [(48, 298), (512, 100), (4096, 50)])
def test_behind_a_gear_nothing_is_lost_and_nothing_begins_anew(
    rig: Rig, counts: int, gear: int
) -> None:
    """Its step is that behind the gear, and between two samples it goes to the nearest turn."""
    geared = with_encoder(
        rig, counts_per_turn=counts, gear=gear, resolution=2 * pi / counts, noise=0.0
    )
    units = LogUnits(geared, CHANNELS)
    position = np.round(0.3 * counts * np.sin(3.0 * TIME))
    for k, (t, x) in enumerate(zip(TIME, position)):
        came = units.sample(float(t), np.array([x, 100.0 * np.cos(0.1 * k)]))
        assert came[0] == pytest.approx(x * 2 * pi / counts / gear, abs=1e-9)
        assert k == 0 or not [one for one in units.remarks if one.sensor == "angle"]


def test_one_number_alone_shows_no_flag(rig: Rig, tmp_path: Path) -> None:
    """A counter that begins in the middle of its register counts on, and is not turned over."""
    counts = 33100.0 + np.round(300.0 * np.sin(2.0 * TIME))
    came = one_by_one(rig, np.column_stack([counts, 8.0 * np.sin(9.0 * TIME)]), tmp_path)
    np.testing.assert_allclose(np.diff(came[:, 0]), np.diff(counts) * 2 * pi / 4096, atol=1e-9)


@pytest.mark.parametrize("end", [65_535.0, 32_767.0, -32_768.0, 2.0**31 - 1])
def test_the_end_of_a_register_is_missing(
    rig: Rig, good: Floats, tmp_path: Path, end: float
) -> None:
    logged = good.copy()
    logged[200:240] = end
    came = one_by_one(rig, logged, tmp_path)
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


def test_a_drive_may_hunt_by_some_counts(rig: Rig, tmp_path: Path) -> None:
    hunts = 300.0 * np.sin(0.5 * TIME) + 3.0 * (-1.0) ** np.arange(N)
    logged = np.round(np.column_stack([hunts, 90.0 * np.cos(0.1 * np.arange(N))]))
    assert not np.isnan(one_by_one(rig, logged, tmp_path)).any()


def test_a_reference_goes_to_the_nearest_turn_after_a_gap(rig: Rig, tmp_path: Path) -> None:
    known = with_camera(rig).with_values({"joints.0.stops": None})
    angle = 165.0 + 30.0 * np.sin(2.0 * TIME)
    wrapped = (angle + 180.0) % 360.0 - 180.0
    cells = [f"{a:.3f}" for a in wrapped]
    cells[20:100] = [""] * 80
    rows = [f"{t:.3f},{k % 7},{k % 5},{a}" for k, (t, a) in enumerate(zip(TIME, cells))]
    path = tmp_path / "log.csv"
    path.write_text("\n".join(["t,angle,current,deg", *rows]))
    truth = np.rad2deg(read_log(path, known).truth["theta"])
    there = np.isfinite(truth)
    np.testing.assert_allclose(truth[there], angle[there], atol=1e-3)


@pytest.mark.parametrize("entry", ENTRIES)
def test_a_good_log_passes_whole(
    entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    expected = good * [2 * pi / 4096, 0.5e-3]
    np.testing.assert_allclose(entry(rig, good, tmp_path), expected, atol=1e-12)


@pytest.mark.parametrize("entry", ENTRIES)
def test_no_position_is_left_out_however_fast_its_drive_is(
    entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    """What it is worth the filter knows: one that is wild, one that jumps and stays, two sources in
    turn.
    """
    odd = good.copy()
    odd[[300, 700], 0] += [900, -700]
    odd[400:500, 0] += 700
    odd[800:1000:2, 0] += 120
    came = entry(rig, odd, tmp_path)
    np.testing.assert_allclose(came, odd * [2 * pi / 4096, 0.5e-3], atol=1e-12)


@pytest.mark.parametrize("entry", ENTRIES)
def test_readings_that_repeat_exactly_are_missing(
    entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    """The position alone may rest between two counts, the current with its noise may not."""
    repeated = good.copy()
    repeated[500:600] = repeated[499]
    came, usual = entry(rig, repeated, tmp_path), entry(rig, good, tmp_path)
    assert np.isnan(came[506:600]).all()
    np.testing.assert_allclose(came[600:], usual[600:], atol=1e-12)
    rests = good.copy()
    rests[500:600, 0] = rests[499, 0]
    assert not np.isnan(entry(rig, rests, tmp_path)).any()


@pytest.mark.parametrize("entry", ENTRIES)
def test_coarse_readings_may_rest(
    entry: Callable[..., Floats], rig: Rig, good: Floats, tmp_path: Path
) -> None:
    """Rounding in motion looks like noise of up to half a step; at rest it repeats."""
    slow = np.where(TIME < 3.0, 150.0 * np.sin(2.0 * TIME), 150.0 * np.sin(6.0))
    coarse = np.round(np.column_stack([slow, 0.5 * slow]))
    assert not np.isnan(entry(rig, coarse, tmp_path)).any()


@pytest.mark.parametrize("seed", range(3))
def test_a_drive_with_a_coarse_current_may_rest(rig: Rig, seed: int, tmp_path: Path) -> None:
    """It goes from rest to rest, and its current is read in steps that are wider than its noise:
    the first rests teach that it rests.
    """
    rng = np.random.default_rng(seed)
    phase = np.cumsum(np.where((np.arange(N) // 150) % 2 == 0, 0.02, 0.0))
    current = 90.0 * np.sin(phase + 1.0) + rng.normal(0.0, 3.0, N)
    logged = np.column_stack([np.round(400.0 * np.sin(phase)), 20.0 * np.round(current / 20.0)])
    assert not np.isnan(one_by_one(rig, logged, tmp_path)[600:]).any()


def test_a_reference_that_wraps_is_in_the_turn_of_its_joint(rig: Rig, tmp_path: Path) -> None:
    angle = 50.0 * np.sin(2.0 * TIME)
    known, path = with_camera(rig), tmp_path / "log.csv"
    for wrapped in (angle % 360.0, (angle + 180.0) % 360.0 - 180.0 + 360.0):
        rows = [f"{t:.3f},{k % 7},{k % 5},{a:.3f}" for k, (t, a) in enumerate(zip(TIME, wrapped))]
        path.write_text("\n".join(["t,angle,current,deg", *rows]))
        truth = read_log(path, known).truth["theta"]
        np.testing.assert_allclose(np.rad2deg(truth), angle, atol=1e-3)


def test_what_was_done_is_said(rig: Rig, good: Floats, tmp_path: Path) -> None:
    units = LogUnits(rig, CHANNELS)
    said = set()
    for t, row in zip(TIME, DECODED["sign in bit 15"](good)):
        units.sample(float(t), row)
        said |= {remark.text for remark in units.remarks}
    assert "'current' holds negative numbers that were read without a sign: decoded" in said
    path = tmp_path / "log.csv"
    below = DECODED["sign in bit 15"](good)
    rows = [f"{t:.3f},{a:.0f},{c:.0f}" for t, a, c in zip(TIME, good[:, 0], below[:, 1])]
    path.write_text("\n".join(["t,angle,current", *rows]))
    with pytest.warns(DistalWarning, match=r"'current' holds negative.*readings.*at 0 s"):
        read_log(path, rig)


def test_how_long_a_motor_was_silent_is_said(rig: Rig, good: Floats, tmp_path: Path) -> None:
    """A rig whose joint may turn far does not say in which turn its motor is after a gap."""
    wide = rig.with_values({"joints.0.stops": (-6.0, 6.0)})
    logged = good.copy()
    logged[200:800, 0] = np.nan
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},{a % 4096:.0f},{c:.0f}" for t, (a, c) in zip(TIME, logged)]
    path.write_text("\n".join(["t,angle,current", *rows]))
    with pytest.warns(DistalWarning, match=r"without a value for 3 s \(1 readings, the first at 4"):
        read_log(path, wide)


def test_a_number_beyond_all_sensors_is_passed_on(rig: Rig, good: Floats) -> None:
    """The estimator takes it as missing, and says so; what comes after it is as before."""
    reader = MessageReader(rig, CHANNELS)
    reader.header("t,angle,current")
    for k, (t, (a, c)) in enumerate(zip(TIME, good)):
        text = {300: "inf", 301: "-1e300"}.get(k, f"{a:.0f}")
        _, sample = reader.csv(f"{t:.3f},{text},{c:.0f}")
        expected = float(text) * 2 * pi / 4096
        assert sample[0] == pytest.approx(expected)


def test_a_log_in_radians_begins_where_it_says(rig: Rig, good: Floats, tmp_path: Path) -> None:
    """A zero that is wrong is not taken for another turn: only a hand sets its motors so."""
    radians_rig = with_encoder(rig, unit="rad", counts_per_turn=None, bias={"value": 0.0})
    path = tmp_path / "log.csv"
    position = 8.0 + good[:, 0] * 2 * pi / 4096
    rows = [f"{t:.3f},{a:.6f},{c:.0f}" for t, a, c in zip(TIME, position, good[:, 1])]
    path.write_text("\n".join(["t,angle,current", *rows]))
    np.testing.assert_allclose(read_log(path, radians_rig).channels["angle"], position, atol=1e-5)


def test_before_a_power_on_routine_no_range_says_where_an_encoder_is(
    rig: Rig, good: Floats, tmp_path: Path
) -> None:
    path = tmp_path / "log.csv"
    rows = [f"{t:.3f},{4000 + a / 10:.0f},{c:.0f}" for t, (a, c) in zip(TIME, good)]
    path.write_text("\n".join(["t,angle,current", *rows]))
    ranged = read_log(path, rig).channels["angle"]
    as_read = read_log(path, rig, ranged=False).channels["angle"]
    np.testing.assert_allclose(as_read - ranged, 2 * pi, atol=1e-9)
    assert as_read[0] > pi > ranged[0]


@pytest.mark.parametrize("turns", [-2, 1])
def test_logs_that_taught_a_rig_say_in_which_turn_it_is(
    rig: Rig, good: Floats, turns: int, tmp_path: Path
) -> None:
    """A motor that counts from another turn, whose joint has no stops."""
    free = rig.with_values({"joints.0.stops": None})
    drawn = drawn_map((free.joint_names[0],), CHANNELS, False)
    reach = float(2 * pi / 4096 * np.ptp(good[:, 0]) / 2)
    learned = drawn.model_copy(update={"low": (-reach, -1.0), "high": (reach, 1.0)})
    off = good + np.array([4096 * turns, 0])
    taught = free.with_map(readings=[learned])
    for entry in ENTRIES:
        came = entry(taught, off, tmp_path)
        np.testing.assert_allclose(came, entry(free, good, tmp_path), atol=1e-9)
