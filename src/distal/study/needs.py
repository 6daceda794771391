"""Whether each thing that varies in a study is needed: a sensor, a number, an estimator."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

from distal.arrays import Bools
from distal.study.description import Plan
from distal.study.design_space import Axis, Space
from distal.study.proportions import FEWEST, Proportion, proportion
from distal.study.storage import Columns
from distal.study.words import parts_of, words_of


class Verdict(Enum):
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
        text: the verdict in words.
        shares: each choice, or part of a range, in words, with the share of rigs that meet the
            requirement there, see `needs_of`.
    """

    name: str
    verdict: Verdict
    text: str
    shares: tuple[tuple[str, Proportion], ...]


def needs_of(plan: Plan, space: Space, columns: Columns, good: Bools) -> tuple[Need, ...]:
    """Return for each thing that varies whether it is needed.

    A choice, or part of a range, is judged by the best share of rigs that it reaches: alone, or
    together with one choice or part of another axis, since a designer may choose that too.

    Args:
        good: which rigs meet the requirement in all scenarios, (n,).
    """
    values = {axis.path: columns[axis.path][:: len(plan.scenarios)] for axis in space.axes}
    parts = {axis.path: parts_of(plan, axis, values[axis.path]) for axis in space.axes}
    found = []
    for axis in space.axes:
        others = [
            inside for path, cells in parts.items() if path != axis.path for _, inside in cells
        ]
        best = [
            (words, _best(good, inside, others))
            for words, inside in parts[axis.path]
            if inside.sum() >= FEWEST
        ]
        if len(best) > 1:
            found.append(_need(plan, axis, best))
    return tuple(found)


def _best(good: Bools, inside: Bools, others: Sequence[Bools]) -> Proportion:
    """Return the share of rigs that meet the requirement with the highest lower end of its
    interval: of all rigs in a part, or of those that are also in one part of another axis.
    """
    cells = [inside, *(inside & other for other in others)]
    shares = [proportion(good[cell]) for cell in cells if cell.sum() >= FEWEST]
    return max(shares, key=lambda share: share.low)


def _need(plan: Plan, axis: Axis, shares: Sequence[tuple[str, Proportion]]) -> Need:
    asked = plan.study.requirement.rigs
    words = words_of(plan, axis.path)
    meets = [share.low >= asked for _, share in shares]
    fails = [share.high < asked for _, share in shares]
    switch = len(axis.choices) == 2 and set(axis.choices) == {True, False}
    without = axis.choices.index(False) if switch else 0
    said = "; ".join(f"{part}: {share}" for part, share in shares)
    if all(fails):
        return Need(
            axis.path,
            Verdict.NOT_ENOUGH,
            f"{words} is not enough, whatever it is ({said})",
            tuple(shares),
        )
    if all(meets) or (switch and meets[without]):
        text = f"{words} is not needed" if switch else f"any {words} does"
        return Need(axis.path, Verdict.NOT_NEEDED, f"{text} ({said})", tuple(shares))
    if switch and fails[without] and meets[1 - without]:
        return Need(axis.path, Verdict.NEEDED, f"{words} is needed ({said})", tuple(shares))
    if any(meets) and not switch:
        enough = ", ".join(part for (part, _), meet in zip(shares, meets) if meet)
        return Need(axis.path, Verdict.SOME, f"enough is {enough} ({said})", tuple(shares))
    return Need(
        axis.path,
        Verdict.NOT_CERTAIN,
        f"whether {words} is needed is not certain ({said})",
        tuple(shares),
    )


def needs_in_short(plan: Plan, needs: Sequence[Need]) -> str:
    """Return which sensors are surely needed and which surely are not, in words; empty where none
    is.
    """
    sensors = [
        need for need in needs if need.name.startswith("sensors.") and need.name.count(".") == 1
    ]
    said = []
    for verdict in (Verdict.NEEDED, Verdict.NOT_NEEDED):
        names = ", ".join(words_of(plan, need.name) for need in sensors if need.verdict is verdict)
        said += [f"{verdict.value}: {names}"] if names else []
    return "; ".join(said)
