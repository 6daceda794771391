"""Lines that the fast tests run, by package: `python -m tools.coverage out/coverage.json`, which
`make coverage` prints.

A place to look for what no test sees; a line that runs is not yet one whose mistake is seen
(`benchmarks.mutants`).
"""

from __future__ import annotations

import json
import sys
from collections import defaultdict
from pathlib import Path


def by_package(
    report: dict[str, dict[str, dict[str, dict[str, int]]]],
) -> list[tuple[str, int, int]]:
    """Return package, lines that were run and all lines, the package with the smallest share
    first.
    """
    lines: dict[str, list[int]] = defaultdict(lambda: [0, 0])
    for path, module in report["files"].items():
        parts = Path(path).parts
        package = parts[parts.index("distal") + 1]
        lines[package][0] += module["summary"]["covered_lines"]
        lines[package][1] += module["summary"]["num_statements"]
    rows = [(package, covered, count) for package, (covered, count) in lines.items() if count]
    return sorted(rows, key=lambda row: row[1] / row[2])


def main() -> None:
    """Print the table."""
    for package, covered, count in by_package(
        json.loads(Path(sys.argv[1]).read_text(encoding="utf-8"))
    ):
        print(
            f"{package:20} {100 * covered / count:5.1f} %  {count - covered:5} of {count} "
            "statements not run"
        )


if __name__ == "__main__":
    main()
