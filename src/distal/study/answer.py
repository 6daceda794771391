"""The answer of a study, from its rows: the share of rigs as built that meet the requirement, what
matters, and the worst cases.
"""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from distal.arrays import Bools, Floats
from distal.errors import StudyError
from distal.study.description import Plan
from distal.study.design_space import FEEDBACK, Space
from distal.study.execution import Columns
from distal.study.runs import BUILT, MEASURES, Task, curves_of, run_tasks
from distal.study.shares import (
    Need,
    Proportion,
    needs_in_short,
    needs_of,
    parts_of,
    proportion,
    setting_in_words,
    words_of,
)
from distal.units import rounded

CASES = 3
"""Number of worst cases that are shown [1]. Source: layout."""

CURVE_POINTS = 500
"""Number of points to which a curve is thinned out; fewer than twice as many remain [1]. Source:
layout.
"""


@dataclass(frozen=True)
class Influence:
    """Which share of the variance of the rigs' RMS errors one column alone explains: a first-order
    Sobol `index` ± `half` (95 %) [1].
    """

    name: str
    words: str
    index: float
    half: float


@dataclass(frozen=True)
class Case:
    """One of the runs with the largest errors: time [s], the joint's true angle, its estimate and
    the half-width of the 95 % band [°], (k,) each.
    """

    words: str
    time: list[float]
    truth: list[float]
    estimate: list[float]
    half: list[float]


@dataclass(frozen=True)
class Answer:
    """The answer of a study.

    Args:
        sentence: the answer in short.
        overall: share of the rigs that meet the requirement in all scenarios.
        scenarios: name → share of the rigs that meet the requirement in it.
        influences: which numbers matter, most first; empty where nothing varies, or fewer than 100
            rigs have an error.
        needs: whether each thing that varies is needed.
        regions: parts of the space of designs, in words, with the share of rigs in each that meet
            the requirement, best first.
        worst: the runs with the largest errors.
        problems: message of an error → number of runs that it ended, most first.
        measures: name (see `MEASURES`) → mean over all runs that did not fail.
    """

    sentence: str
    overall: Proportion
    scenarios: dict[str, Proportion]
    influences: tuple[Influence, ...]
    needs: tuple[Need, ...]
    regions: tuple[tuple[str, Proportion], ...]
    worst: tuple[Case, ...]
    problems: dict[str, int]
    measures: dict[str, float]


def answer_of(plan: Plan, space: Space, columns: Columns) -> Answer:
    """Return the answer of a finished study.

    Args:
        columns: its rows, sorted by design, seed and scenario.

    Raises:
        StudyError: rows are missing, or every run failed.
    """
    study = plan.study
    n_scenarios = len(plan.scenarios)
    rows = len(columns["met"])
    runs = len(space) * study.seeds * n_scenarios
    if rows != runs:
        raise StudyError(f"{rows} rows came of {runs}; run the study to its end")
    names = sorted(study.scenarios)
    met = columns["met"].reshape(-1, n_scenarios).astype(bool)
    good = np.all(met, axis=1)
    errors = columns["rms_deg"].reshape(-1, n_scenarios).astype(np.float64)
    rms = np.sqrt(np.mean(errors**2, axis=1))
    overall = proportion(good)
    of_scenario = {name: proportion(column) for name, column in zip(names, met.T)}
    influences = influences_of(plan, space, columns, rms)
    regions = _regions(plan, space, columns, good, influences)
    problems = dict(Counter(filter(None, columns["problem"].tolist())).most_common())
    if sum(problems.values()) == rows:
        raise StudyError(f"every run failed, so there is no answer: {next(iter(problems))}")
    measures = {name: float(np.nanmean(columns[name].astype(np.float64))) for name in MEASURES}
    worst = _worst(plan, space, columns)
    needs = needs_of(plan, space, columns, good)
    sentence = _sentence(plan, overall, of_scenario, influences, needs, regions, problems)
    return Answer(
        sentence, overall, of_scenario, influences, needs, regions, worst, problems, measures
    )


def influences_of(plan: Plan, space: Space, columns: Columns, rms: Floats) -> tuple[Influence, ...]:
    """Return which numbers influence the RMS error `rms` of the rigs [°], (n,), most first.

    The influences are first-order Sobol indices by RBD-FAST (Tarantola et al., 2006; SALib).
    """
    is_finite = np.isfinite(rms)
    inputs = {}
    for name in [*(axis.path for axis in space.axes), *(n for n in columns if n.startswith(BUILT))]:
        column = columns[name][:: len(plan.scenarios)][is_finite]
        if column.dtype.kind not in "fiub":
            column = np.unique(column, return_inverse=True)[1]
        values = column.astype(np.float64)
        if len(values) and np.ptp(values) > 0.0:
            inputs[name] = values
    rms = rms[is_finite]
    if not inputs or len(rms) < 100 or np.ptp(rms) == 0.0:
        return ()
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from SALib.analyze import rbd_fast

        # designs come in the order of their choices, which the indices must not see
        order = np.random.default_rng(0).permutation(len(rms))
        problem = {"num_vars": len(inputs), "names": list(inputs)}
        table = np.column_stack(list(inputs.values()))
        indices = rbd_fast.analyze(problem, table[order], rms[order], seed=1)
    influences = [
        Influence(name, words_of(plan, name), float(np.clip(index, 0.0, 1.0)), float(half))
        for name, index, half in zip(inputs, indices["S1"], indices["S1_conf"])
    ]
    return tuple(sorted(influences, key=lambda influence: -influence.index))


def _regions(
    plan: Plan, space: Space, columns: Columns, good: Bools, influences: Sequence[Influence]
) -> tuple[tuple[str, Proportion], ...]:
    """Return regions of the space of designs with their shares of rigs, best first.

    The space is split along choices and along numbers whose influence is larger than its
    uncertainty, one after the other, those of the largest influence first, as long as the lower end
    of the best region's interval rises.
    """
    order = [influence.name for influence in influences]
    significant = {influence.name for influence in influences if influence.index > influence.half}
    ranked = sorted(
        space.axes, key=lambda axis: order.index(axis.path) if axis.path in order else len(order)
    )
    axes = [axis for axis in ranked if axis.choices or axis.path in significant] or list(space.axes)
    cells: list[tuple[str, Bools]] = [("", np.ones(len(good), dtype=np.bool_))]
    found: tuple[tuple[str, Proportion], ...] = ()
    for axis in axes:
        parts = parts_of(plan, axis, columns[axis.path][:: len(plan.scenarios)])
        cells = [(f"{a}, {b}" if a else b, x & y) for a, x in cells for b, y in parts]
        regions = [(words, proportion(good[cell])) for words, cell in cells if cell.any()]
        regions.sort(key=lambda region: -region[1].low)
        if found and regions[0][1].low <= found[0][1].low:
            break
        found = tuple(regions)
    return found


def _worst(plan: Plan, space: Space, columns: Columns) -> tuple[Case, ...]:
    """Return the cases with the largest RMS errors, run again for their traces."""
    rms = np.nan_to_num(columns["rms_deg"].astype(np.float64), nan=-1.0)
    order = [k for k in np.argsort(-rms, kind="stable")[:CASES] if rms[k] >= 0.0]
    cases = []
    tasks = []
    for k in order:
        index = int(columns["design"][k])
        scenario = plan.study.scenarios.index(str(columns["scenario"][k]))
        tasks.append(Task(index, space.design(index), int(columns["seed"][k]), scenario))
    for k, task, outcome in zip(order, tasks, run_tasks(plan, tasks)):
        curves = curves_of(outcome, plan.joint)
        if curves is None:
            continue
        time, *angles = (curve[:: max(1, len(curves[0]) // CURVE_POINTS)] for curve in curves)
        settings = (
            setting_in_words(words_of(plan, axis.path), task.design[axis.path], axis.unit)
            for axis in space.axes
        )
        words = "; ".join(
            [f"{plan.study.scenarios[task.scenario]}: RMS {rounded(rms[k])}°", *settings]
        )
        traces = np.round([time - time[0], *map(np.rad2deg, angles)], 3)
        cases.append(Case(words, *traces.tolist()))
    return tuple(cases)


def _sentence(
    plan: Plan,
    overall: Proportion,
    scenarios: dict[str, Proportion],
    influences: Sequence[Influence],
    needs: Sequence[Need],
    regions: Sequence[tuple[str, Proportion]],
    problems: dict[str, int],
) -> str:
    asked = plan.study.requirement
    count = len(scenarios)
    verdict = (
        "yes" if overall.low >= asked.rigs else "no" if overall.high < asked.rigs else "not certain"
    )
    asks = "Over all kinds of feedback" if FEEDBACK in plan.study.vary else "Without an encoder"
    where = f"in all {count} scenarios" if count > 1 else f"in {next(iter(scenarios))}"
    text = (
        f"{asks}: {verdict}. {overall} of {overall.rigs:,} rigs as built stay within "
        f"±{rounded(degrees(asked.within), 3)}° for {100 * asked.time:.3g} % of the time {where}"
    )
    if influences and influences[0].index > influences[0].half:
        text += f"; what matters most: {influences[0].words}"
    if count > 1:
        text += f"; worst: {min(scenarios, key=lambda name: scenarios[name].share)}"
    if short := needs_in_short(plan, needs):
        text += f"; {short}"
    if regions and len(regions) > 1:
        text += f". Best: {': '.join(map(str, regions[0]))}"
    if problems:
        text += f". {sum(problems.values())} runs failed and count as not met"
    return text + "."
