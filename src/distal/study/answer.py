"""The answer of a study, from its rows: the share of rigs as built that meet the requirement, where
it is met, and what is needed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from itertools import pairwise
from math import degrees

import numpy as np

from distal.arrays import Bools
from distal.errors import StudyError
from distal.rig import in_words
from distal.study.design_space import (
    ESTIMATOR,
    FEEDBACK,
    Axis,
    Plan,
    Space,
    Value,
    sensor_of,
)
from distal.study.runs import MEASURES, Columns
from distal.units import quantity, rounded

PARTS = 4
"""Number of parts of a range that an answer tells apart [1]. Source: definition (quarters)."""


@dataclass(frozen=True)
class Proportion:
    """The share of `rigs` that meet the requirement, `met` of them, with its 95 % interval from
    `low` to `high` (Wilson, 1927).
    """

    rigs: int
    met: int
    share: float
    low: float
    high: float

    def __str__(self) -> str:
        return (
            f"{100 * self.share:.0f} % (95 % interval {100 * self.low:.0f} to "
            f"{100 * self.high:.0f} %)"
        )


Shares = tuple[tuple[str, Proportion], ...]
"""The shares of some regions or parts, each in words."""

Parts = list[tuple[str, Bools]]
"""Words for each part of an axis, and which rigs are in it, (n,)."""


def proportion(met: Bools) -> Proportion:
    """Return the share of rigs that meet the requirement, (n,)."""
    from scipy.stats import binomtest

    result = binomtest(int(met.sum()), len(met))
    interval = result.proportion_ci(method="wilson")
    return Proportion(result.n, result.k, result.statistic, interval.low, interval.high)


def words_of(plan: Plan, name: str) -> str:
    """Return in words what a path in ``vary`` stands for."""
    if name in (ESTIMATOR, FEEDBACK):
        return name
    sensor = sensor_of(name)
    return f"sensor {sensor}" if sensor else in_words(plan.rig, name)


def setting_in_words(name: str, setting: Value, unit: str) -> str:
    """Return in words which `setting` a design has for what is called `name`."""
    if isinstance(setting, bool):
        return f"{'with' if setting else 'without'} {name}"
    return f"{name} {setting if isinstance(setting, str) else quantity(setting, unit)}"


def parts_of(plan: Plan, axis: Axis, columns: Columns) -> Parts:
    """Return the parts of an axis; a range has `PARTS`.

    Args:
        columns: of the rows.
    """
    values = columns[axis.path][:: len(plan.scenarios)]
    name = words_of(plan, axis.path)
    if axis.choices:
        return [
            (setting_in_words(name, choice, axis.unit), values == choice) for choice in axis.choices
        ]
    edges = [float(axis.at(share)) for share in np.linspace(0.0, 1.0, PARTS + 1)]
    part = np.searchsorted(edges[1:-1], values.astype(np.float64), side="right")
    return [
        (f"{name} {quantity(low, axis.unit)} to {quantity(high, axis.unit)}", part == k)
        for k, (low, high) in enumerate(pairwise(edges))
    ]


class Verdict(StrEnum):
    """Whether one thing that varies is needed, as far as the rows say.

    `SOME`: some of its choices or parts meet the requirement. `NOT_ENOUGH`: none does.
    """

    NEEDED = "needed"
    NOT_NEEDED = "not needed"
    SOME = "some of it is needed"
    NOT_ENOUGH = "not enough"
    NOT_CERTAIN = "not certain"


@dataclass(frozen=True)
class Need:
    """Whether one thing that varies is needed.

    Args:
        name: path of what varies.
        shares: each choice, or part of a range, in words, with the share of rigs that meet the
            requirement there, see `needs_of`.
    """

    name: str
    verdict: Verdict
    shares: Shares


def needs_of(plan: Plan, parts: Mapping[Axis, Parts], good: Bools) -> tuple[Need, ...]:
    """Return for each thing that varies whether it is needed.

    A choice, or part of a range, is judged by the best share of rigs that it reaches: alone, or
    together with one choice or part of another axis, since a designer may choose that too. The best
    share is that whose interval has the highest lower end, which a part of few rigs never has.

    Args:
        good: which rigs meet the requirement in all scenarios, (n,).
    """
    found = []
    for axis, of_axis in parts.items():
        others = [cell for beside, cells in parts.items() if beside != axis for _, cell in cells]
        best: Shares = ()
        for words, inside in of_axis:
            together = [(words, inside & other) for other in others]
            best += _shares([(words, inside), *together], good)[:1]
        if len(best) > 1:
            found.append(_need(plan, axis, best))
    return tuple(found)


def _need(plan: Plan, axis: Axis, shares: Shares) -> Need:
    asked = plan.study.requirement.rigs
    meets = [share.low >= asked for _, share in shares]
    fails = [share.high < asked for _, share in shares]
    switch = bool(sensor_of(axis.path)) and False in axis.choices
    without = axis.choices.index(False) if switch else 0
    if all(fails):
        verdict = Verdict.NOT_ENOUGH
    elif all(meets) or (switch and meets[without]):
        verdict = Verdict.NOT_NEEDED
    elif switch and fails[without] and any(meets):
        verdict = Verdict.NEEDED
    elif any(meets) and not switch:
        verdict = Verdict.SOME
    else:
        verdict = Verdict.NOT_CERTAIN
    return Need(axis.path, verdict, shares)


@dataclass(frozen=True)
class Answer:
    """The answer of a study.

    Args:
        sentence: the answer in short.
        overall: share of the rigs that meet the requirement in all scenarios.
        scenarios: name → share of the rigs that meet the requirement in it.
        needs: whether each thing that varies is needed.
        regions: parts of the space of designs, in words, with the share of rigs in each that meet
            the requirement, best first.
        problems: message of an error → number of runs that it ended, most first.
        measures: name (see `MEASURES`) → mean over all runs that did not fail.
    """

    sentence: str
    overall: Proportion
    scenarios: dict[str, Proportion]
    needs: tuple[Need, ...]
    regions: Shares
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
    overall = proportion(good)
    of_scenario = {name: proportion(column) for name, column in zip(names, met.T)}
    parts = {axis: parts_of(plan, axis, columns) for axis in space.axes}
    regions = _regions(parts.values(), good)
    problems = dict(Counter(filter(None, columns["problem"].tolist())).most_common())
    if sum(problems.values()) == rows:
        raise StudyError(f"every run failed, so there is no answer: {next(iter(problems))}")
    measures = {name: float(np.nanmean(columns[name].astype(np.float64))) for name in MEASURES}
    needs = needs_of(plan, parts, good)
    sentence = _sentence(plan, overall, of_scenario, needs, regions, problems)
    return Answer(sentence, overall, of_scenario, needs, regions, problems, measures)


def _regions(axes: Iterable[Parts], good: Bools) -> Shares:
    """Return regions of the space of designs with their shares of rigs, best first.

    The space is split along one axis after the other, first along that whose best part has the
    highest lower end of its interval; a split that does not raise that end is left out.
    """
    cells: Parts = [("", np.ones(len(good), dtype=np.bool_))]
    found: Shares = ()
    for parts in sorted(axes, key=lambda parts: -_shares(parts, good)[0][1].low):
        finer = [(f"{a}, {b}" if a else b, x & y) for a, x in cells for b, y in parts]
        regions = _shares(finer, good)
        if not found or regions[0][1].low > found[0][1].low:
            cells = finer
            found = regions
    return found


def _shares(cells: Parts, good: Bools) -> Shares:
    """Return the share of rigs in each cell that has any, best first."""
    shares = [(words, proportion(good[cell])) for words, cell in cells if cell.any()]
    return tuple(sorted(shares, key=lambda share: -share[1].low))


def _sentence(
    plan: Plan,
    overall: Proportion,
    scenarios: dict[str, Proportion],
    needs: Sequence[Need],
    regions: Shares,
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
    if count > 1:
        text += f"; worst: {min(scenarios, key=lambda name: scenarios[name].share)}"
    for which in (Verdict.NEEDED, Verdict.NOT_NEEDED):
        sensors = [
            words_of(plan, need.name)
            for need in needs
            if sensor_of(need.name) and need.verdict is which
        ]
        if sensors:
            text += f"; {which}: {', '.join(sensors)}"
    if len(regions) > 1:
        text += f". Best: {': '.join(map(str, regions[0]))}"
    if problems:
        text += f". {sum(problems.values())} runs failed and count as not met"
    return text + "."
