"""Which optimiser a fit should use, and over how far slopes should be taken: measured on one fit of
three simulated logs.

`python -m benchmarks.derivatives` prints the tables of docs/results/fits.md.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize
from tests.support.plant_and_rig import FREE, drawn_plant, logs_of, start_rig

from benchmarks.report import table
from distal.fitting import Options
from distal.fitting.likelihood import Problem
from distal.fitting.parameter_search import first_widths, hessian, problem_of, search, widths_at

Floats = NDArray[np.float64]


class Counted:
    """A problem whose runs are counted, with the derivatives that SciPy's optimisers take."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.runs, self._widths = problem, 0, first_widths(problem)

    def value(self, z: Floats) -> tuple[float, Floats]:
        """Return −ln p and its gradient."""
        here = self._at(z)
        return here.cost, here.gradient

    def curvature(self, z: Floats) -> Floats:
        """Return Fisher's information and the prior's."""
        return hessian(self.problem, self._at(z))

    def _at(self, z: Floats) -> Any:
        z = np.clip(z, *self.problem.bounds.T)
        self.runs += 1 + self.problem.size
        here = self.problem.derivatives(z, self._widths)
        self._widths = widths_at(self.problem, z, here)
        return here


def steps(problem: Problem) -> None:
    """Print how Fisher's information depends on over how far slopes are taken."""
    end = search(problem, np.zeros(problem.size))
    widths = widths_at(problem, end.z, end.derivatives)
    rows = []
    for share in (0.001, 0.01, 0.1, 0.3, 1.0, 3.0):
        here = hessian(problem, problem.derivatives(end.z, share / 0.3 * widths))
        stds = np.sqrt(np.diag(np.linalg.inv(here)))
        cells = [
            f"{std * part.slope(z):.2e} {part.si}"
            for (part, _), std, z in zip(problem.parts, stds, end.z)
        ]
        rows.append([f"{share:g}", *cells])
    columns = ["slopes over, in standard errors", *(part.name for part, _ in problem.parts)]
    table("fit-steps", "Standard errors by Fisher's information", columns, rows)


def optimisers(problem: Problem) -> None:
    """Print what optimisers need to come to the same place."""
    start, limits = np.zeros(problem.size), [tuple(map(float, pair)) for pair in problem.bounds]
    rows, costs = [], {}

    def record(name: str, run: Any) -> None:
        counted, started = Counted(problem), time.perf_counter()
        costs[name] = float(problem.costs([np.clip(run(counted), *problem.bounds.T)])[0])
        rows.append([name, f"{time.perf_counter() - started:.1f}", f"{costs[name]:.2f}"])

    record("Fisher scoring, four dampings at once (distal)", lambda _: search(problem, start).z)
    for method in ("L-BFGS-B", "TNC"):
        record(
            f"SciPy {method}",
            lambda counted, method=method: (
                minimize(counted.value, start, jac=True, method=method, bounds=limits).x
            ),
        )
    record(
        "SciPy trust-constr with Fisher information",
        lambda counted: (
            minimize(
                counted.value,
                start,
                jac=True,
                hess=counted.curvature,
                method="trust-constr",
                bounds=limits,
                options={"maxiter": 60},
            ).x
        ),
    )
    best = min(costs.values())
    for row in rows:
        row[-1] = f"{costs[row[0]] - best:.2f}"
    table(
        "fit-optimisers",
        "From the priors to the end of one fit",
        ["optimiser", "s", "−ln p above the best"],
        rows,
    )


def main() -> None:
    """Run, print and save."""
    plant, _ = drawn_plant(1)
    problem = problem_of(logs_of(start_rig(), plant, 1), start_rig(), Options(free=FREE))
    steps(problem)
    optimisers(problem)


if __name__ == "__main__":
    main()
