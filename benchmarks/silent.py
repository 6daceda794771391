"""A place that is read no more: what is said of the angle then.

`python -m benchmarks.silent`: seeds and logs on which no number of (4b) was chosen, with
DISTAL_DATA those of the real da Vinci grasper too.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from benchmarks.report import table
from distal import (
    Log,
    Rig,
    estimate,
    load_rig,
    load_scenario,
    read_log,
    scenario_rig,
    simulate,
)
from distal.estimators import channels_of

SEEDS = range(11, 16)
LATER = 2.0
"""Errors count from so long after the last reading [s]."""


def silent(log: Log, channel: str, since: int) -> Log:
    """Return a log in which a sensor says nothing from a sample on."""
    values = log.channels[channel].copy()
    values[since:] = np.nan
    return Log(log.time, {**log.channels, channel: values}, log.truth, "silent", log.truth_source)


def cases() -> Iterator[tuple[str, Rig, Log, float | None]]:
    """Return what is simulated, logs of other simulators and real ones: name, rig, log, homing
    [s].
    """
    for name in ("lab-bench", "series-2", "template", "finger", "wrist"):
        scenario = load_scenario(name)
        for seed in SEEDS:
            yield (
                name,
                scenario_rig(scenario),
                simulate(scenario_rig(scenario), scenario, seed),
                None,
            )
    folder = os.environ.get("DISTAL_DATA")
    if folder:
        rig = load_rig("da-vinci-grasper")
        for path in sorted((Path(folder) / "da_vinci_grasper").glob("run_*.csv")):
            yield "da Vinci grasper, real", rig, read_log(path, rig), 3.0


def main() -> None:
    """Let each place be silent from a quarter and from half of each log on."""
    found: dict[str, list[np.ndarray]] = {}
    for name, rig, log, homing in cases():
        for channel in (sensor.name for sensor in channels_of(rig, "adaptive").positions):
            for share in (0.25, 0.5):
                since = int(share * len(log))
                result = estimate(silent(log, channel, since), rig, homing=homing)
                assert result.truths is not None
                late = log.time > log.time[since] + LATER
                errors = (result.angles - result.truths)[late]
                found.setdefault(name, []).append(np.abs(errors / result.angle_stds[late]))
    rows = [
        [
            name,
            f"{len(ratios)}",
            f"{np.mean([np.mean(each < 1.96) for each in ratios]):.0%}",
            f"{np.median([np.sqrt(np.mean(each**2)) for each in ratios]):.1f}",
            f"{max(np.sqrt(np.mean(each**2)) for each in ratios):.1f}",
        ]
        for name, ratios in found.items()
    ]
    columns = ["log", "runs", "inside the band", "RMS error in stds, median", "worst"]
    table("silent", "A drive's place is read no more: from 2 s later on, all joints", columns, rows)


if __name__ == "__main__":
    main()
