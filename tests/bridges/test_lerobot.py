"""A LeRobot dataset with joint angles: what is added is what `estimate` says, all else stays."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from typer.testing import CliRunner

from distal import Rig, estimate, load_rig, read_log
from distal.bridges.lerobot import ANGLE, STD, WORD, with_angles
from distal.cli.app import app
from distal.errors import DistalWarning, EstimationError, LogError, OutputError
from distal.logs import episodes_of
from distal.rig import edited_text
from distal.run.health import HEALTH
from tests.logs import datasets
from tests.logs.datasets import COLUMNS, capstan_rig, drawn_run, table

LIKE = ("min", "max", "mean", "std", "count", "q10")
ROWS = (60, 80, 70)


@pytest.fixture(scope="module")
def rig() -> Rig:
    return capstan_rig()


def dataset(folder: Path, version: int, lengths: tuple[int, ...] = ROWS) -> Path:
    """Write a dataset of three episodes with statistics and a video."""
    datasets.dataset(folder, [drawn_run(k, rows) for k, rows in enumerate(lengths)], version)
    (folder / "videos").mkdir()
    (folder / "videos" / "a.mp4").write_bytes(bytes(range(256)))
    meta, known = folder / "meta", {what: [0.0, 0.0] for what in LIKE}
    (meta / "stats.json").write_text(json.dumps({"observation.state": known}))
    if version == 2:
        lines = [
            {"episode_index": k, "stats": {"observation.state": known}} for k in range(len(ROWS))
        ]
        (meta / "episodes_stats.jsonl").write_text("\n".join(map(json.dumps, lines)) + "\n")
    else:
        (meta / "episodes").mkdir()
        columns = {f"stats/observation.state/{what}": [[0.0, 0.0]] * 3 for what in LIKE}
        pq.write_table(
            pa.table({"episode_index": [0, 1, 2], **columns}), meta / "episodes" / "file.parquet"
        )
    return folder


def bytes_of(folder: Path) -> dict[str, bytes]:
    """Return path → content of all files of a folder."""
    return {
        str(path.relative_to(folder)): path.read_bytes()
        for path in folder.rglob("*")
        if path.is_file()
    }


@pytest.mark.parametrize("version", [2, 3])
def test_what_is_added_is_the_estimate_and_all_else_stays(
    tmp_path: Path, rig: Rig, version: int
) -> None:
    source = dataset(tmp_path / "set", version)
    before = bytes_of(source)
    written = with_angles(source, rig, tmp_path / "new", "deg")
    assert bytes_of(source) == before
    assert (written.episodes, written.rows) == (3, sum(ROWS))
    assert sum(written.words.values()) == pytest.approx(1.0)
    new = bytes_of(written.folder)
    assert new["videos/a.mp4"] == before["videos/a.mp4"]
    episodes = episodes_of(source)
    tables = [pq.read_table(path) for path in sorted((written.folder / "data").rglob("*.parquet"))]
    whole = pa.concat_tables(tables)
    old = pa.concat_tables([table(k, drawn_run(k, rows)) for k, rows in enumerate(ROWS)])
    assert whole.select(old.column_names).equals(old)
    results = [estimate(read_log(episode, rig), rig) for episode in episodes]
    angles = np.concatenate([np.rad2deg(one.theta) for one in results])
    np.testing.assert_allclose(whole[ANGLE].to_numpy(), angles, atol=1e-5)
    stds = np.concatenate([np.rad2deg(one.angle_stds[:, 0]) for one in results])
    np.testing.assert_allclose(whole[STD].to_numpy(), stds, rtol=1e-6)
    assert set(whole[WORD].to_pylist()) == {list(HEALTH).index("untested")}
    described = json.loads(tables[0].schema.metadata[b"huggingface"])["info"]["features"]
    assert described[ANGLE] == {"dtype": "float32", "_type": "Value"}
    assert described[WORD]["dtype"] == "int64"
    info = json.loads(new["meta/info.json"])
    assert info["features"][ANGLE] == {"dtype": "float32", "shape": [1], "names": ["jaw"]}
    assert json.loads(new["meta/distal.json"])["unit"] == "deg"
    stats = json.loads(new["meta/stats.json"])[ANGLE]
    assert list(stats) == list(LIKE)
    expected = (angles.min(), angles.max(), angles.mean(), angles.std(), len(angles))
    np.testing.assert_allclose([stats[what][0] for what in LIKE[:5]], expected, atol=1e-6)
    assert stats["q10"][0] == pytest.approx(np.quantile(angles, 0.1), abs=1e-6)
    first = angles[: ROWS[0]]
    if version == 2:
        line = json.loads(new["meta/episodes_stats.jsonl"].splitlines()[0])
        assert line["stats"][ANGLE]["max"][0] == pytest.approx(first.max(), abs=1e-6)
    else:
        row = pq.read_table(written.folder / "meta" / "episodes" / "file.parquet").to_pylist()[0]
        assert row[f"stats/{ANGLE}/max"][0] == pytest.approx(first.max(), abs=1e-6)
        assert row[f"stats/{WORD}/count"] == [ROWS[0]]


def test_several_joints_are_a_vector_and_rows_without_an_estimate_are_nan(tmp_path: Path) -> None:
    rig = load_rig("finger-2n")
    names = [sensor.name for sensor in rig.sensors]
    columns = {f"sensors.{name}.column": f"observation.state.{name}" for name in names}
    rig = rig.with_values({"log.time.column": "timestamp", **columns})
    rows = 20
    state = np.zeros((rows, len(names)), np.float32)
    folder = tmp_path / "set"
    (folder / "meta").mkdir(parents=True)
    (folder / "data").mkdir()
    features = {"observation.state": {"dtype": "float32", "shape": [len(names)], "names": names}}
    (folder / "meta" / "info.json").write_text(json.dumps({"features": features}))
    stamps = (np.arange(rows) / 100.0).astype(np.float32)
    held = pa.FixedSizeListArray.from_arrays(pa.array(state.ravel()), len(names))
    columns_of = {"observation.state": held, "timestamp": stamps, "episode_index": [0] * rows}
    pq.write_table(pa.table(columns_of), folder / "data" / "a.parquet")
    written = with_angles(folder, rig, tmp_path / "new")
    table = pq.read_table(written.folder / "data" / "a.parquet")
    joints = len(rig.joint_names)
    assert table.schema.field(ANGLE).type == pa.list_(pa.float32(), joints)
    assert np.isfinite(np.vstack(table[ANGLE].to_pylist())).all()


@pytest.mark.parametrize("version", [2, 3])
def test_an_episode_that_cannot_be_estimated_takes_nothing_from_the_others(
    tmp_path: Path, rig: Rig, version: int
) -> None:
    """Its statistics are those of all rows, with a count of 0: means of means hold."""
    source = dataset(tmp_path / "set", version, (20, 1, 30))
    with pytest.warns(DistalWarning, match="no angles in episode_000001: .* has one row"):
        written = with_angles(source, rig, tmp_path / "new")
    assert written.words == {"untested": pytest.approx(50 / 51), "bad": pytest.approx(1 / 51)}
    tables = [
        pq.read_table(path) for path in sorted((tmp_path / "new" / "data").rglob("*.parquet"))
    ]
    angles = pa.concat_tables(tables)[ANGLE].to_numpy()
    assert np.flatnonzero(np.isnan(angles)).tolist() == [20]
    meta = tmp_path / "new" / "meta"
    if version == 2:
        lines = (meta / "episodes_stats.jsonl").read_text().splitlines()
        stats = [json.loads(line)["stats"][ANGLE] for line in lines]
    else:
        rows = pq.read_table(meta / "episodes" / "file.parquet").to_pylist()
        stats = [{what: row[f"stats/{ANGLE}/{what}"] for what in LIKE} for row in rows]
    assert [of["count"] for of in stats] == [[20], [0], [30]]
    assert stats[1]["mean"][0] == pytest.approx(np.nanmean(angles), abs=1e-6)
    assert stats[2]["max"][0] == pytest.approx(angles[21:].max(), abs=1e-6)


def test_a_copy_of_a_dataset_that_nobody_may_write_can_be_written(tmp_path: Path, rig: Rig) -> None:
    source = dataset(tmp_path / "set", 3)
    for path in (source, *source.rglob("*")):
        path.chmod(0o555)
    folder = with_angles(source, rig, tmp_path / "new").folder
    assert all(path.stat().st_mode & 0o200 for path in (folder, *folder.rglob("*")))


def test_nothing_is_written_where_it_must_not_be(tmp_path: Path, rig: Rig) -> None:
    source = dataset(tmp_path / "set", 3)
    before = bytes_of(tmp_path)
    with pytest.raises(OutputError, match="exists already"):
        with_angles(source, rig, source)
    with pytest.raises(OutputError, match="within the dataset"):
        with_angles(source, rig, source / "new")
    with pytest.raises(LogError):
        with_angles(tmp_path, rig, tmp_path / "new")
    wrong = load_rig("capstan-joint")
    with pytest.raises(LogError):
        with_angles(source, wrong, tmp_path / "new")
    assert bytes_of(tmp_path) == before


@pytest.mark.filterwarnings("ignore:left out")
def test_a_damaged_dataset_leaves_nothing_behind(tmp_path: Path, rig: Rig) -> None:
    source = dataset(tmp_path / "set", 2)
    lines = (source / "meta" / "episodes_stats.jsonl").read_text()
    (source / "meta" / "episodes_stats.jsonl").write_text("{}\n")
    before = bytes_of(tmp_path)
    with pytest.raises(LogError, match="not as LeRobot describes"):
        with_angles(source, rig, tmp_path / "new")
    assert bytes_of(tmp_path) == before
    (source / "meta" / "episodes_stats.jsonl").write_text(lines)
    (source / "data" / "chunk-000" / "episode_000001.parquet").write_bytes(b"PAR1")
    before = bytes_of(tmp_path)
    with pytest.raises(LogError, match=r"episode_000001\.parquet: cannot be read"):
        with_angles(source, rig, tmp_path / "new")
    assert bytes_of(tmp_path) == before


def test_the_command_writes_it_too(tmp_path: Path, rig: Rig) -> None:
    source = dataset(tmp_path / "set", 3)
    file = tmp_path / "rig.toml"
    changes = [f"{path}={json.dumps(column)}" for path, column in COLUMNS.items()]
    file.write_text(edited_text("capstan-joint", changes))
    words = ["estimate", str(source), "--rig", str(file), "--into", str(tmp_path / "new")]
    done = CliRunner().invoke(app, [*words, "--unit", "deg"])
    assert done.exit_code == 0, done.output
    assert f"3 episodes, {sum(ROWS)} rows; health: untested 100%" in " ".join(done.output.split())
    expected = with_angles(source, rig, tmp_path / "same", "deg")
    for path in sorted((expected.folder / "data").rglob("*.parquet")):
        written = tmp_path / "new" / path.relative_to(expected.folder)
        assert pq.read_table(written).equals(pq.read_table(path))
    for more in (["--out", str(tmp_path / "x.csv")], ["-e", "elastic"], ["--homing", "1s"]):
        refused = CliRunner().invoke(app, [*words, *more])
        assert isinstance(refused.exception, EstimationError)
