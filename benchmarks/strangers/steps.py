"""Loads that step within one sample, on plants within the rig's stds: mid-range, and driven into
the stops.
"""

from __future__ import annotations

from functools import partial

import numpy as np
from tests.support.cases import DURATION

from benchmarks.strangers.plants import drawn_plant, wide_rig
from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, by_case, score_known
from distal import simulate
from distal.simulation import build_scenario

NAME = "steps"
FAST, SLOW = (0.5, 1.0), (1.0, 2.0)
KINDS = {
    "mid-range, forces every 0.5 to 1 s": ("force", FAST, (4.3, 5.2)),
    "mid-range, forces every 1 to 2 s": ("force", SLOW, (4.3, 5.2)),
    "mid-range, hung weights every 1 to 2 s": ("weight", SLOW, (4.3, 5.2)),
    "into stops, forces every 0.5 to 1 s": ("force", FAST, (5.0, 8.0)),
    "into stops, forces every 1 to 2 s": ("force", SLOW, (5.0, 8.0)),
    "into stops, hung weights every 1 to 2 s": ("weight", SLOW, (5.0, 8.0)),
}
"""Case → how the sliders are pulled, after what time the loads change over [s], and the larger load
[N].
"""
ALONE = "mid-range, one force at a time"
"""A case in which each force steps when it likes, every 1.5 to 2.5 s, to 2 to 5 N."""
CASES = (*KINDS, ALONE)


def loads(
    rng: np.random.Generator, every: tuple[float, float], upper: tuple[float, float]
) -> dict[str, dict[str, object]]:
    """Return loads of which now one, now the other is the larger; both step within one interval of
    the simulation.
    """
    time, points = 0.0, {"left": [[0.0, 3.0]], "right": [[0.0, 3.0]]}
    left = bool(rng.integers(2))
    while time < DURATION:
        time, left = time + float(rng.uniform(*every)), not left
        large, small = float(rng.uniform(*upper)), float(rng.uniform(1.8, 2.2))
        points["left"].append([time, large if left else small])
        points["right"].append([time, small if left else large])
    return {name: {"points": held, "interpolation": "hold"} for name, held in points.items()}


def one_at_a_time(rng: np.random.Generator) -> dict[str, dict[str, object]]:
    """Return loads that step independently of each other."""
    made: dict[str, dict[str, object]] = {}
    for name in ("left", "right"):
        time, points = 0.0, [[0.0, 3.0]]
        while time < DURATION:
            time += float(rng.uniform(1.5, 2.5))
            points.append([time, float(rng.uniform(2.0, 5.0))])
        made[name] = {"points": points, "interpolation": "hold"}
    return made


def run(case: str, seed: int) -> list[Record]:
    """Simulate one log and score all estimators on it."""
    rng = np.random.default_rng([seed, CASES.index(case), 51])
    plant = drawn_plant(rng)
    how, pulls = "force", {}
    if case == ALONE:
        pulls = one_at_a_time(rng)
    else:
        how, every, upper = KINDS[case]
        pulls = loads(rng, every, upper)
    raw = {
        "rig": "paper-2008-printed",
        "name": f"{case}, seed {seed}",
        "duration": DURATION,
        "plant": plant,
        "drives": {name: {how: load} for name, load in pulls.items()},
        "initial": {"link": float(np.deg2rad(np.clip(rng.normal(0, 3), -6, 6)))},
    }
    rig = wide_rig()
    log = simulate(rig, build_scenario(raw, str(raw["name"])), seed)
    records = all_estimators(NAME, case, f"seed {seed}", log, rig)
    return [*records, score_known(NAME, case, f"seed {seed}", log, rig, plant)]


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 8 seeds of each case, or 1."""
    return [partial(run, case, first + i) for case in CASES for i in range(1 if quick else 8)]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by case."""
    title = (
        "Loads that step within one sample; friction within ±20 %, stiffness within ±10 % of "
        "the rig's"
    )
    return [by_case(NAME, title, records)]
