"""Put measured tables into the documentation, each from the file that its command wrote.

`python -m tools.results` after `make demo` and `make bench`: copies out/reproduce/results.json and out/bench/*.md between
the markers in README.md and docs/, and the figures to docs/figures.
"""

from __future__ import annotations

import json
import re
import shutil
from functools import partial
from pathlib import Path

ROOT = Path(__file__).parents[1]
FIGURES = {
    "out/reproduce/figure-3.svg": "figure-3.svg",
    "out/bench/stepping.svg": "stepping.svg",
    "out/bench/speed.svg": "speed.svg",
    "out/bench/accuracy.svg": "accuracy.svg",
}


def claims() -> str:
    """Return the table of the paper's statements from results.json."""
    held = json.loads((ROOT / "out/reproduce/results.json").read_text(encoding="utf-8"))
    lines = [
        "| | statement | measure | threshold | as printed | as observed | verdict |",
        "|---|---|---|---|---|---|---|",
    ]
    for key in (f"C{i}" for i in range(1, 13)):
        claim = held[key]
        main = claim["measures"][0]
        cells = []
        for plant in ("as printed", "as observed"):
            holds = main["holds"][plant]
            cells.append(f"{main['values'][plant]:.2f} {'✓' if holds else '✗'}")
        bound = f"≥ {main['least']:g}" if main["least"] is not None else f"≤ {main['most']:g}"
        more = len(claim["measures"]) - 1
        measure = main["measure"] + (f" (and {more} more)" if more else "")
        row = [key, claim["statement"], measure, bound, *cells, claim["verdict"]]
        lines.append(f"| {' | '.join(row)} |")
    return "\n".join(lines)


def readings() -> str:
    """Return the table of readings of Q and R, and the errors of Series 2."""
    held = json.loads((ROOT / "out/reproduce/results.json").read_text(encoding="utf-8"))
    by_plant = held["readings_of_q_and_r_rms_deg"]
    lines = ["| reading | RMS, as printed [°] | RMS, as observed [°] |", "|---|---|---|"]
    lines += [
        f"| {name} | {by_plant['as printed'][name]:.2f} | {by_plant['as observed'][name]:.2f} |"
        for name in by_plant["as printed"]
    ]
    lines += [
        "",
        "Errors in Series 2, RMS [°]:",
        "",
        "| plant | series | inextensible | free simulation | ekf-2008 | ekf | adaptive |",
    ]
    lines.append("|---|---|---|---|---|---|---|")
    for plant, series in held["rms_error_deg"].items():
        for name, values in series.items():
            lines.append(f"| {plant} | {name} | {' | '.join(f'{value:.2f}' for value in values.values())} |")
    return "\n".join(lines)


def bench(name: str) -> str:
    """Return a table of `make bench`."""
    return (ROOT / "out/bench" / f"{name}.md").read_text(encoding="utf-8").split("\n\n", 1)[1].strip()


TABLES = {
    "claims": claims,
    "readings": readings,
    "stepping": lambda: bench("stepping"),
    "stepping-cost": lambda: bench("stepping-cost"),
    "accuracy-goals": lambda: bench("accuracy-goals"),
    "accuracy-adaptive": lambda: bench("accuracy-adaptive"),
    "accuracy-mujoco": lambda: bench("accuracy-mujoco"),
    "accuracy-rivals": lambda: bench("accuracy-rivals"),
    "speed": lambda: bench("speed"),
    "chains-data": lambda: bench("chains-data"),
    "chains": lambda: bench("chains"),
    "chains-cost": lambda: bench("chains-cost"),
    "chains-stepping": lambda: bench("chains-stepping"),
    "chains-energy": lambda: bench("chains-energy"),
    "chains-stick-slip": lambda: bench("chains-stick-slip"),
    **{
        name: partial(bench, name)
        for name in (
            "fit-derivatives",
            "fit-steps",
            "fit-optimisers",
            "fit-parameters",
            "fit-blind",
            "fit-mujoco",
            "fit-da-vinci",
            "hysteresis",
            "processes",
            "microcontroller",
            "casadi",
            "float-errors",
            "soak",
            "strangers-steps",
            "strangers-glitches",
            "strangers-rigs",
            "strangers-rigs-kinds",
            "strangers-rigs-worst",
            "strangers-series",
            "strangers-poses",
            "strangers-kinds",
            "strangers-homing",
            "parts",
            "parts-some",
            "sheaths",
            "strangers-hands",
            "strangers-contact",
            "strangers-contact-onset",
            "strangers-foreign",
            "smoothing",
            "reliability",
        )
    },
}


def main() -> None:
    """Rewrite what stands between the markers."""
    for page in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        text = page.read_text(encoding="utf-8")
        for name, table in TABLES.items():
            marker = rf"(<!-- table: {name} -->\n).*?(\n?<!-- end of table -->)"
            if re.search(marker, text, flags=re.S):
                try:
                    made = table()
                except FileNotFoundError as missing:
                    print(f"{page.name}: table {name} left as it is, {missing.filename} is not there")
                    continue
                text = re.sub(marker, lambda m, made=made: m[1] + made + "\n" + m[2].lstrip(), text, flags=re.S)  # type: ignore[misc]
        page.write_text(text, encoding="utf-8")
    for source, name in FIGURES.items():
        if (ROOT / source).exists():
            shutil.copyfile(ROOT / source, ROOT / "docs" / "figures" / name)


if __name__ == "__main__":
    main()
