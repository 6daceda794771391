"""A position that is wrong for half a second: how far off the angle is then, and afterwards.

`python -m benchmarks.bad_seconds FOLDER …` spoils the first position of each folder's logs
`free_*.csv` in the middle: it reads −1, 0 or the end of a register, stays the same, comes from two
sources in turn, or jumps for 2 s. Each log goes through `read_log`, `estimate` and the words of
`log_health`, with the folder's rig, which was learned from other logs. Without a folder it takes
shipped scenarios, whose rigs no log taught; where a log ends sooner than 3 s later, NaN is printed.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.report import table
from benchmarks.wrong_inputs import WIDE, off_of, sensors_of, time_of
from distal import (
    Rig,
    estimate,
    load_rig,
    load_scenario,
    log_health,
    read_log,
    scenario_rig,
    simulate,
)
from distal.confidence import BAND
from distal.logs import true_angles, write_log

KINDS = ("none", "−1", "0", "3276.7", "frozen", "two sources", "jump")
HALF, LONG = 0.5, 2.0
"""Durations of what is wrong; a jump lasts longer [s]."""


def logs_of(folders: list[Path], work: Path) -> Iterator[tuple[Rig, Path]]:
    """Yield rigs with logs of theirs."""
    for name in () if folders else ("lab-bench", "wrist"):
        scenario = load_scenario(name)
        rig = scenario_rig(scenario)
        path = work / f"{name}.csv"
        write_log(simulate(rig, scenario, 41), rig, path)
        yield rig, path
    for folder in folders:
        for path in sorted(folder.glob("free_*.csv")):
            yield load_rig(next(folder.glob("*.toml"))), path


def spoiled(given: pd.DataFrame, rig: Rig, kind: str) -> tuple[pd.DataFrame, slice]:
    """Return a table whose first position is wrong in a stretch of rows, and the stretch."""
    sensor = rig.sensors_of("position")[0]
    time = time_of(given, rig)
    middle = time[0] + 0.45 * (time[-1] - time[0])
    lasts = LONG if kind == "jump" else HALF
    rows = slice(*np.searchsorted(time, [middle, middle + lasts]))
    column = given.columns.get_loc(sensor.log_column)
    values = given.iloc[:, column].to_numpy(dtype=np.float64).copy()
    off = off_of(rig)
    if kind == "two sources":
        values[rows.start : rows.stop : 2] += off
    elif kind == "jump":
        values[rows] += 4.5 * off
    elif kind == "frozen":
        values[rows] = values[rows.start]
    elif kind != "none":
        values[rows] = float(kind.replace("−", "-"))
    given = given.copy()
    given.iloc[:, column] = values
    return given, rows


def results(folders: list[Path]) -> dict[str, list[tuple[float, ...]]]:
    """Return kind → of each log: share inside the band and share hidden behind "ok" while it is
    wrong, RMS error and share inside after it, each for the time from 3 s on.
    """
    found: dict[str, list[tuple[float, ...]]] = {kind: [] for kind in KINDS}
    with tempfile.TemporaryDirectory() as name:
        file = Path(name) / "spoiled.csv"
        for rig, path in logs_of(folders, Path(name)):
            given = pd.read_csv(path)
            given = given.astype(dict.fromkeys(sensors_of(rig, given), float))
            for kind in KINDS:
                table_of, rows = spoiled(given, rig, kind)
                table_of.to_csv(file, index=False)
                log = read_log(file, rig)
                truth = true_angles(log, rig.joint_names)
                assert truth is not None
                result = estimate(log, rig)
                errors = np.abs(result.angles - truth)
                inside = errors <= BAND * result.angle_stds
                off = (errors > WIDE * BAND * result.angle_stds).any(axis=1)
                is_ok = np.array([word == "ok" for word in log_health(log, rig)])
                late = log.time > log.time[min(rows.stop, len(log.time) - 1)] + 3.0
                found[kind].append(
                    (
                        float(inside[rows].mean()),
                        float((off & is_ok)[rows].mean()),
                        float(np.rad2deg(np.sqrt(np.mean(errors[late] ** 2)))),
                        float(inside[late].mean()),
                    )
                )
    return found


def main() -> None:
    """Print a row for each kind."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    found = results(parser.parse_args().folders)
    usual = np.array([row[2] for row in found["none"]])
    rows = []
    for kind, entries in found.items():
        inside, hidden, rms, after = np.array(entries).T
        ratios = rms / usual
        rows.append(
            (
                kind,
                f"{100 * inside.mean():.0f}",
                f"{100 * hidden.mean():.1f}",
                f"{np.exp(np.log(ratios).mean()):.2f}; {ratios.max():.1f}",
                f"{100 * after.mean():.0f}; {100 * after.min():.0f}",
            )
        )
    columns = (
        "position",
        "inside meanwhile [%]",
        "off, but ok [%]",
        "error 3 s later ÷ without; worst",
        "inside then; worst [%]",
    )
    table("bad_seconds", "A position that is wrong for half a second", columns, rows)


if __name__ == "__main__":
    main()
