"""The answer of a study, from its rows: the share of rigs as built that meet the requirement, where
it is met, and what is needed.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from math import degrees

import numpy as np

from distal.arrays import Bools
from distal.errors import StudyError
from distal.study.description import Plan
from distal.study.design_space import FEEDBACK, Space
from distal.study.execution import Columns
from distal.study.runs import MEASURES
from distal.study.shares import (
    Need,
    Proportion,
    needs_in_short,
    needs_of,
    parts_of,
    proportion,
)
from distal.units import rounded


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
    regions: tuple[tuple[str, Proportion], ...]
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
    regions = _regions(plan, space, columns, good)
    problems = dict(Counter(filter(None, columns["problem"].tolist())).most_common())
    if sum(problems.values()) == rows:
        raise StudyError(f"every run failed, so there is no answer: {next(iter(problems))}")
    measures = {name: float(np.nanmean(columns[name].astype(np.float64))) for name in MEASURES}
    needs = needs_of(plan, space, columns, good)
    sentence = _sentence(plan, overall, of_scenario, needs, regions, problems)
    return Answer(sentence, overall, of_scenario, needs, regions, problems, measures)


def _regions(
    plan: Plan, space: Space, columns: Columns, good: Bools
) -> tuple[tuple[str, Proportion], ...]:
    """Return regions of the space of designs with their shares of rigs, best first.

    The space is split along one axis after the other, first along that whose best part has the
    highest lower end of its interval; a split that does not raise that end is left out.
    """
    splits = [
        parts_of(plan, axis, columns[axis.path][:: len(plan.scenarios)]) for axis in space.axes
    ]
    splits.sort(key=lambda parts: -_shares(parts, good)[0][1].low)
    cells: list[tuple[str, Bools]] = [("", np.ones(len(good), dtype=np.bool_))]
    found: tuple[tuple[str, Proportion], ...] = ()
    for parts in splits:
        finer = [(f"{a}, {b}" if a else b, x & y) for a, x in cells for b, y in parts]
        regions = _shares(finer, good)
        if not found or regions[0][1].low > found[0][1].low:
            cells = finer
            found = regions
    return found


def _shares(cells: Sequence[tuple[str, Bools]], good: Bools) -> tuple[tuple[str, Proportion], ...]:
    """Return the share of rigs in each cell that has any, best first."""
    shares = [(words, proportion(good[cell])) for words, cell in cells if cell.any()]
    return tuple(sorted(shares, key=lambda share: -share[1].low))


def _sentence(
    plan: Plan,
    overall: Proportion,
    scenarios: dict[str, Proportion],
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
    if count > 1:
        text += f"; worst: {min(scenarios, key=lambda name: scenarios[name].share)}"
    if short := needs_in_short(plan, needs):
        text += f"; {short}"
    if regions and len(regions) > 1:
        text += f". Best: {': '.join(map(str, regions[0]))}"
    if problems:
        text += f". {sum(problems.values())} runs failed and count as not met"
    return text + "."
