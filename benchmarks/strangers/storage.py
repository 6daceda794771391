"""Records as JSON, small enough to be kept in the repository, and two runs side by side."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from benchmarks.report import table
from benchmarks.strangers.scoring import Record, Table

Stored = dict[str, dict[str, dict[str, dict[str, list[object]]]]]


def save(records: Sequence[Record], path: Path, note: str) -> None:
    """Write the records: bench → case → log → estimator → [RMS, inside, half-width, consistent,
    note], a log per line.
    """
    lines: list[str] = []
    benches = list(dict.fromkeys(one.bench for one in records))
    for bench in benches:
        cases = list(dict.fromkeys(one.case for one in records if one.bench == bench))
        blocks = []
        for case in cases:
            logs: dict[str, dict[str, list[object]]] = {}
            for one in (one for one in records if (one.bench, one.case) == (bench, case)):
                consistent = None if one.consistent is None else int(one.consistent)
                held: list[object] = [one.rms, one.inside, one.half, consistent]
                logs.setdefault(one.log, {})[one.estimator] = (
                    [*held, one.note] if one.note else held
                )
            inner = ",\n".join(f"   {_json(log)}: {_json(held)}" for log, held in logs.items())
            blocks.append(f"  {_json(case)}: {{\n{inner}\n  }}")
        lines.append(f" {_json(bench)}: {{\n" + ",\n".join(blocks) + "\n }")
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(
        f'{{\n "about": {_json(note)},\n' + ",\n".join(lines) + "\n}\n", encoding="utf-8"
    )
    print(f"{len(records)} records in {path} ({path.stat().st_size / 1e3:.0f} kB)")


def _json(value: object) -> str:
    return json.dumps(value, ensure_ascii=False, separators=(",", ":"))


def load(path: Path) -> list[Record]:
    """Return the records of a file that `save` wrote."""
    raw = json.loads(path.read_text(encoding="utf-8"))
    raw.pop("about", None)
    records = []
    for bench, cases in raw.items():
        for case, logs in cases.items():
            for log, estimators in logs.items():
                for estimator, (rms, inside, half, consistent, *note) in estimators.items():
                    flag = None if consistent is None else bool(consistent)
                    records.append(
                        Record(bench, case, log, estimator, rms, inside, half, flag, *note)
                    )
    return records


def show(made: Table) -> None:
    """Print a table, and save it in out/bench."""
    rows = [
        [*labels, *(_number(n, d) for n, (_, d) in zip(row, made.columns))]
        for labels, row in made.rows.items()
    ]
    table(made.name, made.title, [*made.labels, *(name for name, _ in made.columns)], rows)


def show_beside(then: Table, now: Table) -> None:
    """Print two runs of a table side by side: each number as then → now, and the ratio of the
    errors.
    """
    names = [name for name, _ in now.columns]
    error = next(i for i, name in enumerate(names) if "RMS [°]" in name)
    rows = []
    for labels, row in now.rows.items():
        before = then.rows.get(labels)
        if before is None:
            rows.append(
                [*labels, *(f"– → {_number(n, d)}" for n, (_, d) in zip(row, now.columns)), "–"]
            )
            continue
        cells = [
            _number(n, d)
            if _number(b, d) == _number(n, d)
            else f"{_number(b, d)} → {_number(n, d)}"
            for b, n, (_, d) in zip(before, row, now.columns)
        ]
        rows.append(
            [*labels, *cells, f"{row[error] / before[error]:.2f}" if before[error] > 0 else "–"]
        )
    table(
        f"{now.name}-compared",
        f"{now.title}: then → now",
        [*now.labels, *names, "ratio of RMS"],
        rows,
    )


def common(then: Sequence[Record], now: Sequence[Record]) -> tuple[list[Record], list[Record]]:
    """Return the records of the logs and estimators that both runs have, estimators that only one
    has left out.
    """
    both = {one.key for one in then} & {one.key for one in now}
    return [one for one in then if one.key in both], [one for one in now if one.key in both]


def moved(then: Sequence[Record], now: Sequence[Record], most: int = 12) -> Table:
    """Return the logs on which an estimator's error has changed by the largest factor."""
    before = {one.key: one for one in then}
    pairs = [(before[one.key], one) for one in now if one.key in before]
    changes = {
        (a.bench, a.case, a.log, a.estimator): (
            a.rms,
            b.rms,
            100 * a.inside,
            100 * b.inside,
            b.rms / max(a.rms, 1e-6),
        )
        for a, b in pairs
        if a.rms != b.rms or a.inside != b.inside
    }
    largest = sorted(changes.items(), key=lambda item: -abs(np.log(max(item[1][4], 1e-6))))[:most]
    columns = (
        ("RMS then [°]", 3),
        ("now [°]", 3),
        ("inside then [%]", 0),
        ("now [%]", 0),
        ("ratio", 3),
    )
    title = f"Logs whose error changed the most ({len(changes)} of {len(pairs)} changed at all)"
    return Table(
        "strangers-moved", title, ("bench", "case", "log", "estimator"), columns, dict(largest)
    )


def _number(value: float, decimals: int) -> str:
    return "–" if not np.isfinite(value) else f"{value:.{decimals}f}"
