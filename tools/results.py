"""Put measured tables into the documentation, each from the file that its command wrote.

`python -m tools.results` after `make demo` and `make bench`: copies out/reproduce/results.json and
out/bench/*.md between the markers in docs/, and the figures to docs/figures. Wide tables are
shortened here: a page has one row for each case.
"""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIGURES = {
    "out/reproduce/figure-5.png": "paper-figure-5.png",
    "out/bench/stepping.svg": "stepping.svg",
    "out/bench/accuracy.svg": "accuracy.svg",
}


def claims() -> str:
    """Return the table of the paper's statements from results.json."""
    held = json.loads((ROOT / "out/reproduce/results.json").read_text(encoding="utf-8"))
    rows = []
    for key in (f"C{i}" for i in range(1, 13)):
        claim = held[key]
        main = claim["measures"][0]
        cells = []
        for plant in main["values"]:
            holds = main["holds"][plant]
            cells.append(f"{main['values'][plant]:.2f} {'✓' if holds else '✗'}")
        bound = f"≥ {main['least']:g}" if main["least"] is not None else f"≤ {main['most']:g}"
        more = len(claim["measures"]) - 1
        measure = main["measure"] + (f" (and {more} more)" if more else "")
        rows.append([key, claim["statement"], measure, bound, *cells])
    return written(
        ["", "statement", "measure", "threshold", *held["C1"]["measures"][0]["values"]], rows
    )


def bench(name: str) -> str:
    """Return a table of `make bench`."""
    text = (
        (ROOT / "out/bench" / f"{name}.md").read_text(encoding="utf-8").split("\n\n", 1)[1].strip()
    )
    return re.sub(r" *\| *", "|", text)


def cells(name: str) -> tuple[list[str], list[dict[str, str]]]:
    """Return the columns of a measured table and its rows by column."""
    lines = bench(name).splitlines()
    head, *rows = (
        [cell.strip() for cell in line.strip()[1:-1].split("|")] for line in (lines[0], *lines[2:])
    )
    return head, [dict(zip(head, row, strict=True)) for row in rows]


def written(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Return a table in Markdown."""
    return "\n".join(f"|{'|'.join(row)}|" for row in (head, ["---"] * len(head), *rows))


def part(
    name: str, *columns: str, only: Callable[[dict[str, str]], bool] = lambda row: True
) -> str:
    """Return some columns, and some rows, of a measured table.

    Args:
        name: of the table.
        columns: to keep, all if none is named.
        only: says which rows are kept.
    """
    head, rows = cells(name)
    kept = list(columns) or head
    return written(kept, [[row[column] for column in kept] for row in rows if only(row)])


def side_by_side(
    name: str,
    keys: tuple[str, ...],
    values: tuple[str, str],
    names: tuple[str, ...],
    only: Callable[[dict[str, str]], bool] = lambda row: True,
) -> str:
    """Return one row for each case, and in it "first (second)" of two columns for each estimator.

    Args:
        name: of the table.
        keys: columns that make a case.
        values: the two columns that are shown.
        names: estimators, from left to right; – where a case has none.
        only: says which rows are kept.
    """
    found: dict[tuple[str, ...], dict[str, str]] = {}
    for row in filter(only, cells(name)[1]):
        shown = f"{row[values[0]]} ({row[values[1]].removesuffix(' %')})"
        found.setdefault(tuple(row[key] for key in keys), {})[row["estimator"]] = shown
    rows = [[*case, *(held.get(one, "–") for one in names)] for case, held in found.items()]
    return written([*keys, *names], rows)


strangers = partial(side_by_side, keys=("case",), values=("RMS [°]", "inside 95 % band [%]"))
accuracy = partial(side_by_side, values=("RMS [°]", "inside 95 % band"))
RIVALS = ("adaptive", "elastic", "inextensible", "ekf")

PARTS = ("part", "within 2 standard errors", "RMS, fitted [°]", "ratio", "inside")

TABLES: dict[str, Callable[[], str]] = {
    "claims": claims,
    "stepping": lambda: part("stepping", "scheme", "6", "10", "15", "30"),
    "speed": lambda: part("speed"),
    "accuracy-goals": lambda: part(
        "accuracy-goals", "case", "RMS [°]", "worst seed [°]", "inside 95 % band", "half-width [°]"
    ),
    "accuracy-rivals": lambda: accuracy(
        "accuracy-rivals", keys=("plants",), names=(*RIVALS, "ekf-2008", "iterated")
    ),
    "accuracy-mujoco": lambda: accuracy(
        "accuracy-mujoco", keys=("log",), names=(*RIVALS, "ekf-2008", "iterated")
    ),
    "chains": lambda: side_by_side(
        "chains",
        keys=("plant", "log"),
        values=("mean [°]", "inside [%]"),
        names=("adaptive", "without forces", "elastic", "inextensible"),
    ),
    "fit-parameters": lambda: part(
        "fit-parameters", "", "within 2 errors", "RMS error / std. error", "RMS", "std. error"
    ),
    "fit-da-vinci": lambda: part("fit-da-vinci", only=lambda row: not row["run"].startswith("run")),
    "microcontroller": lambda: part("microcontroller"),
    "silent": lambda: part("silent"),
    "exports": lambda: part("exports"),
    "strangers-steps": lambda: strangers(
        "strangers-steps", names=("adaptive", "adaptive, plant known", "elastic", "inextensible")
    ),
    "strangers-rigs": lambda: part(
        "strangers-rigs",
        "logs",
        "estimator",
        "median RMS [°]",
        "inside 95 % band, mean [%]",
        "below half inside [%]",
        "diverged",
    ),
    "strangers-kinds": lambda: strangers(
        "strangers-kinds",
        names=("adaptive", "regression", "adaptive, nothing learned"),
    ),
    "strangers-homing": lambda: strangers(
        "strangers-homing", names=("adaptive", "regression", "inextensible")
    ),
    "strangers-hands": lambda: strangers("strangers-hands", names=("adaptive", "regression")),
    "strangers-foreign": lambda: strangers(
        "strangers-foreign", names=("adaptive", "regression", "adaptive, rig as it came")
    ),
    **{
        name: partial(bench, name)
        for name in (
            "control-paper",
            "control-finger",
            "chains-bounds",
            "fit-command-lacking",
            "fit-command-named",
            "hysteresis",
            "float-errors",
        )
    },
}


def main() -> None:
    """Rewrite what stands between the markers."""
    for page in sorted((ROOT / "docs").rglob("*.md")):
        text = page.read_text(encoding="utf-8")
        for name, table in TABLES.items():
            marker = rf"(<!-- table: {name} -->\n).*?(\n?<!-- end of table -->)"
            if re.search(marker, text, flags=re.S):
                try:
                    made = table()
                except FileNotFoundError as missing:
                    print(
                        f"{page.name}: table {name} left as it is, {missing.filename} is not there"
                    )
                    continue
                text = re.sub(
                    marker,
                    lambda m, made=made: m[1] + made + "\n" + m[2].lstrip(),
                    text,
                    flags=re.S,
                )  # type: ignore[misc]
        page.write_text(text, encoding="utf-8")
    for source, name in FIGURES.items():
        if (ROOT / source).exists():
            shutil.copyfile(ROOT / source, ROOT / "docs" / "figures" / name)


if __name__ == "__main__":
    main()
