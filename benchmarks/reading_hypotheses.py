"""What the constants of the hypotheses of readings are worth (`distal.run.redundancy`: a position
is late, two are exchanged).

`python -m benchmarks.reading_hypotheses FOLDER …` takes the folders of `benchmarks.wrong_inputs`.
Printed is, with each of `VARIANTS`, which share of the samples is off behind "ok", where the kind
shows, and how many good logs are accused for more than 0.3 % of their time.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd

from benchmarks.report import table
from benchmarks.wrong_inputs import KINDS, NAMED, WIDE, densities_of, sensors_of, shows
from distal import Log, Rig, estimate, load_rig, log_health, read_log
from distal.confidence import BAND
from distal.logs import true_angles
from distal.run import redundancy
from distal.run.redundancy import Redundancy

TRIED = [kind for kind in NAMED if kind != "stuck"]

VARIANTS: dict[str, dict[str, float]] = {
    "none": {"PRIOR": 1e-300},
    "as it is": {},
    "LATE = 0.1 s": {"LATE": 0.1},
    "LATE = 0.4 s": {"LATE": 0.4},
    "KEPT = 2": {"KEPT": 2},
    "KEPT = 8": {"KEPT": 8},
    "INDEPENDENT = 0.3 s": {"INDEPENDENT": 0.3},
    "INDEPENDENT = 1 s": {"INDEPENDENT": 1.0},
    "LATER = 0.001": {"LATER": 1e-3},
}

FALSE = 0.003
"""Share of a good log above which it counts as accused."""


@dataclass(frozen=True)
class Case:
    """A log: its kind, what came, and whether its samples are off, and "ok" without hypotheses."""

    kind: str
    log: Log
    rig: Rig
    off: np.ndarray
    is_ok: np.ndarray


@contextmanager
def changed(constants: Mapping[str, float]) -> Iterator[None]:
    """Change constants of `distal.run.redundancy`."""
    before = {name: getattr(redundancy, name) for name in constants}
    try:
        vars(redundancy).update(constants)
        redundancy._kernel.cache_clear()
        yield
    finally:
        vars(redundancy).update(before)
        redundancy._kernel.cache_clear()


def cases(path: Path) -> Iterator[Case]:
    """Yield a log, and it spoiled in each way that shows."""
    rig = load_rig(next(path.parent.glob("*.toml")))
    good = read_log(path, rig)
    truth = true_angles(good, rig.joint_names)
    assert truth is not None
    given = pd.read_csv(path)
    given = given.astype(dict.fromkeys(sensors_of(rig, given), float))
    densities = densities_of(good, rig)
    with tempfile.TemporaryDirectory() as folder:
        for kind in ("none", *TRIED):
            file = Path(folder) / f"{kind}.csv"
            spoiled = KINDS[kind](given.copy(), rig, np.random.default_rng(7))
            spoiled.to_csv(file, index=False)
            log = read_log(file, rig)
            if kind == "none" or (not spoiled.equals(given) and shows(log, densities, rig)):
                result = estimate(log, rig)
                off = np.abs(result.angles - truth) > WIDE * BAND * result.angle_stds
                is_ok = np.array([word == "ok" for word in log_health(log, rig)])
                yield Case(kind, log, rig, off.any(axis=1), is_ok)


def accused(case: Case) -> np.ndarray:
    """Return whether the forces of a sample are not those of free motion."""
    asked = Redundancy.of(case.rig, list(case.log.channels))
    values = np.column_stack(list(case.log.channels.values()))
    is_read = np.isfinite(values)
    _, unlike, _ = asked.along(case.log.time, np.where(is_read, values, 0.0), is_read)
    return (unlike > 0.0).any(axis=1)


def main() -> None:
    """Print the shares with each variant."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folders", nargs="+", type=Path)
    paths = [path for f in parser.parse_args().folders for path in sorted(f.glob("free_*.csv"))]
    warnings.simplefilter("ignore")
    with changed({"PRIOR": 1e-300}):
        found = [each for path in paths for each in cases(path)]
    rows = []
    for name, constants in VARIANTS.items():
        with changed(constants):
            words = [accused(each) for each in found]
        shares = []
        for kind in TRIED:
            hidden = [
                np.mean(each.off & each.is_ok & ~is_accused)
                for each, is_accused in zip(found, words, strict=True)
                if each.kind == kind
            ]
            shares.append(f"{100 * np.mean(hidden):.1f}" if hidden else "")
        good = [np.mean(a) > FALSE for each, a in zip(found, words) if each.kind == "none"]
        rows.append([name, *shares, f"{sum(good)} of {len(good)}"])
    columns = ["hypotheses", *(f"{kind} [%]" for kind in TRIED), "good logs accused"]
    table("reading_hypotheses", "Hypotheses of readings", columns, rows)


if __name__ == "__main__":
    main()
