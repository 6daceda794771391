"""What in a hand's file the ends of its motors' travel contradict, in words, and what would correct
it.

The file predicts where a motor meets both ends of its travel, with a covariance. Where what was met
is too improbable, the likeliest single mistakes that explain it are named.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from math import log, pi
from statistics import NormalDist

import numpy as np

from distal.arrays import Floats
from distal.confidence import CLEARLY
from distal.hands.sweeps import FEWEST_SWEEPS, Sweep, is_pair, winds_to
from distal.hands.tendon_faults import Fault, FaultKind
from distal.rig import Capstan, Rig
from distal.rig.drive_range import KNOWN
from distal.rig.sensors.base import COUNTS, AngleSensor

RARE = log(2 * NormalDist().cdf(-CLEARLY))
"""Log of the probability below which a file, or one of several causes, is ruled out [1]. Source:
definition (level of `CLEARLY`).
"""

NONE = np.zeros((2, 1))
"""No unknown. Source: definition."""

SLACK = "its tendons are slack"

DONE = {
    "zero": "The zero is taken as found",
    "slack": "Slack is assumed",
    "file": "It is not calibrated and gets no goals",
}
"""Kind of a doubt → what is done without consent."""

ACCEPT = "; --accept puts the first into the file"

Cause = tuple[float, str, Mapping[str, object]]
"""Log probability of what was met, words, and values by path that correct the file."""


class _Line:
    """What the file says of one motor, in its readings [rad]: its zero, where its `ends` are beyond
    that, and how well it knows both; and where they were `met`.
    """

    def __init__(self, rig: Rig, name: str, sweeps: Sequence[Sweep]) -> None:
        drive = rig.drive(name)
        assert isinstance(drive, Capstan)
        self.name = name
        self.radius = drive.radius
        self.sensors = [sensor for sensor in rig.sensors if sensor.of == name]
        position = next(sensor for sensor in self.sensors if sensor.measures == "position")
        self.zero = position.bias
        self.sign = position.sign
        self.bias = f"sensors.{position.name}.bias"
        self.tendons = rig.tendons_of(name)
        self.joint = joint = next(j for j in rig.joints if j.name in self.tendons[0].joints)
        rows = []
        for tendon in self.tendons:
            way = tendon.winding
            arm = tendon.arms()[joint.name]
            met, length, std = winds_to(rig, tendon, sweeps)
            std = np.hypot(std, tendon.slack.total_std)
            length += tendon.slack.value
            rows.append((arm, way * arm, way * length, std, met * self.radius.value))
        columns = np.array(rows, dtype=np.float64).T / self.radius.value
        self.arms, self.per_stop, self.ends, self.stds, self.met = columns
        # a zero that is not known is anywhere
        std = self.zero.total_std
        self.zero_std = std if std <= KNOWN * abs(self.per_stop[0]) else 2 * pi
        self.off = self.met - self.zero.value - self.ends
        if isinstance(position, AngleSensor) and position.unit in COUNTS:
            # it wraps: in which turn it counts, says nothing
            turn = 2 * pi / position.gear
            turns = turn * np.round(np.mean(self.off) / turn)
            self.met = self.met - turns
            self.off = self.off - turns

    def judged(
        self, free: Floats = NONE, mean: Floats | None = None, met: Floats | None = None
    ) -> tuple[float, ...]:
        """Return the log probability that ends were `met` that are at `mean` beyond the zero, if an
        unknown of unit std adds `free`; their squared distance in stds; the unknown, and its std.
        """
        mean = self.ends if mean is None else mean
        off = (self.met if met is None else met) - self.zero.value - mean
        ratio = self.radius.total_std / self.radius.value * mean
        spread = np.diag(self.stds**2) + self.zero_std**2 + np.outer(ratio, ratio)
        spread += free @ free.T
        far, seen = np.linalg.solve(spread, np.column_stack([off, free[:, 0]])).T
        size = off @ far + np.linalg.slogdet(2 * pi * spread)[1]
        return -size / 2, off @ far, free[:, 0] @ far, np.sqrt(1 - free[:, 0] @ seen)

    def turned(self, sign: int, zero: object) -> dict[str, object]:
        """Return the values of a motor that turns by another sign, with its zero."""
        signs = {f"sensors.{of.name}.sign": sign * of.sign for of in self.sensors}
        return signs | {self.bias: zero}

    def causes(self) -> Iterator[Cause]:
        """Yield what would explain the ends."""
        joint = self.joint
        diagonal = np.diag(self.per_stop)
        size = max(self.judged(np.full((2, 1), std))[0] for std in (KNOWN, 2 * pi))
        moved = np.mean(self.off) / (2 * pi)
        yield size, f"its zero is {moved:.3f} turns off, or both ends of its range are", {}
        for at, free in enumerate(KNOWN * diagonal):
            size, _, x, std = self.judged(free[:, None])
            stops = list(joint.travel)
            stops[int(self.arms[at] > 0)] += KNOWN * x
            low, high = np.rad2deg(stops)
            path = f"joints.{joint.name}.stops"
            values = {path: stops, f"{path}_std": max(joint.stops_std, KNOWN * std)}
            yield size, f"its range is {low:.1f}° to {high:.1f}°", values
        size, _, x, std = self.judged(self.ends[:, None])
        radius = self.radius.value / (1 + x)
        values = {f"drives.{self.name}.radius": {"value": radius, "std": radius * std / (1 + x)}}
        yield size, f"its radius is {1e3 * radius:.3g} mm, or its gear {1 + x:.3g} : 1", values
        size = self.judged(mean=-self.ends[::-1])[0]
        words = "it turns the other way, or its range has the wrong sign: look"
        yield size, words, self.turned(-1, -self.zero.value)
        if np.ptp(self.met) > np.ptp(self.ends):
            stds = (KNOWN, np.ptp(joint.travel))
            yield max(self.judged(std * diagonal)[0] for std in stds), SLACK, {}

    def exchanged(self, other: _Line) -> Cause:
        """Return that the motor is exchanged with another one."""
        size = -other.judged()[0]
        values = dict[str, object]()
        for a, b in ((self, other), (other, self)):
            same = a.sign * b.sign
            size += b.judged(met=same * a.met[::same])[0]
            zero, radius = (of.model_dump(exclude_defaults=True) for of in (b.zero, b.radius))
            values |= a.turned(same, zero) | {f"drives.{a.name}.radius": radius}
            values |= {f"tendons.{tendon.name}.drive": b.name for tendon in a.tendons}
        return size, f"it is exchanged with {other.name}", values


def doubts_of(rig: Rig, sweeps: Mapping[str, Sequence[Sweep]]) -> tuple[Fault, ...]:
    """Return what is likely wrong in the file of a hand, by the motors with a pair of tendons, with
    what would correct it: nothing for a zero, which the routine finds in any case.

    Args:
        rig: the hand as its file has it.
        sweeps: motor → its sweeps.
    """
    lines = [
        _Line(rig, name, of)
        for name, of in sweeps.items()
        if is_pair(rig, name) and len(of) >= FEWEST_SWEEPS
    ]
    doubts = list[Fault]()
    for line in lines:
        # exp(−d/2) is the probability of two numbers at least so far off
        if line.judged()[1] < 2 * (log(len(lines)) - RARE):
            continue
        causes = [*line.causes(), *(line.exchanged(other) for other in lines if other is not line)]
        causes.sort(key=lambda cause: -cause[0])
        words = [cause[1] for cause in causes if cause[0] > causes[0][0] + RARE]
        values = causes[0][2]
        kind: FaultKind = "slack" if SLACK in words else "file" if values else "zero"
        off = np.rad2deg(line.off / line.per_stop)
        sentence = (
            f"{line.name} ({line.joint.name}): the file has the ends of its travel {off[0]:.1f}° "
            f"and {off[1]:.1f}° of the joint off: {'; or '.join(words)}. {DONE[kind]}"
        )
        doubts.append(Fault(kind, line.name, sentence + (ACCEPT if values else ""), values))
    return tuple(doubts)
