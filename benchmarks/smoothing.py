"""The smoother against the filter: `python -m benchmarks.smoothing` prints RMS error and share
inside the band of both.
"""

from __future__ import annotations

import os
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from tests.support.cases import (
    INTO_STOPS,
    MID_RANGE,
    hand_log,
    hand_rig,
    paper_log,
    paper_rig,
    spoiled,
)

from benchmarks.report import table
from distal import (
    Log,
    Rig,
    estimate,
    load_scenario,
    scenario_rig,
    shipped_scenarios,
    simulate,
    smooth,
)

SEEDS = 20


def logs_of(name: str, seed: int) -> tuple[Log, Rig]:
    """Return one log of a row of the table, and the rig that the filter knows."""
    if name in shipped_scenarios():
        scenario = load_scenario(name)
        rig = scenario_rig(scenario)
        return simulate(rig, scenario, seed), rig
    if name == "hand":
        return hand_log(seed), hand_rig("given")
    kinds = MID_RANGE if "mid-range" in name else INTO_STOPS
    log, rig = paper_log(kinds[seed % len(kinds)], "as the rig", seed), paper_rig("as the rig")
    return (spoiled(log, seed), rig) if "spoiled" in name else (log, rig)


ROWS = (
    *shipped_scenarios(),
    "mid-range",
    "mid-range, spoiled",
    "into stops",
    "into stops, spoiled",
    "hand",
)


def run(job: tuple[str, int]) -> list[float]:
    """Return mean square error and share inside of the filter, then of the smoother."""
    log, rig = logs_of(*job)
    results = (estimate(log, rig), smooth(log, rig))
    return [
        part
        for result in results
        for part in (float(np.mean(result.errors() ** 2)), result.inside_band())
    ]


def main() -> None:
    """Print the table."""
    jobs = [(name, seed) for name in ROWS for seed in range(SEEDS)]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        found = np.array(list(pool.map(run, jobs, chunksize=4))).reshape(len(ROWS), SEEDS, 4)
    rows = []
    for name, each in zip(ROWS, found.mean(axis=1)):
        one, other = np.rad2deg(np.sqrt(each[[0, 2]]))
        cells = [
            f"{one:.3f}",
            f"{other:.3f}",
            f"{other / one:.3f}",
            f"{100 * each[1]:.0f} %",
            f"{100 * each[3]:.0f} %",
        ]
        rows.append([name, *cells])
    heads = ["logs", "filter [°]", "smoother [°]", "ratio", "inside, filter", "inside, smoother"]
    table("smoothing", f"RMS error over {SEEDS} seeds", heads, rows)


if __name__ == "__main__":
    main()
