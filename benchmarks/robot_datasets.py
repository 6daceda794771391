"""A thousand episodes by a Dask cluster of two processes, beside our own two: `python -m
benchmarks.robot_datasets`.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from distal import Estimate, Rig, load_rig
from distal.logs import Episode, episodes_of
from distal.rig import edited_text
from distal.run import estimate_batch

EPISODES, ROWS = 1000, 1500


def written(folder: Path, episodes: int) -> Path:
    """Write a LeRobot dataset of version 3, fifty episodes in a file."""
    (folder / "meta").mkdir(parents=True)
    names = {"observation.state": {"names": ["position", "torque"]}}
    (folder / "meta" / "info.json").write_text(json.dumps({"features": names}))
    data = folder / "data" / "chunk-000"
    data.mkdir(parents=True)
    rng = np.random.default_rng(0)
    for number in range(0, episodes, 50):
        parts = []
        for episode in range(number, min(number + 50, episodes)):
            position = np.cumsum(rng.normal(0.0, 2e-3, ROWS))
            state = np.column_stack([position, 0.02 * np.sign(np.gradient(position))]).astype(
                np.float32
            )
            parts.append(
                pa.table(
                    {
                        "observation.state": pa.FixedSizeListArray.from_arrays(
                            pa.array(state.ravel()), 2
                        ),
                        "timestamp": np.arange(ROWS) / 200.0,
                        "episode_index": np.full(ROWS, episode),
                    }
                )
            )
        pq.write_table(pa.concat_tables(parts), data / f"file-{number // 50:03d}.parquet")
    return folder


CHANGES = {
    "log.time.column": "timestamp",
    "sensors.motor_angle.column": "observation.state.position",
    "sensors.motor_torque.column": "observation.state.torque",
}
"""Of `capstan-joint`, so that it reads the dataset."""


def commanded(dataset: Path, rig: Path, out: Path) -> float:
    """Return how long `distal estimate` takes for a dataset, with its start and its files [s]."""
    command = [
        sys.executable,
        "-m",
        "distal",
        "estimate",
        str(dataset),
        "--rig",
        str(rig),
        "--out",
        str(out),
    ]
    begin = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - begin


def estimated(episodes: list[Episode], rig: Rig) -> list[Estimate]:
    """Return the estimates over some episodes, as a worker of a cluster makes them."""
    return list(estimate_batch(episodes, rig, workers=1))


def main() -> None:
    """Measure and print."""
    from distributed import Client, LocalCluster

    count = int(sys.argv[1]) if len(sys.argv) > 1 else EPISODES
    rig = load_rig("capstan-joint").with_values(CHANGES)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        file, dataset = root / "rig.toml", written(root / "set", count)
        file.write_text(
            edited_text("capstan-joint", [f'{path}="{column}"' for path, column in CHANGES.items()])
        )
        episodes = episodes_of(dataset)
        list(estimate_batch(episodes[:8], rig))
        begin = time.perf_counter()
        own = list(estimate_batch(episodes, rig, workers=2))
        here = time.perf_counter() - begin
        chunks = [episodes[k : k + 32] for k in range(0, len(episodes), 32)]
        with (
            LocalCluster(n_workers=2, threads_per_worker=1, dashboard_address=None) as cluster,
            Client(cluster) as client,
        ):
            client.gather(client.map(estimated, chunks[:2], rig=rig))
            begin = time.perf_counter()
            parts = client.gather(client.map(estimated, chunks, rig=rig, pure=False))
            far = [estimate for part in parts for estimate in part]
            there = time.perf_counter() - begin
            times = [commanded(dataset, file, root / f"{k}") for k in range(3)]
    same = max(float(np.abs(a.angles - b.angles).max()) for a, b in zip(own, far))
    print(
        f"{count} episodes: {here:.1f} s by two threads, {there:.1f} s by two Dask workers, "
        f"{there / here:.2f} x; "
        f"largest difference {same:.1e} rad"
    )
    print(f"as a command that writes its files, median of three: {np.median(times):.1f} s")


if __name__ == "__main__":
    main()
