"""The 2008 paper's Series 1 and 2 on the plant as observed; the filters know the rig `paper-2008`
as it is shipped.
"""

from __future__ import annotations

from functools import partial

from tests.support.cases import INTO_STOPS, MID_RANGE, PLANTS, WINDOW, WITHIN, paper_log

from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, by_case
from distal import load_rig, load_scenario, simulate

NAME = "series"
SERIES = ("series-1-soft", "series-1", "series-2", "series-2-medium", "series-2-high")
SOFT = {"tendons.0.stiffness": 403.0, "tendons.1.stiffness": 403.0}
SHIPPED = {"series-1-soft": "paper-2008-soft"}
"""The rig that the filters know where it is not `paper-2008`."""


def run(series: str, seed: int) -> list[Record]:
    """Simulate one test on Table 1 with the friction that was observed, and score all estimators
    with the shipped rig.
    """
    scenario = load_scenario(series)
    shipped = load_rig(SHIPPED.get(series, "paper-2008")).with_values(scenario.set)
    true = load_rig("paper-2008-printed").with_values(
        {**(SOFT if series == "series-1-soft" else {}), **scenario.set}
    )
    log = simulate(true, scenario.model_copy(update={"plant": PLANTS["as observed"]}), seed)
    return all_estimators(NAME, series, f"seed {seed}", log, shipped)


FRIENDLY = "friendly plants, paper-2008"


def friendly(seed: int) -> list[Record]:
    """Score plants within ±20 % friction and ±10 % stiffness of Table 1 with the shipped rig, which
    does not know that.
    """
    kinds = (*MID_RANGE, *INTO_STOPS)
    log = paper_log(kinds[seed % len(kinds)], WITHIN[seed % len(WITHIN)], seed)
    return all_estimators(
        NAME, FRIENDLY, f"seed {seed}", log, load_rig("paper-2008").with_values(WINDOW)
    )


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 5 seeds of each test, or 1."""
    made = [partial(run, series, first + i) for series in SERIES for i in range(1 if quick else 5)]
    return made + [partial(friendly, first + i) for i in range(2 if quick else 15)]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by test."""
    title = (
        "Series 1 and 2, plant as observed (slider friction 0.1 T, axle friction as its load "
        "to the power of 1.5)"
    )
    alike = [one for one in records if one.case == FRIENDLY]
    others = [one for one in records if one.case != FRIENDLY]
    known = "the paper's rig as shipped, paper-2008, on plants that are like Table 1"
    return [by_case(NAME, title, others, "all"), by_case(f"{NAME}-friendly", known, alike)]
