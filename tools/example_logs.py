"""The logs that the README begins with: `python -m tools.example_logs` writes them anew.

A motor pulls a finger's joint over a Bowden cable, with friction in the sheath and slack. The plant
is `tests.support.hands_plants`, which shares no code with `distal.model`. All have the angle
of an encoder at the joint; three are to learn from, `unseen.csv` is a fourth motion.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from tests.support.hands_plants import GEAR, TORQUE_CONSTANT, bowden_log

FOLDER = Path(__file__).parents[1] / "examples" / "finger_logs"
SECONDS = 20.0
SEEDS = {"run_0": 11, "run_1": 12, "run_2": 13, "unseen": 14}
HEADER = "time [s],motor [deg],current [mA],finger [deg]"


def main() -> None:
    """Write the logs."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    for name, seed in SEEDS.items():
        log = bowden_log(seed, "ramps", SECONDS)
        current = log.channels["current"] / (TORQUE_CONSTANT * GEAR)
        columns = [
            log.time,
            np.rad2deg(log.channels["motor"]),
            1e3 * current,
            np.rad2deg(log.truth["theta"]),
        ]
        table = np.column_stack(columns)
        path = FOLDER / f"{name}.csv"
        formats = ["%.2f", "%.3f", "%.1f", "%.3f"]
        np.savetxt(path, table, delimiter=",", header=HEADER, comments="", fmt=formats)
        print(path.name, len(table), "rows")


if __name__ == "__main__":
    main()
