"""What a study's rows say: the share of rigs as built that meet the requirement, what matters, and the worst cases."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import pairwise
from math import degrees, prod

import numpy as np
from numpy.typing import NDArray

from distal.arrays import Bools, Floats
from distal.control import ClosedLoop
from distal.errors import DistalError, StudyError
from distal.results import BAND, Estimate
from distal.rig import in_words
from distal.study.description import Plan
from distal.study.runs import BUILT, MEASURES, Task, run_tasks
from distal.study.space import ESTIMATOR, FEEDBACK, Axis, Space, Value
from distal.study.storage import Columns

BINS = 4
"""A range is split into so many parts."""

MOST_AXES = 3
"""Parts are told by so many of the numbers that vary."""

FEWEST = 20
"""A part of the space with fewer rigs says nothing."""

MOST_SAMPLES = 20_000
"""More rigs than this are not needed for the indices."""

CASES = 3
"""Worst cases that are shown."""

PREFIXES = ((1e3, 1e3, "k"), (0.1, 1.0, ""), (1e-4, 1e-3, "m"), (0.0, 1e-6, "µ"))
"""From which size on a unit has a prefix, how many of it are one with that prefix, and the prefix."""

POINTS = 500
"""Points of a trace."""


@dataclass(frozen=True)
class Proportion:
    """A share of rigs, with the 95 % interval of Wilson (1927).

    Args:
        rigs: how many there are.
        met: how many meet the requirement.
        share: of them.
        low: of the interval.
        high: of the interval.
    """

    rigs: int
    met: int
    share: float
    low: float
    high: float

    def __str__(self) -> str:
        return f"{100 * self.share:.0f} % (95 % interval {100 * self.low:.0f} to {100 * self.high:.0f} %)"


@dataclass(frozen=True)
class Influence:
    """How much of the variance of the RMS error one number alone explains: its first-order Sobol index.

    Args:
        name: of the column.
        words: what it is.
        index: the share, of 1.
        half: half-width of its 95 % interval.
    """

    name: str
    words: str
    index: float
    half: float


@dataclass(frozen=True)
class Region:
    """A part of the space of designs, and the share of rigs there.

    Args:
        where: in words.
        proportion: of the rigs.
    """

    where: str
    proportion: Proportion


@dataclass(frozen=True)
class Case:
    """A run that is among the worst.

    Args:
        words: what it is.
        time: stamps [s], (k,).
        truth: the joint's angle [°], (k,).
        estimate: of it [°], (k,).
        half: half-width of the 95 % band [°], (k,).
    """

    words: str
    time: list[float]
    truth: list[float]
    estimate: list[float]
    half: list[float]


@dataclass(frozen=True)
class Answer:
    """What a study says.

    Args:
        sentence: the answer in words.
        overall: of all rigs.
        scenarios: name → share of the rigs that meet the requirement in it, of those that are asked.
        influences: which numbers matter, most first; empty where SALib is not installed or nothing varies.
        regions: parts of the space, best first.
        worst: cases.
        problems: errors of runs → how many had them.
        measures: name → mean over all runs.
    """

    sentence: str
    overall: Proportion
    scenarios: dict[str, Proportion]
    influences: tuple[Influence, ...]
    regions: tuple[Region, ...]
    worst: tuple[Case, ...]
    problems: dict[str, int]
    measures: dict[str, float]

    def as_json(self) -> dict[str, object]:
        """Return it as tables and lists."""
        return asdict(self)


def proportion(met: Bools) -> Proportion:
    """Return the share of rigs that meet the requirement.

    Args:
        met: whether each does, (n,).
    """
    from scipy.stats import binomtest

    interval = binomtest(int(met.sum()), len(met)).proportion_ci(method="wilson")
    return Proportion(len(met), int(met.sum()), float(met.mean()), float(interval.low), float(interval.high))


def answer_of(plan: Plan, space: Space, columns: Columns) -> Answer:
    """Return what the rows of a finished study say.

    Args:
        columns: its rows, by design, seed and scenario.

    Raises:
        StudyError: rows are missing, or every run failed.
    """
    study, each = plan.study, len(plan.scenarios)
    if len(columns["met"]) != len(space) * study.seeds * each:
        raise StudyError(
            f"{len(columns['met'])} rows came of {len(space) * study.seeds * each}; run the study to its end"
        )
    names = sorted(study.scenarios)
    met = columns["met"].reshape(-1, each)
    asked = [
        k for k, name in enumerate(names) if not study.requirement.scenarios or name in study.requirement.scenarios
    ]
    good = np.all(met[:, asked] == 1, axis=1)
    rms = np.sqrt(np.mean(columns["rms_deg"].reshape(-1, each)[:, asked].astype(np.float64) ** 2, axis=1))
    overall = proportion(good)
    of_scenario = {names[k]: proportion(met[:, k] == 1) for k in asked}
    influences = influences_of(plan, space, columns, rms)
    regions = _regions(plan, space, columns, good, influences)
    texts, counts = np.unique(columns["problem"].astype(str), return_counts=True)
    problems = {str(text): int(count) for text, count in zip(texts, counts) if text}
    if sum(problems.values()) == len(columns["problem"]):
        raise StudyError(f"every run failed, so there is no answer: {max(problems, key=lambda text: problems[text])}")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # nothing but problems has no mean
        measures = {name: float(np.nanmean(columns[name].astype(np.float64))) for name in MEASURES}
    worst = _worst(plan, space, columns)
    sentence = _sentence(plan, overall, of_scenario, influences, regions, problems)
    return Answer(sentence, overall, of_scenario, influences, regions, worst, problems, measures)


def words_of(plan: Plan, name: str) -> str:
    """Return what a column is, in words."""
    own = name.removeprefix(BUILT)
    if own in (ESTIMATOR, FEEDBACK):
        return own
    shared = own in plan.rig.sharing()
    what = f"common error of {own}" if shared else in_words(plan.rig, own)
    if own.startswith("sensors.") and own.count(".") == 1:
        what = f"sensor {own.partition('.')[2]}"
    return f"{what}, as built" if name.startswith(BUILT) else what


def quantity(value: float, unit: str) -> str:
    """Return a number with its unit as people write it.

    Args:
        value: SI.
        unit: SI.
    """
    if unit == "rad":
        return f"{degrees(value):.3g}°"
    if not unit or value == 0.0:
        return f"{value:.3g} {unit}".strip()
    scaled = unit[0] in "mNsHV"  # kg has its prefix already
    _, size, prefix = next(one for one in PREFIXES if abs(value) >= one[0]) if scaled else (0.0, 1.0, "")
    return f"{value / size:.3g} {prefix}{unit}"


def influences_of(plan: Plan, space: Space, columns: Columns, rms: Floats) -> tuple[Influence, ...]:
    """Return which numbers matter, most first: first-order Sobol indices by RBD-FAST (Tarantola et al., 2006; SALib).

    Args:
        rms: RMS error of each rig [°], (n,).
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            from SALib.analyze import rbd_fast
    except ImportError:
        return ()
    each, known = len(plan.scenarios), np.isfinite(rms)
    inputs = {}
    for name in [*(axis.path for axis in space.axes), *(key for key in columns if key.startswith(BUILT))]:
        values = columns[name][::each][known]
        numbers = (
            values.astype(np.float64) if values.dtype.kind in "fiub" else np.unique(values, return_inverse=True)[1]
        )
        if len(numbers) and np.ptp(numbers) > 0.0:
            inputs[name] = numbers.astype(np.float64)
    some = np.random.default_rng(0).permutation(int(known.sum()))[:MOST_SAMPLES]
    if not inputs or len(some) < 100 or np.ptp(rms[known]) == 0.0:
        return ()
    problem = {"num_vars": len(inputs), "names": list(inputs), "bounds": [[0.0, 1.0]] * len(inputs)}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = rbd_fast.analyze(problem, np.column_stack(list(inputs.values()))[some], rms[known][some], seed=1)
    every = [
        Influence(name, words_of(plan, name), float(np.clip(index, 0.0, 1.0)), float(half))
        for name, index, half in zip(inputs, found["S1"], found["S1_conf"])
    ]
    return tuple(sorted(every, key=lambda one: -one.index))


def _parts(plan: Plan, axis: Axis, values: NDArray[np.generic], bins: int) -> list[tuple[str, Bools]]:
    """Return parts of an axis, each in words with the rigs that are in it."""
    name = words_of(plan, axis.path)
    if axis.choices:
        return [(said_of(name, one, axis.unit), values == one) for one in axis.choices]
    edges = [float(axis.at(k / bins)) for k in range(bins + 1)]
    numbers = values.astype(np.float64)
    parts = []
    for k, (low, high) in enumerate(pairwise(edges)):
        inside = (numbers >= low) & ((numbers < high) | (k == bins - 1))
        parts.append((f"{name} {quantity(low, axis.unit)} to {quantity(high, axis.unit)}", inside))
    return parts


def said_of(name: str, value: Value, unit: str) -> str:
    """Return in words what something that varies is.

    Args:
        value: SI.
        unit: SI.
    """
    if isinstance(value, bool):
        return f"{'with' if value else 'without'} {name}"
    return f"{name} {value}" if isinstance(value, str) else f"{name} {quantity(value, unit)}"


def _regions(
    plan: Plan, space: Space, columns: Columns, good: Bools, influences: Sequence[Influence]
) -> tuple[Region, ...]:
    """Return the shares in parts of the space along its choices and the numbers of it that matter, best first."""
    order = [one.name for one in influences]
    told = {one.name for one in influences if one.index > one.half}
    every = sorted(space.axes, key=lambda axis: order.index(axis.path) if axis.path in order else len(order))
    known = [axis for axis in every if axis.choices or axis.path in told]
    axes = (known or list(space.axes))[:MOST_AXES]
    while len(axes) > 1 and FEWEST * prod(len(axis.choices) or BINS for axis in axes) > len(good):
        axes.pop()
    found, each = [], len(plan.scenarios)
    cells: list[tuple[str, Bools]] = [("", np.ones(len(good), dtype=np.bool_))] if axes else []
    for axis in axes:
        parts = _parts(plan, axis, columns[axis.path][::each], BINS)
        cells = [(f"{a}, {b}" if a else b, x & y) for a, x in cells for b, y in parts]
    for where, inside in cells:
        if inside.sum() >= FEWEST:
            found.append(Region(where, proportion(good[inside])))
    return tuple(sorted(found, key=lambda one: -one.proportion.low))


def _worst(plan: Plan, space: Space, columns: Columns) -> tuple[Case, ...]:
    """Return the cases with the largest RMS errors, run again for their traces."""
    rms = np.nan_to_num(columns["rms_deg"].astype(np.float64), nan=-1.0)
    order = [int(k) for k in np.argsort(-rms, kind="stable")[:CASES] if rms[k] >= 0.0]
    tasks = []
    for k in order:
        index, scenario = int(columns["design"][k]), plan.study.scenarios.index(str(columns["scenario"][k]))
        tasks.append(Task(index, space.design(index), int(columns["seed"][k]), scenario))
    cases = []
    for k, task, found in zip(order, tasks, run_tasks(plan, tasks, space)):
        curves = _curves(found, plan.joint)
        if curves is None:
            continue
        time, *traces = (each[:: max(1, len(curves[0]) // POINTS)] for each in curves)
        said = (said_of(words_of(plan, axis.path), task.design[axis.path], axis.unit) for axis in space.axes)
        words = "; ".join([f"{plan.study.scenarios[task.scenario]}: RMS {rms[k]:.2g}°", *said])
        stamps = [round(float(t), 3) for t in time - time[0]]
        cases.append(Case(words, stamps, *([round(float(v), 3) for v in np.rad2deg(one)] for one in traces)))
    return tuple(cases)


def _curves(found: Estimate | ClosedLoop | DistalError, j: int) -> tuple[Floats, Floats, Floats, Floats] | None:
    """Return time [s], true angle, estimate and half of the band [rad] of a run; None where there are none."""
    if isinstance(found, ClosedLoop):
        return found.time, found.angles[:, j], found.estimates[:, j], BAND * found.stds[:, j]
    if isinstance(found, DistalError) or found.truths is None:
        return None
    return found.time, found.truths[:, j], found.angles[:, j], BAND * found.angle_stds[:, j]


def _sentence(
    plan: Plan,
    overall: Proportion,
    scenarios: dict[str, Proportion],
    influences: Sequence[Influence],
    regions: Sequence[Region],
    problems: dict[str, int],
) -> str:
    asked, count = plan.study.requirement, len(scenarios)
    verdict = "yes" if overall.low >= asked.rigs else "no" if overall.high < asked.rigs else "not certain"
    asks = "Over all kinds of feedback" if FEEDBACK in plan.study.vary else "Without an encoder"
    where = f"in all {count} scenarios" if count > 1 else f"in {next(iter(scenarios))}"
    text = (
        f"{asks}: {verdict}. {overall} of {overall.rigs:,} rigs as built stay within "
        f"±{degrees(asked.within):.3g}° for {100 * asked.time:.3g} % of the time {where}"
    )
    if influences and influences[0].index > influences[0].half:
        text += f"; what matters most: {influences[0].words}"
    if count > 1:
        text += f"; worst: {min(scenarios, key=lambda name: scenarios[name].share)}"
    if regions and len(regions) > 1:
        text += f". Best: {regions[0].where}: {regions[0].proportion}"
    if problems:
        text += f". {sum(problems.values())} runs failed and count as not met"
    return text + "."
