"""What a da Vinci instrument's hysteresis is driven by: linear regressions, one motion class left
out at a time.

`python -m benchmarks.hysteresis` prints the table of docs/results/da-vinci.md. Features are linear
in unknown weights; the offset of a run is known from its first 3 s (homing move) or 0.2 s (homing
point), as in the filter's tests.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from examples.da_vinci.logs import da_vinci_grasper
from numpy.typing import NDArray

from benchmarks.report import table
from distal.logs import read_table

Floats = NDArray[np.float64]
Features = Callable[[Floats, Floats], list[Floats]]


def play(effort: Floats, limit: float) -> Floats:
    """Return the play operator z⁺ = clip(z, U − h, U + h) of an effort, z = U at the start."""
    z, held = float(effort[0]), []
    for u in effort:
        z = min(max(z, float(u) - limit), float(u) + limit)
        held.append(z)
    return np.array(held)


def dahl(position: Floats, length: float) -> Floats:
    """Return Dahl's hysteresis of a displacement: z⁺ = σ + (z − σ) e^{−|dx|/δ}, with a dead band of
    one count.
    """
    z, last, held = 0.0, float(position[0]), []
    for x in position:
        step = float(x) - last
        if abs(step) > 0.06:
            z = np.sign(step) + (z - np.sign(step)) * np.exp(-abs(step) / length)
            last = float(x)
        held.append(z)
    return np.array(held)


def smooth(values: Floats, rows: int = 5) -> Floats:
    """Return a running mean."""
    padded = np.pad(values, rows // 2, mode="edge")
    return np.convolve(padded, np.ones(rows) / rows, "valid")


SETS: dict[str, Features] = {
    "proximal angle": lambda phi, tau: [],
    "+ torque (elastic)": lambda phi, tau: [tau],
    "+ Dahl of the angle, 1° and 4°, alone and times torque": lambda phi, tau: [
        tau,
        *(f for d in (1.0, 4.0) for f in (dahl(phi, d), dahl(phi, d) * tau)),
    ],
    "+ direction of motion (Coulomb friction at the motor)": lambda phi, tau: [tau, dahl(phi, 0.3)],
    "+ one play of the torque, 0.03 N m": lambda phi, tau: [tau, play(tau, 0.03)],
    "+ one play, stiffening (τ², τ³)": lambda phi, tau: [tau, tau**2, tau**3, play(tau, 0.03)],
    "+ one play, stiffening, both times angle": lambda phi, tau: [
        tau,
        tau**2,
        tau**3,
        play(tau, 0.03),
        phi * tau,
        phi * play(tau, 0.03),
    ],
    "+ one play, stiffening, and direction of motion": lambda phi, tau: [
        tau,
        tau**2,
        tau**3,
        play(tau, 0.03),
        dahl(phi, 0.3),
    ],
}


def main() -> None:
    """Fit, print and save."""
    runs = {}
    for path in da_vinci_grasper():
        columns = read_table(path).columns
        phi, tau = columns["theta_prox_deg"], -smooth(columns["tau_prox_Nm"])
        runs[path.stem.removeprefix("run_")] = (columns["t_s"], phi, tau, columns["theta_true_deg"])
    rows = []
    for name, features in SETS.items():
        made = {
            run: np.column_stack([np.ones_like(t), phi, *features(phi, tau)])
            for run, (t, phi, tau, _) in runs.items()
        }
        cells = [name]
        for homing in (3.0, 0.2):
            errors = []
            for group in sorted({run[0] for run in runs}):
                train = [run for run in runs if run[0] != group]
                known = {run: runs[run][0] < 0.2 if homing < 1 else slice(None) for run in runs}
                left = np.vstack([made[run] - made[run][known[run]].mean(axis=0) for run in train])
                right = np.concatenate(
                    [runs[run][3] - runs[run][3][known[run]].mean() for run in train]
                )
                weights = np.linalg.lstsq(left, right, rcond=None)[0]
                for run in (run for run in runs if run[0] == group):
                    rest = runs[run][3] - made[run] @ weights
                    early = runs[run][0] < homing
                    errors.append(float(np.sqrt(np.mean((rest - rest[early].mean())[~early] ** 2))))
            cells += [f"{np.mean(errors):.2f}", f"{np.max(errors):.2f}"]
        rows.append(cells)
    columns = ["features", "homing move [°]", "worst", "homing point [°]", "worst"]
    table(
        "hysteresis",
        "da Vinci grasper, linear regression, one motion class left out",
        columns,
        rows,
    )


if __name__ == "__main__":
    main()
