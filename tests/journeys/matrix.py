"""Rigs, logs with a truth, and options of commands, by pairs: what a user may put together."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from allpairspy import AllPairs

from distal import Log, Rig, shipped_rigs, simulate, write_log
from distal.simulation import build_scenario

REPLAY = Path(__file__).parents[1] / "export" / "replay.py"
EXAMPLES = Path(__file__).parents[2] / "examples"
MADE = ("fitted", "learned", "learned from positions")
"""Rigs that commands write before the matrix runs."""

RIGS = (
    "da-vinci-grasper",
    "finger-2n",
    "fitted",
    "capstan-joint",
    "paper-2008-printed",
    "finger-underactuated",
    *sorted(
        set(shipped_rigs())
        - {"da-vinci-grasper", "finger-2n", "capstan-joint"}
        - {"paper-2008-printed", "finger-underactuated"}
    ),
    "start.toml",
    *MADE[1:],
)
MANY = "hand"
"""A rig of so many joints that full filters and fits take minutes."""

Truth = Callable[[np.ndarray], np.ndarray]


def contradicts(truth: np.ndarray) -> np.ndarray:
    """Return angles that no rig near this one has."""
    return 1.4 * truth + 0.3


def missing(truth: np.ndarray) -> np.ndarray:
    """Return the angles without those of some seconds, the first tenth of a second included."""
    count = len(truth)
    rows = np.arange(count)
    lost = (rows < count // 60) | ((rows > count // 3) & (rows < count // 2))
    return np.where(lost[:, None], np.nan, truth)


def of_another(truth: np.ndarray) -> np.ndarray:
    """Return the angles of another joint; of the only one, those of another run."""
    return np.roll(truth, 1, axis=1) if truth.shape[1] > 1 else truth[::-1] - 0.2


TRUTHS: Mapping[str, Truth] = {
    "agrees": lambda truth: truth,
    "contradicts": contradicts,
    "is missing for a while": missing,
    "is of another joint": of_another,
}


@dataclass(frozen=True)
class Case:
    """One row of the matrix; its fields are the words that go into a command."""

    rig: str
    truth: str
    command: str
    estimator: str
    homing: str
    smooth: str
    findings: str
    given: str

    def __str__(self) -> str:
        """Return the row as the name of a test."""
        words = (self.rig, self.truth, self.command, self.estimator, self.homing)
        return " ".join(filter(None, (*words, self.smooth, self.findings, self.given)))

    def words(self, rig: Path | str, log: Path) -> str:
        """Return the lines for a shell that stand for the row."""
        log_words = f"{log.name} --rig {rig}"
        if self.command == "estimate" or (self.command == "fit" and self.rig == MANY):
            options = " ".join((self.estimator, self.homing, self.smooth, self.findings))
            given = f"--truth {log.stem}.truth.csv" if self.given else ""
            return f"distal estimate {log_words} {options} {given} --out out.csv --plot out.svg"
        if self.command == "stream":
            return f"distal stream --rig {rig} {self.estimator} < {log.name} > out.csv"
        if self.command == "fit":
            return f"distal fit {log_words} {self.homing} --out out.toml"
        chosen = self.estimator.removeprefix("-e ")
        return (
            f"distal export-c {rig} {self.estimator} --out c --name made\n"
            f"{sys.executable} {REPLAY} {rig} made {chosen} > c/replay.c\n"
            "cd c\ncc -std=c99 -O1 -fno-math-errno replay.c made.c -lm -o replay\n"
            f"./replay ../{log.name} > ../out.csv"
        )


ESTIMATE = {
    "rig": RIGS,
    "truth": tuple(TRUTHS),
    "command": ("estimate",),
    "estimator": (
        "",
        *(f"-e {name}" for name in ("adaptive", "regression", "elastic", "inextensible")),
    ),
    "homing": ("", "--homing 0.2s", "--homing 1s"),
    "smooth": ("", "--smooth"),
    "findings": ("", "--findings", "--no-what-if"),
    "given": ("", "truth in a file"),
}

OTHERS = {
    **ESTIMATE,
    "command": ("stream", "export-c", "fit"),
    "smooth": ("",),
    "findings": ("",),
    "given": ("",),
}


def cases(factors: Mapping[str, tuple[str, ...]]) -> list[Case]:
    """Return rows in which every pair of options occurs."""
    return [Case(*row) for row in AllPairs(list(factors.values()))]


def simulated(rig: Rig, seconds: float = 6.0, seed: int = 1) -> Log:
    """Return a log with its truth: every drive goes back and forth at a frequency of its own."""
    drives = {}
    for k, drive in enumerate(rig.drives):
        frequency = 0.4 + 0.13 * k
        if drive.kind == "slider":
            position = {"amplitude": 1e-3, "frequency": frequency}
            servo = {"position": position, "stiffness": 5e4, "damping": 100.0}
        else:
            position = {"amplitude": 0.1, "frequency": frequency}
            servo = {"angle": position, "stiffness": 20.0, "damping": 0.3}
        drives[drive.name] = {"servo": servo}
    raw = {"rig": rig.name, "duration": seconds, "drives": drives}
    return simulate(rig, build_scenario(raw, "matrix"), seed)


def write_logs(rig: Rig, folder: Path) -> None:
    """Write a log for each kind of truth into a folder, and the truth alone beside each."""
    log = simulated(rig)
    angles = [name for name in log.truth if name.startswith("theta")]
    truth = np.column_stack([log.truth[name] for name in angles])
    for number, changed in enumerate(TRUTHS.values()):
        columns = dict(zip(angles, changed(truth).T))
        path = folder / f"log_{number}.csv"
        write_log(Log(log.time, log.channels, columns, str(path)), rig, path)
        beside = np.column_stack([log.time, *columns.values()])
        header = ",".join(["t", *(f"{name} [rad]" for name in angles)])
        np.savetxt(
            folder / f"log_{number}.truth.csv", beside, delimiter=",", header=header, comments=""
        )
