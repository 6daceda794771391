"""What the power of the equations' likelihood is worth (`distal.fitting.inverse_dynamics.POWER`).

`python -m benchmarks.likelihood_power [--powers 1 0.1] [--benches 4] [--first-seed 11500] [--only
finger-2n]` fits with each power the bench of the tutorial, whose rig file has all physics, and
learns the plants of `benchmarks.learned`, which share no code with `distal.model`. Printed are the
errors of the bench's parameters over their stds, and the errors of the angle on free logs that
nothing has seen.
"""

from __future__ import annotations

import argparse
import tempfile
import warnings
from collections.abc import Iterator
from pathlib import Path
from unittest import mock

import numpy as np
from numpy.typing import NDArray

from benchmarks.learned import drawn_cases, outcome_of
from benchmarks.report import table
from distal import fit, learn, load_scenario, read_log, scenario_rig, simulate, write_log
from distal.fitting.inverse_dynamics import InverseProblem
from distal.rig import number

LOGS = 3
"""Logs of the bench for each fit."""


def bench_errors(seed: int, folder: Path) -> Iterator[float]:
    """Yield the error of each parameter of the tutorial's bench in its standard errors, with an
    encoder in the joint.
    """
    scenario = load_scenario("lab-bench")
    rig = scenario_rig(scenario)
    true = scenario.plant_rig(rig)
    logs = []
    for k in range(LOGS):
        path = folder / f"run_{seed}_{k}.csv"
        write_log(simulate(rig, scenario, LOGS * seed + k), rig, path)
        logs.append(read_log(path, rig))
    for part in fit(logs, rig).fitted:
        if not part.noise and part.paths[0] in ASKED:
            yield (part.value - number(true, part.paths[0]).value) / part.std


ASKED = (
    "tendons.0.stiffness",
    "tendons.0.pretension",
    "tendons.1.pretension",
    "joints.0.friction.coefficient",
    "drives.0.friction.constant",
    "drives.0.friction.load",
)
"""Parameters of the bench that its plant has otherwise than its rig file."""


def main() -> None:
    """Print a table with a row for each power."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--powers", type=float, nargs="+", default=[1.0, 0.3, 0.1, 0.03])
    parser.add_argument("--benches", type=int, default=4)
    parser.add_argument("--first-seed", type=int, default=11500)
    parser.add_argument("--only")
    arguments = parser.parse_args()
    warnings.simplefilter("ignore")
    rows = []
    for power in arguments.powers:
        with (
            mock.patch.object(InverseProblem, "power", power),
            tempfile.TemporaryDirectory() as folder,
        ):
            errors: NDArray[np.float64] = np.array(
                [
                    error
                    for seed in range(arguments.benches)
                    for error in bench_errors(seed, Path(folder))
                ]
            )
            outcomes = [
                outcome_of(learn(drawn.calibration).rig, drawn.free)
                for _, drawn in drawn_cases(arguments.first_seed, arguments.only)
            ]
        rows.append(
            [
                f"{power:g}",
                f"{np.sqrt(np.mean(errors**2)):.2f}",
                f"{100 * np.mean(np.abs(errors) < 2.0):.0f} %",
                *(f"{np.mean(outcome.rms):.3f}" for outcome in outcomes),
            ]
        )
    names = [name for name, _ in drawn_cases(arguments.first_seed, arguments.only)]
    columns = ["power", "RMS of error over std", "within 2 stds", *(f"{n}, °" for n in names)]
    table("likelihood-power", "the power of the equations' likelihood", columns, rows)


if __name__ == "__main__":
    main()
