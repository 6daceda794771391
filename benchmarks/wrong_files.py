"""Files of hands that are wrong in one of eight kinds, and what the power-on routine says of them:
`python -m benchmarks.wrong_files [--first-seed N] [--draws N] [--drawings]`.

A hand of two joints of `servo_hands` (which shares no code with `distal`) has a file that is right
within its stds. Then one number in it is made wrong, the routine runs by the wrong file, and
`calibrate` is called without consent and with it. A quarter as many files stay right.
"""

from __future__ import annotations

import argparse
import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from tests.support.servo_hands import ORCA, PERIOD, TORQUE_CONSTANT, Hands, Known, orca_like

from benchmarks.report import table
from distal import Rig
from distal.errors import RigError
from distal.hands import Routine, RoutineOptions, calibrate
from distal.logs import Log
from distal.rig.hand_tables import Row, hand_of

KINDS = ("range", "zero", "exchanged", "direction", "swapped", "turn", "gear", "radius")
"""What is wrong: an end of a range or a zero by 4 to 8°; both ends of a range exchanged; the
direction of a motor; the motors of two joints exchanged; a zero by a whole turn; a gear of 2 : 1
or 3 : 2 left out or put in; a spool's radius by 15 to 60 %."""

OFF = (4.0, 8.0)
"""By how much ranges and zeros are wrong [deg]."""

GEARS = (0.5, 2 / 3, 1.5, 2.0)
"""Turns of a spool for one of its motor, where the file has the same for both."""

RADII = (0.15, 0.6)
"""By how much a spool's radius is wrong, as a share."""

UNEQUAL = 10.0
"""Least difference of the sizes of both ends of a range whose motor's direction is wrong [deg]: if
the ends are alike, nothing that a motor reads says which way its joint turns."""


@dataclass(frozen=True)
class Stds:
    """How well a right file knows its hand: ratio of radii [1], ends of ranges and zeros at the
    joint [deg], slack of a tendon [m].
    """

    ratio: float
    ends: float
    zero: float
    slack: float


MEASURED = Stds(0.005, 0.5, 0.5, 0.05e-3)
"""A file whose hand was once measured with a reference."""

DRAWINGS = Stds(0.03, 1.0, 4.0, 0.25e-3)
"""A file from drawings, and zeros from another calibration."""


@dataclass(frozen=True)
class Case:
    """A hand, its file and what is wrong in it.

    Args:
        known: names of the hand's parts.
        hands: the hand.
        rows: the right file's lines.
        slack: joint and side → slack of its tendon, in both files.
        kind: what is wrong; empty in a right file.
        at: the joint concerned.
        wrong: the wrong file's lines.
    """

    known: Known
    hands: Hands
    rows: list[Row]
    slack: dict[tuple[str, str], object]
    kind: str
    at: int
    wrong: list[Row]

    def rig(self, rows: list[Row]) -> Rig:
        """Return the rig of some lines.

        Raises:
            RigError: a line is impossible.
        """
        motors = {row.joint: row.motor for row in rows}
        slack = {
            f"tendons.{motors[joint]}_{side}.slack": value
            for (joint, side), value in self.slack.items()
        }
        return hand_of(rows, "hand", "table").rig.with_values(slack)


def drawn(seed: int, kind: str, stds: Stds) -> Case:
    """Return a hand and its file, wrong in this kind."""
    rng = np.random.default_rng([seed, 88])
    names = list(ORCA)
    while True:
        joints = [names[k] for k in rng.choice(len(names), 2, replace=False)]
        ends = np.array([ORCA[joint][:2] for joint in joints])
        if kind != "direction" or abs(ends[0].sum()) >= UNEQUAL:
            break
    known, hands = orca_like([seed], joints)
    d = hands.d
    rows, slack = list[Row](), dict[tuple[str, str], object]()
    for j, joint in enumerate(joints):
        arm, spool = d.arms[0, j, j], d.spools[0, j, j]
        low, high = np.array([d.low[0, j], d.high[0, j]]) + np.deg2rad(stds.ends) * rng.normal(
            size=2
        )
        zero = d.zeros[0, j] + np.deg2rad(stds.zero) * arm / spool * rng.normal()
        rows.append(
            Row(
                joint=joint,
                motor=known.motors[j],
                low=low,
                high=high,
                spool_radius=spool * (1 + stds.ratio * rng.normal()),
                joint_radius=arm,
                direction=int(d.signs[0, j]),
                zero=zero,
                zero_std=float(np.deg2rad(stds.zero) * arm / spool),
                ratio_std=stds.ratio,
                range_std=float(np.deg2rad(stds.ends)),
            )
        )
        for word, t in (("plus", j), ("minus", j + 2)):
            value = max(d.slack[0, t] + stds.slack * rng.normal(), 0.0)
            slack[joint, word] = {"value": value, "std": stds.slack}
    wrong = list(rows)
    first, size = rows[0], np.deg2rad(rng.uniform(*OFF)) * rng.choice([-1.0, 1.0])
    turn = first.joint_radius / first.spool_radius
    change: dict[str, Any] = {}
    if kind == "range":
        end = str(rng.choice(["low", "high"]))
        change = {end: getattr(first, end) + size}
    elif kind == "zero":
        change = {"zero": first.zero + turn * size}
    elif kind == "exchanged":
        change = {"low": first.high, "high": first.low}
    elif kind == "direction":
        change = {"direction": -first.direction}
    elif kind == "turn":
        change = {"zero": first.zero + 2 * np.pi * rng.choice([-1.0, 1.0])}
    elif kind == "gear":
        change = {"spool_radius": first.spool_radius / float(rng.choice(GEARS))}
    elif kind == "radius":
        share = rng.uniform(*RADII) * rng.choice([-1.0, 1.0])
        change = {"spool_radius": first.spool_radius * (1 + share)}
    if kind == "swapped":
        wrong = [
            row.model_copy(update={"motor": other.motor}) for row, other in zip(rows, rows[::-1])
        ]
    else:
        wrong[0] = first.model_copy(update=change)
    return Case(known, hands, rows, slack, kind, 0, wrong)


def routine_log(case: Case, rig: Rig) -> Log:
    """Return the log of the routine by a rig, both motors at one time."""
    hands, motors = case.hands, case.known.motors
    routine = Routine(rig, RoutineOptions(order=[motors]))
    of = {(s.of, s.measures): s.sign for s in rig.sensors if s.of in motors}
    signs = np.array([of[motor, "position"] for motor in motors])
    positions, currents, k = (
        hands.positions[0] * hands.d.signs[0] + hands.d.zeros[0],
        np.zeros(2),
        0,
    )
    while not routine.done:
        sample = dict(zip([f"{motor}_position" for motor in motors], signs * positions))
        torques = TORQUE_CONSTANT * signs * currents
        sample |= dict(zip([f"{motor}_current" for motor in motors], torques))
        goals = routine.step(PERIOD * k, sample)
        read = hands.step(signs * np.array([[goals[motor] for motor in motors]]))
        positions, currents, k = read["positions"][0], read["currents"][0], k + 1
    return routine.log()


WORDS = {
    "range": "its range is ",
    "zero": "its zero is ",
    "direction": "it turns the other way",
    "swapped": "it is exchanged with ",
    "turn": "its zero is ",
    "gear": "its radius is ",
    "radius": "its radius is ",
}
"""How the cause that is named first begins. No motor can tell a gear from a radius."""

MARK = " of the joint off: "
"""What a sentence on a file has before the causes."""

NEAR = 1.5
"""A file is corrected if both ends of its joint, and the angles that it gives there, are so close
to those of the hand [deg], in the middle of the play."""


@dataclass
class Judged:
    """What came of a file: whether its mistake was named first or at all, whether anything was
    changed without consent, how far it is off afterwards with consent [deg]; at how many motors of
    which the file is right the file is said to be wrong, or tendons are said to be slack.
    """

    kind: str
    first: bool
    named: bool
    changed: bool
    off: float
    accused: int
    slack: int


def is_named(kind: str, cause: str) -> bool:
    """Return whether a cause in words is of this kind; a turn has its number."""
    turned = re.search(r"zero is (-?[0-9.]+) turns", cause)
    whole = turned is not None and abs(float(turned[1])) > 0.5
    return cause.startswith(WORDS[kind]) and (
        kind not in ("zero", "turn") or whole == (kind == "turn")
    )


def fixed(rig: Rig) -> list[object]:
    """Return what no routine may change without consent."""
    return [
        *((joint.name, joint.stops) for joint in rig.joints),
        *((sensor.name, sensor.sign) for sensor in rig.sensors),
        *((tendon.name, tendon.drive) for tendon in rig.tendons),
    ]


def off_of(case: Case, rig: Rig, j: int) -> float:
    """Return how far the range of a joint is off, or the angles at its ends in the middle of its
    play [deg].
    """
    d, name, motor = case.hands.d, case.known.joints[j], case.known.motors[j]
    joint = next(one for one in rig.joints if one.name == name)
    sensor = next(one for one in rig.sensors_of("position") if one.of == motor)
    tendons = sorted(rig.tendons_of(motor), key=lambda tendon: -tendon.winding)
    if name not in tendons[0].joints:
        return 180.0  # the motor is another joint's
    loose = [one.slack.value - one.pretension.value / one.stiffness.value for one in tendons]
    worst = list[float]()
    for stop, true in zip(joint.travel, (d.low[0, j], d.high[0, j])):
        wound = d.arms[0, j, j] * true + (d.slack[0, j] - d.slack[0, j + 2]) / 2
        read = d.zeros[0, j] + d.signs[0, j] * wound / d.spools[0, j, j]
        wound = (sensor.sign * read - sensor.bias.value) * rig.drive(motor).lever
        angle = (wound - (loose[0] - loose[1]) / 2) / tendons[0].arms()[name]
        worst += [abs(stop - true), abs(angle - true)]
    return float(np.rad2deg(max(worst)))


def judged(case: Case) -> Judged:
    """Return what came of a file."""
    try:
        rig = case.rig(case.wrong)
    except RigError as refused:
        # no motor moves; whoever writes the file exchanges the two numbers
        said = case.known.joints[0] in str(refused) and "the wrong way round" in str(refused)
        return Judged(case.kind, said, said, False, off_of(case, case.rig(case.rows), 0), 0, 0)
    log = routine_log(case, rig)
    found = calibrate(log, rig)
    concerned = (0, 1) if case.kind == "swapped" else (0,) if case.kind else ()
    doubts = {fault.drive: fault for fault in found.faults if MARK in fault.sentence}
    first = named = bool(concerned)
    for j in concerned:
        doubt = doubts.pop(case.known.motors[j], None)
        causes = doubt.sentence.split(MARK)[-1].split("; or ") if doubt else []
        first = first and bool(causes) and is_named(case.kind, causes[0])
        named = named and any(is_named(case.kind, cause) for cause in causes)
    accepted = calibrate(log, rig, accept=True)
    if any(fault.kind not in ("zero", "slack") for fault in accepted.faults):
        # a motor that missed an end with the wrong file meets it with the corrected one
        log = routine_log(case, accepted.rig)
        accepted = calibrate(log, accepted.rig, accept=True)
    off = max(off_of(case, accepted.rig, j) for j in concerned or (0, 1))
    right = [motor for j, motor in enumerate(case.known.motors) if j not in concerned]
    slack = [
        fault
        for fault in found.faults
        if fault.kind == "slack" and fault.drive in right and fault not in doubts.values()
    ]
    changed = fixed(found.rig) != fixed(rig)
    return Judged(case.kind, first, named, changed, off, len(doubts), len(slack))


def main() -> None:
    """Print what came of files drawn wrong, by kind, and of right ones."""
    parser = argparse.ArgumentParser()
    parser.add_argument("--first-seed", type=int, default=1)
    parser.add_argument("--draws", type=int, default=30)
    parser.add_argument("--drawings", action="store_true")
    asked = parser.parse_args()
    stds = DRAWINGS if asked.drawings else MEASURED
    results = list[Judged]()
    for k in range(asked.draws + asked.draws // 4):
        kind = KINDS[k % len(KINDS)] if k < asked.draws else ""
        results.append(judged(drawn(asked.first_seed + k, kind, stds)))
        print(asked.first_seed + k, results[-1], flush=True)
    rows = []
    groups = {kind or "right": [kind] for kind in (*KINDS, "")} | {"all wrong": list(KINDS)}
    for title, kinds in groups.items():
        of = [one for one in results if one.kind in kinds]
        counts = [
            sum(one.first for one in of),
            sum(one.named for one in of),
            sum(one.off <= NEAR for one in of),
            sum(one.changed for one in of),
            sum(one.accused > 0 for one in of),
            sum(one.slack > 0 for one in of),
        ]
        rows.append([title, str(len(of)), *map(str, counts)])
    columns = [
        "file",
        "drawn",
        "named first",
        "named",
        "corrected",
        "changed",
        "accused",
        "slack said",
    ]
    table("wrong_files", f"files by the routine, seeds {asked.first_seed} on", columns, rows)


if __name__ == "__main__":
    main()
