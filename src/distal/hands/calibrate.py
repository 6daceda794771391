"""`calibrate`: the parameters of a hand from its power-on routine alone.

The ends of the joints' ranges, where the motors met them, are the reference angles; the parameters
of each finger follow by the ordinary fit to its sweeps. Faults of tendons and spools are named.
The hand's file predicts where a motor meets both ends of its travel, with a covariance: where what
was met is too improbable, the likeliest single mistakes in the file that explain it are named, and
what would correct them.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from itertools import combinations
from math import degrees, log, nan, pi
from pathlib import Path
from statistics import NormalDist
from typing import Literal, TypeAlias

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND, CLEARLY
from distal.errors import DistalWarning, FitError, LogError
from distal.fitting import Options
from distal.fitting.fit import MARK, write_fitted
from distal.fitting.likelihood import Problem
from distal.fitting.parameter_search import most_likely, problem_of, search, searched
from distal.fitting.parameters_and_priors import assignments
from distal.from_logs.drive_and_tendon_sizes import servos_of
from distal.hands.power_on_routine import (
    FEWEST_SWEEPS,
    STRONGEST,
    Sweep,
    contacts,
    crossed,
    is_pair,
    needed,
    sweeps_of,
    travel_of,
    winds_to,
)
from distal.logs import Log, Source, read_log
from distal.rig import Capstan, Rig, Sensor, Subsystem, as_rig, check_scales, independent_parts
from distal.rig.hand_tables import ASSUMED
from distal.rig.plausibility import KNOWN
from distal.rig.sensors import COUNTS, AngleSensor

SPRUNG = 4.0
"""Std of a motor's torque about the model's in usual motion, in multiples of that in the slow
routine, where joints share one tendon against springs [1]. Source: benchmark
(docs/results/hands.md).
"""

SPRINGS_APART = 0.35
"""Std of the springs of a finger, as a share [1]: one motor hardly tells which spring is stiffer.
Source: benchmark (docs/results/hands.md).
"""

UNKNOWN = 2 * np.pi
"""Std of a zero before the ends of the travel were met [rad]. Source: definition (a turn)."""

ITERATIONS = 3
"""How often the ends are linearized anew. Source: rounding (5e-6 rad, travel 20 % off)."""


Values: TypeAlias = dict[str, object]
"""Path by names → value, in a rig."""

Sweeps: TypeAlias = Mapping[str, Sequence[Sweep]]
"""Motor → its sweeps."""


def part_values(log: Log, part: Subsystem, sweeps: Sweeps) -> Values:
    """Return path by names → value of the parameters of one independent subsystem; tendons of a
    pair under tension have a negative slack.

    Args:
        log: of the power-on routine.
        part: the subsystem.
        sweeps: motor → its sweeps.

    Raises:
        FitError: no rig with these motors moves as the log does.
    """
    rig = part.rig
    drives = rig.drive_names
    begin = min(sweeps[name][0].end for name in drives)
    end = max(sweeps[name][-1].end for name in drives)
    cut = replace(log.select(slice(begin, end + 1)), truth={})
    pairs = all(is_pair(rig, name) for name in drives)
    at_ends = _at_ends(rig, sweeps)
    prior = rig.with_values(at_ends)
    problem = problem_of([cut], prior, Options(noise=pairs, workers=1))
    parameters = searched(problem, _likeliest(problem, prior))
    if not np.isfinite(parameters.optimum.cost):
        raise FitError(
            f"{log.source}: no rig with the motors {', '.join(drives)} moves as this log does"
        )
    fitted = parameters.problem.filter.rig
    values = at_ends | assignments(parameters.fitted, fitted)
    for sensor in fitted.sensors_of("force"):
        # friction is not the same everywhere, and the rig says how well it is known
        friction = rig.drive(sensor.of).friction.constant.total_std
        noise = max(sensor.noise, friction) if pairs else SPRUNG * sensor.noise
        values[f"sensors.{sensor.name}.noise"] = noise
    return _with_ranges(
        rig, {path: v for path, v in values.items() if not path.endswith((".initial", ".hold"))}
    )


def _at_ends(rig: Rig, sweeps: Sweeps) -> Values:
    """Return path by names → prior by the ends of the sweeps: zeros and radii of motors, slack,
    angles of joints at the end of the first sweep, noise of torques.
    """
    values = Values()
    for sensor in rig.sensors_of("force"):
        # friction is not the same everywhere, and the rig says how well it is known
        noise = rig.drive(sensor.of).friction.constant.total_std
        if is_pair(rig, sensor.of):  # it is fitted, from what the free motion shows
            noise = max(sweep.noise for sweep in sweeps[sensor.of])
        values[f"sensors.{sensor.name}.noise"] = max(sensor.noise, noise)
    for sensor in rig.sensors_of("position"):
        values |= _by_contacts(rig, sensor, sweeps[sensor.of])
    for tendon in rig.tendons:
        way = sweeps[tendon.drive][0].way * tendon.winding
        for joint, arm in crossed(rig, tendon):
            if joint.coupled is None:
                end = joint.travel[way * arm > 0]
                values[f"joints.{joint.name}.initial"] = {"value": end, "std": joint.stops_std}
    return values


def _by_contacts(rig: Rig, sensor: Sensor, sweeps: Sequence[Sweep]) -> Values:
    """Return path by names → a motor's zero and radius and its tendons' slack, as the ends of the
    travel and the rig tell them together (Kalman, J. Basic Engineering 82, 1960, iterated).

    A tendon meets its end at zero ± (Σ arm · stop + slack)/radius, as well as the stops are known.
    A pre-tension T is the slack −T/k.
    """
    drive = rig.drive(sensor.of)
    assert isinstance(drive, Capstan)
    tendons = rig.tendons_of(drive.name)
    ways = np.array([tendon.winding for tendon in tendons])
    met, lengths, unsure = np.array([winds_to(rig, tendon, sweeps) for tendon in tendons]).T
    stds = [
        np.hypot(t.slack.total_std, t.pretension.total_std / t.stiffness.value) for t in tendons
    ]
    slacks = [tendon.loose for tendon in tendons]
    zero = np.mean(met - ways * (lengths + slacks) / drive.lever)
    prior = np.array([zero, drive.lever, *slacks])
    covariance = np.diag(np.square([UNKNOWN, drive.radius.total_std, *stds]))
    x = prior
    for _ in range(ITERATIONS):
        away = ways * (lengths + x[2:]) / x[1]
        slopes = np.column_stack([np.ones(len(ways)), -away / x[1], np.diag(ways / x[1])])
        cross = slopes @ covariance
        seen = cross @ slopes.T + np.diag(np.square(unsure) / x[1] ** 2)
        gain = np.linalg.solve(seen, cross).T
        x = prior + gain @ (met - x[0] - away - slopes @ (prior - x))
    names = [f"sensors.{sensor.name}.bias", f"drives.{drive.name}.radius"]
    values = Values()
    for tendon in tendons if len(tendons) == 2 else ():
        names.append(f"tendons.{tendon.name}.slack")
        values[f"tendons.{tendon.name}.pretension"] = {"value": 0.0, "std": 0.0}
    for name, value, variance in zip(names, x, np.diag(covariance - gain @ cross)):
        values[name] = {"value": float(value), "std": float(np.sqrt(variance))}
    return values


def _likeliest(problem: Problem, prior: Rig) -> Floats:
    """Return where the search for the parameters begins, (n,): at the end of one for some of them,
    or where joints have springs, at the likeliest end of several searches.

    A joint at its stop shows as a bend of the torque, and the same bends may be those of other
    joints. So each further search begins with the bends of two joints exchanged, until none ends
    likelier.
    """
    best = np.zeros(problem.size)
    exchanges = _exchanges(problem, prior)
    if not exchanges:
        # friction first, since a wrong torque draws all else away; noise last
        frictions = [part.paths[0].endswith("friction.constant") for part, _ in problem.parts]
        noises = [part.noise for part, _ in problem.parts]
        for fixed in (~np.array(frictions), np.array(noises)):
            best = search(problem, best, fixed=fixed).z
        return best
    best = most_likely(problem, best)[1].z
    while True:
        ends = [best]
        for one, other, ratio in exchanges:
            z = best.copy()
            first = problem.parts[one][0]
            second = problem.parts[other][0]
            z[one] = first.coordinate(ratio * second.value(best[other]))
            z[other] = second.coordinate(first.value(best[one]) / ratio)
            ends.append(most_likely(problem, z)[1].z)
        likeliest = int(np.nanargmin(problem.costs(ends)))
        if likeliest == 0:
            return best
        best = ends[likeliest]


def _exchanges(problem: Problem, prior: Rig) -> list[tuple[int, int, float]]:
    """Return the coordinates of the stiffness of each two springs along a tendon, and the ratio of
    the first to the second with which both joints would come to their stops at one tension.

    A joint does so at the tension k |θ − rest|/arm.
    """
    reaches = dict[str, dict[int, float]]()
    for at, (free, _) in enumerate(problem.parts):
        kind, index, *of_part = free.paths[0].split(".")
        if kind != "joints" or of_part != ["spring", "stiffness"]:
            continue
        joint = prior.joints[int(index)]
        assert joint.spring is not None
        tendon = next(tendon for tendon in prior.tendons if joint.name in tendon.joints)
        arm = tendon.arms()[joint.name]
        stop = joint.travel[arm > 0]
        reach = abs((stop - joint.spring.rest_angle.value) / arm)
        reaches.setdefault(tendon.name, {})[at] = reach
    return [
        (one, other, along[other] / along[one])
        for along in reaches.values()
        for one, other in combinations(along, 2)
    ]


def _with_ranges(rig: Rig, values: Mapping[str, object]) -> Values:
    """Return the values with wider stds: radii, zeros and slack are known no better than the ranges
    of joints by which they were found, and springs no better than `SPRINGS_APART`.
    """
    wider = dict(values)

    def widen(path: str, std: float) -> None:
        if isinstance(found := wider.get(path), dict) and "std" in found:
            wider[path] = found | {"std": float(f"{np.hypot(found['std'], std):.3g}")}

    for joint in rig.joints:
        path = f"joints.{joint.name}.spring.stiffness"
        if isinstance(found := wider.get(path), dict):
            std = float(f"{SPRINGS_APART * found['value']:.3g}")
            wider[path] = {"value": found["value"], "std": std}
    for sensor in rig.sensors_of("position"):
        drive = rig.drive(sensor.of)
        meets = crossed(rig, rig.tendons_of(drive.name)[0])
        off = np.hypot.reduce([arm * joint.stops_std for joint, arm in meets]) / drive.lever
        radius = np.sqrt(2) * off * drive.lever**2 / needed(rig, drive.name)
        widen(f"drives.{drive.name}.radius", radius)
        widen(f"sensors.{sensor.name}.bias", off / np.sqrt(2))
        for tendon in rig.tendons_of(drive.name) if is_pair(rig, drive.name) else ():
            widen(f"tendons.{tendon.name}.slack", off * drive.lever)
    return wider


FaultKind = Literal["side", "slack", "broken", "slipped", "stopped", "file", "zero"]

SLIPPED = 4.0
"""Motion of the end of the travel between sweeps, at the joint, from which on a spool slipped
[deg]. Source: judgement.
"""

TURNS_MOST = degrees(1.0) ** 0.5
"""Travel of all motors, in multiples of what their joints' ranges need, from which on a unit is
wrong [1]. Source: definition (nearer to degrees than to radians).
"""

WAYS = {1: "as its reading grows", -1: "as its reading falls"}
"""Direction of a sweep → its words."""


@dataclass(frozen=True)
class Fault:
    """One fault of a motor or of its tendons.

    Args:
        kind: of the fault.
        drive: name of the motor.
        sentence: the fault in words.
        values: path by names → value that corrects the file, where that may be wrong.
    """

    kind: FaultKind
    drive: str
    sentence: str
    values: Mapping[str, object] = field(default_factory=dict)


def faults_of(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[Fault, ...]:
    """Return the fault of a motor's tendons that its sweeps show, or none: the most certain where
    there are several.
    """
    tendons = rig.tendons_of(drive)
    ratio = tendons[0].total_arm / rig.drive(drive).lever
    pair = is_pair(rig, drive)

    def fault(kind: FaultKind, sentence: str) -> tuple[Fault, ...]:
        return (Fault(kind, drive, f"{drive} ({', '.join(tendons[0].joints)}): {sentence}"),)

    resisted = {way: [sweep.resisted for sweep in sweeps[1:] if sweep.way == way] for way in WAYS}
    none = [way for way in WAYS if not any(resisted[way])]
    if len(sweeps) < FEWEST_SWEEPS or (pair and len(none) == 2):
        return fault(
            "slipped",
            "turns freely both ways: its spool slips on its shaft, or all its tendons are off",
        )
    if pair and none:
        which = " and ".join(tendon.name for tendon in tendons if tendon.winding == none[0])
        return fault(
            "broken",
            f"nothing resists {WAYS[none[0]]}: {which} is broken, off its spool, or wound the "
            "wrong way round",
        )
    if not pair and len(none) == 2:
        return fault("broken", f"nothing resists: {tendons[0].name} is broken or off its spool")
    if not pair and 1 in none:
        return fault(
            "side", "tightens when it should let out: its tendon is wound the wrong way round"
        )
    shifts = [
        np.ptp(contacts(sweeps, way)) for way in WAYS if way not in none and all(resisted[way])
    ]
    moved = degrees(max(shifts, default=0.0) / ratio)
    if moved > SLIPPED:
        return fault(
            "slipped",
            f"the end of the travel moved by {moved:.1f}° between sweeps: its spool slips",
        )
    if not pair:
        return ()
    longer, std = excess(rig, drive, sweeps)
    if longer < -CLEARLY * std:
        share = 100 * (1 + longer / needed(rig, drive))
        return fault(
            "side",
            f"stops after {share:.0f} % of its travel: it is blocked, a tendon is on the wrong "
            "side, or its radii are others",
        )
    return ()


def excess(rig: Rig, drive: str, sweeps: Sequence[Sweep]) -> tuple[float, float]:
    """Return how much more of its tendons a motor with a pair of them winds, from end to end, than
    its joint's range and their slack need, and the std of that by the rig [m].
    """
    motor = rig.drive(drive)
    assert isinstance(motor, Capstan)
    up, down = (np.mean(contacts(sweeps, way)) for way in WAYS)
    # both ends are off, each by its own error
    meets = crossed(rig, rig.tendons_of(drive)[0])
    stds = [np.sqrt(2) * arm * joint.stops_std for joint, arm in meets]
    slack, slack_std = _slack(rig, drive)
    std = np.hypot.reduce([*stds, slack_std, motor.radius.total_std * (up - down)])
    return float((up - down) * motor.lever - needed(rig, drive) - slack), float(std)


def _slack(rig: Rig, drive: str) -> tuple[float, float]:
    """Return the slack of all tendons of a motor together, and its std [m]."""
    slacks = [tendon.slack for tendon in rig.tendons_of(drive)]
    std = np.hypot.reduce([slack.total_std for slack in slacks])
    return sum(slack.value for slack in slacks), float(std)


def slack_of(found: Rig, rig: Rig, sweeps: Sweeps) -> tuple[Fault, ...]:
    """Return the pairs of tendons that are slack by their travel, or by the calibrated rig `found`,
    of motors without another fault; `sweeps` are theirs.
    """
    faults = []
    for drive in (name for name in sweeps if is_pair(rig, name)):
        tendon = rig.tendons_of(drive)[0]
        before, of_file = _slack(rig, drive)
        slack, of_fit = _slack(found, drive)
        more = slack - before
        longer, std = excess(rig, drive, sweeps[drive])
        # what moves the motor stretches both tendons, by half of this each
        level = float(np.median([abs(sweep.level) for sweep in sweeps[drive]]))
        stretch = level / rig.drive(drive).lever / tendon.stiffness.value
        if longer > max(CLEARLY * std, BAND * std + stretch) or more > max(
            CLEARLY * of_file, BAND * of_fit
        ):
            line = (
                f"{drive} ({', '.join(tendon.joints)}): turns about "
                f"{degrees(max(longer, more) / tendon.total_arm):.0f}° further than its range "
                "asks for: its tendons are slack, or its radii are others"
            )
            faults.append(Fault("slack", drive, line))
    return tuple(faults)


def check_units(rig: Rig, sweeps: Sweeps, source: str) -> None:
    """Check that the motors turn, and pull, as far as a hand's can.

    Raises:
        FitError: all motors turn, or pull, so much more or less that a unit is wrong.
    """
    turned = min(
        np.ptp([sweep.contact for sweep in of]) / travel_of(rig, drive)
        for drive, of in sweeps.items()
    )
    if turned > TURNS_MOST:
        raise FitError(
            f"{source}: all motors turn {turned:.0f} times as far as their joints' ranges ask for, "
            "or more; is the unit of their positions right?"
        )
    pull = max(abs(sweep.level) for of in sweeps.values() for sweep in of)
    noise = min(sensor.noise for sensor in rig.sensors_of("force"))
    if not noise / CLEARLY < pull < STRONGEST:
        raise FitError(
            f"{source}: the motors' torques while they move are {pull:.2g} N m at most; is the "
            "unit of their currents, or the torque constant, right?"
        )


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
        self.position = position = next(s for s in self.sensors if s.measures == "position")
        self.zero = position.bias
        self.tendons = rig.tendons_of(name)
        self.joint = crossed(rig, self.tendons[0])[0][0]
        rows = []
        for tendon in self.tendons:
            way = tendon.winding
            arm = tendon.arms()[self.joint.name]
            met, length, std = winds_to(rig, tendon, sweeps)
            std = np.hypot(std, tendon.slack.total_std)
            length += tendon.slack.value
            rows.append((arm, way * arm, way * length, std, met * self.radius.value))
        columns = np.array(rows).T / self.radius.value
        self.arms, self.per_stop, self.ends, self.stds, self.met = columns
        # a zero that is not known is anywhere
        std = self.zero.total_std
        self.zero_std = std if std <= KNOWN * abs(self.per_stop[0]) else 2 * pi
        self.off = self.met - self.zero.value - self.ends
        if isinstance(position, AngleSensor) and position.unit in COUNTS:
            # it wraps: in which turn it counts, says nothing
            turn = 2 * pi / position.gear
            turns = turn * np.round(np.mean(self.off) / turn)
            self.met -= turns
            self.off -= turns

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
        first = free[:, 0]
        far, seen = np.linalg.solve(spread, np.column_stack([off, first])).T
        size = off @ far + np.linalg.slogdet(2 * pi * spread)[1]
        return -size / 2, off @ far, first @ far, np.sqrt(1 - first @ seen)

    def turned(self, sign: int, zero: object) -> Values:
        """Return the values of a motor that turns by another sign, with its zero."""
        signs = {f"sensors.{of.name}.sign": sign * of.sign for of in self.sensors}
        return signs | {f"sensors.{self.position.name}.bias": zero}

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
        values = self.turned(-1, -self.zero.value)
        yield size, "it turns the other way, or its range has the wrong sign: look", values
        if np.ptp(self.met) > np.ptp(self.ends):
            stds = (KNOWN, np.ptp(joint.travel))
            yield max(self.judged(std * diagonal)[0] for std in stds), SLACK, {}

    def exchanged(self, other: _Line) -> Cause:
        """Return that the motor is exchanged with another one."""
        size = -other.judged()[0]
        values = Values()
        for a, b in ((self, other), (other, self)):
            same = a.position.sign * b.position.sign
            size += b.judged(met=same * a.met[::same])[0]
            zero, radius = (of.model_dump(exclude_defaults=True) for of in (b.zero, b.radius))
            values |= a.turned(same, zero) | {f"drives.{a.name}.radius": radius}
            values |= {f"tendons.{tendon.name}.drive": b.name for tendon in a.tendons}
        return size, f"it is exchanged with {other.name}", values


def doubts_of(rig: Rig, sweeps: Sweeps) -> tuple[Fault, ...]:
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
        sentence += "; --accept puts the first into the file" if values else ""
        doubts.append(Fault(kind, line.name, sentence, values))
    return tuple(doubts)


@dataclass(frozen=True)
class Calibrated:
    """A hand after its power-on routine.

    Args:
        rig: the calibrated rig.
        start: the rig before.
        values: path by names → value, for all that was found.
        faults: of the tendons and motors.
        notes: what was not found, and why.
    """

    rig: Rig
    start: Rig
    values: Mapping[str, object]
    faults: tuple[Fault, ...]
    notes: tuple[str, ...]

    def save(
        self, path: str | Path, source: str = "of the hand itself", text: str | None = None
    ) -> None:
        """Write the rig file.

        Args:
            path: of the file.
            source: what the rig was calibrated by; the head of the file names it.
            text: the rig file as it was, whose comments are kept; None has none.

        Raises:
            OutputError: the file cannot be written; what stood there is unchanged.
        """
        head = f"{MARK}calibrate` to the power-on routine {source}\n\n"
        write_fitted(path, self.rig, self.start, self.values, head, text)


def calibrate(
    log: Log | Source,
    rig: Rig | str | Path,
    stopped: Mapping[str, str] | None = None,
    accept: bool = False,
) -> Calibrated:
    """Return a hand with its zeros, spools, slack or pre-tension, friction and stiffness as its
    power-on routine shows them.

    In the log each motor goes slowly to both ends of its travel and back, at least three times,
    with its angle and its torque. The ends of the joints' ranges are the reference; the rig says
    how well they are known (`stops_std`). Independent subsystems are calibrated separately, side by
    side. Gaps in the readings are filled by interpolation.

    Where the ends of a motor's travel contradict the rig, the faults say what is likely wrong in
    it. Only with `accept` is that corrected, and the notes say what was. Otherwise the motor keeps
    the rig's numbers, and its zero is written as unknown, so that it gets no goals. A zero that has
    moved is taken as it is found, and said.

    Args:
        log: of the power-on routine, or its file.
        rig: of the hand, or its name or path.
        stopped: motor whose routine ended too early → why; these motors are not calibrated.
        accept: whether what is likely wrong in the rig is corrected.

    Raises:
        LogError: the log cannot be read, or no motor sweeps in it.
        CommandError: the rig's scale of force was taken.
        FitError: the rig has sliders, a unit in the log is wrong, or no rig with these motors moves
            as the log does.
    """
    rig = as_rig(rig).bare()
    sliders = [drive.name for drive in rig.drives if drive.kind != "capstan"]
    if sliders:
        raise FitError(
            f"'{rig.name}': {', '.join(sliders)} are sliders; a power-on routine is for motors "
            "that wind tendons"
        )
    check_scales(rig, "a calibration by the motors' torques", "torque")
    log = _bridged(log if isinstance(log, Log) else read_log(log, rig, ranged=False))
    sweeps, stopped = _sweeps(log, rig, stopped or {})
    check_units(rig, sweeps, log.source)
    faults = [
        Fault("stopped", name, f"{name}: its routine ended before its end: {why}")
        for name, why in stopped.items()
    ]
    for drive, of in sweeps.items():
        faults += faults_of(rig, drive, of)
    moved = {fault.drive for fault in faults if fault.kind in ("slipped", "stopped")}
    doubts = doubts_of(rig, {name: of for name, of in sweeps.items() if name not in moved})
    if accept and any(doubt.values for doubt in doubts):
        return _accepted(log, rig, stopped, doubts)
    wrong = {doubt.drive for doubt in doubts if doubt.kind == "file"}
    faulty = wrong.union(fault.drive for fault in faults)
    values = Values()
    parts = independent_parts(rig)
    sound = [part for part in parts if not faulty.intersection(part.rig.drive_names)]
    notes = tuple(
        f"not calibrated, as it has a fault: {', '.join(part.rig.joint_names)}"
        for part in parts
        if part not in sound
    )
    # filters of warnings hold for the whole process, so they are set once around all threads
    with warnings.catch_warnings(), ThreadPoolExecutor() as pool:
        warnings.simplefilter("ignore", DistalWarning)
        for found in pool.map(lambda part: part_values(log, part, sweeps), sound):
            values |= found
    values |= {
        path: value
        for path, value in servos_of([log], rig).items()
        if path.split(".")[1] not in faulty
    }
    for sensor in rig.sensors_of("position"):
        if sensor.of in wrong:  # no goal goes to a motor whose zero is not known
            unknown = {"value": sensor.bias.value, "std": ASSUMED.unknown_zero_std}
            values[f"sensors.{sensor.name}.bias"] = unknown
    found_rig = rig.with_values(values)
    slackened = {doubt.drive for doubt in doubts if doubt.kind == "slack"}
    drives = [name for part in sound for name in part.rig.drive_names if name not in slackened]
    slack = slack_of(found_rig, rig, {name: sweeps[name] for name in drives})
    return Calibrated(found_rig, rig, values, (*doubts, *faults, *slack), notes)


def _accepted(
    log: Log, rig: Rig, stopped: Mapping[str, str], doubts: Sequence[Fault]
) -> Calibrated:
    """Return a hand calibrated after what is likely wrong in its rig is corrected."""
    values = {path: value for doubt in doubts for path, value in doubt.values.items()}
    corrected = rig.with_values(values)
    signs = dict[str, int]()
    for sensor, other in zip(rig.sensors, corrected.sensors):
        signs[sensor.name] = signs[sensor.of] = sensor.sign * other.sign
    turned = replace(
        log,
        channels={name: signs.get(name, 1) * v for name, v in log.channels.items()},
        goals={name: signs.get(name, 1) * v for name, v in log.goals.items()},
    )
    after = calibrate(turned, corrected, stopped)
    notes = [f"corrected: {d.sentence.partition('. ')[0]}" for d in doubts if d.values]
    return replace(
        after, start=rig, values={**values, **after.values}, notes=(*after.notes, *notes)
    )


def _bridged(log: Log) -> Log:
    """Return the log with gaps of its channels filled by linear interpolation."""
    channels = dict(log.channels)
    for name, values in log.channels.items():
        known = np.isfinite(values)
        if known.any():
            channels[name] = np.interp(log.time, log.time[known], values[known], nan, nan)
    return replace(log, channels=channels)


def _sweeps(log: Log, rig: Rig, stopped: Mapping[str, str]) -> tuple[Sweeps, dict[str, str]]:
    """Return the sweeps of each motor, and the motors that have none, each with the reason.

    Raises:
        LogError: no motor sweeps from end to end.
    """
    sweeps = dict[str, tuple[Sweep, ...]]()
    without = dict(stopped)
    for name in rig.drive_names:
        if name not in stopped:
            try:
                sweeps[name] = sweeps_of(log, rig, name)
            except LogError as problem:
                without[name] = str(problem)
    if not sweeps:
        raise LogError(list(without.values())[-1])
    met = any(sweep.resisted for of in sweeps.values() for sweep in of)
    if len(rig.drives) > 1 and not met:
        raise LogError(
            f"{log.source}: no motor meets an end of its travel; is it the log of a power-on "
            "routine (see distal.hands.Routine)?"
        )
    return sweeps, without
