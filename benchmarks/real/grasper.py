"""A da Vinci Maryland grasper (github.com/MRDLab/mis-tool-characterization, commit 03658b2, Open
Database License 1.0), as in the folder `da_vinci_grasper` of the logs for tests.

One motor winds both cables of the jaw. Its encoder begins at zero in each run, inside the
hysteresis, so that the runs differ by up to 3° in a zero that nothing here shows. A rig file of it
ships; it is not given. The motions of the logs to judge by are of a class that no log to learn from
has.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

from benchmarks.real.split import Split

RUNS = ("00", "01", "02", "03", "20", "21", "22", "23", "40", "41", "42", "43")
"""Class of motion and of resistance of each run."""


def splits(repository: Path, folder: Path) -> Iterator[Split]:
    """Yield a split for each class of motion that is left out."""
    for motion in "024":
        training = [repository / f"run_{run}.csv" for run in RUNS if run[0] != motion]
        judged = [repository / f"run_{run}.csv" for run in RUNS if run[0] == motion]
        words = ("--truth", "theta_true_deg", "--drive", "theta_prox_deg=deg")
        words += ("--ignore", "tau_true_Nm,u_cmd,i_motor_A")
        yield Split(f"grasper, motion {motion}", tuple(training), tuple(judged), words)
