"""Sensors that fail for a moment or for good: glitches, bursts, a place that steps, samples that
are missing.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
from numpy.typing import NDArray
from tests.support.cases import MID_RANGE, scenario, spoiled

from benchmarks.strangers.plants import drawn_plant, wide_rig
from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, by_case
from distal import Log, simulate

NAME = "glitches"
POSITIONS = ("x1", "x2")
SMALLEST, TRAVEL = 50e-6, 20e-3
"""Sizes of a glitch [m]: from ten times the sensor's noise to the whole travel, alike on a
logarithmic scale.
"""

Floats = NDArray[np.float64]


def sizes(rng: np.random.Generator, n: int) -> Floats:
    """Return n glitches [m] of either sign."""
    made: Floats = np.exp(rng.uniform(np.log(SMALLEST), np.log(TRAVEL), n)) * rng.choice(
        [-1.0, 1.0], n
    )
    return made


def changed(log: Log, change: Callable[[Floats], Floats], names: tuple[str, ...]) -> Log:
    """Return the log with some channels changed."""
    channels = {
        name: change(np.array(v)) if name in names else v for name, v in log.channels.items()
    }
    return Log(log.time, channels, dict(log.truth), log.source, log.truth_source)


def single(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with 1 % of the displacements off by a glitch of one sample."""

    def change(values: Floats) -> Floats:
        hit = rng.random(len(values)) < 0.01
        return values + np.where(hit, sizes(rng, len(values)), 0.0)

    return changed(log, change, POSITIONS)


def bursts(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with bursts of five samples, each off by the same, once in two seconds and
    sensor.
    """

    def change(values: Floats) -> Floats:
        for start in np.flatnonzero(rng.random(len(values)) < 0.005):
            values[start : start + 5] += sizes(rng, 1)
        return values

    return changed(log, change, POSITIONS)


def stepped(log: Log, rng: np.random.Generator) -> Log:
    """Return the log with one displacement off by 0.3 to 3 mm from a moment on: its clamp has
    slipped.
    """
    start, by = float(rng.uniform(3, 9)), float(rng.uniform(0.3e-3, 3e-3) * rng.choice([-1.0, 1.0]))
    return changed(
        log,
        lambda values: values + np.where(log.time >= start, by, 0.0),
        (str(rng.choice(POSITIONS)),),
    )


def missing(log: Log, rng: np.random.Generator) -> Log:
    """Return the log without 30 % of each sensor's samples, and without all for half a second."""
    start = float(rng.uniform(3, 8))
    gap = (log.time > start) & (log.time <= start + 0.5)
    return changed(
        log,
        lambda values: np.where(gap | (rng.random(len(values)) < 0.3), np.nan, values),
        ("x1", "x2", "u1", "u2"),
    )


SPOILS: dict[str, Callable[[Log, np.random.Generator], Log]] = {
    "as recorded": lambda log, rng: log,
    "glitches of one sample, up to the travel": single,
    "bursts of five samples": bursts,
    "a place that steps": stepped,
    "30 % missing, a gap of 0.5 s": missing,
    "30 % missing, 2 % wild, a gap (make accuracy)": lambda log, rng: spoiled(
        log, int(rng.integers(1 << 31))
    ),
}


def run(kind: str, seed: int) -> list[Record]:
    """Simulate one log and score all estimators on it, as it is and spoiled in each way."""
    rng = np.random.default_rng([seed, MID_RANGE.index(kind), 52])
    named = scenario(kind, "as the rig", 500 + seed).model_copy(update={"plant": drawn_plant(rng)})
    rig = wide_rig()
    log = simulate(rig, named, seed)
    records = []
    for i, (case, spoil) in enumerate(SPOILS.items()):
        bad = spoil(log, np.random.default_rng([seed, MID_RANGE.index(kind), i, 53]))
        records += all_estimators(NAME, case, f"{kind}, seed {seed}", bad, rig)
    return records


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: ramps, weights and servos, 6 seeds each, or 1."""
    return [partial(run, kind, first + i) for kind in MID_RANGE for i in range(1 if quick else 6)]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by kind of failure."""
    title = (
        "Sensors that fail: ramps, weights and servos mid-range, plants within ±20 % "
        "friction, ±10 % stiffness"
    )
    return [by_case(NAME, title, records)]
