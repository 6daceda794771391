"""Each part of the physics alone: simulated by a plant of its own, fitted from three logs, judged
on a fourth.

`python -m benchmarks.parts [SEEDS] [PART …]` (default 20, all). The plant
(`tests/support/one_link.py`) shares no code with `distal.model`. Shown are how often a fitted
number is within two standard errors of the plant's, and the angle's error beside that of the filter
that is given it.
"""

from __future__ import annotations

import sys
import warnings
from concurrent.futures import ProcessPoolExecutor

import numpy as np
from numpy.typing import NDArray
from tests.support.one_link import link_log
from tests.support.parts import NOISE, PARTS, Part, rig_of

from benchmarks.report import table
from benchmarks.shell import estimate
from distal import Log, fit

Floats = NDArray[np.float64]

DURATION = 8.0


def log_of(part: Part, number: float, rng: np.random.Generator) -> Log:
    """Return a log of the plant with sensors' noise and its true angle."""
    values = {**part.fixed, part.path: number}
    return link_log(values, NOISE, rng, DURATION, f"{part.name}, {number:g}")


def run(job: tuple[int, int]) -> tuple[int, float, float, float, float]:
    """Return part, error of its number in standard errors, RMS errors of both filters [°], share
    inside.
    """
    at, seed = job
    part, rng = PARTS[at], np.random.default_rng([seed, at, 11])
    number = part.value + part.std * float(np.clip(rng.normal(), -2, 2))
    *logs, judged = (log_of(part, number, rng) for _ in range(4))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fit(logs, rig_of(part), workers=1, compiled=False)
        one = found[part.path]
        after = estimate(judged, found.rig.bare(), compiled=False)
        known = estimate(judged, rig_of(part, number), compiled=False)
    settled = judged.time > 0.5
    errors = [
        float(np.rad2deg(np.sqrt(np.mean(each.errors()[settled] ** 2)))) for each in (after, known)
    ]
    inside = float(np.mean(np.abs(after.errors()[settled]) <= 1.96 * after.theta_std[settled]))
    return at, (one.value - number) / one.error, *errors, inside


def main() -> None:
    """Fit, judge, print."""
    seeds = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    desired = [at for at, part in enumerate(PARTS) if not sys.argv[2:] or part.name in sys.argv[2:]]
    jobs = [(at, seed) for at in desired for seed in range(seeds)]
    with ProcessPoolExecutor() as pool:
        found = list(pool.map(run, jobs))
    rows = []
    for at, part in ((at, PARTS[at]) for at in desired):
        away, after, known, inside = (
            np.array(each) for each in list(zip(*(one for one in found if one[0] == at)))[1:]
        )
        ratio = np.sqrt(np.mean(after**2) / np.mean(known**2))
        rows.append(
            [
                part.name,
                f"`{part.path}`",
                f"{np.mean(np.abs(away) <= 2):.0%}",
                f"{np.sqrt(np.mean(after**2)):.3f}",
                f"{np.sqrt(np.mean(known**2)):.3f}",
                f"{ratio:.2f}",
                f"{np.mean(inside):.0%}",
            ]
        )
    title = (
        f"Each part alone: a plant of its own, fitted from three logs of {DURATION:g} s; "
        f"{seeds} seeds"
    )
    columns = [
        "part",
        "number",
        "within 2 standard errors",
        "RMS, fitted [°]",
        "RMS, plant known [°]",
        "ratio",
        "inside",
    ]
    table("parts" if len(desired) == len(PARTS) else "parts-some", title, columns, rows)


if __name__ == "__main__":
    main()
