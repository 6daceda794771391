"""One mistake in the rig: a sign, a side, a radius, a stiffness, a unit, a gear; is it flagged, or
named as beyond test?

Each case is a rig with a plant drawn from its stds and a log; then one thing is wrong. A sign or a
unit of a sensor is wrong in what the rig reads of the log; a radius, stiffness or side is wrong in
the rig. "Flagged": something contradicts, or the log is refused. "Named": the diagnosis says that
these sensors cannot test this very thing. "Nothing tested": it says that nothing was compared. What
is left is called consistent. Right rigs are counted beside them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np
from tests.support.cases import scenario

from benchmarks.strangers.library import (
    DistalError,
    Log,
    Rig,
    build_rig,
    build_scenario,
    diagnosed,
    estimate,
    load_rig,
    simulate,
)
from benchmarks.strangers.plants import wide_rig
from benchmarks.strangers.random_rigs import drawn_plant, random_case
from benchmarks.strangers.scoring import Job, Record, Table, share
from distal.diagnosis.causes import COMPLIANCE, SCALE

NAME = "mistakes"
TAG = 77
"""Keeps these draws apart from those of other benches with the same seed."""

RIGHT = "right"
GEAR = 19.0
"""What a gear that was forgotten turns by: that of the shipped capstan joint."""


@dataclass(frozen=True)
class Mistake:
    """Something that is wrong.

    Args:
        kind: row of the table.
        what: of which part.
        rig: as the filters know it.
        log: as it is read.
        names: groups and drives of a "cannot test" that name it.
    """

    kind: str
    what: str
    rig: Rig
    log: Log
    names: frozenset[tuple[str, str]] = frozenset()


def scaled(log: Log, factors: dict[str, float]) -> Log:
    """Return the log with channels multiplied."""
    channels = {name: values * factors.get(name, 1.0) for name, values in log.channels.items()}
    return Log(log.time, channels, dict(log.truth), log.source, log.truth_source)


def changed(rig: Rig, edit: Any) -> Rig:
    """Return the rig after an edit of its raw description."""
    raw = rig.model_dump()
    edit(raw)
    return build_rig(raw, rig.name)


def times(rig: Rig, paths: list[str], factor: float) -> Rig:
    """Return the rig with some values multiplied, their stds kept as shares of them."""

    def edit(raw: Any) -> None:
        for path in paths:
            part = raw
            for key in path.split("."):
                part = part[int(key)] if key.isdigit() else part[key]
            part["value"] *= factor
            part["std"] *= factor

    return changed(rig, edit)


def mistakes(rig: Rig, log: Log) -> Iterator[Mistake]:
    """Return every rig and log with one mistake."""
    for sensor in (
        each for each in rig.sensors if each.measures in ("position", "force", "tension")
    ):
        name, group = sensor.name, SCALE if sensor.measures == "position" else COMPLIANCE
        own = frozenset({(group, sensor.of)})
        yield Mistake("sign of a sensor", name, rig, scaled(log, {name: -1.0}), own)
        for factor in (57.3, 1 / 57.3, 1000.0, 1e-3):
            kind = "a unit, × 57.3" if factor in (57.3, 1 / 57.3) else "a unit, × 1000"
            yield Mistake(kind, f"{name} × {factor:.3g}", rig, scaled(log, {name: factor}), own)
    scale_of = [frozenset({(SCALE, tendon.drive)}) for tendon in rig.tendons]
    for i, known in enumerate(scale_of):

        def flip(raw: Any, i: int = i) -> None:
            raw["tendons"][i]["side"] *= -1

        yield Mistake("side of a tendon", str(i), changed(rig, flip), log, known)
    arms = [f"tendons.{i}.insertion.radius" for i in range(len(rig.tendons))]
    every = frozenset[tuple[str, str]]().union(*scale_of)
    for factor in (0.8, 1.2):
        for path, own in zip(arms, scale_of):
            kind = "one moment arm ± 20 %" if len(arms) > 1 else "all moment arms ± 20 %"
            yield Mistake(kind, f"{path} × {factor}", times(rig, [path], factor), log, own)
        if len(arms) > 1:
            yield Mistake(
                "all moment arms ± 20 %", f"× {factor}", times(rig, arms, factor), log, every
            )
        for i, drive in enumerate(rig.drives):
            if drive.kind == "capstan":
                path, own = f"drives.{i}.radius", frozenset({(SCALE, drive.name)})
                yield Mistake(
                    "radius of a capstan ± 20 %",
                    f"{path} × {factor}",
                    times(rig, [path], factor),
                    log,
                    own,
                )
    springs = [f"tendons.{i}.stiffness" for i in range(len(rig.tendons))]
    stiff = frozenset((COMPLIANCE, tendon.drive) for tendon in rig.tendons)
    for factor in (1 / 3, 3.0):
        yield Mistake("stiffness × 3", f"× {factor:.2g}", times(rig, springs, factor), log, stiff)
    for drive in rig.drives:
        if drive.kind == "capstan":
            sensors = {s.measures: s.name for s in rig.sensors if s.of == drive.name}
            factors = {sensors["position"]: GEAR}
            if "force" in sensors:
                factors[sensors["force"]] = 1 / GEAR
            own = frozenset({(SCALE, drive.name)})
            yield Mistake("a gear forgotten", drive.name, rig, scaled(log, factors), own)


RIGS = ("paper-2008-printed", "pulley-antagonist", "capstan-joint", "random")


def case(name: str, seed: int) -> tuple[Rig, Log]:
    """Return a rig and a log of a plant drawn from its stds, in a motion drawn from a seed."""
    if name == "random":
        drawn = random_case(seed)
        return drawn.rig, drawn.log
    rng = np.random.default_rng([seed, TAG])
    rig = wide_rig() if name == "paper-2008-printed" else load_rig(name)
    plant = drawn_plant(rig, seed, TAG)
    if name == "capstan-joint":
        servo = {
            "angle": {
                "amplitude": float(rng.uniform(0.4, 1.0)),
                "frequency": float(rng.uniform(0.2, 0.6)),
            },
            "stiffness": 20.0,
            "damping": 0.2,
        }
        raw = {"rig": name, "duration": 8.0, "plant": plant, "drives": {"motor": {"servo": servo}}}
        return rig, simulate(rig, build_scenario(raw, name), seed)
    kind = ("ramps", "weights", "servo")[int(rng.integers(3))]
    made = scenario(kind, "as the rig", seed)
    return rig, simulate(rig, made.model_copy(update={"plant": plant}), seed)


FLAGGED, NAMED, UNTESTED, MISSED = "flagged", "named", "untested", "missed"


def judged(kind: str, where: str, mistake: Mistake) -> Record:
    """Return what is said of a mistake, as the record's note; `consistent` is whether it is called
    so.
    """
    try:
        result = estimate(mistake.log, mistake.rig, "adaptive", compiled=False)
    except DistalError:
        return Record(NAME, kind, where, "adaptive", 90.0, 0.0, 0.0, False, FLAGGED)
    # signs and units that would explain it take long, and change nothing here
    verdict = diagnosed(result, mistake.log, mistake.rig, what_if=False)
    note = MISSED if verdict.consistent else UNTESTED if verdict.untested else FLAGGED
    if note != FLAGGED:
        found = getattr(diagnosed(result, mistake.log, mistake.rig), "findings", ())
        beyond = [one.subject for one in found if one.kind == "cannot test"]
        if any(
            group in one and (drive in one or "all drives" in one)
            for one in beyond
            for group, drive in mistake.names
        ):
            note = NAMED
    error, inside = float(np.rad2deg(result.rms_error())), float(result.inside_band())
    half = float(np.rad2deg(1.96 * np.mean(result.theta_std)))
    consistent = verdict.consistent
    return Record(
        NAME,
        kind,
        where,
        "adaptive",
        round(error, 4),
        round(inside, 4),
        round(half, 4),
        consistent,
        note,
    )


def run(name: str, seed: int) -> list[Record]:
    """Score the right rig and every mistake of one case."""
    rig, log = case(name, seed)
    forces = "forces" if any(sensor.measures == "force" for sensor in rig.sensors) else "no forces"
    label = f"{name}, {forces}" if name == "random" else name
    records = [judged(RIGHT, f"{label} | {seed}", Mistake(RIGHT, "", rig, log))]
    return records + [judged(m.kind, f"{label} | {seed} {m.what}", m) for m in mistakes(rig, log)]


def jobs(quick: bool, first: int) -> list[Job]:
    """Return the jobs: 4 seeds of each shipped rig and 10 random rigs, or 1 and 2."""
    few, many = (1, 2) if quick else (3, 10)
    made = [partial(run, name, first + i) for name in RIGS[:3] for i in range(few)]
    return made + [partial(run, "random", first + i) for i in range(many)]


COLUMNS = (
    ("cases", 0),
    ("flagged [%]", 0),
    ("named as beyond test [%]", 0),
    ("nothing tested, and said so [%]", 0),
    ("called consistent [%]", 0),
    ("called so, truth less than half inside [%]", 0),
    ("median RMS [°]", 2),
)


def tables(records: list[Record]) -> list[Table]:
    """Return the table by mistake, for all rigs and for each."""
    rows: dict[tuple[str, ...], tuple[float, ...]] = {}
    groups = list(dict.fromkeys(one.log.split(" | ")[0] for one in records))
    for group in ["all", *groups]:
        own = [one for one in records if group in ("all", one.log.split(" | ")[0])]
        for kind in dict.fromkeys(one.case for one in own):
            chosen = [one for one in own if one.case == kind]
            rows[(group, kind)] = (
                float(len(chosen)),
                share(one.note == FLAGGED for one in chosen),
                share(one.note == NAMED for one in chosen),
                share(one.note == UNTESTED for one in chosen),
                share(one.note == MISSED for one in chosen),
                share(one.note == MISSED and one.inside < 0.5 for one in chosen),
                float(np.median([one.rms for one in chosen])),
            )
    title = "One mistake in the rig: flagged, or named as beyond test, or neither"
    return [Table(f"strangers-{NAME}", title, ("rig", "mistake"), COLUMNS, rows)]
