"""What the constants of a learned map are worth, and what a map gives beside what it corrects.

`python -m benchmarks.one_map [--first-seed 9310] [--seeds 2] [--only finger-2n]` draws logs of
plants that share no code with `distal.model` (`benchmarks.touch`), fits by `distal fit` the rig
files that somebody wrote for them, and learns maps from the calibration logs, on readings alone and
beside the filter. Judged is on logs of free motion that nothing has seen, for each of the
`VARIANTS`.

The usual hyperparameters (`Prior`) are near the medians of those with the largest density of
held-out logs on the rigs of seeds 9310 and 9420; so these seeds say what a change is worth, not how
well a map does on others.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray
from tests.support.maps import with_learned_map

from benchmarks.report import table
from benchmarks.shell import estimate
from benchmarks.touch import CASES, fitted
from distal import Log, Rig, read_log
from distal.fitting.learned_maps import untouched
from distal.logs import true_angles
from distal.regression import Prior

Floats = NDArray[np.float64]

SEARCH = "distal.fitting.learned_maps"


@dataclass(frozen=True)
class Drawn:
    """A fitted rig with its logs for calibration and in free motion."""

    name: str
    rig: Rig
    calibration: tuple[Log, ...]
    free: tuple[Log, ...]


def usual(**steps: float) -> Callable[[], object]:
    """Return a change of the usual hyperparameters by some steps."""
    changed = replace(Prior(), **{name: getattr(Prior(), name) + by for name, by in steps.items()})
    return lambda: patch(f"{SEARCH}.Prior", lambda: changed)


def constant(name: str, value: object) -> Callable[[], object]:
    """Return a change of a constant of the search."""
    return lambda: patch(f"{SEARCH}.{name}", value)


VARIANTS: dict[str, Callable[[], object]] = {
    "as it is": usual(),
    "16 radial functions": constant("RADIAL", 16),
    "64 radial functions": constant("RADIAL", 64),
    "half as many trials": constant("EVALUATIONS", 100),
    "narrower priors of hyperparameters": constant("SPREAD", 1.5),
    "shorter radial functions": usual(reading_length=-0.7, slip_length=-0.4),
    "larger weights of slips": usual(slips=1.0),
    "larger weights of lags": usual(lags=1.0),
    "logs that differ more": usual(log=1.0, log_readings=1.0, log_slips=1.0),
}


@contextmanager
def changed(name: str) -> Iterator[None]:
    """Learn with a variant."""
    with VARIANTS[name]():  # type: ignore[attr-defined]
        yield


def drawn_rigs(first: int, seeds: int, only: str | None) -> Iterator[Drawn]:
    """Yield the fitted rigs."""
    for seed in range(first, first + 110 * seeds, 110):
        for name, case in CASES.items():
            given = "DISTAL_DATA" in os.environ or not name.startswith(("sheath", "finger, three"))
            if not given or "more" in name or only not in (None, name):
                continue
            with tempfile.TemporaryDirectory() as folder:
                drawn = case(seed, Path(folder))
                rig = untouched(fitted(drawn, Path(folder)).bare())
                logs = [
                    tuple(read_log(path, rig) for path in paths)
                    for paths in (drawn.calibration, drawn.free)
                ]
            yield Drawn(f"{name}, {seed}", rig, *logs)


def judged(rig: Rig, logs: Sequence[Log]) -> tuple[float, float]:
    """Return mean RMS error [°] and share inside the band."""
    errors, shares = [], []
    for log in logs:
        result = estimate(log, rig, covariances=False)
        truth = true_angles(log, rig.joint_names)
        assert truth is not None
        off = np.abs(result.angles - truth)
        errors.append(np.rad2deg(np.sqrt(np.nanmean(off**2))))
        shares.append(np.nanmean(off <= 1.96 * result.angle_stds))
    return float(np.mean(errors)), float(np.mean(shares))


def main() -> None:
    """Print a row for each variant, and one for each rig."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.one_map", description=__doc__)
    parser.add_argument("--first-seed", type=int, default=9310)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--only")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    ways = [(kind, name) for kind in ("readings", "filter") for name in VARIANTS]
    found: dict[tuple[str, str], list[tuple[float, float]]] = {way: [] for way in ways}
    rows = []
    for drawn in drawn_rigs(arguments.first_seed, arguments.seeds, arguments.only):
        alone = judged(drawn.rig, drawn.free)
        for kind, name in ways:
            with changed(name):
                learned = with_learned_map(drawn.calibration, drawn.rig, kind)
            found[kind, name].append(judged(learned, drawn.free))
        cells = [alone, *(found[kind, "as it is"][-1] for kind in ("readings", "filter"))]
        rows.append((drawn.name, *(f"{rms:.3f} ({100 * inside:.0f} %)" for rms, inside in cells)))
        print(*rows[-1], sep=" | ", file=sys.stderr)
    if not rows:
        return
    title = "RMS error on logs that nothing has seen [°] (share inside the 95 % band)"
    table("one-map", title, ["rig", "filter alone", "readings alone", "filter and map"], rows)
    lines = []
    for name in VARIANTS:
        cells = []
        for kind in ("readings", "filter"):
            pairs = np.array(found[kind, name])
            ratio = np.exp(np.mean(np.log(pairs[:, 0] / np.array(found[kind, "as it is"])[:, 0])))
            cells.append(f"{ratio:.2f} ({100 * pairs[:, 1].mean():.0f} %)")
        lines.append((name, *cells))
    title = "RMS error over that of the map as it is, geometric mean of rigs"
    table("one-map-variants", title, ["variant", "readings alone", "beside the filter"], lines)


if __name__ == "__main__":
    main()
