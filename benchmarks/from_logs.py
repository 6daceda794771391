"""Rigs from logs alone: columns, structure and mistakes, by the command and the file that it
writes.

`python -m benchmarks.from_logs structure --rigs 80 --first-seed 5000` draws rigs of all families
(`tests.support.drawn_rigs`), writes three logs of each as CSV, runs `distal rig from-logs`, and
compares the tendons in its file with those of the plant. `python -m benchmarks.from_logs columns`
gives the same logs other headers: with units, without, in five languages, shuffled. `python -m
benchmarks.from_logs rigs` fits the rig from logs and the hand-written one by the command, and
judges what they wrote on logs that no fit has seen, beside the best least squares.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Mapping
from copy import deepcopy
from pathlib import Path

import numpy as np
import tomlkit
from numpy.typing import NDArray
from tests.support.drawn_logs import logs_of
from tests.support.drawn_rigs import Drawn, drawn_rig

from benchmarks.report import table
from distal import estimate, load_rig, read_log
from distal.errors import DistalError
from distal.estimators import samples_of_angles
from distal.from_logs import ColumnRole, rig_from_logs
from distal.regression import YARDSTICKS, yardstick_error

Floats = NDArray[np.float64]
Log = dict[str, Floats]

LEARNED = 3
"""Logs that a rig is found from."""

COUNTS = 4096.0
"""Of an encoder in one turn."""


def drawn_logs(seed: int, every: bool = False, alone: bool = False) -> tuple[Drawn, list[Log]]:
    """Return a drawn rig and its logs: time, x0, u0, … in SI, and joint0, … in rad; those to learn
    from, or `every` one. Each drive may move `alone` once.

    In logs to judge by, the angles are exact, about the zeros of the encoders of the others: no log
    tells where else a joint may have its zero.
    """
    rig = drawn_rig(seed, False)
    logs, _ = logs_of(rig, seed, alone)
    joints = [joint["name"] for joint in rig.raw["joints"]]
    made = []
    for log in logs if every else logs[:LEARNED]:
        angles = dict(zip(joints, log.truth.values()))
        if not log.truth_kind.by_sensor:
            angles = {
                name: angle + offset for (name, angle), offset in zip(angles.items(), rig.offsets)
            }
        made.append({"time": log.time, **log.channels, **angles})
    return rig, made


def write(columns: Mapping[str, Floats], path: Path) -> None:
    """Write a log as CSV."""
    cells = np.column_stack(list(columns.values()))
    np.savetxt(path, cells, delimiter=",", header=",".join(columns), comments="", fmt="%.9g")


def crossings_of_plant(rig: Drawn) -> dict[str, Counter[tuple[str, int]]]:
    """Return drive → how often a tendon of it crosses a joint on a side."""
    found: dict[str, Counter[tuple[str, int]]] = {}
    for tendon in rig.raw["tendons"]:
        of_drive = found.setdefault(tendon["drive"].replace("drive", "x"), Counter())
        of_drive.update((c["joint"], c["side"]) for c in tendon.get("crossings", [tendon]))
    return found


def crossings_of_file(path: Path) -> dict[str, Counter[tuple[str, int]]]:
    """Return the same of a rig file, by the column of each drive's position."""
    rig = load_rig(path)
    columns = {s.of: s.log_column for s in rig.sensors if s.measures == "position"}
    found: dict[str, Counter[tuple[str, int]]] = {}
    for tendon in rig.tendons:
        of_drive = found.setdefault(columns[tendon.drive], Counter())
        of_drive.update((joint, 1 if arm > 0 else -1) for joint, arm in tendon.arms().items())
    return found


def structure_of(seed: int) -> tuple[str, str]:
    """Return the kind of a drawn rig, and what the command made of its logs: right, wrong, cannot
    be told, or refused. With half of the seeds each drive moves alone once.
    """
    rig, logs = drawn_logs(seed, alone=seed % 4 > 1)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [folder / f"run_{k}.csv" for k in range(len(logs))]
        for log, path in zip(logs, paths):
            write({n if n[0] != "j" else f"{n} [rad]": c for n, c in log.items()}, path)
        out = folder / "own.toml"
        done = subprocess.run(
            ["distal", "rig", "from-logs", *map(str, paths), "--out", str(out)],
            capture_output=True,
            text=True,
        )
        if done.returncode:
            return rig.kind, f"refused: {done.stderr.strip().splitlines()[-1][:100]}"
        if crossings_of_file(out) == crossings_of_plant(rig):
            return rig.kind, "right"
        return rig.kind, "cannot be told" if "cannot be told" in done.stdout else "wrong"


def structure(rigs: int, first: int) -> None:
    """Print how many structures are right, by family."""
    rows: dict[str, Counter[str]] = {}
    for seed in range(first, first + rigs):
        kind, outcome = structure_of(seed)
        rows.setdefault(kind, Counter())[outcome.partition(":")[0]] += 1
        if outcome != "right":
            print(seed, kind, outcome, file=sys.stderr)
    outcomes = ("right", "cannot be told", "wrong", "refused")
    every = sum(rows.values(), Counter())
    cells = [(kind, *(str(rows[kind][o]) for o in outcomes)) for kind in sorted(rows)]
    cells.append(("all", *(str(every[o]) for o in outcomes)))
    table("from-logs-structure", f"{rigs} rigs from {first} on", ["rig", *outcomes], cells)


Style = Mapping[str, tuple[str, str]]
"""Kind of a column (time, turn, slide, torque, force, angle) → its header and the unit in it; a
column without a unit in its header is in SI.
"""

FACTORS = {
    "s": 1.0,
    "ms": 1e3,
    "us": 1e6,
    "rad": 1.0,
    "deg": 180.0 / np.pi,
    "m": 1.0,
    "mm": 1e3,
    "N": 1.0,
    "N m": 1.0,
    "A": 1.0,
    "mA": 1e3,
    "turn counts": COUNTS * 100 / (2 * np.pi),
    "servo counts": COUNTS / (2 * np.pi),
    "slide counts": 1e7,
}
"""Unit → its size of one in SI; of an ampere one newton (metre) of the plant."""

ALIKE = {
    "mA": ("mA", "cN"),
    "A": ("A", "daN"),
    "turn counts": ("count",),
    "servo counts": ("count",),
    "slide counts": ("count",),
}
"""Unit of a style → how a rig file may have it; else it is itself."""


KINDS = ("time", "turn", "slide", "torque", "force", "angle")

STYLES: dict[str, Style] = {
    name: dict(zip(KINDS, columns, strict=True))
    for name, columns in {
        "units in brackets": (
            ("time [s]", "s"),
            ("motor{n} [deg]", "deg"),
            ("slider{n} [mm]", "mm"),
            ("force{n} [N]", "N"),
            ("force{n} [N]", "N"),
            ("joint{n} [deg]", "deg"),
        ),
        "units at the end": (
            ("time_ms", "ms"),
            ("m{n}_pos_rad", "rad"),
            ("m{n}_pos_mm", "mm"),
            ("m{n}_current_mA", "mA"),
            ("m{n}_current_mA", "mA"),
            ("pip{n}_deg", "deg"),
        ),
        "ticks": (
            ("timestamp_us", "us"),
            ("enc{n}_ticks", "turn counts"),
            ("enc{n}_ticks", "slide counts"),
            ("cur{n}_mA", "mA"),
            ("cur{n}_mA", "mA"),
            ("camera_joint{n}_deg", "deg"),
        ),
        "symbols": (
            ("t", "s"),
            ("phi{n}", "rad"),
            ("x{n}", "m"),
            ("u{n}", "N m"),
            ("u{n}", "N"),
            ("theta{n}", "rad"),
        ),
        "camel case": (
            ("timeStamp", "s"),
            ("motorPosition{n}", "rad"),
            ("motorPosition{n}", "m"),
            ("motorCurrent{n}", "A"),
            ("motorCurrent{n}", "A"),
            ("jointAngle{n}", "rad"),
        ),
        "German": (
            ("zeit_s", "s"),
            ("antrieb{n} [deg]", "deg"),
            ("antrieb{n} [mm]", "mm"),
            ("kraft{n} [N]", "N"),
            ("kraft{n} [N]", "N"),
            ("gelenk{n} [deg]", "deg"),
        ),
        "French": (
            ("temps [s]", "s"),
            ("moteur{n}_deg", "deg"),
            ("moteur{n}_mm", "mm"),
            ("courant{n}_mA", "mA"),
            ("courant{n}_mA", "mA"),
            ("articulation{n}_deg", "deg"),
        ),
        "Spanish": (
            ("tiempo", "s"),
            ("posicion_motor{n}", "rad"),
            ("posicion_motor{n}", "m"),
            ("fuerza{n}", "N"),
            ("fuerza{n}", "N"),
            ("angulo{n}", "rad"),
        ),
        "Italian": (
            ("tempo", "s"),
            ("posizione_motore{n}", "rad"),
            ("posizione_motore{n}", "m"),
            ("corrente{n}", "A"),
            ("corrente{n}", "A"),
            ("angolo_giunto{n}", "rad"),
        ),
    }.items()
}
"""Ways in which builders name the columns of a log."""


def kind_of(name: str, turns: bool) -> str:
    """Return the kind of a column of the plant's log, whose drives turn or slide."""
    if name == "time":
        return "time"
    if name[0] == "x":
        return "turn" if turns else "slide"
    if name[0] == "u":
        return "torque" if turns else "force"
    return "angle"


def true_role(name: str) -> str:
    """Return the role of a column of the plant's log."""
    if name == "time":
        return "time"
    return {"x": "position", "u": "effort"}.get(name[0], "angle")


def outcome_of(column: ColumnRole, role: str, unit: str) -> str:
    """Return whether role and unit of a column are right, wrong and doubted, or wrong."""
    if column.role != role:
        return "wrong" if column.sureness == "sure" else "wrong, doubted"
    if column.unit in ALIKE.get(unit, (unit,)):
        return "right"
    return "wrong, doubted" if column.unit_sureness == "a guess" else "wrong"


def columns(rigs: int, first: int) -> None:
    """Print how many columns get the right role and unit, by the way in which they are named."""
    rows: dict[str, Counter[str]] = {}
    for k, seed in enumerate(range(first, first + rigs)):
        rig, logs = drawn_logs(seed)
        turns = rig.raw["drives"][0]["kind"] == "capstan"
        rng = np.random.default_rng(seed)
        name = list(STYLES)[k % len(STYLES)]
        order = rng.permutation(list(logs[0]))
        named = {}
        for column in order:
            header, unit = STYLES[name][kind_of(column, turns)]
            named[column] = (header.format(n=column[-1]), unit)
        renamed = []
        for log in logs:
            made = {}
            for column, (header, unit) in named.items():
                values = log[column] * FACTORS[unit]
                made[header] = np.round(values) if "counts" in unit else values
            renamed.append(made)
        expected = {header: (true_role(column), unit) for column, (header, unit) in named.items()}
        with tempfile.TemporaryDirectory() as folder:
            paths = [Path(folder) / f"{i}.csv" for i in range(len(renamed))]
            for made, path in zip(renamed, paths):
                write(made, path)
            counted = rows.setdefault(name, Counter())
            try:
                found = rig_from_logs(paths).columns
            except DistalError as problem:
                counted["asked" if "--drive" in str(problem) else "refused"] += len(named)
                print(seed, name, str(problem)[:300], file=sys.stderr)
                continue
        for column in found:
            outcome = outcome_of(column, *expected[column.header])
            counted[outcome] += 1
            if outcome != "right":
                print(seed, name, expected[column.header], column.in_words, file=sys.stderr)
    outcomes = ("right", "wrong, doubted", "wrong", "asked", "refused")
    cells = [(name, *(str(rows[name][o]) for o in outcomes)) for name in rows]
    every = sum(rows.values(), Counter())
    cells.append(("all", *(str(every[o]) for o in outcomes)))
    table(
        "from-logs-columns",
        f"roles and units of columns, {rigs} rigs from {first} on",
        ["headers", *outcomes],
        cells,
    )


def hand_written(rig: Drawn, path: Path) -> None:
    """Write the rig file of somebody who knows the rig, with the columns of these logs."""
    raw = deepcopy(rig.raw)
    for sensor in raw["sensors"]:
        if sensor["measures"] == "angle":
            sensor["column"] = f"{sensor['of']} [rad]"
    raw["log"] = {"time": {"column": "time", "unit": "s"}}
    path.write_text(tomlkit.dumps(raw), encoding="utf-8")


def fitted_errors(rig: Path, training: list[Path], judged: list[Path]) -> tuple[float, float]:
    """Return the RMS error of a rig that the command fits [deg], and the share inside the band."""
    out = rig.with_name(f"{rig.stem}_fitted.toml")
    asked = ["distal", "fit", *map(str, training), "--rig", str(rig), "--out", str(out)]
    done = subprocess.run(asked, capture_output=True, text=True)
    if done.returncode:
        print(done.stderr.strip()[-200:], file=sys.stderr)
        return float("nan"), float("nan")
    description = load_rig(out)
    squares = []
    inside = []
    for path in judged:
        result = estimate(read_log(path, description), description)
        squares.append(result.rms_error() ** 2)
        inside.append(result.inside_band())
    return float(np.rad2deg(np.sqrt(np.mean(squares)))), float(np.mean(inside))


def rigs_of(seed: int) -> dict[str, float]:
    """Return the errors of both rigs of a seed, and of the least squares that its logs choose."""
    rig, logs = drawn_logs(seed, every=True)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [folder / f"run_{k}.csv" for k in range(len(logs))]
        for log, path in zip(logs, paths):
            write({n if n[0] != "j" else f"{n} [rad]": c for n, c in log.items()}, path)
        training, judged = paths[:LEARNED], paths[LEARNED:]
        own, hand = folder / "own.toml", folder / "hand.toml"
        own.write_text(rig_from_logs(training).text, encoding="utf-8")
        hand_written(rig, hand)
        found = dict(zip(("own", "own_inside"), fitted_errors(own, training, judged)))
        found |= dict(zip(("hand", "hand_inside"), fitted_errors(hand, training, judged)))
        description = load_rig(own)
        samples = [samples_of_angles(read_log(path, description), description) for path in paths]
        learned, others = samples[:LEARNED], samples[LEARNED:]
        folds = range(LEARNED)
        errors = {
            yardstick: np.mean(
                [
                    yardstick_error(yardstick, [learned[i] for i in folds if i != k], learned[k])
                    for k in folds
                ]
            )
            for yardstick in YARDSTICKS
        }
        best = min(errors, key=lambda each: errors[each])
        squares = [yardstick_error(best, learned, log) ** 2 for log in others]
        return found | {"least squares": float(np.rad2deg(np.sqrt(np.mean(squares))))}


def rigs(count: int, first: int) -> None:
    """Print the errors of rigs from logs beside hand-written ones."""
    cells = []
    found = []
    for seed in range(first, first + count):
        errors = rigs_of(seed)
        found.append(errors)
        kind = drawn_rig(seed, False).kind
        row = (errors["own"], errors["hand"], errors["least squares"])
        cells.append(
            (f"{seed}", kind, *(f"{e:.3f}" for e in row), f"{100 * errors['own_inside']:.0f}")
        )
        print(*cells[-1], sep=" | ", file=sys.stderr)
    by_hand = np.array([errors["own"] / errors["hand"] for errors in found])
    by_squares = np.array([errors["own"] / errors["least squares"] for errors in found])
    inside = 100 * np.mean([errors["own_inside"] for errors in found])
    print(
        f"beside hand-written: median {np.nanmedian(by_hand):.2f}, worst {np.nanmax(by_hand):.2f}; "
        f"beside least squares: median {np.nanmedian(by_squares):.2f}, worst "
        f"{np.nanmax(by_squares):.2f}; inside {inside:.0f} %"
    )
    columns = [
        "seed",
        "rig",
        "from logs [°]",
        "hand-written [°]",
        "least squares [°]",
        "inside [%]",
    ]
    table("from-logs-rigs", f"{count} rigs from {first} on", columns, cells)


def main() -> None:
    """Run a part."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("part", choices=("structure", "columns", "rigs"))
    parser.add_argument("--rigs", type=int, default=80)
    parser.add_argument("--first-seed", type=int, default=5000)
    arguments = parser.parse_args()
    parts = {"structure": structure, "columns": columns, "rigs": rigs}
    parts[arguments.part](arguments.rigs, arguments.first_seed)


if __name__ == "__main__":
    main()
