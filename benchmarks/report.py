"""Tables of benchmarks: printed, and saved as Markdown and JSON in out/bench."""

from __future__ import annotations

import json
import statistics
import timeit
from collections.abc import Callable, Sequence
from pathlib import Path

FOLDER = Path("out/bench")


def table(name: str, title: str, columns: Sequence[str], rows: Sequence[Sequence[str]]) -> None:
    """Print a table and save it."""
    FOLDER.mkdir(parents=True, exist_ok=True)
    lines = [
        f"| {' | '.join(columns)} |",
        f"|{'---|' * len(columns)}",
        *(f"| {' | '.join(row)} |" for row in rows),
    ]
    text = "\n".join(lines)
    print(f"\n{title}\n\n{text}\n")
    (FOLDER / f"{name}.md").write_text(f"{title}\n\n{text}\n", encoding="utf-8")
    held = {"title": title, "columns": list(columns), "rows": [list(row) for row in rows]}
    (FOLDER / f"{name}.json").write_text(
        json.dumps(held, indent=2, ensure_ascii=False) + "\n", encoding="utf-8"
    )


def microseconds(call: Callable[[], object], number: int = 200, repeat: int = 15) -> float:
    """Return the median over repeats of the time of one call [µs]."""
    return statistics.median(timeit.repeat(call, number=number, repeat=repeat)) / number * 1e6
