"""How many points of friction a cable in its sheath needs, in the model and in the filter.

`python -m benchmarks.sheaths`: against a cable of 16 points (`tests/support/cable.py`), the error
of the tension at the joint with both ends given, and that of the filter's angle on logs of
`tests/support/one_link.py`, with the time beside one without.
"""

from __future__ import annotations

import time
import warnings

import numpy as np
from tests.support.cable import Cable
from tests.support.one_link import link_log
from tests.support.parts import NOISE, PARTS, rig_of

from benchmarks.report import table
from distal import estimate
from distal.model.tendon_tensions import Sheath

COUNTS = (1, 2, 3, 4)
SEEDS = (1, 2, 3)
MU, WRAP, STIFFNESS = 0.2, 1.8, 2000.0


def tension_error(count: int) -> float:
    """Return the RMS error of the tension at the joint as a share of its mean, both ends moving."""
    t = np.arange(0.0, 8.0, 0.005)
    turn = 4.5e-3 * np.sin(2 * np.pi * 0.35 * t)
    drive = 1.2e-3 * (1 + 0.5 * np.sin(2 * np.pi * 0.3 * t + 1)) + turn
    joint = 4.5e-3 * np.sin(2 * np.pi * 0.35 * t - 0.05)
    ratio = float(np.exp(MU * WRAP / count))
    few, many = Sheath(STIFFNESS, ratio, ratio, count), Cable(STIFFNESS, MU, WRAP)
    points, errors, tensions = few.middle(drive[0], joint[0]), [], []
    for d, j in zip(drive, joint):
        many.settle(d, j)
        tensions.append(many.tensions(d, j)[1])
        points = [float(point) for point in few.settled(points, d, j)]
        errors.append(float(few.tensions(points, d, j)[1]) - tensions[-1])
    return float(np.sqrt(np.mean(np.square(errors))) / np.mean(tensions))


def main() -> None:
    """Measure, print."""
    part = next(each for each in PARTS if each.name == "sheath")
    logs = [
        link_log(
            {**part.fixed, part.path: 0.24}, NOISE, np.random.default_rng([seed, 83]), 8.0, "sheath"
        )
        for seed in SEEDS
    ]
    plain = rig_of(part, 0.24).with_values({"tendons.0.path": None})

    def judged(rig: object) -> tuple[float, float, float]:
        errors, inside, spent = [], [], []
        for log in logs:
            estimate(log, rig)  # type: ignore[arg-type]
            begun = time.perf_counter()
            result = estimate(log, rig)  # type: ignore[arg-type]
            spent.append((time.perf_counter() - begun) / len(log))
            late = log.time > 0.5
            error = result.errors()[late]
            errors.append(np.mean(error**2))
            inside.append(np.mean(np.abs(error) < 1.96 * result.theta_std[late]))
        return float(np.rad2deg(np.sqrt(np.mean(errors)))), float(np.mean(inside)), min(spent)

    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        rms, inside, alone = judged(plain)
        rows = [["none: friction not known of", "–", f"{rms:.3f}", f"{inside:.0%}", "1.0"]]
        for count in COUNTS:
            rms, inside, spent = judged(
                rig_of(part, 0.24).with_values({"tendons.0.path.nodes": count})
            )
            rows.append(
                [
                    str(count),
                    f"{tension_error(count):.1%}",
                    f"{rms:.3f}",
                    f"{inside:.0%}",
                    f"{spent / alone:.1f}",
                ]
            )
    columns = [
        "points",
        "error of the tension",
        "angle, RMS [°]",
        "inside",
        "time of a run / without",
    ]
    table("sheaths", "A cable of 16 points, as few points", columns, rows)


if __name__ == "__main__":
    main()
