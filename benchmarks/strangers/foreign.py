"""Rigs with physics that the model lacks: fitted to three logs of 30 s, judged on others that
nothing has seen.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial

from tests.support.foreign_plants import finger_log, finger_rig, hand_log, hand_rig

from benchmarks.strangers.scoring import Job, Record, Table, by_case, score
from distal import Log, Rig, fit

NAME = "foreign"
FITTED = 3
"""So many logs are fitted to."""

PLANTS: dict[str, tuple[Callable[[int], Log], Callable[[], Rig]]] = {
    "finger with a Bowden cable": (finger_log, finger_rig),
    "two motors, creep, backlash": (hand_log, hand_rig),
}


def run(case: str, first: int, judged: int) -> list[Record]:
    """Score the rig as it came and as fitted on logs of other seeds."""
    log_of, rig_of = PLANTS[case]
    rig = rig_of()
    found = fit([log_of(first + seed) for seed in range(FITTED)], rig)
    records = []
    for seed in range(first + FITTED, first + FITTED + judged):
        log = log_of(seed)
        before = replace(
            score(NAME, case, str(seed), log, rig, "adaptive"), estimator="adaptive, rig as it came"
        )
        records += [
            before,
            *(
                score(NAME, case, str(seed), log, found.rig, name)
                for name in ("adaptive", "regression")
            ),
        ]
    return records


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: two plants, four fits of each."""
    return [
        partial(run, case, first + 100 * i, 3) for case in PLANTS for i in range(1 if quick else 4)
    ]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by plant."""
    title = (
        "rigs with other physics, fitted to three logs of 30 s, judged on three others; four "
        "such fits"
    )
    return [by_case(NAME, title, records)]
