"""Datasets of robot learning: LeRobot versions 2 and 3, HDF5; read, estimated, written beside, and
refused in a line.
"""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from distal import estimate, load_rig, read_log, write_log
from distal.cli.app import app
from distal.errors import DistalWarning, LogError
from distal.logs import Episode, Log, episodes_of
from distal.logs.formats.hdf5 import _is_column
from distal.rig import Rig
from distal.rig.hand_tables import Row, hand_of
from distal.run import estimate_batch
from tests.logs.datasets import COLUMNS, NAMES, capstan_rig, dataset, drawn_run, table


@pytest.fixture(scope="module")
def rig() -> Rig:
    return capstan_rig()


@pytest.fixture(scope="module")
def runs() -> list[np.ndarray]:
    return [drawn_run(seed, 300 + 10 * seed) for seed in range(4)]


def csv_of(path: Path, rig: Rig, run: np.ndarray) -> Path:
    """Write the same values, as they are in float32, as CSV."""
    values = run.astype(np.float64)
    write_log(
        Log(values[:, 0], {"motor_angle": values[:, 1], "motor_torque": values[:, 2]}), rig, path
    )
    return path


@pytest.mark.parametrize("version", [2, 3])
def test_episodes_are_the_logs_that_a_csv_of_the_same_values_is(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray], version: int
) -> None:
    episodes = episodes_of(dataset(tmp_path / "data set", runs, version))
    assert [episode.number for episode in episodes] == [0, 1, 2, 3]
    found = list(estimate_batch(episodes, rig, compiled=False))
    for episode, run, result in zip(episodes, runs, found):
        plain = estimate(
            read_log(csv_of(tmp_path / f"{episode.stem}.csv", rig, run), rig), rig, compiled=False
        )
        np.testing.assert_allclose(result.angles, plain.angles, rtol=0, atol=1e-12)
        np.testing.assert_allclose(result.angle_stds, plain.angle_stds, rtol=0, atol=1e-12)


@pytest.mark.parametrize(
    "names", [{"motors": NAMES}, [NAMES], {name: k for k, name in enumerate(NAMES)}]
)
def test_names_of_motors_come_in_groups_nested_or_with_their_positions(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray], names: object
) -> None:
    (episode,) = episodes_of(dataset(tmp_path / "set", runs[:1], 2, names))
    log = read_log(episode, rig)
    np.testing.assert_array_equal(log.channels["motor_angle"], runs[0][:, 1].astype(np.float64))


def test_a_vector_without_names_has_numbers(tmp_path: Path, runs: list[np.ndarray]) -> None:
    path = tmp_path / "alone.parquet"
    pq.write_table(table(0, runs[0]), path)
    numbered = load_rig("capstan-joint").with_values(
        {
            "log.time.column": "timestamp",
            "sensors.motor_angle.column": "observation.state.0",
            "sensors.motor_torque.column": "action.1",
        }
    )
    log = read_log(path, numbered)
    np.testing.assert_array_equal(log.channels["motor_angle"], runs[0][:, 1].astype(np.float64))
    np.testing.assert_array_equal(log.channels["motor_torque"], runs[0][:, 2].astype(np.float64))
    wrong = numbered.with_values({"sensors.motor_angle.column": "observation.state.2"})
    with pytest.raises(
        LogError, match=r"column 'observation.state.2' is missing; did you mean 'observation.state"
    ):
        read_log(path, wrong)


def test_hdf5_is_read_like_a_csv(tmp_path: Path, rig: Rig, runs: list[np.ndarray]) -> None:
    path, run = tmp_path / "run.hdf5", runs[1]
    with h5py.File(path, "w") as file:
        file["timestamp"] = run[:, 0]
        file["observations/state"] = run[:, 1:]
        file["images"] = np.zeros((len(run), 4, 4, 3), dtype=np.uint8)
        file["task"] = [b"grasp"] * len(run)
    named = rig.with_values(
        {
            "sensors.motor_angle.column": "observations/state.0",
            "sensors.motor_torque.column": "observations/state.1",
        }
    )
    plain = read_log(csv_of(tmp_path / "run.csv", rig, run), rig)
    log = read_log(path, named)
    with h5py.File(path) as file:
        assert [name for name, part in file.items() if _is_column(part)] == ["timestamp"]
    for name in plain.channels:
        np.testing.assert_array_equal(log.channels[name], plain.channels[name])


def test_hdf5_of_other_lengths_or_none_is_one_line(tmp_path: Path, rig: Rig) -> None:
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        file["timestamp"], file["a"], file["b"] = np.arange(4.0), np.arange(4.0), np.arange(3.0)
    named = rig.with_values({"sensors.motor_angle.column": "a", "sensors.motor_torque.column": "b"})
    with pytest.raises(LogError, match="different lengths: 3, 4 rows"):
        read_log(path, named)
    path.write_bytes(path.read_bytes()[:900])
    with pytest.raises(LogError, match=r"run.h5: .*damaged"):
        read_log(path, named)


def test_half_written_datasets_are_one_line_and_nothing_is_overwritten(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray]
) -> None:
    folder = dataset(tmp_path / "set", runs, 3)
    cut = folder / "data" / "chunk-000" / "file-001.parquet"
    cut.write_bytes(cut.read_bytes()[:500])
    with pytest.warns(DistalWarning, match=r"left out: .*file-001.parquet: is not a Parquet file"):
        found = episodes_of(folder)
    assert found
    assert all(episode.path != cut for episode in found)
    cut.unlink()
    (folder / "meta" / "info.json").write_text('{"fps": ')
    with pytest.raises(LogError, match=r"info.json: cannot be read .*half written"):
        episodes_of(folder)
    (tmp_path / "empty" / "meta").mkdir(parents=True)
    (tmp_path / "empty" / "meta" / "info.json").write_text("{}")
    with pytest.raises(LogError, match="without files in 'data'"):
        episodes_of(tmp_path / "empty")
    ragged = pa.table({"v": [[1.0, 2.0], [3.0]], "timestamp": [0.0, 0.1]})
    pq.write_table(ragged, tmp_path / "ragged.parquet")
    named = rig.with_values(
        {"sensors.motor_angle.column": "v.0", "sensors.motor_torque.column": "v.1"}
    )
    with pytest.raises(LogError, match="vectors of different lengths"):
        read_log(tmp_path / "ragged.parquet", named)


def test_an_episode_in_two_files_is_refused(tmp_path: Path, runs: list[np.ndarray]) -> None:
    folder = dataset(tmp_path / "set", runs, 3)
    data = folder / "data" / "chunk-000"
    pq.write_table(table(3, runs[3]), data / "file-002.parquet")
    with pytest.raises(LogError, match="episode 3: is in two files"):
        episodes_of(folder)


@pytest.mark.slow
def test_the_command_estimates_all_episodes_into_files_beside(
    tmp_path: Path, rig: Rig, runs: list[np.ndarray]
) -> None:
    folder, out = dataset(tmp_path / "set", runs, 3), tmp_path / "estimates"
    columns = [f"--set={path}={json.dumps(column)}" for path, column in COLUMNS.items()]
    done = CliRunner().invoke(
        app, ["estimate", str(folder), "--rig", "capstan-joint", *columns, "--out", str(out)]
    )
    assert done.exit_code == 0, done.output
    assert sorted(path.name for path in out.iterdir()) == [f"episode_{k:06d}.csv" for k in range(4)]
    first = np.loadtxt(out / "episode_000002.csv", delimiter=",", skiprows=1, usecols=(0, 1))
    alone = estimate(
        read_log(Episode(folder / "data" / "chunk-000" / "file-000.parquet", 2), rig), rig
    )
    np.testing.assert_allclose(np.deg2rad(first[:, 1]), alone.angles[:, 0], rtol=0, atol=1e-9)


def test_a_rig_of_motors_finds_them_in_the_state_of_a_dataset(tmp_path: Path) -> None:
    """Its columns, ``motor_1_position`` and ``time``, are ``observation.state.…`` and ``timestamp``
    there.
    """
    run = drawn_run(0, 50)
    names = ["motor_1_position", "motor_1_current"]
    rig = hand_of(
        [Row(joint="mcp", motor="motor_1", low=0.0, high=1.5, spool_radius=7e-3)], "hand", "table"
    ).rig
    (episode,) = episodes_of(dataset(tmp_path / "set", [run], 3, names))
    log = read_log(episode, rig)
    np.testing.assert_allclose(log.time, run[:, 0], atol=1e-12)
    np.testing.assert_allclose(log.channels["motor_1_position"], run[:, 1], atol=1e-9)
