"""Fits as users run them: `distal fit` in a shell, then `distal estimate` with the file it wrote.

Nothing here calls a fit from Python. Each rig is a folder with a rig file and logs as CSV; the
commands run there with the environment of whoever runs this. The rigs' plants share no code with
`distal.model`, and most have physics that their rig files lack:

* `python -m benchmarks.fit_command named`: the rigs of `benchmarks.newcomers` and, with the folder
  of logs in `DISTAL_DATA`, the four that newcomers wrote;
* `python -m benchmarks.fit_command lacking --rigs 60 --first-seed 400`: rigs drawn at random
  (`benchmarks.strangers.lacking`), with 2 to 6 logs each;
* `--candidates` also fits from Python, to score on the held-out logs every candidate that a rig
  file can hold.
"""

from __future__ import annotations

import argparse
import re
import tempfile
import time
import warnings
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from tests.support.drawn_rigs import drawn_rig

from benchmarks import newcomers
from benchmarks.report import table
from benchmarks.shell import command, estimate, write_rig
from benchmarks.strangers import lacking
from distal import Log, Rig, fit, load_rig, read_log, write_log
from distal.errors import DistalError
from distal.logs import true_angles
from distal.rig import build_rig

LOGS = (2, 3, 3, 4, 5, 6)
"""Rigs drawn at random are fitted to so many logs, in turn."""

HELD_OUT = 2
"""So many logs of the same kind of motion are kept apart."""


@dataclass
class Outcome:
    """What came of one rig: whether a file was written, its score, and errors on held-out logs.

    The `errors` are beside the encoder of the fit, as the score is; `true_errors` and `inside` are
    beside the plant's angle, where it is another.
    """

    name: str
    ended: bool
    seconds: float
    message: str = ""
    score: float = float("nan")
    errors: list[float] = field(default_factory=list)
    true_errors: list[float] = field(default_factory=list)
    inside: list[float] = field(default_factory=list)
    best: float = float("nan")
    chosen: str = ""
    candidates: dict[str, tuple[float, list[float]]] = field(default_factory=dict)


def write_folder(
    folder: Path, rig: Rig, logs: Sequence[Log], held_out: Sequence[Log], plant: Sequence[Log] = ()
) -> None:
    """Write what a user has: a rig file, logs to fit and logs that are kept apart; and the latter
    with the plant's own angle.
    """
    write_rig(rig, folder / "mine.toml")
    for kind, kept in (("run", logs), ("held_out", held_out), ("plant", plant)):
        for i, log in enumerate(kept):
            write_log(as_logged(log, rig), rig, folder / f"{kind}_{i}.csv")


def as_logged(log: Log, rig: Rig) -> Log:
    """Return a log whose angles stand in the encoders' own columns where they come from these."""
    joints = [joint.name for joint in rig.joints]
    angles = true_angles(log, joints)
    encoders = {sensor.of: sensor.name for sensor in rig.sensors_of("angle")}
    if angles is None or not log.truth_kind.by_sensor or set(encoders) != set(joints):
        return log
    read = {encoders[name]: angles[:, j] for j, name in enumerate(joints)}
    return replace(log, channels={**log.channels, **read}, truth={})


def write_lacking(folder: Path, seed: int) -> None:
    """Write the folder of a rig drawn at random whose file lacks something."""
    count = LOGS[seed % len(LOGS)]
    drawn = drawn_rig(2 * seed, False)
    # the last log is of a wider motion: it is not one that the score speaks of
    logs, _ = lacking.logs_of(drawn, seed, count + HELD_OUT, 1)
    plant, _ = lacking.logs_of(drawn, seed, count, HELD_OUT + 1)
    kept = slice(count, count + HELD_OUT)
    rig = build_rig(drawn.raw, f"lacking {seed}")
    write_folder(folder, rig, logs[:count], logs[kept], plant[kept])


def write_named(folder: Path, name: str) -> None:
    """Write the folder of one of the rigs of `benchmarks.newcomers`."""
    rig, logs, others = newcomers.CASES[name](folder)
    write_folder(folder, rig, logs, [log for kept in others.values() for log in kept][:4])


def judged(folder: Path, name: str) -> Outcome:
    """Fit the logs of a folder and judge the file that was written, all by commands."""
    runs = sorted(path.name for path in folder.glob("run_*.csv"))
    began = time.perf_counter()
    done = command(folder, "fit", *runs, "--rig", "mine.toml", "--out", "fitted.toml")
    outcome = Outcome(name, done.returncode == 0, time.perf_counter() - began)
    if done.returncode:
        outcome.message = done.stderr.strip().splitlines()[-1]
        return outcome
    outcome.score = first_score(done.stdout)
    kinds = ("held_out", "plant") if any(folder.glob("plant_*.csv")) else ("held_out",)
    for kind in kinds:
        for log in sorted(folder.glob(f"{kind}_*.csv")):
            words = ("estimate", log.name, "--rig", "fitted.toml")
            said = command(folder, *words, "--no-what-if")
            row = re.search(
                r"^\s*(?:adaptive|regression)\s+([\d.]+)\s+[\d.]+\s+(\d+) %", said.stdout, re.M
            )
            if row is None:
                outcome.message = said.stderr.strip()[-300:] or "no error was printed"
                outcome.ended = False
                return outcome
            if kind == "held_out":
                outcome.errors.append(float(row[1]))
            if kind == kinds[-1]:
                outcome.true_errors.append(float(row[1]))
                outcome.inside.append(float(row[2]) / 100.0)
    return outcome


def first_score(text: str) -> float:
    """Return the error that `distal fit` printed first [°]; NaN where it printed none."""
    found = re.search(r"what gives the angle.*?\n[^\n]*\n.*?\s(\d+\.\d+)\s", text, re.S)
    return float(found[1]) if found else float("nan")


def with_candidates(folder: Path, outcome: Outcome) -> None:
    """Add the errors on the held-out logs of every candidate that a rig file can hold."""
    rig = load_rig(folder / "mine.toml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = fit([read_log(path, rig) for path in sorted(folder.glob("run_*.csv"))], rig)
        held_out = [read_log(path, rig) for path in sorted(folder.glob("held_out_*.csv"))]
        for candidate in found.candidates:
            errors = [_rms(log, candidate.rig) for log in held_out]
            outcome.candidates[candidate.name] = (float(np.rad2deg(candidate.error)), errors)
    outcome.chosen = found.candidates[0].name if found.candidates else ""
    outcome.best = min((mean(own) for *_, own in outcome.candidates.values()), default=np.nan)


def _rms(log: Log, rig: Rig) -> float:
    try:
        return float(np.rad2deg(estimate(log, rig, compiled=False).rms_error()))
    except DistalError:
        return float("inf")


def mean(errors: Sequence[float]) -> float:
    """Return the mean of some errors."""
    return float(np.mean(errors)) if len(errors) else float("nan")


def run(case: str | int, candidates: bool) -> Outcome:
    """Return what came of one rig, a named one or one of a seed."""
    with tempfile.TemporaryDirectory() as kept:
        folder = Path(kept)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            if isinstance(case, int):
                write_lacking(folder, case)
            else:
                write_named(folder, case)
        outcome = judged(folder, str(case))
        if candidates and outcome.ended:
            with_candidates(folder, outcome)
    return outcome


def summary(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return the rows of the goals, over all rigs."""
    ended = [outcome for outcome in outcomes if outcome.ended]
    rows = [["fits that end with their file", f"{len(ended)} of {len(outcomes)}"]]
    for words, errors in (
        ("RMS beside the encoder", "errors"),
        ("RMS of the plant's angle", "true_errors"),
    ):
        ratios = np.array(
            [mean(getattr(one, errors)) / one.score for one in ended if one.score > 0.0]
        )
        if len(ratios):
            at_most = f"{100 * np.mean(ratios <= 2.0):.0f} %"
            rows.append([f"{words} / score printed first", f"{_geometric(ratios):.2f}"])
            rows.append([f"{words}, at most twice the score", at_most])
    inside = [share for one in ended for share in one.inside]
    if inside:
        rows.append(["inside the band, pooled", f"{100 * np.mean(inside):.0f} %"])
    against = np.array([mean(one.errors) / one.best for one in ended if one.best > 0.0])
    if len(against):
        rows.append(["RMS / candidate that is best there", f"{_geometric(against):.3f}"])
    return rows


RIG = ("rig", "fit [s]", "score printed first [°]", "RMS on other logs [°]", "inside")


def by_rig(outcomes: Sequence[Outcome]) -> list[list[str]]:
    """Return a row for each rig."""
    return [
        [
            one.name,
            f"{one.seconds:.0f}",
            f"{one.score:.3f}",
            f"{mean(one.errors):.3f}" if one.ended else one.message,
            f"{100 * mean(one.inside):.0f} %" if one.ended else "",
        ]
        for one in outcomes
    ]


def _geometric(ratios: Any) -> float:
    return float(np.exp(np.mean(np.log(ratios))))


def main() -> None:
    """Run, print and store."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fit_command", description=__doc__)
    parser.add_argument("which", choices=("named", "lacking"))
    parser.add_argument("--rigs", type=int, default=60)
    parser.add_argument("--first-seed", type=int, default=400)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--candidates", action="store_true")
    asked = parser.parse_args()
    cases: list[str | int] = list(newcomers.CASES)
    if asked.which == "lacking":
        cases = list(range(asked.first_seed, asked.first_seed + asked.rigs))
    outcomes = []
    with ProcessPoolExecutor(asked.processes) as pool:
        jobs = [pool.submit(run, case, asked.candidates) for case in cases]
        for job in jobs:
            outcome = job.result()
            outcomes.append(outcome)
            said = f"{mean(outcome.errors):.3f}° / {outcome.score:.3f}° {outcome.chosen}"
            print(
                f"{outcome.name:20s} {outcome.seconds:5.0f} s  {outcome.message or said}",
                flush=True,
            )
    rows = by_rig(outcomes) if asked.which == "named" else summary(outcomes)
    columns = list(RIG) if asked.which == "named" else ["over all rigs", "measured"]
    title = f"{len(outcomes)} rigs, by commands"
    table(f"fit-command-{asked.which}", title, columns, rows)


if __name__ == "__main__":
    main()
