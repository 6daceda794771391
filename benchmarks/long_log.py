"""What `distal estimate` takes for a long log at 1 kHz, CSV and Parquet: `python -m
benchmarks.long_log [HOURS]`.

The log goes forth and back through a log of a finger, a motor's angle and its current, with noise.
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.csv
import pyarrow.parquet

LOGS = Path(__file__).parents[1] / "examples" / "finger_logs"
SCHEMA = pa.schema([(name, pa.float64()) for name in ("time [s]", "motor [deg]", "current [mA]")])
AT_ONCE = 500_000
"""Rows that are made at once."""


def parts(count: int) -> Iterator[pa.RecordBatch]:
    """Yield the rows of the log."""
    stamps, motor, current, _ = np.loadtxt(LOGS / "unseen.csv", delimiter=",", skiprows=1).T
    rng = np.random.default_rng(1)
    for begin in range(0, count, AT_ONCE):
        time = np.arange(begin, min(begin + AT_ONCE, count)) / 1000.0
        at = stamps[-1] - np.abs(np.mod(time, 2 * stamps[-1]) - stamps[-1])
        angle = np.interp(at, stamps, motor) + rng.normal(0.0, 0.002, len(time))
        effort = np.interp(at, stamps, current) + rng.normal(0.0, 1.0, len(time))
        columns = [time, np.round(angle, 3), np.round(effort, 1)]
        yield pa.record_batch(columns, schema=SCHEMA)


def main() -> None:
    """Measure and print."""
    count = round(float(sys.argv[1] if len(sys.argv) > 1 else 3) * 3_600_000)
    with tempfile.TemporaryDirectory() as folder:
        root = Path(folder)
        with (
            pa.csv.CSVWriter(root / "long.csv", SCHEMA) as csv,
            pa.parquet.ParquetWriter(root / "long.parquet", SCHEMA) as parquet,
        ):
            for part in parts(count):
                csv.write_batch(part)
                parquet.write_batch(part)
        distal = [sys.executable, "-m", "distal"]
        logs = [str(LOGS / f"run_{k}.csv") for k in range(3)]
        subprocess.run([*distal, "learn", *logs, "--out", "rig.toml"], cwd=root, check=True)
        for ending in ("csv", "parquet"):
            before = resource.getrusage(resource.RUSAGE_CHILDREN)
            words = ["estimate", f"long.{ending}", "--rig", "rig.toml", "--out", f"out.{ending}"]
            subprocess.run([*distal, *words], cwd=root, check=True)
            after = resource.getrusage(resource.RUSAGE_CHILDREN)
            seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
            print(
                f"{count:,} rows, {ending}: {seconds:.0f} s of processor time, at most "
                f"{1024 * after.ru_maxrss / 1e9:.2f} GB in any process so far"
            )


if __name__ == "__main__":
    main()
