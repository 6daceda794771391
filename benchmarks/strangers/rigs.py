"""300 random rigs with plants drawn from their own stds: who is off, who is inside, who is told
that all is well.
"""

from __future__ import annotations

from functools import partial

import numpy as np

from benchmarks.strangers.library import Log, Rig
from benchmarks.strangers.random_rigs import random_case
from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, score_known, share
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
    ("median half-width / RMS", 1),
    ("below half inside [%]", 1),
    ("of these consistent [%]", 0),
    ("of those ≥ 90 % inside consistent [%]", 0),
    ("worse than inextensible (1.5 × + 0.5°) [%]", 1),
    ("diverged", 0),
    ("refused", 0),
)


def summary(records: list[Record], others: dict[tuple[str, str], float]) -> tuple[float, ...]:
    """Return the numbers of `COLUMNS`.

    Args:
        records: of one estimator.
        others: RMS of `inextensible` by case and log.
    """
    low = [one for one in records if one.inside < 0.5]
    good = [one for one in records if one.inside >= 0.9]
    worse = [one.rms > 1.5 * others[(one.case, one.log)] + 0.5 for one in records]
    return (
        float(len(records)),
        float(np.median([one.rms for one in records])),
        100.0 * float(np.mean([one.inside for one in records])),
        float(np.median([one.half / max(one.rms, 1e-12) for one in records])),
        100.0 * len(low) / len(records),
        share(one.consistent for one in low),
        share(one.consistent for one in good),
        share(worse),
        float(sum(1 for one in records if one.note == "diverged")),
        float(sum(1 for one in records if one.note == "refused")),
    )


GROUPS = {
    "one tendon": lambda about: about.startswith("1 tendon"),
    "capstan": lambda about: "capstan" in about,
    "sliders, two tendons or more": lambda about: (
        "capstan" not in about and not about.startswith("1 tendon")
    ),
    "with forces": lambda about: "no forces" not in about,
    "without forces": lambda about: "no forces" in about,
    "pinned": lambda about: "pinned" in about,
    "spring or gravity": lambda about: "spring" in about or "gravity" in about,
    "mode above a fifth of the rate": lambda about: _share_of_rate(about) > 0.2,
}


def _share_of_rate(about: str) -> float:
    mode, _, rest = about.rpartition(" Hz mode at ")
    return float(mode.rsplit(" ", 1)[1]) / float(rest.split(" ")[0])


def tables(records: list[Record]) -> list[Table]:
    """Return the summary by estimator, that of `adaptive` by kind of rig, and its worst rigs."""
    others = {(one.case, one.log): one.rms for one in records if one.estimator == "inextensible"}
    rows = {}
    for case in (CLEAN, SPOILED):
        for estimator in dict.fromkeys(one.estimator for one in records):
            chosen = [one for one in records if (one.case, one.estimator) == (case, estimator)]
            if chosen:
                rows[(case, estimator)] = summary(chosen, others)
    title = "Random rigs, plants drawn from the rigs' own stds"
    made = [Table("strangers-rigs", title, ("logs", "estimator"), COLUMNS, rows)]
    adaptive = [one for one in records if one.estimator == "adaptive" and one.case == CLEAN]
    groups = {}
    for name, belongs in GROUPS.items():
        chosen = [one for one in adaptive if belongs(one.log.partition(": ")[2])]
        if chosen:
            groups[(name,)] = summary(chosen, others)
    made.append(
        Table(
            "strangers-rigs-kinds",
            "`adaptive` by kind of rig, logs as recorded",
            ("rigs",),
            COLUMNS,
            groups,
        )
    )
    worst = sorted(adaptive, key=lambda one: one.inside - 1e-3 * one.rms)[:12]
    columns = (
        ("RMS [°]", 2),
        ("`inextensible` [°]", 2),
        ("inside [%]", 0),
        ("half-width [°]", 2),
        ("consistent", 0),
    )
    found = {
        (one.log,): (
            one.rms,
            others[(one.case, one.log)],
            100 * one.inside,
            one.half,
            _flag(one.consistent),
        )
        for one in worst
    }
    made.append(
        Table(
            "strangers-rigs-worst",
            "The rigs with the least inside (consistent: 1)",
            ("rig",),
            columns,
            found,
        )
    )
    return made


def _flag(value: bool | None) -> float:
    return float("nan") if value is None else float(value)
