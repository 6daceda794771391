"""Suggestions: which change narrows the band of a rig most, another sensor, a number that is known
better, or a calibration at a known angle.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from distal.arrays import Floats
from distal.confidence import BAND
from distal.errors import StudyError
from distal.estimators import DEFAULT
from distal.results import Estimate
from distal.rig import Rig, in_words, number
from distal.study.description import Plan
from distal.study.plants import draws_of
from distal.study.runs import NOMINAL, Task, run_tasks

BETTER = 0.5
"""Share of its std that a better known number keeps, and of its errors a better sensor [1]. Source:
judgement.
"""

KNOWN = 2.0
"""Time at the start for which the joint's angle is known in a calibration [s]. Source:
judgement.
"""

PLANTS = 24
"""Number of rigs as built on which each option is simulated [1]. Source: judgement."""

SAME = 0.05
"""Bands, or errors, that differ by a smaller share than this count as the same [1]. Source:
judgement.
"""

NOISE = 0.1
"""Noise std of an added tension sensor or load cell where the rig has no force sensor to copy it
from [N]. Source: judgement.
"""


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
    """What an option brings, by the samples after the first `KNOWN` seconds.

    Args:
        band: mean half-width of the 95 % band by the filter's covariance, on one nominal log of
            each scenario [rad].
        squares: mean square error of each rig as built over all scenarios, NaN where a run failed,
            (n,) [rad²].
    """

    words: str
    band: float
    squares: Floats

    @property
    def error(self) -> float:
        """RMS error over the rigs as built that did not fail [rad]."""
        return float(np.sqrt(np.nanmean(self.squares)))


def suggestions(
    plan: Plan, progress: Callable[[int, int], None] | None = None
) -> tuple[Suggestion, list[Suggestion], float]:
    """Return the rig as it is, the options (narrowest band first), and Kendall's τ between their
    ranks by band and by error.

    In these ranks an option that changes nothing is equal to the rig as it is: its band or its
    error differs by less than `SAME`, or its error by less than twice the standard error of the
    difference between the same plants with and without the option.

    Raises:
        StudyError: the study's estimator is not the default one, whose covariance is needed, or the
            rig cannot be estimated.
    """
    from scipy.stats import kendalltau

    if plan.study.estimator != DEFAULT:
        raise StudyError(
            f"suggestions go by the covariance of '{DEFAULT}'; '{plan.study.estimator}' came as "
            "estimator"
        )
    options = options_of(plan.rig)
    judged = list[Suggestion]()
    for k, option in enumerate(options, 1):
        judged.append(_judged(plan, option))
        if progress is not None:
            progress(k, len(options))
    base, *changes = judged
    bands = [
        base.band if abs(change.band - base.band) < SAME * base.band else change.band
        for change in changes
    ]
    tau = kendalltau(bands, [_identified(base, change) for change in changes]).statistic
    return base, sorted(changes, key=lambda change: change.band), float(tau)


def _identified(base: Suggestion, change: Suggestion) -> float:
    """Return the RMS error of an option [rad], or that of the rig as it is where its plants do not
    show a difference.
    """
    differences = change.squares - base.squares
    differences = differences[np.isfinite(differences)]
    unsure = 2.0 * np.std(differences) / np.sqrt(max(len(differences), 1))
    unknown = len(differences) < 2 or abs(np.mean(differences)) < unsure
    return (
        base.error
        if unknown or abs(change.error - base.error) < SAME * base.error
        else change.error
    )


def options_of(rig: Rig) -> list[Option]:
    """Return the options for a rig; the first one leaves the rig as it is."""
    options = [Option("as it is", rig)]
    groups = dict[str, dict[str, object]]()
    for draw in draws_of(rig):
        if draw.paths[0].startswith("sensors."):
            continue
        key = "{0}.*.{2}".format(*draw.paths[0].split(".", 2))
        words = in_words(rig, key) + (" in common" if draw.common else "")
        for path in draw.paths:
            std = draw.std if draw.common else number(rig, path).independent_std
            groups.setdefault(words, {})[f"{path}.{'shared.std' if draw.common else 'std'}"] = (
                BETTER * std
            )
    options += [
        Option(f"{words} known twice as well", rig.with_values(values))
        for words, values in groups.items()
    ]
    for kind in ("position", "force", "tension"):
        errors: dict[str, object] = {}
        for i, sensor in enumerate(rig.sensors):
            if sensor.measures == kind:
                sizes = {
                    name: getattr(sensor, name) for name in ("noise", "linearity", "resolution")
                }
                errors |= {
                    f"sensors.{i}.{name}": BETTER * size
                    for name, size in sizes.items()
                    if size > 0.0
                }
        if errors:
            options.append(Option(f"{kind} sensors twice as good", rig.with_values(errors)))
    options += _with_sensors(rig)
    return [*options, Option(f"the angle known for the first {KNOWN:g} s", rig, KNOWN)]


def _with_sensors(rig: Rig) -> list[Option]:
    """Return options that add sensors which the rig does not have."""
    noise = (
        min((sensor.noise for sensor in rig.sensors_of("force") if sensor.si == "N"), default=NOISE)
        or NOISE
    )
    rate = max((sensor.rate for sensor in rig.sensors), default=100.0)
    options = []
    for measures, parts, words in (
        (
            "tension",
            rig.tendon_names,
            f"a tension sensor of {noise:g} N on each tendon",
        ),
        (
            "force",
            [d.name for d in rig.drives if d.kind == "slider"],
            f"a load cell of {noise:g} N at each drive",
        ),
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
            options.append(Option(words, rig.with_values({"sensors": sensors})))
    return options


def _judged(plan: Plan, option: Option) -> Suggestion:
    changed = replace(plan, rig=option.rig)
    scenarios = range(len(plan.scenarios))
    tasks = [Task(0, {}, seed, s) for s in scenarios for seed in (NOMINAL, *range(PLANTS))]
    bands = []
    squares = []
    for task, outcome in zip(tasks, run_tasks(changed, tasks, homing=option.homing)):
        if not isinstance(outcome, Estimate) or outcome.truths is None:
            if task.seed == NOMINAL:
                raise StudyError(f"{option.words}: {outcome}")
            squares.append(np.nan)
            continue
        # a calibration is judged by what comes after it, and so are all other options
        late = outcome.time - outcome.time[0] >= KNOWN
        if task.seed == NOMINAL:
            bands.append(np.mean(BAND * outcome.angle_stds[late, plan.joint]))
        else:
            squares.append(np.mean((outcome.angles - outcome.truths)[late, plan.joint] ** 2))
    by_scenario = np.array(squares, dtype=np.float64).reshape(len(plan.scenarios), PLANTS)
    return Suggestion(option.words, float(np.mean(bands)), by_scenario.mean(axis=0))
