"""Joint angles in LeRobot datasets (versions 2 and 3): a copy of a dataset with what `estimate`
says.

The copy has three features more: ``observation.joint_angle``, ``observation.joint_angle_std`` and
``observation.joint_health``, with their names, statistics and types; all else is as it was.
"""

from __future__ import annotations

import json
import shutil
import tempfile
import warnings
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.errors import DistalError, DistalWarning, LogError, OutputError
from distal.logs import Episode, episodes_of, read_log
from distal.logs.table_cells import INFO, dataset_info
from distal.rig import Rig, as_rig
from distal.run import HEALTH, estimate, log_health
from distal.run.health import word_code
from distal.units import unit_factor

STATE = "observation.state"
NEW = [f"observation.joint_{what}" for what in ("angle", "angle_std", "health")]
ANGLE, STD, WORD = NEW

NEAR = 1e-5
"""Distance of a stamp of a dataset from that of the same row in a log [s]. Source: rounding (stamps
are of single precision)."""


New: TypeAlias = dict[int, Floats]
"""Episode → values of its rows: angles, stds and a word, (k, 2 n_joints + 1)."""


@dataclass(frozen=True)
class Written:
    """What `with_angles` wrote.

    Args:
        folder: of the new dataset.
        episodes: number of episodes.
        rows: number of rows.
        words: health word → share of all rows.
    """

    folder: Path
    episodes: int
    rows: int
    words: Mapping[str, float]


def with_angles(
    dataset: str | Path, rig: Rig | str | Path, into: str | Path, unit: str = "rad"
) -> Written:
    """Write a copy of a dataset with the joint angles of each row, their standard deviations, and
    the health word of the row as its place in `HEALTH`; NaN where there is no estimate.

    Args:
        dataset: folder of a LeRobot dataset, version 2 or 3. It is not changed.
        rig: whose sensors name numbers of ``observation.state``.
        into: folder that does not exist yet.
        unit: of the angles.

    Raises:
        LogError: this is no such dataset, or an episode cannot be read.
        OutputError: the folder exists, is within the dataset, or cannot be written.
        RigError: the rig is unknown or wrong.
    """
    dataset = Path(dataset)
    into = Path(into)
    rig = as_rig(rig)
    scale = 1.0 / unit_factor(unit, "rad")
    info = dataset_info(dataset)
    if not isinstance(info.get("features"), dict):
        raise LogError(f"{dataset / INFO}: names no features")
    if into.exists():
        raise OutputError(f"{into}: exists already; give the name of a new folder")
    if into.resolve().is_relative_to(dataset.resolve()):
        raise OutputError(f"{into}: is within the dataset, which stays as it is")
    episodes = episodes_of(dataset)
    columns = _columns(episodes, rig, scale)
    unread = set((dataset / "data").rglob("*.parquet")) - set(columns)
    if unread:
        raise LogError(f"{min(unread)}: cannot be read, so that its rows would have no angles")
    values = New()
    try:
        with tempfile.TemporaryDirectory(
            prefix=".distal-", dir=into.parent, ignore_cleanup_errors=True
        ) as folder:
            half = Path(folder)
            shutil.copytree(dataset, half, dirs_exist_ok=True)
            for path in (half, *half.rglob("*")):
                path.chmod(path.stat().st_mode | 0o200)  # the original may be read-only
            for path, estimates in columns.items():
                values |= _extended(half / path.relative_to(dataset), path, estimates)
            _describe(half, info, rig, values, unit)
            half.rename(into)
    except OSError as problem:
        raise OutputError(f"{into}: {problem.strerror or problem}") from None
    except (KeyError, ValueError) as problem:
        raise LogError(f"{dataset}: not as LeRobot describes its datasets ({problem})") from None
    codes = np.concatenate([*values.values()])[:, -1].astype(int)
    words = list(HEALTH)
    shares = {words[code]: float(np.mean(codes == code)) for code in np.unique(codes)}
    return Written(into, len(values), len(codes), shares)


def _features(values: Floats) -> dict[str, Floats]:
    """Return name of a feature → its columns of the new values."""
    n = values.shape[1] // 2
    return dict(zip(NEW, np.hsplit(values, [n, 2 * n])))


def _columns(
    episodes: list[Episode], rig: Rig, scale: float
) -> dict[Path, dict[int, tuple[Floats, Floats]]]:
    """Return file → episode → its stamps [s] and new values, of the rows that were read; NaN for an
    episode that cannot be estimated, with a warning.
    """
    by_file: dict[Path, dict[int, tuple[Floats, Floats]]] = {}
    problems: dict[Episode, DistalError] = {}
    for episode in episodes:
        time = np.full(1, np.nan)
        new = np.full((1, 2 * len(rig.joints) + 1), np.nan)
        try:
            log = read_log(episode, rig)
            estimated = estimate(log, rig)
            words = [word_code(word) for word in log_health(log, rig)]  # type: ignore[arg-type]
            time = log.time
            new = np.column_stack([scale * estimated.angles, scale * estimated.angle_stds, words])
        except DistalError as problem:
            problems[episode] = problem
        by_file.setdefault(episode.path, {})[episode.number] = time, new
    for episode, error in problems.items():
        if len(problems) == len(episodes):
            raise error
        warnings.warn(f"no angles in {episode.name}: {error}", DistalWarning, stacklevel=3)
    return by_file


def _extended(target: Path, source: Path, estimates: Mapping[int, tuple[Floats, Floats]]) -> New:
    """Write a file of a dataset with the new columns, and return its new values."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    table = pq.read_table(source)
    of_episode = table["episode_index"].to_numpy()
    stamps = table["timestamp"].to_numpy().astype(np.float64)
    columns = np.empty((len(stamps), 0))
    for number, (time, new) in estimates.items():
        if not columns.size:
            columns = np.full((len(stamps), new.shape[1]), np.nan)
            columns[:, -1] = word_code("bad")
        rows = np.flatnonzero(of_episode == number)
        at = np.searchsorted(time, stamps[rows] - NEAR).clip(0, len(time) - 1)
        is_there = np.abs(time[at] - stamps[rows]) <= NEAR
        columns[rows[is_there]] = new[at[is_there]]
    metadata = dict(table.schema.metadata or {})
    described = json.loads(metadata.get(b"huggingface", b"{}"))
    for name, of in _features(columns).items():
        kind = pa.int64() if name == WORD else pa.float32()
        flat = pa.array(of.ravel()).cast(kind)
        size = of.shape[1]
        column = flat if size == 1 else pa.FixedSizeListArray.from_arrays(flat, size)
        table = table.append_column(name, column)
        if described:
            value = {"dtype": str(kind).replace("float", "float32"), "_type": "Value"}
            listed = {"feature": value, "length": size, "_type": "Sequence"}
            described["info"]["features"][name] = value if size == 1 else listed
    if described:
        metadata[b"huggingface"] = json.dumps(described).encode()
    pq.write_table(table.replace_schema_metadata(metadata), target)
    return {number: columns[of_episode == number] for number in estimates}


def _describe(folder: Path, info: dict[str, Any], rig: Rig, values: New, unit: str) -> None:
    """Write the new features and their statistics where the dataset has those of its state."""
    import pyarrow as pa
    import pyarrow.parquet as pq

    joints = rig.joint_names
    for name, dtype, names in (
        (ANGLE, "float32", joints),
        (STD, "float32", joints),
        (WORD, "int64", ["health"]),
    ):
        info["features"][name] = {"dtype": dtype, "shape": [len(names)], "names": names}
    _write_json(folder / INFO, info)
    words = {word: code for code, word in enumerate(HEALTH)}
    meta = folder / "meta"
    _write_json(meta / "distal.json", {"rig": rig.name, "unit": unit, "health": words})
    every = np.vstack([*values.values()])
    stats = meta / "stats.json"
    if stats.is_file():
        of_all = json.loads(stats.read_text(encoding="utf-8"))
        _write_json(stats, of_all | _statistics(every, every, of_all.get(STATE, {})))
    by_episode = meta / "episodes_stats.jsonl"
    if by_episode.is_file():
        lines = [json.loads(line) for line in by_episode.read_text(encoding="utf-8").splitlines()]
        for line in lines:
            of_episode = values.get(line["episode_index"])
            if of_episode is not None:
                line["stats"] |= _statistics(of_episode, every, line["stats"].get(STATE, {}))
        text = "".join(f"{json.dumps(line)}\n" for line in lines)
        by_episode.write_text(text, encoding="utf-8")
    start = f"stats/{STATE}/"
    for path in sorted((meta / "episodes").rglob("*.parquet")):
        table = pq.read_table(path)
        like = [name.removeprefix(start) for name in table.column_names if name.startswith(start)]
        episodes = table["episode_index"].to_pylist() if like else []
        rows = [_statistics(values[episode], every, like) for episode in episodes]
        for name in NEW if rows else ():
            for what in rows[0][name]:
                column = pa.array([row[name][what] for row in rows])
                table = table.append_column(f"stats/{name}/{what}", column)
        pq.write_table(table, path)


def _statistics(
    values: Floats, every: Floats, like: Iterable[str]
) -> dict[str, dict[str, list[float]]]:
    """Return the statistics of each new feature of `values` that a feature of the dataset has too;
    rows with NaN are left out. Where none is left, they are those of `every` row, with a count of
    0.
    """
    known = ("min", "max", "mean", "std", "count")
    kinds = [what for what in like or known if what in known or what[1:].isdigit()]

    def one(what: str, rows: Floats, every: Floats) -> list[float]:
        rows, every = (of[np.isfinite(of).all(axis=1)] for of in (rows, every))
        counted = rows if len(rows) else every
        if what == "count":
            return [len(rows)]
        if what.startswith("q"):
            return list(np.quantile(counted, float(what[1:]) / 100.0, axis=0))
        return list(getattr(np, what)(counted, axis=0))

    pairs = zip(_features(values).values(), _features(every).values())
    return {name: {what: one(what, *pair) for what in kinds} for name, pair in zip(NEW, pairs)}


def _write_json(path: Path, content: object) -> None:
    path.write_text(json.dumps(content, indent=4, ensure_ascii=False) + "\n", encoding="utf-8")
