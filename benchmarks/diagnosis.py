"""What a diagnosis costs beside its estimate: `python -m benchmarks.diagnosis`; with DISTAL_DATA
the given rigs too.

Best of six; kernels are in the cache, so that writing C and compiling are left out.
"""

from __future__ import annotations

import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TypeVar

from benchmarks.ladder import GIVEN, placed
from benchmarks.report import table
from distal import Log, Rig, diagnose, estimate, load_scenario, read_log, scenario_rig, simulate

Found = TypeVar("Found")


def best(call: Callable[[], Found], times: int = 6) -> tuple[float, Found]:
    """Return the least time of some calls [ms], and what the last one gave."""
    costs = []
    for _ in range(times):
        begun = time.perf_counter()
        found = call()
        costs.append(1e3 * (time.perf_counter() - begun))
    return min(costs), found


def logs(folder: Path) -> dict[str, tuple[Log, Rig]]:
    """Return a log of the tutorial's bench, and of the given rigs where they are."""
    scenario = load_scenario("lab-bench", ['duration="30 s"'])
    rig = scenario_rig(scenario)
    found = {"lab-bench": (simulate(rig, scenario, 1), rig)}
    for name in GIVEN if "DISTAL_DATA" in os.environ else ():
        rig = placed(name, 9000, folder / f"{name}.csv")([])
        found[name] = read_log(folder / f"{name}.csv", rig), rig
    return found


def main() -> None:
    """Print a row for each rig, with a truth and without."""
    rows = []
    with tempfile.TemporaryDirectory() as folder:
        for name, (log, rig) in logs(Path(folder)).items():
            for what, one in (("with a truth", log), ("without", replace(log, truth={}))):
                alone, result = best(lambda one=one, rig=rig: estimate(one, rig))
                whole, _ = best(lambda one=one, rig=rig, result=result: diagnose(result, one, rig))
                rows.append(
                    [
                        name,
                        what,
                        f"{len(log)}",
                        f"{alone:.0f}",
                        f"{whole:.0f}",
                        f"{whole / alone:.1f}",
                    ]
                )
    columns = ["rig", "log", "samples", "estimate [ms]", "diagnosis [ms]", "ratio"]
    table("diagnosis", "A diagnosis beside its estimate", columns, rows)


if __name__ == "__main__":
    main()
