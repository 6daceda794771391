"""Two rigs as labs have them (`tests.support.hands_plants`): fitted to three calibration logs,
judged on other motions of other seeds.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from functools import partial

from tests.support.hands_plants import bowden_log, bowden_rig, ropes_log, ropes_rig

from benchmarks.strangers.scoring import Job, Record, Table, by_case, score
from distal import Log, Rig, fit

NAME = "hands"
FITTED = 3
"""So many calibration logs are fitted to."""

TOUCHED: Mapping[str, object] = {"joints.0.external_torque.std": "0.015 N m"}
"""What a user says of logs in which a hand may touch the finger."""

PLANTS: dict[str, tuple[Callable[[int, str], Log], Callable[[], Rig], tuple[str, ...]]] = {
    "Bowden finger": (bowden_log, bowden_rig, ("ramps", "stops", "hand")),
    "two motors": (ropes_log, ropes_rig, ("ramps", "holds")),
}


def run(case: str, first: int, judged: int) -> list[Record]:
    """Score the fitted rig, `regression` from the same logs, and the rig as it came."""
    log_of, rig_of, kinds = PLANTS[case]
    rig = rig_of()
    found = fit([log_of(first + seed, "calibration") for seed in range(FITTED)], rig).rig
    records = []
    for kind in kinds:
        said = TOUCHED if kind == "hand" else {}
        for seed in range(first + FITTED, first + FITTED + judged):
            log, row = log_of(seed, kind), f"{case}: {kind}"
            for name in ("adaptive", "regression"):
                records.append(score(NAME, row, str(seed), log, found.with_values(said), name))
    return records


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: two plants, two fits of each."""
    return [
        partial(run, case, first + 100 * i, 3) for case in PLANTS for i in range(1 if quick else 2)
    ]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by plant and motion."""
    title = (
        "rigs with sheath, slack, cogging, counts; and with creep, backlash, gains: fitted to "
        "three logs of 30 s"
    )
    return [by_case(NAME, title, records)]
