"""A reference that is late, or a joint that follows late: what `distal learn` takes them for.

`python -m benchmarks.late [--plants 10] [--first-seed 9000] [--cases late,joint] [--quick]` draws
plants in plain NumPy that share no code with `distal.model`, and writes their logs as files. In
`late` the reference of the calibration logs is late, and held until its next sample where it is
slower than the log, as a camera's. In `joint` the reference is not late, and the joint follows its
drives late, as the tip of a catheter. `distal learn` and `distal estimate` run as a user runs them.
Measured are the lag that is assumed, the error against the exact angle on new logs beside that of
the same command with the true lag given, and the error that was promised beside the one that
`distal estimate` prints of a new log. These two are against the reference with its noise.

What is late in a joint lies beyond the end of its tendons, so that its drives feel nothing of it.
With a reference of full rate a joint behind a delay thus gives the same logs as a reference that
comes so much later: there, only what is usual can tell one from the other.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
import tomllib
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from typer.testing import CliRunner

from benchmarks.from_logs import write
from benchmarks.report import table
from distal.cli.app import STOPPED, app

Floats = NDArray[np.float64]
Columns = dict[str, Floats]

STEP, PERIOD = 0.001, 0.01
"""Steps of the plant and of its logs [s]."""

BEFORE, DURATION = 2.0, 20.0
"""A plant moves so long before its log begins; length of a log [s]."""

LOGS = 4
"""Calibration logs."""

SLOW, FAST = 1.0, 2.0
"""Highest frequency of the motion in calibration logs and `new`, and in `fast` [Hz]."""

SETTLED = 0.5
"""Errors count from here on [s], as those that `distal learn` promises."""

RIGHT = 0.008
"""An assumed lag is right that is off by at most so much [s]."""

KINDS = ("capstan", "two motors", "two sliders")
"""Kinds of plants, in turn."""


@dataclass(frozen=True)
class Case:
    """What is late, and how.

    Args:
        kind: late (the reference) or joint.
        lag: by how much [s]; of a joint's first-order lag the time constant.
        rate: of the reference [Hz], 0 for one sample in each row.
        delay: whether a joint is behind a delay, else behind a first-order lag.
    """

    kind: str
    lag: float
    rate: float = 0.0
    delay: bool = False

    @property
    def name(self) -> str:
        """The case in words."""
        if self.kind == "joint":
            how = "delay" if self.delay else "first-order lag"
            return f"joint, {how} of {1e3 * self.lag:.0f} ms"
        held = f"held at {self.rate:.0f} Hz" if self.rate else "full rate"
        return f"late by {1e3 * self.lag:.0f} ms, {held}"

    @property
    def reference_lag(self) -> float:
        """By how much a sample of the reference is late when it arrives [s]."""
        return self.lag if self.kind == "late" else 0.0

    @property
    def lag_in_log(self) -> float:
        """By how much it is late in the first row that has it, on average [s].

        A reference with its own clock waits for that row for half of a period. Rows that repeat it
        later are none of its samples.
        """
        return self.reference_lag + (PERIOD / 2 if self.rate else 0.0)


CASES = (
    *(
        Case("late", lag, rate)
        for rate in (0.0, 60.0, 30.0)
        for lag in (0.0, 0.010, 0.016, 0.040, 0.080)
    ),
    *(Case("joint", lag, delay=delay) for delay in (False, True) for lag in (0.050, 0.100, 0.200)),
)


@dataclass(frozen=True)
class Plant:
    """A joint that stands where its tendons and its load are in balance.

    Args:
        kind: one of `KINDS`.
        drum: radius of the motors' drums [m]; 1 for sliders.
        arm: radius at the joint [m].
        stiffness: of a tendon [N/m].
        spring: of the joint [N m/rad].
        weight: largest torque of gravity [N m].
        leans: angle at which gravity does nothing [rad].
        play: half of the backlash of the tendon, or way over which sheath friction turns [m].
        pretension: of each of two tendons [N].
        sheath: friction coefficient times bend of each sheath [1].
        rub: friction of a motor [N m].
        constant: torque constant of a motor [N m/A].
        reference_std: random error of the reference [rad].
    """

    kind: str
    drum: float
    arm: float
    stiffness: float
    spring: float
    weight: float
    leans: float
    play: float
    pretension: float
    sheath: float
    rub: float
    constant: float
    reference_std: float

    @classmethod
    def drawn(cls, kind: str, rng: np.random.Generator) -> Plant:
        """Return a random plant of a kind."""
        return cls(
            kind=kind,
            drum=1.0 if kind == "two sliders" else rng.uniform(0.006, 0.012),
            arm=rng.uniform(0.008, 0.013),
            stiffness=rng.uniform(4e3, 10e3),
            spring=rng.uniform(0.03, 0.08),
            weight=rng.uniform(0.01, 0.04),
            leans=rng.uniform(-1.0, 1.0),
            play=rng.uniform(0.5e-4, 2e-4),
            pretension=rng.uniform(11.0, 16.0),
            sheath=rng.uniform(0.1, 0.35),
            rub=rng.uniform(0.005, 0.02),
            constant=rng.uniform(0.05, 0.1),
            reference_std=np.deg2rad(rng.uniform(0.1, 0.3)),
        )

    def strokes(self, highest: float, rng: np.random.Generator) -> Floats:
        """Return how much each drive draws in at each step [m], (k, n_drives)."""
        way = self.arm * np.deg2rad(rng.uniform(35, 45)) * smooth(highest, rng)
        if self.kind == "capstan":
            return way[:, None]
        both = 1e-4 * rng.uniform(0.5, 2.0) * smooth(SLOW, rng)
        return np.column_stack([both + way, both - way])

    def angle_and_tensions(self, strokes: Floats) -> tuple[Floats, Floats]:
        """Return the angle [rad], (k,), and the tensions at the drives [N], (k, n_drives), of which
        that of the one drive is the difference of its two sides.
        """
        after = np.column_stack([played(stroke, self.play) for stroke in strokes.T])
        if self.kind == "capstan":
            drawn, passed, signs, pretension = after, np.ones_like(after), np.ones(1), 0.0
        else:
            drawn, signs, pretension = strokes, np.array([1.0, -1.0]), self.pretension
            passed = np.exp(-self.sheath * (strokes - after) / self.play)
        angle = np.zeros(len(strokes))
        for _ in range(50):
            tensions = pretension + self.stiffness * (drawn - self.arm * signs * angle[:, None])
            excess = self.arm * (passed * signs * tensions).sum(axis=1) - self.load(angle)
            softer = self.arm**2 * self.stiffness * passed.sum(axis=1)
            change = excess / (softer + self.spring + self.weight * np.cos(angle - self.leans))
            angle = angle + change
            if np.abs(change).max() < 1e-12:
                break
        assert self.kind == "capstan" or tensions.min() > 0.0
        return angle, tensions

    def load(self, angle: Floats) -> Floats:
        """Return the torque of spring and gravity [N m]."""
        return self.spring * angle + self.weight * np.sin(angle - self.leans)

    def columns(self, strokes: Floats, tensions: Floats, rng: np.random.Generator) -> Columns:
        """Return what the drives of a log read."""
        rows = rows_of_log()
        read: Columns = {"t [s]": PERIOD * np.arange(len(rows))}
        for k, (stroke, tension) in enumerate(zip(strokes.T, tensions.T), 1):
            noise = rng.normal(size=len(rows))
            if self.kind == "two sliders":
                read[f"slider{k} [mm]"] = np.round(1e3 * stroke[rows], 3)
                read[f"force{k} [N]"] = np.round(tension[rows] + 0.05 * noise, 3)
                continue
            turned = stroke / self.drum
            rub = self.rub * np.tanh(np.gradient(turned, STEP) / 0.05)
            current = (self.drum * tension + rub) / self.constant
            counts = np.round(turned[rows] * 4096 / (2 * np.pi))
            read[f"motor{k} [deg]"] = counts * 360 / 4096
            read[f"current{k} [mA]"] = np.round(1e3 * current[rows] + 10.0 * noise)
        return read


def smooth(highest: float, rng: np.random.Generator) -> Floats:
    """Return a smooth random motion between −1 and 1 from 0.1 Hz up to a highest frequency."""
    time = times()
    frequencies = np.append(np.exp(rng.uniform(np.log(0.1), np.log(highest), 7)), highest)
    sizes = rng.uniform(0.5, 1.0, 8) / np.sqrt(frequencies)
    phases = rng.uniform(0, 2 * np.pi, 8)
    motion = np.sin(2 * np.pi * np.outer(time, frequencies) + phases) @ sizes
    scaled: Floats = motion / np.abs(motion).max()
    return scaled


def times() -> Floats:
    """Return the times of the plant's steps, 0 where the log begins [s]."""
    return STEP * np.arange(-round(BEFORE / STEP), round(DURATION / STEP) + 1)


def rows_of_log() -> NDArray[np.int64]:
    """Return the steps at which a log has a row."""
    every = round(PERIOD / STEP)
    return np.arange(round(BEFORE / STEP), len(times()), every)


def played(values: Floats, half: float) -> Floats:
    """Return what follows values with play of a half-width."""
    now = float(values[0])
    after = []
    for value in values.tolist():
        now = min(max(now, value - half), value + half)
        after.append(now)
    return np.array(after)


def followed(values: Floats, case: Case) -> Floats:
    """Return the angle of the joint behind that of the tendon's end, at all steps."""
    if case.kind != "joint":
        return values
    if case.delay:
        steps = round(case.lag / STEP)
        return np.concatenate([np.full(steps, values[0]), values[: len(values) - steps]])
    now = float(values[0])
    kept = float(np.exp(-STEP / case.lag))
    after = []
    for value in values.tolist():
        now = value + kept * (now - value)
        after.append(now)
    return np.array(after)


def referred(angle: Floats, std: float, case: Case, rng: np.random.Generator) -> Floats:
    """Return the reference in each row of a log, from the joint's angle at all steps [rad].

    A sample is taken, arrives later by the lag, and stands in the rows until the next arrives.
    """
    rows = times()[rows_of_log()]
    if case.rate:
        first = -1.0 + rng.uniform() / case.rate
        samples = first + np.arange(round((DURATION + 2.0) * case.rate)) / case.rate
    else:
        samples = rows - case.reference_lag
    read = np.interp(samples, times(), angle) + std * rng.normal(size=len(samples))
    # a row that is a rounding error before an arrival has it
    latest = np.searchsorted(samples + case.reference_lag, rows + 1e-9, side="right") - 1
    return read[latest]


def write_logs(folder: Path, seed: int, case: Case) -> None:
    """Write `run_0.csv` … to learn from, `new.csv` and `fast.csv`, which have no reference,
    with their exact angles beside them, and `referred.csv`, which is `new.csv` with a reference.

    All cases of a seed have the same plant, motion and errors of the drives' readings.
    """
    rng = np.random.default_rng(seed)
    plant = Plant.drawn(KINDS[seed % len(KINDS)], rng)
    motions = {**{f"run_{k}": SLOW for k in range(LOGS)}, "new": SLOW, "fast": FAST}
    for k, (name, highest) in enumerate(motions.items()):
        strokes = plant.strokes(highest, rng)
        end, tensions = plant.angle_and_tensions(strokes)
        angle = followed(end, case)
        columns = plant.columns(strokes, tensions, rng)
        if name.startswith("run"):
            own = np.random.default_rng([seed, k])
            columns["joint [deg]"] = np.rad2deg(referred(angle, plant.reference_std, case, own))
        write(columns, folder / f"{name}.csv")
        if name == "new":
            own = np.random.default_rng([seed, k])
            columns["joint [deg]"] = np.rad2deg(referred(angle, plant.reference_std, case, own))
            write(columns, folder / "referred.csv")
        exact = {"t": columns["t [s]"], "theta": angle[rows_of_log()]}
        write(exact, folder / f"{name}_exact.csv")


def columns_of(path: Path) -> Columns:
    """Return the columns of a CSV by their names without units."""
    with path.open(encoding="utf-8") as file:
        names = [name.partition("[")[0].strip() for name in file.readline().split(",")]
        cells = np.genfromtxt(file, delimiter=",")
    return dict(zip(names, cells.T))


def command(*words: object) -> str:
    """Return what `distal` prints, run in this process.

    Raises:
        RuntimeError: it ended with an error.
        KeyboardInterrupt: it was stopped.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = CliRunner().invoke(app, [str(word) for word in words])
    if done.exit_code == STOPPED:  # by a signal, after which it ends with the best so far
        raise KeyboardInterrupt
    if done.exit_code:
        raise RuntimeError(f"{done.output[-300:]} {done.exception or ''}".strip())
    return str(done.output)


def said_lag(printed: str) -> float:
    """Return the lag of the reference that `distal learn` says it assumes [s], 0 where it says
    none.
    """
    text = " ".join(printed.split())
    found = re.search(r"reference is taken as ([\d.]+) ms (later|earlier)", text)
    if found is None:
        return 0.0
    return 1e-3 * float(found[1]) * (1.0 if found[2] == "later" else -1.0)


def promised_error(rig: Path) -> float:
    """Return the RMS error that a rig file says of logs left out [rad]; NaN where it says none."""
    with rig.open("rb") as file:
        left_out = tomllib.load(file).get("left_out", {})
    return float(left_out.get("rms", np.nan))


def learned(folder: Path, name: str, *words: str) -> str:
    """Return what `distal learn` prints, which writes a rig of this name."""
    runs = [folder / f"run_{k}.csv" for k in range(LOGS)]
    return command("learn", *runs, "--out", folder / f"{name}.toml", *words)


def error_of(folder: Path, rig: str, log: str) -> float:
    """Return the RMS error of `distal estimate` on a log against its exact angle [rad]."""
    out = folder / f"{log}_by_{rig}.csv"
    options = ("--no-what-if", "--unit", "rad", "--out", out)
    command("estimate", folder / f"{log}.csv", "--rig", folder / f"{rig}.toml", *options)
    estimated = columns_of(out)
    exact = columns_of(folder / f"{log}_exact.csv")
    angle = next(name for name in estimated if name.startswith("theta"))
    assert np.allclose(estimated["t"], exact["t"], atol=1e-6)
    errors = (estimated[angle] - exact["theta"])[exact["t"] >= SETTLED]
    return float(np.sqrt(np.mean(errors**2)))


def found_error(folder: Path) -> float:
    """Return the RMS error that `distal estimate` prints of a new log with a reference [rad]."""
    options = ("--no-what-if", "--out", folder / "referred_out.csv")
    printed = command("estimate", folder / "referred.csv", "--rig", folder / "own.toml", *options)
    found = re.search(r"RMS error ([\d.]+)°", " ".join(printed.split()))
    assert found is not None, printed
    return float(np.deg2rad(float(found[1])))


@dataclass(frozen=True)
class Outcome:
    """What came of one plant in one case.

    Args:
        assumed: lag of the reference that was assumed [s].
        true: the true one, of the first row of each sample [s].
        ratios: log → RMS error over that with the true lag given [1].
        promised: RMS error that the rig file says [rad].
        found: RMS error that is printed of the new log with a reference [rad].
    """

    assumed: float
    true: float
    ratios: Mapping[str, float]
    promised: float
    found: float

    @property
    def right(self) -> bool:
        """Whether the right lag was assumed."""
        return abs(self.assumed - self.true) <= RIGHT


def outcome_of(seed: int, case: Case) -> Outcome:
    """Return what came of one plant in one case.

    Raises:
        RuntimeError: a command ended with an error.
    """
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        write_logs(folder, seed, case)
        assumed = said_lag(learned(folder, "own"))
        true = case.lag_in_log
        learned(folder, "told", "--reference-lag", f"{1e3 * true:.4g} ms" if true else "0")
        errors = {
            log: tuple(error_of(folder, rig, log) for rig in ("own", "told"))
            for log in ("new", "fast")
        }
        return Outcome(
            assumed=assumed,
            true=true,
            ratios={log: own / told for log, (own, told) in errors.items()},
            promised=promised_error(folder / "own.toml"),
            found=found_error(folder),
        )


def outcomes_of(seeds: Sequence[int], case: Case) -> Iterator[Outcome]:
    """Yield what came of each plant, and print it to stderr; errors are printed only."""
    for seed in seeds:
        kind = KINDS[seed % len(KINDS)]
        try:
            outcome = outcome_of(seed, case)
        except RuntimeError as problem:
            print(f"{case.name}, {kind} {seed}: {problem}", file=sys.stderr, flush=True)
            continue
        ratios = ", ".join(f"{log} {ratio:.3f}" for log, ratio in outcome.ratios.items())
        print(
            f"{case.name}, {kind} {seed}: assumed {1e3 * outcome.assumed:.0f} of "
            f"{1e3 * outcome.true:.1f} ms; ratios {ratios}; promised "
            f"{np.rad2deg(outcome.promised):.3f}°, found {np.rad2deg(outcome.found):.3f}°",
            file=sys.stderr,
            flush=True,
        )
        yield outcome


COLUMNS = (
    "case",
    "runs",
    "true lag [ms]",
    "assumed, median (range) [ms]",
    "found right [%]",
    "RMS over that with the true lag given, new: median, worst",
    "fast: median, worst",
    "promised, found [°], medians",
    "found/promised, median",
)


def row_of(name: str, outcomes: Sequence[Outcome], asked: int) -> tuple[str, ...]:
    """Return the cells of some outcomes."""
    runs = f"{len(outcomes)}" if len(outcomes) == asked else f"{len(outcomes)} of {asked}"
    if not outcomes:
        return (name, runs, *["–"] * (len(COLUMNS) - 2))

    def over(number: Callable[[Outcome], float]) -> Floats:
        return np.array([number(outcome) for outcome in outcomes])

    true = 1e3 * over(lambda outcome: outcome.true)
    assumed = 1e3 * over(lambda outcome: outcome.assumed)
    ratios = [over(lambda outcome, log=log: outcome.ratios[log]) for log in ("new", "fast")]
    promised = over(lambda outcome: outcome.promised)
    found = over(lambda outcome: outcome.found)
    is_one = np.ptp(true) < 1e-6
    spread = f"{np.median(assumed):.0f} ({assumed.min():.0f} to {assumed.max():.0f})"
    return (
        name,
        runs,
        f"{true[0]:.1f}" if is_one else "–",
        spread if is_one else "–",
        f"{100 * np.mean(over(lambda outcome: outcome.right)):.0f}",
        *(f"{np.median(ratio):.2f}, {ratio.max():.2f}" for ratio in ratios),
        f"{np.rad2deg(np.nanmedian(promised)):.3f}, {np.rad2deg(np.median(found)):.3f}",
        f"{np.nanmedian(found / promised):.2f}",
    )


def main() -> None:
    """Run, print and save."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.late", description=__doc__)
    parser.add_argument("--plants", type=int, default=10)
    parser.add_argument("--first-seed", type=int, default=9000)
    asked = parser.parse_args()
    seeds = range(asked.first_seed, asked.first_seed + asked.plants)
    outcomes = {case: list(outcomes_of(seeds, case)) for case in CASES}
    rows = [row_of(case.name, of_case, len(seeds)) for case, of_case in outcomes.items()]
    for kind in ("late", "joint"):
        group = [case for case in CASES if case.kind == kind]
        every = [outcome for case in group for outcome in outcomes[case]]
        rows.append(row_of(f"all of {kind}", every, len(seeds) * len(group)))
    title = f"late references and joints, {len(seeds)} plants from seed {asked.first_seed} on"
    table("late", title, COLUMNS, rows)


if __name__ == "__main__":
    main()
