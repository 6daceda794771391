"""The 2008 paper's Series 1 and 2 on the plant as observed; the filters know the rig `paper-2008` as it is shipped."""

from __future__ import annotations

from functools import partial

from benchmarks.cases import PLANTS
from benchmarks.strangers.library import load_rig, load_scenario, printed_rig, simulate
from benchmarks.strangers.scoring import Job, Record, Table, all_estimators, by_case

NAME = "series"
SERIES = ("series-1-soft", "series-1", "series-2", "series-2-medium", "series-2-high")
SOFT = {"tendons.0.stiffness": 403.0, "tendons.1.stiffness": 403.0}
SHIPPED = {"series-1-soft": "paper-2008-soft"}
"""The rig that the filters know where it is not `paper-2008`."""


def run(series: str, seed: int) -> list[Record]:
    """Simulate one test on Table 1 with the friction that was observed, and score all estimators with the shipped rig."""
    scenario = load_scenario(series)
    shipped = load_rig(SHIPPED.get(series, "paper-2008")).with_values(scenario.set)
    true = printed_rig().with_values({**(SOFT if series == "series-1-soft" else {}), **scenario.set})
    log = simulate(true, scenario.model_copy(update={"plant": PLANTS["as observed"]}), seed)
    return all_estimators(NAME, series, f"seed {seed}", log, shipped)


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 5 seeds of each test, or 1."""
    return [partial(run, series, first + i) for series in SERIES for i in range(1 if quick else 5)]


def tables(records: list[Record]) -> list[Table]:
    """Return the table by test."""
    title = "Series 1 and 2, plant as observed (slider friction 0.1 T, axle friction as its load to the power of 1.5)"
    return [by_case(NAME, title, records, "all")]
