"""A push on a simulated finger, seen."""

from __future__ import annotations

from functools import partial

import numpy as np
from tests.support.pushed_finger import finger

from benchmarks.strangers.library import (
    estimate,
)
from benchmarks.strangers.scoring import Job, Record, Table
from distal import Estimate

NAME = "contact"


def contacts(result: Estimate) -> list[float]:
    """Return the times at which contacts with the first joint begin [s]: where the external torque
    exceeds five of its standard deviations, after it was below half of that.
    """
    stds = np.maximum(result.external_torque_stds[:, 0], 1e-300)
    ratio = np.abs(result.external_torques[:, 0]) / stds
    onsets = list[float]()
    touched = False
    for time, level in zip(result.time.tolist(), ratio.tolist()):
        if not touched and level > 5.0:
            onsets.append(time)
        touched = level > (2.5 if touched else 5.0)
    return onsets


def onset(seed: int) -> list[Record]:
    """Return how long after a push its onset is seen [ms], or how many are seen where there is
    none.
    """
    pushed = 3.0 + 0.37 * (seed % 7)
    log, rig = finger(seed, pushed + 3.5, pushed)
    result = estimate(log, rig)
    seen = [time for time in contacts(result) if time >= pushed]
    late = 1e3 * (seen[0] - pushed) if seen else float("inf")
    early = sum(0.5 < time < pushed for time in contacts(result))
    return [
        Record(
            NAME,
            "push of 0.07 N m",
            str(seed),
            "adaptive",
            min(late, 9999.0),
            float(late <= 100.0),
            early,
            None,
        )
    ]


def quiet(seed: int) -> list[Record]:
    """Return how many onsets are seen in a minute without any."""
    log, rig = finger(seed, 60.0, None)
    seen = [time for time in contacts(estimate(log, rig)) if time > 0.5]
    return [
        Record(
            NAME,
            "a minute without a push",
            str(seed),
            "adaptive",
            float(len(seen)),
            float(not seen),
            0.0,
            None,
        )
    ]


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 40 pushes, ten minutes without one."""
    made: list[Job] = [partial(onset, first + seed) for seed in range(8 if quick else 40)]
    made += [partial(quiet, first + 1000 + seed) for seed in range(2 if quick else 10)]
    return made


def tables(records: list[Record]) -> list[Table]:
    """Return the table of onsets."""
    found = list[Table]()
    onsets: dict[tuple[str, ...], tuple[float, ...]] = {}
    pushes = [one for one in records if one.case.startswith("push")]
    calm = [one for one in records if one.case.startswith("a minute")]
    if pushes and calm:
        lates = [one.rms for one in pushes]
        onsets[("finger",)] = (
            float(len(pushes)),
            100.0 * float(np.mean([one.inside for one in pushes])),
            float(np.median(lates)),
            float(len(calm)),
            sum(one.rms for one in calm) + sum(one.half for one in pushes),
        )
        heads = (
            ("pushes", 0),
            ("seen within 0.1 s [%]", 0),
            ("median delay [ms]", 0),
            ("minutes without", 0),
            ("false onsets", 0),
        )
        found.append(
            Table(
                f"strangers-{NAME}-onset",
                "a push of 0.07 N m on a simulated finger",
                ("rig",),
                heads,
                onsets,
            )
        )
    return found
