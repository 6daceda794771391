"""Right rigs: is anything said to be wrong? `python -m benchmarks.false_alarms [--plants 100]`.

Plants are drawn from the stds of shipped rigs; with the truth beside the log, and without it. An
alarm is a finding that contradicts the rig where the truth is inside the band for 85 % or more.
"""

from __future__ import annotations

import argparse
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

from benchmarks.report import table
from distal import Rig, diagnose, estimate, load_scenario, scenario_rig, simulate
from distal.diagnosis import Diagnosis
from distal.study.design_space import built_values, draws_of, scores

SCENARIOS = ("lab-bench", "series-2", "finger", "wrist")
FIRST, LONGEST = 900, 12.0
ENOUGH = 0.85


def said(name: str, seed: int) -> tuple[float, Diagnosis, Diagnosis]:
    """Return of one plant the share inside, and what is said with the truth, and without it."""
    plan = load_scenario(name)
    rig: Rig = scenario_rig(plan)
    draws = draws_of(rig)
    plant = rig.with_values(built_values(rig, draws, scores(draws, [seed])))
    log = simulate(
        plant, plan.model_copy(update={"plant": {}, "duration": min(plan.duration, LONGEST)}), seed
    )
    result, blind = estimate(log, rig), replace(log, truth={})
    return (
        result.inside_band(),
        diagnose(result, log, rig),
        diagnose(estimate(blind, rig), blind, rig),
    )


def contradicts(diagnosis: Diagnosis) -> bool:
    """Return whether something is said to be wrong."""
    return any(finding.contradicts for finding in diagnosis.findings)


def main() -> None:
    """Print every alarm, and the table."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.false_alarms", description=__doc__)
    parser.add_argument("--plants", type=int, default=100)
    parser.add_argument("--first-seed", type=int, default=FIRST)
    given = parser.parse_args()
    rows, each = [], given.plants // len(SCENARIOS)
    with ProcessPoolExecutor() as pool:
        for name in SCENARIOS:
            found = list(
                pool.map(partial(said, name), range(given.first_seed, given.first_seed + each))
            )
            right, low = (
                [one for one in found if (one[0] >= ENOUGH) is held] for held in (True, False)
            )
            alarms = [[one[k].text for one in right if contradicts(one[k])] for k in (1, 2)]
            for text in (*alarms[0], *alarms[1]):
                print(f"{name}: {text[:200]}")
            named = sum(
                any(finding.kind == "would explain" for finding in one[1].findings) for one in right
            )
            identified = sum(contradicts(one[1]) for one in low)
            rows.append(
                [
                    name,
                    *(
                        f"{n}"
                        for n in (
                            len(found),
                            len(alarms[0]),
                            len(alarms[1]),
                            named,
                            len(low),
                            identified,
                        )
                    ),
                ]
            )
    columns = [
        "scenario",
        "plants",
        "alarms beside the truth",
        "without it",
        "a cause of an error inside the band named",
        "below 85 % inside",
        "of which told",
    ]
    table("false-alarms", "Right rigs of which something is said", columns, rows)


if __name__ == "__main__":
    main()
