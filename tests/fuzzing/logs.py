"""Hostile logs: CSV, Parquet, MCAP and bags with bytes, cells and blocks changed; no row is lost,
no file changed.
"""

from __future__ import annotations

import random
import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from distal.errors import DistalError
from distal.logs import Log, read_log, write_log
from distal.rig import Rig, log_factor
from tests.fuzzing.outcome import JSON, ODD_CELLS, TAKEN, Outcome, broken, damaged, refusal
from tests.logs.recordings import Recorder, write_bag

CELLS = (
    *ODD_CELLS,
    *(
        "NaN",
        "null",
        "-",
        "1e-400",
        '""',
        '"1',
        "1'",
        "'1'",
        "1;5",
        " 1 ",
        "\t",
        "inf",
        "true",
        "#",
    ),
    "a" * 3000,
    "2026-11-20T21:02:47Z",
    "1700000000000000000",
    "9" * 30,
    "\ufeff1",
)


class Logs:
    """A good log in every format, of which damaged ones are made.

    Args:
        log: the good one.
        rig: that it was read by.
        folder: to write to.
    """

    def __init__(self, log: Log, rig: Rig, folder: Path) -> None:
        self._rig, self._folder = rig, folder
        self._names = [sensor.log_column for sensor in rig.sensors if sensor.name in log.channels]
        write_log(log, rig, folder / "good.csv")
        write_log(log, rig, folder / "good.parquet")
        self._csv = (folder / "good.csv").read_text()
        self._columns = pl.read_csv(self._csv.encode())
        rows = self._columns.iter_rows(named=True)
        names, times = self._names, [round(1e9 * t) for t in self._columns["t"]]
        values = [[row[name] for name in names] for row in rows]
        states = [("/all", t, t, names, row, row) for t, row in zip(times, values)]
        (self._bag,) = write_bag(folder / "bag", states).glob("*.db3")
        columns = {
            f"sensors.{sensor.name}.column": f"/all.position[{names.index(sensor.log_column)}]"
            for sensor in rig.sensors
            if sensor.log_column in names
        }
        self._good = {
            "parquet": (folder / "good.parquet").read_bytes(),
            "mcap": self._mcap(random.Random(0), 0.0),
            "db3": self._bag.read_bytes(),
        }
        self._bag_rig = rig.with_values(columns)

    def attempt(self, seed: int) -> Outcome:
        """Read a damaged log, and return what came of it.

        Args:
            seed: of the damage.
        """
        rng = random.Random(seed)
        kind = rng.choice(["csv", "csv", "csv", "parquet", "parquet", "mcap", "db3"])
        path, odd = self._folder / f"damaged.{kind}", rng.random()
        if kind == "csv":
            data = self._damaged_csv(rng)
        elif kind == "parquet" and odd < 0.3:
            data = self._odd_parquet(rng)
        elif kind == "mcap" and odd < 0.6:
            data = self._mcap(rng, 0.1)
        else:
            data = damaged(rng, self._good[kind])
        if kind == "db3":
            path = self._bag
        path.write_bytes(data)
        try:
            with warnings.catch_warnings(record=True) as said:
                warnings.simplefilter("always")
                read = read_log(path, self._bag_rig if kind == "db3" else self._rig)
        except DistalError as problem:
            outcome = refusal(problem)
        except Exception as problem:
            outcome = broken((seed, kind), problem)
        else:
            outcome = self._rows(seed, data, read, bool(said)) if kind == "csv" else TAKEN
        return outcome if path.read_bytes() == data else broken((seed, kind), "the log was changed")

    def _rows(self, seed: int, data: bytes, read: Log, is_said: bool) -> Outcome:
        """Return whether every line of a CSV file that was taken is a row with the line's values,
        but for those of which a warning says that they are left out.
        """
        text = data.decode().removeprefix("\ufeff").replace("\r\n", "\n").strip("\r\n")
        text = text if "\n" in text else text.replace("\r", "\n")
        lines = [line for line in text.split("\n") if line.strip(" \t\r") and line[0] != "#"]
        separator = max((",", ";", "\t"), key=lines[0].count)
        if len(read) != len(lines) - 1:
            left_out = is_said and len(read) < len(lines) - 1
            return TAKEN if left_out else broken(seed, f"{len(lines) - 1} lines, {len(read)} rows")
        if separator in CELLS or any(mark in text for mark in ('"', "'")):
            return TAKEN
        header = [name.strip() for name in lines[0].split(separator)]
        for sensor in self._rig.sensors:
            if sensor.name not in read.channels:
                continue
            at = header.index(sensor.log_column)
            for line, value in zip(lines[1:], read.channels[sensor.name]):
                cell = line.split(separator)[at].strip()
                given = value / (sensor.sign * log_factor(sensor))
                if np.isfinite(value) and not np.isclose(float(cell), given, rtol=1e-12, atol=0):
                    return broken(seed, f"'{cell}' was read as {value}")
                if np.isnan(value) and _is_number(cell):
                    return broken(seed, f"'{cell}' was lost")
        return TAKEN

    def _damaged_csv(self, rng: random.Random) -> bytes:
        if rng.random() < 0.4:
            return damaged(rng, self._csv.encode())
        lines = [line.split(",") for line in self._csv.splitlines()]
        for _ in range(rng.choice([1, 1, 2, 5])):
            row = rng.randrange(len(lines))
            what = rng.randrange(7)
            if what == 0:
                lines[row].append(rng.choice(CELLS))
            elif what == 1:
                lines[row] = lines[row][: rng.randrange(len(lines[row]) + 1)]
            elif what == 2:
                lines.insert(row, rng.choice([[""], ["# comment"], lines[row], [" "]]))
            elif what == 3:
                lines[row], lines[0] = lines[0], lines[row]
            elif lines[row]:
                lines[row][rng.randrange(len(lines[row]))] = rng.choice(CELLS)
        separator, end = (
            rng.choice([",", ",", ",", ";", "\t"]),
            rng.choice(["\n", "\n", "\r\n", "\r"]),
        )
        text = end.join(separator.join(line) for line in lines)
        return (
            rng.choice(["", "", "\ufeff", "\n", "\n\n"]) + text + rng.choice(["", end, end * 3])
        ).encode("utf-8", "replace")

    def _odd_parquet(self, rng: random.Random) -> bytes:
        name = rng.choice(self._columns.columns)
        column, rows = self._columns[name], self._columns.height
        odd: Any = rng.choice(
            [
                lambda: column.cast(pl.String),
                lambda: column.cast(pl.Float32),
                lambda: column.cast(pl.Int8, strict=False),
                lambda: column.is_null(),
                lambda: pl.Series(name, [None] * rows),
                lambda: pl.Series(name, [[1.0]] * rows),
                lambda: pl.Series(name, [{"a": 1}] * rows),
                lambda: pl.Series(name, [2**63] * rows, dtype=pl.UInt64),
                lambda: (column * 1e18).cast(pl.Int64, strict=False),
                lambda: pl.Series(name, [b"x"] * rows),
                lambda: column.cast(pl.Int64, strict=False).cast(pl.Datetime("ns")),
                lambda: pl.Series(name, ["a"] * rows, dtype=pl.Categorical),
                lambda: column * float("inf"),
                lambda: column.reverse(),
                lambda: column * 1e300,
            ]
        )
        frame = self._columns.with_columns(odd().alias(name))
        frame = rng.choice(
            [
                frame,
                frame.head(rng.randrange(3)),
                frame.drop(name),
                frame.rename({name: rng.choice(["²", "", "t "])}),
            ]
        )
        path = self._folder / "odd.parquet"
        frame.write_parquet(
            path, compression=rng.choice(["zstd", "snappy", "lz4", "gzip", "uncompressed"])
        )
        return path.read_bytes()

    def _mcap(self, rng: random.Random, share: float) -> bytes:
        """Return messages of which a share has something odd."""
        path = self._folder / "odd.mcap"
        recorder = Recorder(path)
        for values in self._columns.iter_rows(named=True):
            message: dict[str, Any] = {name: values[name] for name in ("t", *self._names)}
            if rng.random() < share:
                message[rng.choice(list(message))] = rng.choice(JSON)
                message = rng.choice([message, message, {"a": message}, {}])
            recorder.add("/sample", values["t"], message)
        recorder.close()
        return path.read_bytes()


def good_log(rig: Rig, scenario: Any, samples: int = 60) -> Log:
    """Return a short simulated log.

    Args:
        rig: the description.
        scenario: what is done.
        samples: how many.
    """
    from distal.simulation import simulate_plant as simulate

    return replace(simulate(rig, scenario, 3).select(slice(0, samples)), truth={})


def _is_number(cell: str) -> bool:
    """Return whether a cell is more than a word, which is a missing value with a warning."""
    return re.search(r"[^\W\d_]{2}|#", cell) is None and any(map(str.isnumeric, cell))
