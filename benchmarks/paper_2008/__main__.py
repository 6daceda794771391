"""Simulate and filter the 2008 paper's two test series; write its figures, results and a page."""

from __future__ import annotations

import argparse
import sys
from itertools import count
from pathlib import Path

from benchmarks.paper_2008.claims import GROUPS
from benchmarks.paper_2008.figures import CAPTIONS
from benchmarks.paper_2008.page import FEEDBACKS, reproduce
from benchmarks.paper_2008.series import TESTS
from distal.cli.console import progress_bar, say, table
from distal.errors import OutputError


def main() -> None:
    """Write the files, and print how many of the paper's statements hold."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.paper_2008", description=__doc__)
    parser.add_argument(
        "--out",
        type=Path,
        default=Path("out/reproduce"),
        help="folder for figures, results.json and index.html",
    )
    parser.add_argument("--lab", type=Path, help="a page of tools.lab, to be linked from the page")
    arguments = parser.parse_args()
    done = count(1)
    total = len(TESTS) + len(FEEDBACKS) + len(CAPTIONS)
    try:
        with progress_bar("simulating and filtering", total) as show:
            claims, _ = reproduce(arguments.out, lambda: show(next(done)), arguments.lab)
    except OutputError as problem:
        sys.exit(f"error: {problem}")
    rows = [(group, str(sum(claim.group == group for claim in claims))) for group in GROUPS]
    table(f"{len(claims)} statements of the paper", ["of them", "number"], rows)
    say(
        f"open {arguments.out}/index.html: the rig, figures 2 to 5, all errors, and "
        "why each statement holds or does not"
    )


if __name__ == "__main__":
    main()
