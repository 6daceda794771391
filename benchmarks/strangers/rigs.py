"""300 random rigs with plants drawn from their own stds: who is off, who is inside, who is told
that all is well.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.strangers.random_rigs import random_case
from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, score_known
from distal import Log, Rig
from distal.rig import step_of

NAME = "rigs"
CLEAN, SPOILED = "as recorded", "30 % missing, 2 % wild"


def spoilt(log: Log, rig: Rig, seed: int) -> Log:
    """Return the log without 30 % of each sensor's samples, 2 % of the rest off by 20 to 200
    standard deviations.
    """
    rng = np.random.default_rng([seed, 301])
    channels = {}
    for sensor in rig.sensors:
        values = np.array(log.channels[sensor.name])
        sigma = np.hypot(sensor.noise, step_of(sensor) / np.sqrt(12.0))
        wild = rng.random(len(values)) < 0.02
        values += np.where(
            wild, sigma * rng.uniform(20, 200, len(values)) * rng.choice([-1, 1], len(values)), 0.0
        )
        values[rng.random(len(values)) < 0.3] = np.nan
        channels[sensor.name] = values
    return Log(log.time, channels, dict(log.truth), log.source, log.truth_source)


def run(seed: int) -> list[Record]:
    """Draw one rig and score all estimators on its log, whole and spoiled; and `adaptive` with the
    plant's own values.
    """
    case = random_case(seed)
    name = f"{seed}: {case.about}"
    records = all_estimators(NAME, CLEAN, name, case.log, case.rig)
    records.append(score_known(NAME, CLEAN, name, case.log, case.rig, case.plant))
    return records + all_estimators(NAME, SPOILED, name, spoilt(case.log, case.rig, seed), case.rig)


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 300 rigs, or 30."""
    return [partial(run, first + i) for i in range(30 if quick else 300)]


COLUMNS = (
    ("rigs", 0),
    ("median RMS [°]", 2),
    ("inside 95 % band, mean [%]", 0),
    ("below half inside [%]", 1),
    ("diverged", 0),
    ("refused", 0),
)


def summary(records: list[Record]) -> tuple[float, ...]:
    """Return the numbers of `COLUMNS` for the records of one estimator."""
    inside = np.array([one.inside for one in records])
    notes = [one.note for one in records]
    return (
        float(len(records)),
        float(np.median([one.rms for one in records])),
        100.0 * float(np.mean(inside)),
        100.0 * float(np.mean(inside < 0.5)),
        float(notes.count("diverged")),
        float(notes.count("refused")),
    )


def tables(records: list[Record]) -> list[Table]:
    """Return the summary by logs and estimator."""
    groups: dict[tuple[str, ...], list[Record]] = {}
    for one in sorted(records, key=lambda one: one.case == SPOILED):
        groups.setdefault((one.case, one.estimator), []).append(one)
    rows = {group: summary(chosen) for group, chosen in groups.items()}
    title = "Random rigs, plants drawn from the rigs' own stds"
    return [Table("strangers-rigs", title, ("logs", "estimator"), COLUMNS, rows)]
