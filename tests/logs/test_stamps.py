"""Stamps as labs write them: dates in any unit, ISO text, datetimes; time counts from the start,
the original is kept.
"""

from __future__ import annotations

from collections.abc import Callable
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from distal import Log, Rig, estimate, load_rig, read_log
from distal.errors import DistalWarning, LogError

TIME = 0.01 * np.arange(40)
NANOSECONDS = 1_795_208_567_123_456_789 + 10_000_000 * np.arange(40)
"""20 November 2026, 21:02:47 UTC, and on at 100 Hz."""


@pytest.fixture(scope="module")
def rig() -> Rig:
    return load_rig("capstan-joint")


@pytest.fixture
def frame() -> pl.DataFrame:
    time = np.arange(40) * 0.01
    return pl.DataFrame(
        {"motor_angle": 0.2 * np.sin(5 * time), "motor_torque": 0.01 * np.cos(5 * time)}
    )


Read = Callable[..., Log]


@pytest.fixture
def read(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> Read:
    """Read a log with other stamps from a file, by a rig that says their unit or none."""

    def call(stamps: object, unit: str | None = None) -> Log:
        path = tmp_path / "log.csv"
        frame.with_columns(pl.Series("t", stamps)).write_csv(path)
        return read_log(path, rig if unit is None else rig.with_values({"log.time.unit": unit}))

    return call


COUNTED = {"ns": 1, "us": 1000, "ms": 1_000_000}
"""Unit → its size [ns]. What is a date in one unit is too small for one in a smaller unit."""


@pytest.mark.parametrize(
    ("size", "said"),
    [
        (size, said)
        for size in COUNTED.values()
        for said in (None, "s", *(unit for unit, other in COUNTED.items() if other >= size))
    ],
)
def test_whole_numbers_of_any_unit(read: Read, size: int, said: str | None) -> None:
    """Exact to the last digit, whether the rig says the unit or it is known by its size."""
    log = read(NANOSECONDS // size, said)
    np.testing.assert_array_equal(log.stamps, NANOSECONDS // size * size)
    np.testing.assert_allclose(log.time, TIME, atol=1e-15)


@pytest.mark.parametrize("size", [1e9, 1e6])
def test_seconds_or_milliseconds_with_a_fraction(read: Read, size: float) -> None:
    """A float of 1.8e9 s tells 0.24 µs."""
    log = read(NANOSECONDS / size)
    np.testing.assert_allclose(log.stamps, NANOSECONDS, rtol=0, atol=500)
    np.testing.assert_allclose(log.time, TIME, atol=1e-6)


BELOW = 123_456_789 + 10_000_001 * np.arange(40)
"""Nanoseconds after 20 November 2026, 21:02:47 UTC."""
WHOLE = 10_000_000 * np.arange(40)


@pytest.mark.parametrize(
    ("form", "after", "size"),
    [
        ("2026-11-20T21:02:47.{:03d}Z", WHOLE, 10**6),
        ("2026-11-20 21:02:47.{:03d}", WHOLE, 10**6),
        ("2026-11-20T21:02:47,{:03d}", WHOLE, 10**6),
        ("2026/11/20 21:02:47.{:03d}", WHOLE, 10**6),
        ("2026-11-20T23:02:47.{:06d}+02:00", WHOLE, 10**3),
        ("2026-11-20T21:02:47.{:09d}Z", BELOW, 1),
        ("20261120T210247.{:09d}Z", BELOW, 1),
        ("20261120T210247.{:09d}", BELOW, 1),
        ("2026-11-20 23:02:47,{:09d}+02:00", BELOW, 1),
    ],
)
def test_iso_text(read: Read, form: str, after: np.ndarray, size: int) -> None:
    """Also what is below a microsecond counts, and whole seconds may lack their fraction."""
    texts = [form.format(nanoseconds) for nanoseconds in (after // size).tolist()]
    texts[0] = texts[0].replace(".000000+", "+")
    np.testing.assert_array_equal(read(texts).stamps, 1_795_208_567_000_000_000 + after)


def test_datetimes_of_frames(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> None:
    """polars, Parquet and pandas, in a column or as the index, with a zone or without."""
    dated = frame.with_columns(t=pl.Series(NANOSECONDS).cast(pl.Datetime("ns")))
    dated.write_parquet(tmp_path / "log.parquet")
    plain = dated.to_pandas()
    zoned = plain.assign(t=plain["t"].dt.tz_localize("UTC").dt.tz_convert("Europe/Berlin"))
    index = (plain.set_index("t"), zoned.set_index("t"))
    for log in (dated, tmp_path / "log.parquet", plain, zoned, *index):
        np.testing.assert_array_equal(read_log(log, rig).stamps, NANOSECONDS)


def test_results_have_them(read: Read, rig: Rig) -> None:
    """By `stamp` results join with other topics; parts of a log keep theirs. What counts from a
    start of its own has none.
    """
    assert "stamp [ns]" not in estimate(read(5.0 + TIME), rig, compiled=False).columns()
    log = read(NANOSECONDS)
    made = estimate(log, rig, compiled=False).columns()
    assert list(made)[:2] == ["t [s]", "stamp [ns]"]
    assert made["stamp [ns]"].dtype == np.int64
    np.testing.assert_array_equal(made["stamp [ns]"], NANOSECONDS)
    np.testing.assert_array_equal(log.select(slice(3, 9)).stamps, NANOSECONDS[3:9])


def test_a_truth_that_is_dated_too_is_laid_over_the_log(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    """It begins a tenth of a second earlier."""
    angle = 0.01 * np.arange(60)
    stamps = NANOSECONDS[0] - 100_000_000 + 10_000_000 * np.arange(60)
    pl.DataFrame({"t": stamps, "theta": angle}).write_csv(tmp_path / "truth.csv")
    log = read_log(frame.with_columns(t=NANOSECONDS), rig, tmp_path / "truth.csv")
    np.testing.assert_allclose(log.truth["theta"], angle[10:50], atol=1e-9)


@pytest.mark.parametrize("cell", ["2026-13-20T21:02:47", "", "now"])
def test_a_date_that_is_none(read: Read, cell: str) -> None:
    texts = [f"2026-11-20T21:02:47.{k:03d}Z" for k in range(40)]
    texts[4] = cell
    with pytest.raises(LogError, match=f"row 6, column 't': '{cell}' is no date"):
        read(texts)


@pytest.mark.parametrize("stamp", [10**19 * 5, 3e30])
def test_a_stamp_of_no_time(read: Read, stamp: float) -> None:
    with pytest.raises(LogError, match="which is no time; what unit has it"):
        read([str(stamp + k) for k in range(40)])


@pytest.mark.parametrize("year", ["9999", "1600", "0001"])
def test_dates_that_no_clock_has_are_refused(
    read: Read, frame: pl.DataFrame, rig: Rig, year: str
) -> None:
    """64 bits hold nanoseconds from 1678 to 2262: what is beyond would come out as another date."""
    texts = [f"{year}-01-01T00:00:00.{k:03d}" for k in range(40)]
    with pytest.raises(LogError, match=f"row 2, column 't': '{texts[0]}' is no date"):
        read(texts)
    dated = frame.with_columns(t=pl.Series(texts).str.to_datetime(time_unit="us"))
    with pytest.raises(LogError, match="is no date"):
        read_log(dated, rig)


@pytest.mark.parametrize("row", [0, 1, 7, 38, 39])
@pytest.mark.parametrize("begins", [0, 1_700_000_000])
@pytest.mark.parametrize("odd", [0.0, -5e9, 1e8, 1_700_000_030 + 2**64 // 10**9, 2**62, 1e300])
def test_one_wild_stamp_costs_its_row_only(
    read: Read, frame: pl.DataFrame, row: int, begins: int, odd: float
) -> None:
    """Wherever it stands, in a log with dates or without."""
    stamps = begins + 5.0 + TIME
    stamps[row] = odd
    with pytest.warns(DistalWarning, match=rf"log\.csv: row {row + 2} left out"):
        log = read(stamps)
    others = np.delete(TIME, row)
    start = 5.0 if begins == 0 else -others[0]
    np.testing.assert_allclose(log.time, others + start, atol=1e-6)
    np.testing.assert_array_equal(log.channels["motor_angle"], np.delete(frame["motor_angle"], row))


@pytest.mark.parametrize("begins", [0, 1_700_000_000])
@pytest.mark.parametrize("odd", [[0.06, 0.05], [-5e9, -5e9]])
def test_of_two_wild_stamps_nobody_knows_what_is_right(
    read: Read, begins: int, odd: list[float]
) -> None:
    stamps = begins + TIME
    stamps[5:7] = np.add(begins, odd)
    with pytest.raises(LogError, match=r"goes back|repeats|is inf"):
        read(stamps)


@pytest.mark.parametrize(
    ("form", "step"),
    [
        ("%H:%M:%S.%f", 10),
        ("%I:%M:%S.%f %p", 10),
        ("%d/%m/%Y %I:%M:%S.%f %p", 10),
        ("03-May-2024 %H:%M:%S.%f", 10),
        ("Fri May 03 %H:%M:%S.%f CEST 2024", 10),
        ("05/03/2024 %H:%M:%S.%f", 10),
        ("%M:%S.%f", 100),
    ],
)
def test_times_of_day_go_on_over_midnight(read: Read, form: str, step: int) -> None:
    """Whatever date stands around them; minutes, seconds and a fraction as spreadsheets show it."""
    begun = datetime(2024, 5, 3, 23, 59, 59, 800_000)
    texts = [(begun + k * timedelta(milliseconds=step)).strftime(form) for k in range(40)]
    np.testing.assert_allclose(read(texts).time, 1e-3 * step * np.arange(40), atol=1e-9)
    texts[7] = "half past nine"
    with pytest.raises(LogError, match=r"row 9, column 't': 'half past nine' is no time of day"):
        read(texts)


@pytest.mark.parametrize(("bits", "step", "unit"), [(32, 10_000, "us"), (16, 10, "ms")])
def test_a_counter_begins_anew(read: Read, bits: int, step: int, unit: str) -> None:
    log = read((2**bits - 15 * step + step * np.arange(40)) % 2**bits, unit)
    np.testing.assert_allclose(np.diff(log.time), 0.01)


def test_a_count_beyond_16_bits_is_no_counter_of_them(read: Read) -> None:
    """The clock was set back by 2¹⁶ ms after it had counted beyond; what follows is another run."""
    stamps = 65_530 + 10 * np.arange(40)
    stamps[30:] -= 2**16
    with pytest.warns(DistalWarning, match="did the clock begin anew"):
        read(stamps, "ms")


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1 / 86400, "day")])
def test_a_unit_of_time_that_is_another_is_proposed(read: Read, factor: float, unit: str) -> None:
    with pytest.raises(LogError, match=f'log.time.unit="{unit}"'):
        read(factor * TIME)
    np.testing.assert_allclose(read(factor * TIME, unit).time, TIME, atol=1e-9)
