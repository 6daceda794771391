"""Datasets of robot learning: LeRobot versions 2 and 3, HDF5; read, estimated, written beside, and
refused in a line.
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from distal import estimate, read_log
from distal.errors import DistalWarning, LogError
from distal.logs import Log, episodes_of
from distal.logs.formats.hdf5 import _is_column
from distal.rig import Rig
from distal.rig.hand_tables import Row, hand_of
from tests.cli.test_cli import run  # noqa: F401
from tests.logs.datasets import COLUMNS, NAMES, capstan_rig, dataset, drawn_run, table


@pytest.fixture(scope="module")
def rig() -> Rig:
    return capstan_rig()


@pytest.fixture(scope="module")
def runs() -> list[np.ndarray]:
    return [drawn_run(seed, 300 + 10 * seed) for seed in range(4)]


def plain(run: np.ndarray, rig: Rig) -> Log:
    """Return the log of the same values, as they are in float32, as a table."""
    names = (rig.log.time.column, *(sensor.log_column for sensor in rig.sensors[:2]))
    return read_log(pl.DataFrame(dict(zip(names, run.astype(np.float64).T))), rig)


def check(log: Log, run: np.ndarray, rig: Rig) -> None:
    expected = plain(run, rig)
    np.testing.assert_array_equal(log.time, expected.time)
    for name in log.channels:
        np.testing.assert_array_equal(log.channels[name], expected.channels[name])


@pytest.mark.parametrize("version", [2, 3])
def test_episodes_are_the_logs_that_a_table_of_the_same_values_is(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray], version: int
) -> None:
    episodes = episodes_of(dataset(tmp_path / "data set", runs, version))
    assert [episode.number for episode in episodes] == [0, 1, 2, 3]
    for episode, values in zip(episodes, runs):
        check(read_log(episode, rig), values, rig)


@pytest.mark.parametrize(
    "names", [{"motors": NAMES}, [NAMES], {name: k for k, name in enumerate(NAMES)}]
)
def test_names_of_motors_come_in_groups_nested_or_with_their_positions(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray], names: object
) -> None:
    (episode,) = episodes_of(dataset(tmp_path / "set", runs[:1], 2, names))
    check(read_log(episode, rig), runs[0], rig)


def with_columns(rig: Rig, angle: str, torque: str) -> Rig:
    return rig.with_values(
        {"sensors.motor_angle.column": angle, "sensors.motor_torque.column": torque}
    )


def test_a_vector_without_names_has_numbers(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray]
) -> None:
    pq.write_table(table(0, runs[0]), tmp_path / "alone.parquet")
    numbered = with_columns(rig, "observation.state.0", "action.1")
    check(read_log(tmp_path / "alone.parquet", numbered), runs[0], rig)


def test_hdf5_is_read_like_a_table(tmp_path: Path, rig: Rig, runs: list[np.ndarray]) -> None:
    path, run = tmp_path / "run.hdf5", runs[1]
    with h5py.File(path, "w") as file:
        file["timestamp"] = run[:, 0]
        file["observations/state"] = run[:, 1:]
        file["images"] = np.zeros((len(run), 4, 4, 3), dtype=np.uint8)
        file["task"] = [b"grasp"] * len(run)
    named = with_columns(rig, "observations/state.0", "observations/state.1")
    check(read_log(path, named), run, rig)
    with h5py.File(path) as file:
        assert [name for name, part in file.items() if _is_column(part)] == ["timestamp"]


def test_hdf5_of_other_lengths_or_none_is_one_line(tmp_path: Path, rig: Rig) -> None:
    path, named = tmp_path / "run.h5", with_columns(rig, "a", "b")
    with h5py.File(path, "w") as file:
        file["timestamp"], file["a"], file["b"] = np.arange(4.0), np.arange(4.0), np.arange(3.0)
    with pytest.raises(LogError, match="different lengths: 3, 4 rows"):
        read_log(path, named)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(LogError, match=r"run.h5: cannot be read .*truncated"):
        read_log(path, named)


def test_half_written_datasets_are_one_line(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray]
) -> None:
    folder = dataset(tmp_path / "set", runs, 3)
    data, info = folder / "data" / "chunk-000", folder / "meta" / "info.json"
    pq.write_table(table(3, runs[3]), data / "file-002.parquet")
    with pytest.raises(LogError, match="episode 3: is in two files"):
        episodes_of(folder)
    cut = data / "file-002.parquet"
    cut.write_bytes(cut.read_bytes()[:500])
    with pytest.warns(DistalWarning, match=r"left out: .*file-002.parquet: cannot be read as P"):
        found = episodes_of(folder)
    assert {episode.path.name for episode in found} == {"file-000.parquet", "file-001.parquet"}
    info.write_text('{"fps": ')
    with pytest.raises(LogError, match=r"info.json: cannot be read .*half written"):
        episodes_of(folder)
    info.write_text("{}")
    (folder / "data").rename(folder / "no data")
    with pytest.raises(LogError, match="without files in 'data'"):
        episodes_of(folder)
    ragged = pa.table({"v": [[1.0, 2.0], [3.0]], "timestamp": [0.0, 0.1]})
    pq.write_table(ragged, tmp_path / "ragged.parquet")
    with pytest.raises(LogError, match="vectors of different lengths"):
        read_log(tmp_path / "ragged.parquet", with_columns(rig, "v.0", "v.1"))


@pytest.mark.slow
def test_the_command_estimates_all_episodes_into_files_beside(
    run, tmp_path: Path, rig: Rig, runs: list[np.ndarray]
) -> None:
    folder, out = dataset(tmp_path / "set", runs, 3), tmp_path / "estimates"
    columns = [f"--set={path}={json.dumps(column)}" for path, column in COLUMNS.items()]
    done = run(f"estimate {folder} --rig capstan-joint --out {out}", *columns)
    assert done.code == 0, done.err
    assert sorted(path.name for path in out.iterdir()) == [f"episode_{k:06d}.csv" for k in range(4)]
    written = pl.read_csv(out / "episode_000002.csv")["theta [deg]"]
    alone = estimate(plain(runs[2], rig), rig)
    np.testing.assert_allclose(np.deg2rad(written), alone.angles[:, 0], rtol=0, atol=1e-9)


def test_a_rig_of_motors_finds_them_in_the_state_of_a_dataset(tmp_path: Path) -> None:
    """Its columns, ``motor_1_position`` and ``time``, are ``observation.state.…`` and ``timestamp``
    there.
    """
    run = drawn_run(0, 50)
    motor = Row(joint="mcp", motor="motor_1", low=0.0, high=1.5, spool_radius=7e-3)
    rig = hand_of([motor], "hand", "table").rig
    names = ["motor_1_position", "motor_1_current"]
    (episode,) = episodes_of(dataset(tmp_path / "set", [run], 3, names))
    log = read_log(episode, rig)
    np.testing.assert_allclose(log.time, run[:, 0], atol=1e-12)
    np.testing.assert_allclose(log.channels["motor_1_position"], run[:, 1], atol=1e-9)
