"""A format of logs is one file; what its package lacks is said before the work begins; frames of
any library are read.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest

from distal import Log, Rig, read_log, write_log
from distal.errors import LogError, OutputError
from distal.logs.formats.registry import format_of
from tests.cli.test_cli import refused, run  # noqa: F401


@pytest.mark.parametrize(
    ("name", "module"),
    [
        ("a.CSV", "csv"),
        ("a", "csv"),
        ("a.pq", "parquet"),
        ("a.mcap", "mcap"),
        ("a.db3", "rosbag"),
        ("bag", "rosbag"),
    ],
)
def test_the_name_tells_the_format(tmp_path: Path, name: str, module: str) -> None:
    (tmp_path / "bag").mkdir()
    (tmp_path / "bag" / "metadata.yaml").touch()
    found = format_of(tmp_path / name)
    assert (found.read or found.messages).__module__.endswith(f".{module}")  # type: ignore[union-attr]


@pytest.fixture
def log() -> Log:
    time = 0.01 * np.arange(5)
    return Log(time, dict.fromkeys(("x1", "x2", "u1", "u2"), 0.001 * time))


@pytest.fixture
def no_frames(monkeypatch: pytest.MonkeyPatch) -> None:
    for library in ("pyarrow", "polars", "pandas"):
        monkeypatch.setitem(sys.modules, library, None)


def test_csv_needs_no_library_of_frames(
    tmp_path: Path, pulley_rig: Rig, log: Log, no_frames: None
) -> None:
    path = tmp_path / "log.csv"
    write_log(log, pulley_rig, path)
    np.testing.assert_array_equal(read_log(path, pulley_rig).channels["x1"], log.channels["x1"])


def test_parquet_without_pyarrow(
    tmp_path: Path, pulley_rig: Rig, log: Log, no_frames: None
) -> None:
    path = tmp_path / "log.parquet"
    said = r"log\.parquet: needs .* \(pip install '\.\[parquet\]'\); or write CSV"
    with pytest.raises(OutputError, match=said):
        write_log(log, pulley_rig, path)
    assert not path.exists()
    path.write_bytes(b"PAR1")
    said = r"log\.parquet: Parquet needs .* \(pip install '\.\[parquet\]'\)"
    with pytest.raises(LogError, match=said):
        read_log(path, pulley_rig)


def test_it_is_said_before_the_work(
    run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, no_frames: None
) -> None:
    monkeypatch.setattr("distal.simulation.simulate", None)
    said = run(f"simulate template --out {tmp_path / 'log.parquet'}")
    refused(said, "needs the package pyarrow")


class Series:
    """A column of a library that distal does not know."""

    def __init__(self, values: object) -> None:
        self._values = values

    def to_numpy(self) -> object:
        return self._values


class Frame(dict):  # type: ignore[type-arg]
    columns = property(dict.keys)


def test_frames_of_any_library(pulley_rig: Rig, log: Log) -> None:
    columns = {name: Series(values) for name, values in {"t": log.time, **log.channels}.items()}
    columns["u1"] = Series(np.array(["1.5", None, "2", "na", 3], dtype=object))
    read = read_log(Frame(columns), pulley_rig)
    np.testing.assert_array_equal(read.channels["x1"], log.channels["x1"])
    np.testing.assert_array_equal(read.channels["u1"], [1.5, np.nan, 2.0, np.nan, 3.0])
    columns["u1"] = Series(np.array([True] * 5))
    with pytest.raises(LogError, match="column 'u1' holds bool; numbers are expected"):
        read_log(Frame(columns), pulley_rig)
