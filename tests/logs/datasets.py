"""Datasets of robot learning as LeRobot has them, of a joint with a capstan."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from distal import Rig, load_rig

NAMES = ("motor.pos", "motor.current")
COLUMNS = {
    "log.time.column": "timestamp",
    "sensors.motor_angle.column": "observation.state.motor.pos",
    "sensors.motor_torque.column": "observation.state.motor.current",
}
"""What a rig file says of the columns."""


def capstan_rig() -> Rig:
    """Return the joint with a capstan, whose sensors are numbers of a vector."""
    return load_rig("capstan-joint").with_values(COLUMNS)


def drawn_run(seed: int, rows: int) -> np.ndarray:
    """Return stamps and both readings of a run as float32, (rows, 3)."""
    position = np.cumsum(np.random.default_rng(seed).normal(0.0, 2e-3, rows))
    torque = 0.02 * np.sign(np.gradient(position) if rows > 1 else position)
    return np.column_stack([np.arange(rows) / 200.0, position, torque]).astype(np.float32)


def table(number: int, run: np.ndarray) -> pa.Table:
    """Return the table of an episode."""
    value = {"dtype": "float32", "_type": "Value"}
    known = {"info": {"features": {"timestamp": value}}}
    made = pa.table(
        {
            "observation.state": pa.array(run[:, 1:].tolist(), pa.list_(pa.float32())),
            "action": pa.FixedSizeListArray.from_arrays(pa.array(run[:, 1:].ravel()), 2),
            "timestamp": pa.array(run[:, 0]),
            "frame_index": pa.array(np.arange(len(run))),
            "episode_index": pa.array(np.full(len(run), number)),
        }
    )
    return made.replace_schema_metadata({"huggingface": json.dumps(known)})


def dataset(folder: Path, runs: list[np.ndarray], version: int, names: object = NAMES) -> Path:
    """Write a dataset."""
    (folder / "meta").mkdir(parents=True)
    features = {"observation.state": {"dtype": "float32", "shape": [2], "names": names}}
    info = {
        "codebase_version": f"v{version}.0",
        "fps": 200,
        "total_episodes": len(runs),
        "features": features,
    }
    (folder / "meta" / "info.json").write_text(json.dumps(info))
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    tables = [table(number, run) for number, run in enumerate(runs)]
    files = [[part] for part in tables] if version == 2 else [tables[:3], tables[3:]]
    for number, parts in enumerate(filter(None, files)):
        name = f"episode_{number:06d}" if version == 2 else f"file-{number:03d}"
        pq.write_table(pa.concat_tables(parts), data / f"{name}.parquet")
    return folder
