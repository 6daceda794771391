"""`python -m benchmarks.real`: `distal learn` on real logs, beside least squares and boosted trees.

The repositories of the logs are read from the folder in `DISTAL_REAL`, each under its own name; one
that is not there is left out, and said.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from pathlib import Path

from benchmarks.learned import COLUMNS, row_of
from benchmarks.real import grasper, neck, trunks
from benchmarks.report import table

SETS = {
    "Data-and-Results": neck.splits,
    "da_vinci_grasper": grasper.splits,
    "trunk-stack": trunks.splits,
}
"""Name of a folder in `DISTAL_REAL` → function that yields the splits of its logs."""


def main() -> None:
    """Print a row for each split."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", help="name of a folder")
    arguments = parser.parse_args()
    home = Path(os.environ["DISTAL_REAL"])
    rows = []
    for name, splits in SETS.items():
        if arguments.only not in (None, name):
            continue
        if not (home / name).exists():
            print(f"{home / name} is not there: left out", file=sys.stderr)
            continue
        with tempfile.TemporaryDirectory() as folder:
            for split in splits(home / name, Path(folder)):
                rows.append(row_of(split.title, split.training, split.judged, *split.words))
    table("real-logs", "distal learn on real logs", COLUMNS, rows)


if __name__ == "__main__":
    main()
