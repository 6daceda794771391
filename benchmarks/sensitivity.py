"""What `adaptive` owes to its choices: `python -m benchmarks.sensitivity` prints tables.

The prior of friction that the rig does not know of, against mid-range accuracy and against plants
that have some; and what declaring that friction gives. Errors are of the joint angle, pooled over
5 seeds; `--seeds 1` is quicker.
"""

from __future__ import annotations

import argparse
import os
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import lru_cache

import numpy as np
from rich.progress import track
from tests.support.cases import (
    HARD,
    INTO_STOPS,
    MID_RANGE,
    SCENARIOS,
    WITHIN,
    paper_log,
    paper_rig,
)

from benchmarks.report import table
from distal import estimate
from distal.confidence import BAND
from distal.estimators import AdaptiveFilter, Robustness

SEEDS = 5
PRIORS = ((0.7, 0.5), (0.7, 0.6), (0.7, 1.0), (1.0, 1.0), (1.0, 2.0))
"""Standard deviation and random walk per √s of unknown friction, in σ of the force sensor."""


@lru_cache(maxsize=16)
def _filter(prior: tuple[float, float]) -> AdaptiveFilter:
    std, walk = prior
    guards = Robustness(unknown_friction=std, unknown_friction_walk=walk)
    return AdaptiveFilter(paper_rig("as the rig"), robustness=guards)


USUAL = Robustness().unknown_friction, Robustness().unknown_friction_walk


@lru_cache(maxsize=1)
def _declared() -> AdaptiveFilter:
    values = {f"drives.{i}.friction.constant": {"value": 0.5, "std": 0.5} for i in range(2)}
    return AdaptiveFilter(paper_rig("as the rig").with_values(values))


def run(
    job: tuple[str, str, str, int, tuple[float, float]],
) -> tuple[float, float, float]:
    """Return mean square error, share inside the band, median std of one log."""
    what, kind, plant, seed, prior = job
    used = _declared() if what == "declared" else _filter(prior)
    result = estimate(paper_log(kind, plant, seed), used.rig, used)
    square = float(np.mean(result.errors() ** 2))
    return square, result.inside_band(), float(np.median(result.theta_std))


def said(scores: Sequence[tuple[float, float, float]]) -> list[str]:
    """Return the cells of pooled scores: RMS error, inside the band, half-width over RMS."""
    square, inside, std = np.mean(np.array(scores), axis=0)
    rms = np.sqrt(square)
    return [
        f"{np.rad2deg(rms):.2f}",
        f"{100 * inside:.0f} %",
        f"{BAND * std / rms:.1f}",
    ]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=SEEDS)
    seeds = range(parser.parse_args().seeds)
    prior = USUAL
    jobs = [
        ("whole", kind, plant, seed, pair)
        for pair in PRIORS
        for kind in SCENARIOS
        for plant in (*WITHIN, *HARD)
        for seed in seeds
    ]
    jobs += [
        ("declared", kind, plant, seed, prior)
        for kind in MID_RANGE
        for plant in HARD
        for seed in seeds
    ]
    with ProcessPoolExecutor(os.cpu_count()) as pool:
        results = list(
            track(pool.map(run, jobs, chunksize=25), "logs", total=len(jobs), transient=True)
        )
    scores = dict(zip(jobs, results))

    def chosen(**desired: object) -> list[tuple[float, float, float]]:
        names = ("what", "kind", "plant", "seed", "prior")
        return [
            score
            for job, score in scores.items()
            if all(
                value in desired[name]
                if isinstance(desired.get(name), list)
                else desired.get(name, value) == value
                for name, value in zip(names, job)
            )
        ]

    cells = ["RMS [°]", "inside", "half-width / RMS"]
    cases = (
        ("mid-range, within", list(MID_RANGE), list(WITHIN)),
        ("into the stops, within", list(INTO_STOPS), list(WITHIN)),
        ("beyond", list(SCENARIOS), list(HARD)),
    )
    table(
        "sensitivity-priors",
        "Friction that the rig does not know of: its prior and its random walk [σ, σ/√s of the "
        "force sensor]",
        ["prior", "walk", "case", *cells],
        [
            [
                f"{pair[0]}",
                f"{pair[1]}",
                name,
                *said(chosen(what="whole", prior=pair, kind=kinds, plant=plants)),
            ]
            for pair in PRIORS
            for name, kinds, plants in cases
        ],
    )
    table(
        "sensitivity-declared",
        "Friction of the drives declared as 0.5 ± 0.5 N, or not",
        ["rig file", "plant", *cells],
        [
            [how, plant, *said(chosen(what=what, prior=prior, kind=list(MID_RANGE), plant=plant))]
            for what, how in (("whole", "none"), ("declared", "0.5 ± 0.5 N"))
            for plant in HARD
        ],
    )


if __name__ == "__main__":
    main()
