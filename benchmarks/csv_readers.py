"""Readers of CSV beside each other: time and memory for a long log, and what each makes of damaged
ones.

`python -m benchmarks.csv_readers` prints the tables of docs/results/dependencies.md.
"""

from __future__ import annotations

import csv
import hashlib
import multiprocessing
import random
import resource
import tempfile
import time
import warnings
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from tests.fuzzing.logs import Logs, good_log

from distal import load_scenario, scenario_rig
from distal.logs import read_table, write_columns

ROWS, COLUMNS, DAMAGED = 600_000, 10, 2000

Values = dict[str, Any]


def with_distal(path: Path) -> Values:
    return read_table(path).columns


def with_csv(path: Path) -> Values:
    with path.open(newline="") as file:
        names, *rows = csv.reader(file)
    return {name: np.array([float(row[k]) for row in rows]) for k, name in enumerate(names)}


def with_loadtxt(path: Path) -> Values:
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.loadtxt(path, delimiter=",", skiprows=1, ndmin=2).T))


def with_genfromtxt(path: Path) -> Values:
    names = path.read_text().splitlines()[0].split(",")
    return dict(zip(names, np.atleast_2d(np.genfromtxt(path, delimiter=",", skip_header=1)).T))


def with_pyarrow(path: Path) -> Values:
    import pyarrow.csv

    table = pyarrow.csv.read_csv(path)
    return {name: np.asarray(table[name].cast("float64")) for name in table.column_names}


def with_polars(path: Path) -> Values:
    import polars

    frame = polars.read_csv(path)
    return {name: frame[name].cast(polars.Float64).to_numpy() for name in frame.columns}


def with_polars_as_text(path: Path) -> Values:
    """Cells as text, then numbers, so that no type is guessed and a cell that is none can be
    named.
    """
    import polars

    frame = polars.read_csv(path, infer_schema=False, quote_char=None)
    return {
        name: frame[name].str.strip_chars().cast(polars.Float64).to_numpy()
        for name in frame.columns
    }


READERS = (
    with_distal,
    with_csv,
    with_loadtxt,
    with_genfromtxt,
    with_pyarrow,
    with_polars,
    with_polars_as_text,
)


def costs(read: Callable[[Path], Values], path: Path, identified: Any) -> None:
    """Send wall and processor time [s], memory beyond that of a read of two lines [MB], and the
    values' bytes' hash.
    """
    short = path.with_name("short.csv")
    read(short)  # imports
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    wall, processor = time.perf_counter(), time.process_time()
    values = read(path)
    wall, processor = time.perf_counter() - wall, time.process_time() - processor
    memory = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
    identified.send(
        (
            wall,
            processor,
            memory,
            hashlib.sha1(b"".join(values[name].tobytes() for name in sorted(values))).hexdigest(),
        )
    )


def long_log(folder: Path) -> None:
    """Print what each reader takes for a long log, each in a process of its own."""
    rng = np.random.default_rng(1)
    columns = {f"c{k}": np.cumsum(rng.normal(0.0, 1e-4, ROWS)) for k in range(1, COLUMNS)}
    path = folder / "long.csv"
    write_columns({"t": 0.001 * np.arange(ROWS), **columns}, path)
    (folder / "short.csv").write_bytes(b"\n".join(path.read_bytes().split(b"\n", 3)[:3]) + b"\n")
    print(f"\n{ROWS:,} rows of {COLUMNS} columns, {path.stat().st_size / 1e6:.0f} MB\n")
    print("| reader | wall [s] | processor [s] | memory [MB] | same bits |\n|---|---|---|---|---|")
    first = None
    for read in READERS:
        runs = []
        for _ in range(3):
            here, there = multiprocessing.Pipe()
            process = multiprocessing.get_context("fork").Process(
                target=costs, args=(read, path, there)
            )
            process.start()
            runs.append(here.recv())
            process.join()
        wall, processor, memory, values = (min(column) for column in zip(*runs))
        first = values if first is None else first
        print(
            f"| {read.__name__[5:]} | {wall:.1f} | {processor:.1f} | {memory:.0f} | "
            f"{values == first} |",
            flush=True,
        )


def damaged_logs(folder: Path) -> None:
    """Print what each reader makes of damaged logs, beside what distal makes of them."""
    rig = scenario_rig(load_scenario("template"))
    logs = Logs(good_log(rig, load_scenario("template")), rig, folder)
    path = folder / "damaged.csv"
    counts = {read: Counter[str]() for read in READERS}
    for seed in range(DAMAGED):
        path.write_bytes(logs._damaged_csv(random.Random(seed)))
        expected = outcome(with_distal, path)
        for read in READERS:
            counts[read][compared(outcome(read, path), expected)] += 1
    kinds = (
        "same",
        "refused as well",
        "takes what distal refuses",
        "refuses what distal takes",
        "other values",
    )
    print(
        f"\n{DAMAGED} damaged logs\n\n| reader | {' | '.join(kinds)} |\n|---|{'---|' * len(kinds)}"
    )
    for read in READERS:
        print(f"| {read.__name__[5:]} | {' | '.join(str(counts[read][kind]) for kind in kinds)} |")


def outcome(read: Callable[[Path], Values], path: Path) -> Values | None:
    """Return what a reader reads, None where it refuses in any way."""
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            values = read(path)
            return {
                name.strip(): np.asarray(each, dtype=np.float64) for name, each in values.items()
            }
    except Exception:
        return None


def compared(found: Values | None, expected: Values | None) -> str:
    if found is None or expected is None:
        if found is None and expected is None:
            return "refused as well"
        return "takes what distal refuses" if expected is None else "refuses what distal takes"
    alike = found.keys() == expected.keys() and all(
        np.array_equal(found[name], expected[name], equal_nan=True) for name in expected
    )
    return "same" if alike else "other values"


def main() -> None:
    """Print both tables."""
    with tempfile.TemporaryDirectory() as name:
        long_log(Path(name))
        damaged_logs(Path(name))


if __name__ == "__main__":
    main()
