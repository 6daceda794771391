"""Which derivatives, and which optimiser, a fit should use: measured on one fit of three simulated logs.

`python -m benchmarks.derivatives` prints the tables of docs/identification.md.
"""

from __future__ import annotations

import time
from typing import Any

import casadi as ca
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

from benchmarks.fitting import FREE, drawn_plant, logs_of, start_rig
from benchmarks.report import table
from distal.estimators import AdaptiveFilter
from distal.estimators.adaptive.filter import adaptive_function
from distal.fitting import likelihood as criterion
from distal.fitting.likelihood import Likelihood
from distal.fitting.search import search
from distal.fitting.selection import choose
from distal.homing import added_reference
from distal.kernels import Kernel

Floats = NDArray[np.float64]
ROWS = 2000


def tangent_kernel(function: ca.Function, directions: int) -> Kernel:
    """Return the filter with its derivatives in some directions, by CasADi's forward mode, as one kernel."""
    carry, x, p = (ca.MX.sym(name, function.numel_in(i)) for i, name in enumerate(("carry", "x", "p")))
    d_carry = ca.MX.sym("d_carry", carry.numel(), directions)
    d_p = ca.MX.sym("d_p", p.numel(), directions)
    following, y = function(carry, x, p)
    slopes = function.forward(directions)(carry, x, p, following, y, d_carry, ca.MX(x.numel(), directions), d_p)
    outputs = [ca.vertcat(a, ca.vec(ca.densify(b))) for a, b in zip((following, y), slopes)]
    inputs = [ca.vertcat(carry, ca.vec(d_carry)), x, ca.vertcat(p, ca.vec(d_p))]
    return Kernel(ca.Function("tangent", inputs, outputs))


def derivatives(found: Likelihood) -> None:
    """Print the cost of one directional derivative of the whole filter, by forward mode and by differences."""
    rig = found.rig
    runner = AdaptiveFilter(rig, references=found.references, inputs=[q for part in found.free for q in part.paths])
    function = adaptive_function(runner.states, 4)
    belief = runner.initial(0.0, found.data[0].first)
    rows = found.data[0].rows[:ROWS]

    def per_row(kernel: Kernel, carry: Floats, p: Floats) -> float:
        best = min(_timed(lambda: kernel.scan(carry, rows, p)) for _ in range(5))
        return best / len(rows) * 1e6

    plain = per_row(runner.kernel, belief.carry, runner.numbers)
    lines = [["one run of the filter", "1", f"{plain:.2f}", "", ""]]
    for directions in (1, 4):
        started = time.perf_counter()
        kernel = tangent_kernel(function, directions)
        built = time.perf_counter() - started
        carry = np.concatenate([belief.carry, np.zeros(directions * len(belief.carry))])
        p = np.concatenate([runner.numbers, np.zeros(directions * len(runner.numbers))])
        each = per_row(kernel, carry, p) / directions
        lines.append(
            [f"forward mode, {directions} at once", "1", f"{each:.2f}", f"{each / plain:.1f}", f"{built:.0f} s"]
        )
    lines.append(["central differences", "2", f"{2 * plain:.2f}", "2.0", "none"])
    columns = ["derivative in one direction", "runs", "µs per sample", "in runs", "to compile, once"]
    table(
        "fit-derivatives",
        f"One directional derivative of the filter ({len(runner.state_names)} states)",
        columns,
        lines,
    )


def steps(found: Likelihood) -> None:
    """Print how the gradient depends on the step of the differences."""
    z = np.array([0.3 if not part.noise else 0.0 for part, _ in found.parts()])
    gradients = {}
    for step in (1e-6, 1e-5, 1e-4, 1e-3, 1e-2):
        criterion.STEP = step
        gradients[step] = found.derivatives(z).gradient
    criterion.STEP = 1e-3
    base = gradients[1e-4]
    rows = [[f"{step:g}", f"{np.linalg.norm(g - base) / np.linalg.norm(base):.1e}"] for step, g in gradients.items()]
    table("fit-steps", "Gradient by central differences, against that at 1e-4", ["step", "relative difference"], rows)


def optimisers(found: Likelihood) -> None:
    """Print what optimisers need to come to the same place."""
    bounds = np.array([part.bounds for part, _ in found.parts()])
    start = np.zeros(found.size)
    rows, costs = [], {}

    def record(name: str, run: Any) -> None:
        found.evaluations = 0
        took = _timed(lambda: costs.__setitem__(name, run()))
        rows.append([name, str(found.evaluations), f"{took:.1f}", f"{costs[name]:.2f}"])

    def value(z: Floats) -> tuple[float, Floats]:
        here = found.derivatives(np.clip(z, *bounds.T))
        return here.cost, here.gradient

    def hessian(z: Floats) -> Floats:
        here = found.derivatives(np.clip(z, *bounds.T))
        return here.information + here.prior

    record("Fisher scoring, damped (distal)", lambda: search(found, start).cost)
    limits = [tuple(map(float, pair)) for pair in bounds]
    record("SciPy L-BFGS-B", lambda: minimize(value, start, jac=True, method="L-BFGS-B", bounds=limits).fun)
    record("SciPy TNC", lambda: minimize(value, start, jac=True, method="TNC", bounds=limits).fun)
    record(
        "SciPy trust-constr with Fisher information",
        lambda: (
            minimize(
                value, start, jac=True, hess=hessian, method="trust-constr", bounds=limits, options={"maxiter": 60}
            ).fun
        ),
    )
    record(
        "SciPy Nelder-Mead, no derivatives",
        lambda: minimize(found.cost, start, method="Nelder-Mead", bounds=limits).fun,
    )
    best = min(costs.values())
    for row in rows:
        row[-1] = f"{costs[row[0]] - best:.2f}"
    columns = ["optimiser", "runs of the filter over all logs", "s", "−ln p above the best"]
    table("fit-optimisers", "From the priors to the end of one fit: k, μ, b and three noises", columns, rows)


def _timed(call: Any) -> float:
    started = time.perf_counter()
    call()
    return time.perf_counter() - started


def main() -> None:
    """Run, print and save."""
    plant, _ = drawn_plant(1)
    rig, reference = added_reference(start_rig(), 100.0)
    logs = logs_of(start_rig(), plant, 1)
    found = Likelihood(rig, (reference,), choose(rig, (reference,), FREE, (), True, False), logs)
    derivatives(found)
    steps(found)
    optimisers(found)


if __name__ == "__main__":
    main()
