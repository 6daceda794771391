"""Readings that go wrong: how much of the error is hidden behind the word "ok".

`python -m benchmarks.wrong_inputs [FOLDER …]` spoils logs in the ways of `KINDS` and writes them as
CSV. Each goes through `read_log` and `estimate` with the words of `log_health`, and through a
stream's messages and `Monitor`. Counted are the samples whose error is more than 1.5 half-widths of
the 95 % band while the word is "ok". A kind *shows* on a rig where the readings are clearly less
likely than without it: a t-test of the log densities of innovations, and of forces by what
positions predict of them, over `BLOCKS` parts of the log, at the level `LEVEL`. Logs are shipped
scenarios, with DISTAL_DATA the hand of `cases/base`, and each FOLDER's `*.toml` with its logs
`free_*.csv` (plants that share no code with the model, rigs that were learned from others of their
logs).
"""

from __future__ import annotations

import argparse
import os
import tempfile
import warnings
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
from scipy.stats import ttest_1samp

from benchmarks.report import table
from distal import (
    DistalError,
    Estimate,
    LiveEstimator,
    Log,
    Monitor,
    Rig,
    diagnose,
    estimate,
    load_rig,
    load_scenario,
    log_health,
    read_log,
    scenario_rig,
    simulate,
)
from distal.confidence import BAND
from distal.logs import MessageReader, true_angles, write_log
from distal.rig import log_factor
from distal.run.exchanged_or_late import Redundancy

WIDE = 1.5
"""Half-widths of the band beyond which an error counts as hidden."""

BLOCKS = 20
"""Number of parts of a log whose densities count as independent."""

LEVEL = 0.001
"""Chance that a kind that changes nothing counts as one that shows."""

OFF = np.radians(20.0)
"""Angle of a joint by which a reading is off [rad]."""

Change = Callable[[pd.DataFrame, Rig, np.random.Generator], pd.DataFrame]


def _positions(rig: Rig) -> list[str]:
    return [sensor.log_column for sensor in rig.sensors_of("position")]


def sensors_of(rig: Rig, table: pd.DataFrame) -> list[str]:
    columns = [s.log_column for s in rig.sensors if s.measures not in ("angle", "torque")]
    return [column for column in columns if column in table]


def off_of(rig: Rig) -> float:
    """Return the first position's logged number for a joint's turn by `OFF`."""
    sensor = rig.sensors_of("position")[0]
    drive = next(drive for drive in rig.drives if drive.name == sensor.of)
    tendon = next(tendon for tendon in rig.tendons if tendon.drive == drive.name)
    lever = drive.radius.value if drive.kind == "capstan" else 1.0
    off = OFF * tendon.total_arm / lever / log_factor(sensor)
    return float(np.round(off) if getattr(sensor, "counts_per_turn", None) else off)


def _stuck(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    name = _positions(rig)[0]
    half = len(table) // 2
    table.loc[half:, name] = table.loc[half, name]
    return table


def _repeated(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    names = sensors_of(rig, table)
    count = int(0.5 / np.median(np.diff(time_of(table, rig))))
    for first in rng.integers(len(table) // 5, len(table) - count, 3):
        table.loc[first : first + count, names] = table.loc[first, names].to_numpy()
    return table


def _zeros(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    hit = rng.random(len(table)) < 0.01
    table.loc[hit, sensors_of(rig, table)] = 0
    return table


def _wild(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    name = _positions(rig)[0]
    hit = rng.random(len(table)) < 0.01
    table.loc[hit, name] += rng.choice([-3.0, 3.0], int(hit.sum())) * off_of(rig)
    return table


def _wrapped(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    for sensor in rig.sensors_of("position"):
        turn = getattr(sensor, "counts_per_turn", None)
        if turn is None and sensor.si == "rad":
            turn = 2 * np.pi / log_factor(sensor)
        if turn:
            table[sensor.log_column] %= turn
    return table


def _offset(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    table[_positions(rig)[0]] += off_of(rig)
    return table


def _scaled(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    table[_positions(rig)[0]] *= 1.3
    return table


def _sign(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    table[_positions(rig)[0]] *= -1
    return table


def _swap(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    names = _positions(rig)[:2]
    if len(names) == 2:
        table[names] = table[names[::-1]].to_numpy()
    return table


def _two_sources(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    name = _positions(rig)[0]
    table[name] = table[name].astype(float)
    table.loc[::2, name] += off_of(rig)
    return table


def _unit(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    efforts = [name for name in sensors_of(rig, table) if name not in _positions(rig)]
    table[efforts] /= 1000.0
    return table


def _slip(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    table.loc[len(table) // 2 :, _positions(rig)[0]] += 3 * off_of(rig)
    return table


def _late(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    name = _positions(rig)[0]
    count = int(0.2 / np.median(np.diff(time_of(table, rig))))
    table[name] = table[name].shift(count).bfill()
    return table


def _unsigned(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    for name in sensors_of(rig, table):
        values = table[name].to_numpy()
        if (values == np.round(values)).all() and (values < 0).any():
            table[name] = np.where(values < 0, values + 65536, values)
    return table


def _good(table: pd.DataFrame, rig: Rig, rng: np.random.Generator) -> pd.DataFrame:
    return table


KINDS: dict[str, Change] = {
    "none": _good,
    "stuck": _stuck,
    "repeated": _repeated,
    "zeros": _zeros,
    "wild": _wild,
    "wrapped": _wrapped,
    "offset": _offset,
    "scaled": _scaled,
    "sign": _sign,
    "swap": _swap,
    "two sources": _two_sources,
    "unit": _unit,
    "slip": _slip,
    "late": _late,
    "unsigned": _unsigned,
}


def time_of(table: pd.DataFrame, rig: Rig) -> np.ndarray:
    factor = {"s": 1.0, "ms": 1e-3, "us": 1e-6}[rig.log.time.unit]
    return table[rig.log.time.column].to_numpy() * factor


def _logs(folders: list[Path], work: Path) -> Iterator[tuple[str, Rig, Path]]:
    for name in ("finger", "lab-bench", "series-2", "wrist"):
        scenario = load_scenario(name)
        rig = scenario_rig(scenario)
        path = work / f"{name}.csv"
        write_log(simulate(rig, scenario, 41), rig, path)
        yield name, rig, path
    data = os.environ.get("DISTAL_DATA")
    if data:
        base = Path(data) / "cases" / "base"
        yield "hand", load_rig(base / "hand.toml"), base / "log_2.csv"
    for folder in folders:
        for path in sorted(folder.glob("free_*.csv")):
            yield folder.name, load_rig(next(folder.glob("*.toml"))), path


def _streamed(path: Path, rig: Rig) -> tuple[np.ndarray, np.ndarray, list[str]]:
    live = LiveEstimator(rig)
    monitor = Monitor(live)
    reader = MessageReader(rig, live.channels)
    lines = path.read_text().splitlines()
    reader.header(lines[0])
    readings = []
    for line in lines[1:]:
        time, sample = reader.csv(line)
        readings.append(monitor.take(time, sample, reader.remarks))
    angles = np.array([reading.angles for reading in readings])
    stds = np.array([reading.angle_stds for reading in readings])
    return angles, stds, [reading.health for reading in readings]


def _hidden(
    angles: np.ndarray, stds: np.ndarray, words: list[str], truth: np.ndarray
) -> tuple[float, float, float]:
    """Return the shares of samples that are off behind "ok", off, and not ok."""
    off = (np.abs(angles - truth) > WIDE * BAND * stds).any(axis=1)
    is_ok = np.array([word == "ok" for word in words])
    return float(np.mean(off & is_ok)), float(np.mean(off)), float(np.mean(~is_ok))


def densities_of(log: Log, rig: Rig) -> list[np.ndarray]:
    """Return the log densities of a log's samples: of its innovations, and of its forces by what
    positions predict of them.
    """
    result = estimate(log, rig)
    variances = np.maximum(result.innovation_variances, 1e-30)
    squares = result.innovations**2 / variances + np.log(variances)
    redundancy = Redundancy.of(rig, list(log.channels))
    values = np.column_stack(list(log.channels.values()))
    mask = np.isfinite(values)
    predicted, _, _ = redundancy.along(log.time, np.where(mask, values, 0.0), mask)
    return [-np.nansum(squares, axis=1) / 2, -np.sum(predicted, axis=1) / 2]


def shows(spoiled: Log, good: list[np.ndarray], rig: Rig) -> bool:
    """Return whether the samples of a log are clearly less likely than the `good` ones."""
    for as_is, right in zip(densities_of(spoiled, rig), good, strict=True):
        lost = [part.mean() for part in np.array_split(right - as_is, BLOCKS)]
        if np.any(lost) and ttest_1samp(lost, 0.0, alternative="greater").pvalue < LEVEL:
            return True
    return False


NAMED = {
    "stuck": "is it stuck",
    "offset": "off: its zero",
    "scaled": "gear",
    "sign": "its sign",
    "swap": "swapped",
    "unit": "1000 times too small",
    "late": "s late",
}
"""Kind → what the diagnosis says of it first."""


def _names(log: Log, rig: Rig, result: Estimate, kind: str) -> float:
    """Return whether the diagnosis, which does not know the truth, names the kind first; NaN of a
    kind that has no name.
    """
    if kind not in NAMED:
        return np.nan
    findings = diagnose(replace(result, truths=None), replace(log, truth={}), rig).findings
    causes = [f.text for f in findings if f.kind in ("looks like", "stuck")]
    return float(bool(causes) and NAMED[kind] in causes[0])


Row = tuple[str, str, float, float, float, bool, float]


def results(folders: list[Path]) -> dict[str, list[Row]]:
    """Return kind → (rig, entry point, share hidden, share off, share not ok, whether it shows,
    whether it is named).
    """
    found = defaultdict(list)
    with tempfile.TemporaryDirectory() as name, warnings.catch_warnings():
        warnings.simplefilter("ignore")
        work = Path(name)
        for rig_name, rig, path in _logs(folders, work):
            good: Log = read_log(path, rig)
            truth = true_angles(good, rig.joint_names)
            assert truth is not None
            densities = densities_of(good, rig)
            for kind, change in KINDS.items():
                given = pd.read_csv(path)
                columns = dict.fromkeys(sensors_of(rig, given), float)
                spoiled = change(given.astype(columns), rig, np.random.default_rng(7))
                if kind != "none" and spoiled.equals(given.astype(columns)):
                    continue
                file = work / "spoiled.csv"
                spoiled.to_csv(file, index=False)
                log = read_log(file, rig)
                try:
                    result = estimate(log, rig)
                except DistalError:  # it ends with a sentence
                    shares = 0.0, 1.0, 1.0
                    is_shown = True
                    named = np.nan
                else:
                    is_shown = shows(log, densities, rig)
                    words = list(log_health(log, rig))
                    shares = _hidden(result.angles, result.angle_stds, words, truth)
                    named = _names(log, rig, result, kind)
                found[kind].append((rig_name, "estimate", *shares, is_shown, named))
                streamed = _hidden(*_streamed(file, rig), truth)
                found[kind].append((rig_name, "stream", *streamed, is_shown, np.nan))
    return found


def main() -> None:
    """Print a table of the kinds, and the worst rig of each."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="*", type=Path)
    found = results(parser.parse_args().folders)
    rows = []
    for kind, entries in found.items():
        hidden = [entry[2] for entry in entries]
        worst = entries[int(np.argmax(hidden))]
        means = [f"{100 * np.mean([entry[i] for entry in entries]):.1f}" for i in (2, 3, 4)]
        shown = [entry[2] for entry in entries if entry[5]]
        named = [entry[6] for entry in entries if entry[5] and not np.isnan(entry[6])]
        silent = sorted({entry[0] for entry in entries if not entry[5]})
        rows.append(
            (
                kind,
                *means,
                f"{100 * worst[2]:.0f} ({worst[0]}, {worst[1]})",
                f"{100 * np.mean(shown):.1f}" if shown else "",
                f"{100 * np.mean(named):.0f} of {len(named)}" if named else "",
                ", ".join(silent),
            )
        )
    columns = (
        "kind",
        "off, but ok [%]",
        "off [%]",
        "not ok [%]",
        "worst: off, but ok [%]",
        "off, but ok, where it shows [%]",
        "named first, where it shows [%]",
        "shows not on",
    )
    table("wrong_inputs", "Readings that go wrong", columns, rows)


if __name__ == "__main__":
    main()
