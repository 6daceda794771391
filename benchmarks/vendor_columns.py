"""How many columns are read right, with no option, in logs named as vendors and labs name them.

`python -m benchmarks.vendor_columns` prints a row for each style of names: how many columns have
the right role (and the right unit, where the header gives one), how many a wrong one, how many
were left to a question to the user or to a refusal, and the seconds until the answer or question.
What was not read right is listed below the table.

A style is a list of headers and of what each really holds (vendor_columns.toml). Its logs come
from a plain quasi-static plant, antagonists or one motor to a joint on compliant tendons with
friction; it shares no code with `distal.model`. The order of the columns is drawn, so the time may
be anywhere. Where two columns of a drive are both its effort, as a torque and the current that it
was computed from, or two are both times, one has to be found and the other one may be found or
left.

The names were written down without a look at the words that the package knows.
"""

from __future__ import annotations

import argparse
import csv
import tempfile
import time
import tomllib
from collections import defaultdict
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from benchmarks.report import table
from distal.errors import DistalError
from distal.from_logs import ColumnRole, rig_from_logs

Floats = NDArray[np.float64]

RATE = 50.0
DURATION = 20.0
LOGS = 3
TURN = 2.0 * np.pi
UNIX = 1718031234.0
"""Time of the first row where a log has the time of day [s]."""

ROLE_OF = {
    "time": "time",
    "time of day": "time",
    "position": "position",
    "effort": "effort",
    "angle": "angle",
    "goal": "command",
    "goal effort": "command",
    "joint goal": "command",
}
"""Role of a column by what it holds; of all else it is `other`."""


@dataclass(frozen=True)
class Column:
    """A column, or one for each drive or joint where its header says `{drive}` or `{joint}`.

    Args:
        header: as the log has it.
        holds: what its values are, a key of `ROLE_OF` or a case of `values_of`.
        unit: of its values.
        said: the header gives the unit.
        spare: another column has the same role for the same drive, and one of them is enough.
        number: value of a constant, or the first one of a counter.
    """

    header: str
    holds: str
    unit: str = ""
    said: bool = False
    spare: bool = False
    number: float = 0.0

    @property
    def role(self) -> str:
        """What it has to be taken for."""
        return ROLE_OF.get(self.holds, "other")


@dataclass(frozen=True)
class Layout:
    """Names of the drives and the references of a rig: as many drives as references where each
    joint has one motor, twice as many where each has two.

    Args:
        drives: names or numbers; antagonists side by side.
        references: columns of the true angles, one a joint.
        joints: their names or numbers, for headers that say `{joint}`.
    """

    drives: list[str]
    references: list[Column]
    joints: list[str]


@dataclass(frozen=True)
class Style:
    """How a vendor or a lab names columns.

    Args:
        name: of the style.
        columns: all but the references.
        layouts: taken in turn.
    """

    name: str
    columns: list[Column]
    layouts: list[Layout]


def column_of(row: Sequence[Any]) -> Column:
    """Return a column of the file of styles: header, what it holds, unit and options."""
    options = row[-1] if isinstance(row[-1], dict) else {}
    return Column(*(cell for cell in row if cell is not options), **options)


def styles() -> list[Style]:
    """Return all styles."""
    text = Path(__file__).with_suffix(".toml").read_text(encoding="utf-8")
    return [
        Style(
            style["name"],
            [column_of(row) for row in style["columns"]],
            [
                Layout(
                    layout["drives"],
                    [column_of(row) for row in layout["references"]],
                    layout.get("joints", []),
                )
                for layout in style["layouts"]
            ],
        )
        for style in tomllib.loads(text)["styles"]
    ]


@dataclass(frozen=True)
class Named:
    """A column of a rig: with the drive and the joint that its values are of."""

    column: Column
    header: str
    drive: int = 0
    joint: int = 0


def named_columns(style: Style, layout: Layout) -> list[Named]:
    """Return all columns of a rig, in a fixed order."""
    result = [Named(column, column.header, joint=j) for j, column in enumerate(layout.references)]
    for column in style.columns:
        if "{drive}" in column.header:
            headers = [column.header.format(drive=name) for name in layout.drives]
            result += [Named(column, header, drive=d) for d, header in enumerate(headers)]
        elif "{joint}" in column.header:
            headers = [column.header.format(joint=name) for name in layout.joints]
            result += [Named(column, header, joint=j) for j, header in enumerate(headers)]
        else:
            result.append(Named(column, column.header))
    return result


@dataclass(frozen=True)
class Finger:
    """A joint with its tendons, in SI units.

    Args:
        antagonists: two motors that each pull one tendon, else one that pulls both.
        spool, pulley: radii at the motor and at the joint [m].
        stiffness: of a tendon [N/m].
        preload: of both tendons of a single motor [N].
        spring: of the joint [N m/rad].
        weight, phase: greatest torque of gravity [N m] and where it is zero [rad].
        joint_friction: Coulomb's, of the joint [N m].
        gear_friction: the same of a motor [N m].
        tendon_friction: share of a tendon's force that its way takes [1].
        torque_constant: of a motor with its gear [N m/A].
    """

    antagonists: bool
    spool: float
    pulley: float
    stiffness: float
    preload: float
    spring: float
    weight: float
    phase: float
    joint_friction: float
    gear_friction: float
    tendon_friction: float
    torque_constant: float

    @staticmethod
    def drawn(antagonists: bool, rng: np.random.Generator) -> Finger:
        """Return one with sizes of a robot's finger."""
        spool = rng.uniform(6e-3, 12e-3)
        pulley = rng.uniform(7e-3, 14e-3)
        return Finger(
            antagonists=antagonists,
            spool=spool,
            pulley=pulley,
            stiffness=rng.uniform(2.5e3, 1.5e4),
            preload=rng.uniform(6.0, 12.0),
            spring=rng.uniform(0.04, 0.1),
            weight=rng.uniform(0.005, 0.025),
            phase=rng.uniform(-1.0, 1.0),
            joint_friction=rng.uniform(0.02, 0.04) * 10.0 * pulley,
            gear_friction=rng.uniform(0.03, 0.06) * 10.0 * spool,
            tendon_friction=rng.uniform(0.02, 0.05),
            torque_constant=rng.uniform(0.3, 1.0),
        )

    def load(self, q: Floats) -> Floats:
        """Return the torque that holds the joint against spring and gravity [N m]."""
        return self.spring * q + self.weight * np.sin(q - self.phase)

    def goals(self, wanted: Floats, both: Floats) -> list[Floats]:
        """Return how much tendon each motor has to take up for a joint angle [m].

        Args:
            wanted: the angle [rad].
            both: force in which both antagonists pull [N].
        """
        force = self.load(wanted) / self.pulley
        if not self.antagonists:
            return [self.pulley * wanted + force / (2.0 * self.stiffness)]
        flexor = both + np.maximum(force, 0.0)
        extensor = both + np.maximum(-force, 0.0)
        return [
            self.pulley * wanted + flexor / self.stiffness,
            -self.pulley * wanted + extensor / self.stiffness,
        ]

    def forces(self, taken: Sequence[Floats], q: Floats) -> tuple[Floats, Floats]:
        """Return the forces of the flexor and of the extensor; a tendon cannot push [N]."""
        if self.antagonists:
            flexor = self.stiffness * (taken[0] - self.pulley * q)
            extensor = self.stiffness * (taken[1] + self.pulley * q)
        else:
            stretch = self.stiffness * (taken[0] - self.pulley * q)
            flexor = self.preload + stretch
            extensor = self.preload - stretch
        return np.maximum(flexor, 0.0), np.maximum(extensor, 0.0)

    def angles(self, taken: Sequence[Floats]) -> Floats:
        """Return the joint's angle: it stays where it is while friction can hold it [rad]."""
        lowest = self._balance(taken, self.joint_friction)
        highest = self._balance(taken, -self.joint_friction)
        q = np.empty_like(lowest)
        at = 0.5 * (lowest[0] + highest[0])
        for k in range(len(q)):
            at = min(max(at, lowest[k]), highest[k])
            q[k] = at
        return q

    def _balance(self, taken: Sequence[Floats], torque: float) -> Floats:
        """Return the angles at which the tendons leave a torque over [rad]."""
        low = np.full_like(taken[0], -2.5)
        high = np.full_like(taken[0], 2.5)
        for _ in range(45):
            middle = 0.5 * (low + high)
            flexor, extensor = self.forces(taken, middle)
            over = self.pulley * (flexor - extensor) - self.load(middle) > torque
            low = np.where(over, middle, low)
            high = np.where(over, high, middle)
        return 0.5 * (low + high)

    def pulls(self, taken: Sequence[Floats], q: Floats) -> list[Floats]:
        """Return the force with which each motor pulls, with the friction of the way [N]."""
        flexor, extensor = self.forces(taken, q)
        moving = [np.tanh(np.gradient(each) * RATE / 1e-3) for each in taken]
        if self.antagonists:
            forces = [flexor, extensor]
            return [
                force * (1.0 + self.tendon_friction * sign) for force, sign in zip(forces, moving)
            ]
        return [flexor - extensor + self.tendon_friction * (flexor + extensor) * moving[0]]


def smooth(count: int, fastest: float, rng: np.random.Generator) -> Floats:
    """Return a smooth random motion between about -1 and 1.

    Args:
        count: of its samples.
        fastest: highest frequency in it [Hz].
        rng: draws it.
    """
    seconds = np.arange(count) / RATE
    frequencies = rng.uniform(0.05, fastest, 7)
    phases = rng.uniform(0.0, TURN, 7)
    sizes = rng.uniform(0.5, 1.0, 7)
    waves = np.sin(TURN * frequencies[:, None] * seconds + phases[:, None])
    motion = sizes @ waves
    return (motion - motion.mean()) / np.abs(motion - motion.mean()).max()


def followed(goal: Floats, lag: float) -> Floats:
    """Return how a motor follows a goal, late by a lag [s]."""
    share = 1.0 - np.exp(-1.0 / (RATE * lag))
    result = np.empty_like(goal)
    at = goal[0]
    for k in range(len(goal)):
        at += share * (goal[k] - at)
        result[k] = at
    return result


@dataclass(frozen=True)
class Drive:
    """How a drive is mounted and read: its sign and its zero, and how its spool and motor are."""

    finger: Finger
    sign: float
    zero: float

    @staticmethod
    def drawn(finger: Finger, rng: np.random.Generator) -> Drive:
        """Return one that turns either way from any zero."""
        return Drive(finger, float(rng.choice([-1.0, 1.0])), rng.uniform(-1.0, 1.0))

    def position(self, taken: Floats, unit: str, zeroed: bool = True) -> Floats:
        """Return the tendon that is taken up as the drive's encoder shows it, before rounding."""
        zero = self.zero if zeroed else 0.0
        if unit == "mm":
            return self.sign * taken * 1e3 + (25.0 + 10.0 * zero if zeroed else 0.0)
        radians = self.sign * taken / self.finger.spool + 1.2 * zero
        if unit == "count":
            return radians / TURN * 4096.0 + (2048.0 if zeroed else 0.0)
        return (
            radians
            * {"rad": 1.0, "deg": 360.0 / TURN, "turn": 1.0 / TURN, "rpm": 60.0 / TURN}[unit]
        )

    def effort(self, pull: Floats, speed: Floats, unit: str) -> Floats:
        """Return what the drive says of the force with which it pulls.

        Args:
            pull: the force [N].
            speed: at which it takes up tendon [m/s].
            unit: of the result.
        """
        if unit == "N":
            return pull
        friction = self.finger.gear_friction * np.tanh(speed / 1e-3)
        torque = self.sign * (self.finger.spool * pull + friction)
        amperes = torque / self.finger.torque_constant
        scales = {"A": 1.0, "mA": 1e3, "permille": 1e3 / 1.5}
        return torque if unit == "N m" else amperes * scales[unit]


@dataclass
class Run:
    """What really happened in a log, in SI units: a list has an entry for each drive or joint."""

    seconds: Floats
    goals: list[Floats] = field(default_factory=list)
    taken: list[Floats] = field(default_factory=list)
    pulls: list[Floats] = field(default_factory=list)
    wanted: list[Floats] = field(default_factory=list)
    angles: list[Floats] = field(default_factory=list)


def run_of(fingers: Sequence[Finger], rng: np.random.Generator) -> Run:
    """Return a log's motion of all joints."""
    count = int(DURATION * RATE)
    jitter = rng.uniform(-3e-4, 3e-4, count)
    run = Run(np.arange(count) / RATE + 0.01 + jitter)
    for finger in fingers:
        wanted = rng.uniform(0.1, 0.3) + rng.uniform(0.55, 0.8) * smooth(count, 0.7, rng)
        both = 8.0 + rng.uniform(3.0, 5.0) * smooth(count, 0.25, rng)
        goals = finger.goals(wanted, both)
        taken = [followed(goal, 0.03) for goal in goals]
        angles = finger.angles(taken)
        run.wanted.append(wanted)
        run.angles.append(angles)
        run.goals += goals
        run.taken += taken
        run.pulls += finger.pulls(taken, angles)
    return run


def rounded(values: Floats, unit: str) -> Floats:
    """Return values with as many digits as a log has."""
    return np.round(values, {"count": 0, "mA": 0, "permille": 0, "deg": 3, "mm": 3}.get(unit, 5))


def values_of(
    named: Named, run: Run, drives: Sequence[Drive], rng: np.random.Generator
) -> Iterable[object]:
    """Return the values of a column in a log."""
    column = named.column
    unit = column.unit
    drive = drives[named.drive]
    rows = len(run.seconds)
    taken = run.taken[named.drive]
    speed = np.gradient(taken) * RATE
    noise = rng.standard_normal(rows)
    match column.holds:
        case "time" | "time of day":
            start = UNIX if column.holds == "time of day" else 0.0
            scale = {"s": 1.0, "ms": 1e3, "ns": 1e9}[unit]
            if unit == "s":
                return np.round(start + run.seconds, 6)
            return [round(start * scale) + round(each * scale) for each in run.seconds]
        case "position":
            step = 0.01 if unit == "mm" else {"count": 1.0, "rad": TURN, "deg": 360.0}.get(unit, 1)
            step = step / 4096.0 if unit in ("rad", "deg", "turn") else step
            seen = drive.position(taken, unit)
            return rounded(np.round(seen / step + 0.2 * noise) * step, unit)
        case "goal":
            return rounded(drive.position(run.goals[named.drive], unit), unit)
        case "error":
            behind = drive.position(run.goals[named.drive], unit) - drive.position(taken, unit)
            return rounded(behind, unit)
        case "velocity":
            turned = drive.position(taken, unit)
            return rounded(np.gradient(turned) * RATE * (1.0 + 0.03 * noise), unit)
        case "effort":
            effort = drive.effort(run.pulls[named.drive], speed, unit)
            return rounded(effort + 0.02 * np.abs(effort).max() * noise, unit)
        case "goal effort":
            effort = drive.effort(run.pulls[named.drive], speed, unit)
            return rounded(followed(effort, 0.01), unit)
        case "pwm":
            effort = drive.effort(run.pulls[named.drive], speed, "permille")
            return np.round(effort + 400.0 * drive.sign * speed / drive.finger.spool / TURN)
        case "bus current":
            efforts = [d.effort(pull, 0.0 * speed, "A") for d, pull in zip(drives, run.pulls)]
            return np.round(0.3 + 0.2 * sum(np.abs(each) for each in efforts) + 0.01 * noise, 4)
        case "angle" | "joint goal":
            true = run.angles if column.holds == "angle" else run.wanted
            blur = np.radians(0.15) * noise if column.holds == "angle" else 0.0
            scale = 360.0 / TURN if unit == "deg" else 1.0
            return np.round((true[named.joint] + blur) * scale, 4)
        case "tip across":
            return np.round(320.0 + 180.0 * np.sin(run.angles[named.joint]) + 0.4 * noise, 1)
        case "tip along":
            return np.round(240.0 + 180.0 * np.cos(run.angles[named.joint]) + 0.4 * noise, 1)
        case "temperature":
            return np.round(36.0 + 0.15 * run.seconds + rng.uniform(0.0, 2.0))
        case "voltage":
            return np.round(12.0 + 0.05 * noise, 1)
        case "noise":
            return np.round(0.01 * noise, 4)
        case "near constant":
            return np.round(column.number + 0.2 * noise, 2)
        case "counter":
            return range(int(column.number), int(column.number) + rows)
        case "seconds":
            return [int(UNIX + each) for each in run.seconds]
        case "nanoseconds":
            return [round(each % 1.0 * 1e9) for each in run.seconds]
        case "nothing":
            return [""] * rows
        case "text":
            return [f"tendon_{named.drive}"] * rows
        case _:
            return [int(column.number)] * rows


@dataclass
class Score:
    """How the columns of a style were read: counts, seconds of each rig, and what was not right."""

    right: int = 0
    wrong: int = 0
    asked: int = 0
    refused: int = 0
    seconds: list[float] = field(default_factory=list)
    remarks: list[str] = field(default_factory=list)

    @property
    def counts(self) -> tuple[int, int, int, int]:
        """Columns right, wrong, asked and refused."""
        return self.right, self.wrong, self.asked, self.refused

    def cells(self) -> list[str]:
        """Return the cells of its row."""
        seconds = f"{np.mean(self.seconds):.1f}"
        return [*(str(count) for count in self.counts), seconds]


def mistakes(names: Sequence[Named], found: Sequence[ColumnRole]) -> list[str]:
    """Return what is wrong with each column that is not read right, a line each."""
    taken = {column.header: column for column in found}
    roles = {
        name.header: taken[name.header].role if name.header in taken else "other" for name in names
    }
    shared = defaultdict[tuple[str, int], list[str]](list)
    for name in names:
        shared[name.column.role, name.drive].append(roles[name.header])
    result = []
    for name in names:
        truth = name.column.role
        role = roles[name.header]
        spare = truth == "time" or name.column.spare
        if spare and role == "other" and truth in shared[truth, name.drive]:
            continue
        if role != truth:
            result.append(f"{name.header}: {role}, is {truth}")
        elif name.column.said and truth != "other" and taken[name.header].unit != name.column.unit:
            unit = taken[name.header].unit
            result.append(f"{name.header}: in '{unit}', is '{name.column.unit}'")
    return result


def try_rig(style: Style, layout: Layout, rng: np.random.Generator, score: Score) -> None:
    """Write the logs of a rig, have them read, and add to a style's score."""
    names = named_columns(style, layout)
    antagonists = len(layout.drives) == 2 * len(layout.references)
    fingers = [Finger.drawn(antagonists, rng) for _ in layout.references]
    each = 2 if antagonists else 1
    drives = [Drive.drawn(finger, rng) for finger in fingers for _ in range(each)]
    order = [names[i] for i in rng.permutation(len(names))]
    with tempfile.TemporaryDirectory() as folder:
        paths = []
        for number in range(LOGS):
            run = run_of(fingers, rng)
            columns = [values_of(name, run, drives, rng) for name in order]
            path = Path(folder) / f"log_{number}.csv"
            with path.open("w", newline="", encoding="utf-8") as file:
                writer = csv.writer(file)
                writer.writerow([name.header for name in order])
                writer.writerows(zip(*columns))
            paths.append(path)
        start = time.perf_counter()
        try:
            found = rig_from_logs(paths).columns
        except DistalError as error:
            score.seconds.append(time.perf_counter() - start)
            asks = "--drive" in str(error) or "--truth" in str(error)
            score.asked += len(names) if asks else 0
            score.refused += 0 if asks else len(names)
            score.remarks.append(f"{'asked' if asks else 'refused'}: {error}")
            return
        score.seconds.append(time.perf_counter() - start)
    wrong = mistakes(names, found)
    score.wrong += len(wrong)
    score.right += len(names) - len(wrong)
    score.remarks += [f"wrong: {line}" for line in wrong]


def score_of(number: int, style: Style, seeds: Iterable[int]) -> Score:
    """Return how the columns of a style are read, a rig for each seed."""
    score = Score()
    for seed in seeds:
        rng = np.random.default_rng((seed, number))
        layout = style.layouts[seed % len(style.layouts)]
        try:
            try_rig(style, layout, rng, score)
        except Exception as error:
            error.add_note(f"style '{style.name}', seed {seed}")
            raise
    return score


def main() -> None:
    """Print the table and what was not read right."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--first-seed", type=int, default=0)
    parser.add_argument("--rigs", type=int, default=2, help="rigs of each style")
    arguments = parser.parse_args()
    seeds = range(arguments.first_seed, arguments.first_seed + arguments.rigs)
    scores = {style.name: score_of(number, style, seeds) for number, style in enumerate(styles())}
    rows = [[name, *score.cells()] for name, score in scores.items()]
    totals = [sum(counts) for counts in zip(*(score.counts for score in scores.values()))]
    share = 100.0 * totals[0] / sum(totals)
    seconds = np.mean([each for score in scores.values() for each in score.seconds])
    rows.append(
        [f"all, {share:.1f} % right", *(str(total) for total in totals), f"{seconds:.1f}"],
    )
    table(
        "vendor_columns",
        f"Columns read without any option, {arguments.rigs} rigs a style",
        ["style", "right", "wrong", "asked", "refused", "seconds"],
        rows,
    )
    for name, score in scores.items():
        for remark in dict.fromkeys(score.remarks):
            print(f"{name}: {remark}")


if __name__ == "__main__":
    main()
