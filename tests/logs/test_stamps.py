"""Stamps as labs write them: dates in any unit, ISO text, datetimes; time counts from the start,
the original is kept.
"""

from __future__ import annotations

from datetime import datetime, timedelta, timezone
from pathlib import Path

import numpy as np
import pandas
import polars as pl
import pytest

from distal import Log, Rig, estimate, load_rig, read_log
from distal.errors import DistalWarning, LogError

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


def read(frame: pl.DataFrame, stamps: object, rig: Rig, path: Path, unit: str | None = None) -> Log:
    frame.with_columns(pl.Series("t", stamps)).write_csv(path)
    return read_log(path, rig if unit is None else rig.with_values({"log.time.unit": unit}))


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
def test_whole_numbers_of_any_unit(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, size: int, said: str | None
) -> None:
    """Exact to the last digit, whether the rig says the unit or it is known by its size."""
    log = read(frame, NANOSECONDS // size, rig, tmp_path / "log.csv", said)
    assert log.stamps is not None
    np.testing.assert_array_equal(log.stamps, NANOSECONDS // size * size)
    np.testing.assert_allclose(log.time, np.arange(40) * 0.01, atol=1e-15)


def test_seconds_with_a_fraction(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> None:
    """A float of 1.8e9 s tells 0.24 µs."""
    log = read(frame, NANOSECONDS / 1e9, rig, tmp_path / "log.csv")
    assert log.stamps is not None
    assert np.abs(log.stamps - NANOSECONDS).max() < 500
    np.testing.assert_allclose(log.time, np.arange(40) * 0.01, atol=1e-6)


ZONE = timezone(timedelta(hours=2))
DATES = [
    datetime(2026, 11, 20, 23, 2, 47, tzinfo=ZONE) + timedelta(milliseconds=10 * k)
    for k in range(40)
]
TEXTS = {
    "UTC": [f"2026-11-20T21:02:47.{10 * k:03d}Z" for k in range(40)],
    "no zone": [f"2026-11-20 21:02:47.{10 * k:03d}" for k in range(40)],
    "another zone, whole seconds without a fraction": [date.isoformat() for date in DATES],
    "a decimal comma": [f"2026-11-20T21:02:47,{10 * k:03d}" for k in range(40)],
    "slashes": [f"2026/11/20 21:02:47.{10 * k:03d}" for k in range(40)],
    "nanoseconds without marks": [f"20261120T210247.{10_000_000 * k:09d}Z" for k in range(40)],
    "nanoseconds": [f"2026-11-20T21:02:47.{10_000_000 * k:09d}Z" for k in range(40)],
}


@pytest.mark.parametrize("kind", TEXTS)
def test_iso_text(frame: pl.DataFrame, rig: Rig, tmp_path: Path, kind: str) -> None:
    log = read(frame, TEXTS[kind], rig, tmp_path / "log.csv")
    assert log.stamps is not None
    np.testing.assert_array_equal(
        log.stamps, 1_795_208_567_000_000_000 + 10_000_000 * np.arange(40)
    )


def test_what_is_below_a_microsecond_counts(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> None:
    for form in (
        "2026-11-20T21:02:47.{:09d}Z",
        "20261120T210247.{:09d}",
        "2026-11-20 23:02:47,{:09d}+02:00",
    ):
        log = read(
            frame,
            [form.format(123_456_789 + 10_000_001 * k) for k in range(40)],
            rig,
            tmp_path / "log.csv",
        )
        assert log.stamps is not None
        np.testing.assert_array_equal(
            log.stamps, 1_795_208_567_123_456_789 + 10_000_001 * np.arange(40)
        )


def test_datetimes_of_frames(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> None:
    """polars, Parquet and pandas, in a column or as the index, with a zone or without."""
    dated = frame.with_columns(t=pl.Series(NANOSECONDS).cast(pl.Datetime("ns")))
    dated.write_parquet(tmp_path / "log.parquet")
    pandas_frame = frame.to_pandas()
    pandas_frame["t"] = pandas.to_datetime(NANOSECONDS)
    zoned = pandas_frame.assign(
        t=pandas_frame["t"].dt.tz_localize("UTC").dt.tz_convert("Europe/Berlin")
    )
    for log in (
        dated,
        tmp_path / "log.parquet",
        pandas_frame,
        zoned,
        zoned.set_index("t"),
        pandas_frame.set_index("t"),
    ):
        stamps = read_log(log, rig).stamps
        assert stamps is not None
        np.testing.assert_array_equal(stamps, NANOSECONDS)


def test_what_counts_from_a_start_of_its_own_has_no_dates(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    log = read(frame, 5.0 + np.arange(40) * 0.01, rig, tmp_path / "log.csv")
    assert log.stamps is None
    assert log.time[0] == 5.0
    assert "stamp" not in estimate(log, rig, compiled=False).columns()


def test_results_have_them(frame: pl.DataFrame, rig: Rig, tmp_path: Path) -> None:
    """By `stamp` results join with other topics; parts of a log keep theirs."""
    log = read(frame, NANOSECONDS, rig, tmp_path / "log.csv")
    result = estimate(log, rig, compiled=False)
    made = result.columns()
    assert list(made)[:2] == ["t [s]", "stamp [ns]"]
    assert made["stamp [ns]"].dtype == np.int64
    np.testing.assert_array_equal(made["stamp [ns]"], NANOSECONDS)
    part = log.select(slice(3, 9)).stamps
    assert part is not None
    np.testing.assert_array_equal(part, NANOSECONDS[3:9])


def test_a_truth_that_is_dated_too_is_laid_over_the_log(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    angle = np.arange(60) * 0.01
    begun = NANOSECONDS[0] - 100_000_000  # a tenth of a second earlier
    pl.DataFrame({"t": begun + 10_000_000 * np.arange(60), "theta": angle}).write_csv(
        tmp_path / "truth.csv"
    )
    frame.with_columns(pl.Series("t", NANOSECONDS)).write_csv(tmp_path / "log.csv")
    log = read_log(tmp_path / "log.csv", rig, tmp_path / "truth.csv")
    np.testing.assert_allclose(log.truth["theta"], angle[10:50], atol=1e-9)


@pytest.mark.parametrize(
    ("cell", "said"),
    [
        ("2026-13-20T21:02:47", "row 6, column 't': '2026-13-20T21:02:47' is no date"),
        ("", "is no date"),
        ("now", "is no date"),
    ],
)
def test_a_date_that_is_none(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, cell: str, said: str
) -> None:
    with pytest.raises(LogError, match=said):
        read(frame, [*TEXTS["UTC"][:4], cell, *TEXTS["UTC"][5:]], rig, tmp_path / "log.csv")


@pytest.mark.parametrize("stamp", [10**19 * 5, 3e30])
def test_a_stamp_of_no_time(frame: pl.DataFrame, rig: Rig, tmp_path: Path, stamp: float) -> None:
    with pytest.raises(LogError, match="which is no time; what unit has it"):
        read(frame, [str(stamp + k) for k in range(40)], rig, tmp_path / "log.csv")


@pytest.mark.parametrize("year", ["9999", "1600", "0001"])
def test_dates_that_no_clock_has_are_refused(tmp_path: Path, rig: Rig, year: str) -> None:
    """64 bits hold nanoseconds from 1678 to 2262: what is beyond would come out as another date."""
    text = "\n".join(f"{year}-01-01T00:00:00.{k:03d},1e-3,2,1e-3,2" for k in range(20))
    path = tmp_path / "log.csv"
    path.write_text(f"t,x1,u1,x2,u2\n{text}\n")
    with pytest.raises(
        LogError, match=f"row 2, column 't': '{year}-01-01T00:00:00.000' is no date"
    ):
        read_log(path, rig)
    frame = pl.read_csv(path).with_columns(t=pl.col("t").str.to_datetime(time_unit="us"))
    with pytest.raises(LogError, match="is no date"):
        read_log(frame, rig)


@pytest.mark.parametrize("row", [0, 1, 7, 38, 39])
@pytest.mark.parametrize("begins", [0, 1_700_000_000])
@pytest.mark.parametrize("odd", [0.0, -5e9, 1e8, 1_700_000_030 + 2**64 // 10**9, 2**62, 1e300])
def test_one_wild_stamp_costs_its_row_only(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, row: int, begins: int, odd: float
) -> None:
    """Wherever it stands, in a log with dates or without."""
    stamps = [begins + 5.0 + 0.01 * k for k in range(40)]
    stamps[row] = float(odd)
    with pytest.warns(DistalWarning, match=rf"log\.csv: row {row + 2} left out"):
        log = read(frame, stamps, rig, tmp_path / "log.csv")
    others = [k for k in range(40) if k != row]
    start = 5.0 if begins == 0 else -0.01 * others[0]
    np.testing.assert_allclose(log.time, 0.01 * np.array(others) + start, atol=1e-6)
    angles = log.channels["motor_angle"]
    np.testing.assert_array_equal(angles, frame["motor_angle"].to_numpy()[others])


@pytest.mark.parametrize(
    ("begins", "odd"),
    [
        *((begins, odd) for begins in (0, 1_700_000_000) for odd in ([0.06, 0.05], [-5e9, -5e9])),
    ],
)
def test_of_two_wild_stamps_nobody_knows_what_is_right(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, begins: int, odd: list[float]
) -> None:
    stamps = [begins + 0.01 * k for k in range(40)]
    stamps[5:7] = [begins + odd[0], begins + odd[1]]
    with pytest.raises(LogError, match=r"goes back|repeats|is inf"):
        read(frame, stamps, rig, tmp_path / "log.csv")


@pytest.mark.parametrize(
    ("form", "step"),
    [
        ("03-May-2024 10:15:{:06.3f}", 0.01),
        ("Fri May 03 10:15:{:06.3f} CEST 2024", 0.01),
        ("05/03/2024 10:15:{:06.3f}", 0.01),
        ("10:15:{:06.3f}", 0.01),
        ("59:{:04.1f}", 0.1),
    ],
)
def test_times_of_day_in_other_forms(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, form: str, step: float
) -> None:
    """Whatever date stands around them; minutes, seconds and a fraction as spreadsheets show it."""
    seconds = 59.0 + step * np.arange(40) if step < 0.1 else 56.0 + step * np.arange(40)
    texts = [form.format(second % 60).replace("10:15:0", "10:16:0") for second in seconds]
    if step == 0.1:  # over the hour
        texts = [t.replace("59:", "0:") if s >= 60 else t for t, s in zip(texts, seconds)]
    log = read(frame, texts, rig, tmp_path / "log.csv")
    np.testing.assert_allclose(log.time, step * np.arange(40), atol=1e-9)


@pytest.mark.parametrize(("bits", "step", "unit"), [(32, 10_000, "us"), (16, 10, "ms")])
def test_a_counter_begins_anew(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, bits: int, step: int, unit: str
) -> None:
    stamps = (2**bits - 15 * step + step * np.arange(40)) % 2**bits
    log = read(frame, stamps, rig, tmp_path / "log.csv", unit)
    np.testing.assert_allclose(np.diff(log.time), 0.01)


def test_a_count_beyond_16_bits_is_no_counter_of_them(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path
) -> None:
    """The clock was set back by 2¹⁶ ms after it had counted beyond; what follows is another run."""
    stamps = 65_530 + 10 * np.arange(40)
    stamps[30:] -= 2**16
    with pytest.warns(DistalWarning, match="did the clock begin anew"):
        read(frame, stamps, rig, tmp_path / "log.csv", "ms")


@pytest.mark.parametrize(("factor", "unit"), [(1e3, "ms"), (1e6, "us"), (1 / 86400, "day")])
def test_a_unit_of_time_that_is_another_is_proposed(
    frame: pl.DataFrame, rig: Rig, tmp_path: Path, factor: float, unit: str
) -> None:
    stamps = 0.01 * factor * np.arange(40)
    with pytest.raises(LogError, match=f'log.time.unit="{unit}"'):
        read(frame, stamps, rig, tmp_path / "log.csv")
    log = read(frame, stamps, rig, tmp_path / "log.csv", unit)
    np.testing.assert_allclose(log.time, 0.01 * np.arange(40), atol=1e-9)
