"""Hostile logs: CSV, Parquet, MCAP and bags with bytes, cells and blocks changed; no row is lost,
no file changed.
"""

from __future__ import annotations

import json
import random
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import polars as pl

from distal.errors import DistalError
from distal.logs import Log, read_log, write_log
from distal.rig import Rig, log_factor
from tests.fuzzing.outcome import TAKEN, Outcome, broken, refusal

CELLS = (
    "",
    "nan",
    "NaN",
    "null",
    "-",
    "1e400",
    "-1e308",
    "1e-400",
    '"',
    '"1"',
    '""',
    '"1',
    '1"',
    "'1'",
    "1,5",
    "1;5",
    "0x10",
    "1_000",
    "١٢",
    "²",
    " 1 ",
    "\t",
    "\x00",
    "\x1b[2J",
    "inf",
    "true",
    "a" * 3000,
    "2026-11-20T21:02:47Z",
    "1700000000000000000",
    "9" * 30,
    "\ufeff1",
    "#",
)
BYTES = (
    b"\x00",
    b"\xff",
    b"\n",
    b"\r",
    b'"',
    b",",
    b"\n\n",
    b"\x80" * 8,
    b"\x00" * 64,
    b"\xef\xbb\xbf",
)
STAMPS = (0, 1, -1, 2**31, 2**63 - 1, 2**63, 2**64 - 1, 10**18)
JSON = (
    None,
    True,
    "",
    "x",
    "1",
    [],
    [1],
    [[1], [1, 2]],
    {},
    {"a": 1},
    1e308,
    -1e308,
    2**63,
    10**30,
    "²",
)


class Logs:
    """A good log in every format, of which damaged ones are made.

    Args:
        log: the good one.
        rig: that it was read by.
        folder: to write to.
    """

    def __init__(self, log: Log, rig: Rig, folder: Path) -> None:
        self._rig, self._folder, self._log = rig, folder, log
        self._names = [sensor.log_column for sensor in rig.sensors if sensor.name in log.channels]
        write_log(log, rig, folder / "good.csv")
        write_log(log, rig, folder / "good.parquet")
        self._csv, self._parquet = (
            (folder / "good.csv").read_text(),
            (folder / "good.parquet").read_bytes(),
        )
        self._columns = pl.read_csv(self._csv.encode())
        (folder / "good.mcap").write_bytes(self._mcap(random.Random(0), False))
        self._bags = {
            ".db3": self._bag(2, folder / "two"),
            ".bag": self._bag(1, folder / "one.bag"),
        }
        self._bag_rig = replace_columns(rig, {name: f"/{name}.data" for name in self._names})

    def attempt(self, seed: int) -> Outcome:
        """Read a damaged log, and return what came of it.

        Args:
            seed: of the damage.
        """
        rng = random.Random(seed)
        kind = rng.choice(["csv", "csv", "csv", "parquet", "parquet", "mcap", "db3", "bag"])
        path, rig = self._folder / f"damaged.{kind}", self._rig
        if kind == "csv":
            data = self._damaged_csv(rng)
        elif kind == "parquet":
            data = self._odd_parquet(rng) if rng.random() < 0.3 else _damaged(rng, self._parquet)
        elif kind == "mcap":
            odd = rng.random() < 0.6
            data = (
                self._mcap(rng, True)
                if odd
                else _damaged(rng, (self._folder / "good.mcap").read_bytes())
            )
        else:
            data, rig = _damaged(rng, self._bags[f".{kind}"].read_bytes()), self._bag_rig
        if kind == "db3":
            path = self._folder / "damaged_bag" / "two.db3"
            shutil.rmtree(path.parent, ignore_errors=True)
            shutil.copytree(self._folder / "two", path.parent)
        path.write_bytes(data)
        try:
            read = read_log(path, rig)
        except DistalError as problem:
            outcome = refusal(problem)
        except Exception as problem:
            outcome = broken((seed, kind), problem)
        else:
            outcome = self._rows(seed, data, read) if kind == "csv" else TAKEN
        return outcome if path.read_bytes() == data else broken((seed, kind), "the log was changed")

    def _rows(self, seed: int, data: bytes, read: Log) -> Outcome:
        """Return whether every line of a CSV file that was taken is a row with the line's
        values.
        """
        text = data.decode().removeprefix("\ufeff").replace("\r\n", "\n").strip("\r\n")
        text = text if "\n" in text else text.replace("\r", "\n")
        lines = [line for line in text.split("\n") if line.strip(" \t\r")]
        separator = max((",", ";", "\t"), key=lines[0].count)
        width = lines[0].count(separator)
        whole = [line for line in lines[1:] if line.count(separator) == width]
        names = [name.strip() for name in lines[0].split(separator)]
        if self._rig.log.time.column in names:
            at = names.index(self._rig.log.time.column)
            whole = [line for line in whole if _is_number(line.split(separator)[at])]
        if not len(whole) <= len(read) <= len(lines) - 1:
            return broken(seed, f"{len(lines) - 1} lines, {len(read)} rows")
        if len(read) < len(lines) - 1:
            return TAKEN  # what is cut at the end is left out, with a warning
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
            return _damaged(rng, self._csv.encode())
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

    def _mcap(self, rng: random.Random, odd: bool) -> bytes:
        import io

        from mcap.writer import CompressionType, Writer

        buffer = io.BytesIO()
        writer = Writer(buffer, compression=rng.choice(list(CompressionType)))
        writer.start()
        schema = writer.register_schema("sample", "jsonschema", b"{}")
        channel = writer.register_channel("/sample", "json", schema)
        for row, values in enumerate(self._columns.iter_rows(named=True)):
            stamp, message = (
                round(values["t"] * 1e9),
                json.dumps({name: values[name] for name in ("t", *self._names)}).encode(),
            )
            if odd and rng.random() < 0.1:
                changed: Any = {**values, rng.choice(["t", *self._names]): rng.choice(JSON)}
                message = rng.choice(
                    [
                        json.dumps(changed),
                        json.dumps([changed]),
                        json.dumps({"a": changed}),
                        "[" * 900,
                        "",
                        "{",
                        "NaN",
                    ]
                ).encode()
            if odd and rng.random() < 0.05:
                stamp = rng.choice([s for s in STAMPS if s >= 0])
            writer.add_message(channel, stamp, message, stamp, row)
        writer.finish()
        return buffer.getvalue()

    def _bag(self, version: int, path: Path) -> Path:
        from rosbags.rosbag1 import Writer as Writer1
        from rosbags.rosbag2 import StoragePlugin
        from rosbags.rosbag2 import Writer as Writer2
        from rosbags.typesys import Stores, get_typestore

        store = get_typestore(Stores.ROS2_HUMBLE if version == 2 else Stores.ROS1_NOETIC)
        number = store.types["std_msgs/msg/Float64"]
        with (
            Writer2(path, version=9, storage_plugin=StoragePlugin.SQLITE3)
            if version == 2
            else Writer1(path) as writer
        ):
            for name in self._names:
                connection = writer.add_connection(f"/{name}", number.__msgtype__, typestore=store)
                for stamp, value in zip(self._columns["t"], self._columns[name]):
                    data = (store.serialize_cdr if version == 2 else store.serialize_ros1)(
                        number(float(value)), number.__msgtype__
                    )
                    writer.write(connection, round(stamp * 1e9) + 1_000_000_000, data)
        return next(path.glob("*.db3")) if version == 2 else path


def _damaged(rng: random.Random, data: bytes) -> bytes:
    """Return bytes of which some are changed, lost, doubled or moved."""
    for _ in range(rng.choice([1, 1, 1, 2, 5])):
        at = rng.randrange(len(data) + 1)
        if rng.random() < 0.4:
            at = max(
                len(data) - rng.randrange(min(len(data), 400) + 1), 0
            )  # footers are where it hurts
        size = rng.choice([0, 1, 1, 1, 4, 60])
        what = rng.randrange(6)
        if what <= 2 and at < len(data):
            data = data[:at] + bytes([data[at] ^ (1 << rng.randrange(8))]) + data[at + 1 :]
        elif what == 3:
            data = data[:at] + rng.choice(BYTES) + data[at + size :]
        elif what == 4:
            data = data[:at] if rng.random() < 0.3 else data[:at] + data[at + size :]
        else:
            data = data[:at] + data[at : at + size] * 2 + data[at + size :]
    return data


def replace_columns(rig: Rig, names: dict[str, str]) -> Rig:
    """Return a rig whose sensors have other columns.

    Args:
        rig: the description.
        names: of columns → new names.
    """
    return rig.with_values(
        {
            f"sensors.{s.name}.column": names[s.log_column]
            for s in rig.sensors
            if s.log_column in names
        }
    )


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
