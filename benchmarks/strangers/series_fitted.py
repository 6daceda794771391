"""The paper's series on the plant as observed: `paper-2008` fitted to one run of each but 4 N / 12
N, judged on others.

`python -m benchmarks.strangers.series_fitted`: on its own, since its kernels are worth compiling.
"""

from __future__ import annotations

import warnings
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

from tests.support.cases import PLANTS

from benchmarks.strangers.library import Log, fit, load_rig, load_scenario, printed_rig, simulate
from benchmarks.strangers.scoring import Record, by_case, score, score_known
from benchmarks.strangers.storage import show

NAME = "series-fitted"
FITTED = ("series-1", "series-2", "series-2-medium")
JUDGED = (*FITTED, "series-2-high")
OBSERVED = PLANTS["as observed"]

ONE_RIG = {
    "drives.0.stops": ("-12 mm", "30 mm"),
    "drives.1.stops": ("-12 mm", "30 mm"),
    "joints.0.initial": {"value": "-10 deg", "std": "15 deg"},
}
"""What makes one rig of the tests: they start elsewhere, and each has its own window of the travel.
"""


def log_of(series: str, seed: int) -> Log:
    """Simulate one test on Table 1 with the friction that was observed."""
    scenario = load_scenario(series)
    rig = printed_rig().with_values(scenario.set)
    return simulate(rig, scenario.model_copy(update={"plant": OBSERVED}), seed)


def run(first: int, judged: int) -> list[Record]:
    """Fit once, and score the fitted rig, `regression`, the rig as it came, and the filter that is
    given the plant.
    """
    rig = load_rig("paper-2008").with_values(ONE_RIG)
    found = fit([log_of(series, first) for series in FITTED], rig)
    records = []
    for series in JUDGED:
        for seed in range(first + 1, first + 1 + judged):
            log, name = log_of(series, seed), f"{first}: {seed}"
            before = replace(
                score(NAME, series, name, log, rig, "adaptive"),
                estimator="adaptive, rig as it came",
            )
            records += [
                before,
                *(
                    score(NAME, series, name, log, found.rig, each)
                    for each in ("adaptive", "regression")
                ),
            ]
            records.append(score_known(NAME, series, name, log, rig, OBSERVED))
    return records


def main() -> None:
    """Run four fits, each judged on two other seeds, and print the table."""
    warnings.simplefilter("ignore")
    with ProcessPoolExecutor(2) as pool:
        records = [
            record for part in pool.map(partial(run, judged=2), range(0, 40, 10)) for record in part
        ]
    title = (
        "paper-2008 fitted to one run each of series-1, series-2, series-2-medium, plant as "
        "observed; on other seeds"
    )
    show(by_case(NAME, title, records, "all"))


if __name__ == "__main__":
    main()
