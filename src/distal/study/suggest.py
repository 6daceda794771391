"""Suggestions: which change narrows the band of a rig most, another sensor, a number that is known
better, or a calibration at a known angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distal.confidence import BAND
from distal.errors import StudyError
from distal.estimators import DEFAULT
from distal.results import Estimate
from distal.rig import Rig, in_words, number
from distal.study.description import Plan
from distal.study.design_space import draws_of
from distal.study.runs import Task, run_tasks

KNOWN_TIME = 2.0
"""Time at the start for which the joint's angle is known in a calibration [s]. Source:
judgement.
"""

PLANTS = 24
"""Number of rigs as built on which each option is simulated [1]. Source: judgement."""


@dataclass(frozen=True)
class Option:
    """Something that could be done.

    Args:
        rig: the rig with it.
        homing: for how long the angle is known at the start [s], or None.
    """

    words: str
    rig: Rig
    homing: float | None = None


@dataclass(frozen=True)
class Suggestion:
    """What an option brings, over rigs as built in all scenarios, by the samples after the first
    `KNOWN_TIME` seconds.

    Args:
        band: mean half-width of the 95 % band by the filter's covariance [rad].
        error: RMS error [rad].
    """

    words: str
    band: float
    error: float


def suggestions(
    plan: Plan, progress: Callable[[int, int], None] | None = None
) -> tuple[Suggestion, list[Suggestion]]:
    """Return the rig as it is, and the options, narrowest band first.

    Raises:
        StudyError: the study's estimator is not the default one, whose covariance is needed, or the
            rig cannot be estimated.
    """
    if plan.study.estimator != DEFAULT:
        raise StudyError(
            f"suggestions go by the covariance of '{DEFAULT}'; '{plan.study.estimator}' came as "
            "estimator"
        )
    options = options_of(plan.rig, plan.study.added_noise)
    judged = list[Suggestion]()
    for k, option in enumerate(options, 1):
        judged.append(_judged(plan, option))
        if progress is not None:
            progress(k, len(options))
    base, *changes = judged
    return base, sorted(changes, key=lambda change: change.band)


def options_of(rig: Rig, noise: float) -> list[Option]:
    """Return the options for a rig; the first one leaves the rig as it is.

    Args:
        noise: of an added sensor of force where the rig has no load cell [N].
    """
    options = [Option("as it is", rig)]
    groups = dict[str, dict[str, object]]()
    for draw in draws_of(rig):
        if draw.paths[0].startswith("sensors."):
            continue
        key = "{0}.*.{2}".format(*draw.paths[0].split(".", 2))
        words = in_words(rig, key) + (" in common" if draw.common else "")
        for path in draw.paths:
            std = draw.std if draw.common else number(rig, path).independent_std
            key = "shared.std" if draw.common else "std"
            groups.setdefault(words, {})[f"{path}.{key}"] = std / 2.0
    options += [
        Option(f"{words} known twice as well", rig.with_values(values))
        for words, values in groups.items()
    ]
    for kind in ("position", "force", "tension"):
        errors: dict[str, object] = {
            f"sensors.{i}.{name}": size / 2.0
            for i, sensor in enumerate(rig.sensors)
            for name in ("noise", "linearity", "resolution")
            if sensor.measures == kind and (size := getattr(sensor, name)) > 0.0
        }
        if errors:
            options.append(Option(f"{kind} sensors twice as good", rig.with_values(errors)))
    options += _with_sensors(rig, noise)
    return [*options, Option(f"the angle known for the first {KNOWN_TIME:g} s", rig, KNOWN_TIME)]


def _with_sensors(rig: Rig, noise: float) -> list[Option]:
    """Return options that add sensors which the rig does not have, as noisy as its best load cell,
    or with the given `noise` [N] where it has none.
    """
    cells = [sensor.noise for sensor in rig.sensors_of("force") if sensor.si == "N"]
    noise = min(cells, default=noise) or noise
    rate = max((sensor.rate for sensor in rig.sensors), default=100.0)
    sliders = [drive.name for drive in rig.drives if drive.kind == "slider"]
    options = []
    for measures, parts, words in (
        ("tension", rig.tendon_names, "tension sensor of {:g} N on each tendon"),
        ("force", sliders, "load cell of {:g} N at each drive"),
    ):
        measured = {sensor.of for sensor in rig.sensors_of(measures)}
        added = [
            {
                "name": f"{measures}_{part}",
                "measures": measures,
                "of": part,
                "noise": noise,
                "rate": rate,
            }
            for part in parts
            if part not in measured
        ]
        if added:
            sensors = [*rig.model_dump()["sensors"], *added]
            options.append(
                Option(f"a {words.format(noise)}", rig.with_values({"sensors": sensors}))
            )
    return options


def _judged(plan: Plan, option: Option) -> Suggestion:
    changed = replace(plan, rig=option.rig)
    scenarios = range(len(plan.scenarios))
    tasks = [Task(0, {}, seed, s) for s in scenarios for seed in range(PLANTS)]
    outcomes = run_tasks(changed, tasks, homing=option.homing)
    bands = []
    squares = []
    for outcome in outcomes:
        if isinstance(outcome, Estimate) and outcome.truths is not None:
            # a calibration is judged by what comes after it, and so are all other options
            late = outcome.time - outcome.time[0] >= KNOWN_TIME
            bands.append(np.mean(BAND * outcome.angle_stds[late, plan.joint]))
            squares.append(np.mean((outcome.angles - outcome.truths)[late, plan.joint] ** 2))
    if not bands:
        raise StudyError(f"{option.words}: {outcomes[0]}")
    return Suggestion(option.words, float(np.mean(bands)), float(np.sqrt(np.mean(squares))))
