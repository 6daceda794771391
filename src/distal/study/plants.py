"""Rigs as built: plants that are drawn from what a rig's description does not know."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from distal.rig import Rig, known_to_a_factor, named, number, parameters_below

KINDS = ("joints", "drives", "tendons", "sensors")


@dataclass(frozen=True)
class Draw:
    """Something that one rig as built differs by from its description.

    Args:
        name: of the number, by names of parts, or of what several have in common.
        std: what is not known: of a number in SI, of what is common as a share.
        paths: of the numbers that it changes.
        common: whether it is what several err by together.
    """

    name: str
    std: float
    paths: tuple[str, ...]
    common: bool = False


def draws_of(rig: Rig) -> tuple[Draw, ...]:
    """Return what is drawn of a rig: every number with a std, and what several err by together."""
    found, common = list[Draw](), dict[str, tuple[float, list[str]]]()
    for kind in KINDS:
        for i, part in enumerate(getattr(rig, kind)):
            for path, parameter in parameters_below(part, f"{kind}.{i}"):
                if path.endswith(".nominal_force"):  # what filters take where they measure none
                    continue
                if parameter.std > 0.0:
                    found.append(Draw(named(rig, path), parameter.std, (path,)))
                if parameter.shared is not None and parameter.shared.std > 0.0:
                    common.setdefault(parameter.shared.name, (parameter.shared.std, []))[1].append(path)
    return (*found, *(Draw(name, std, tuple(paths), True) for name, (std, paths) in common.items()))


def scores(draws: Sequence[Draw], seed: Sequence[int]) -> dict[str, float]:
    """Return how many standard deviations each draw is off; a draw's number depends on its name and the seed alone.

    Args:
        seed: whole numbers that say which rig this is.
    """
    keys = ([*seed, crc32(draw.name.encode())] for draw in draws)
    return {draw.name: float(np.random.default_rng(key).normal()) for draw, key in zip(draws, keys)}


def built_values(rig: Rig, draws: Sequence[Draw], score: Mapping[str, float]) -> dict[str, float]:
    """Return path → value of a rig as built.

    p = value (1 + σ z) + σ_own ε; what cannot be negative is drawn from the normal distribution cut at zero, and what is
    known to a factor only from the log-normal one, as filters take them.

    Args:
        score: how many standard deviations each is off.
    """
    values: dict[str, float] = {}
    for draw in sorted(draws, key=lambda one: not one.common):
        for path in draw.paths:
            known = number(rig, path)
            if draw.common:
                rough = known_to_a_factor(path, 1.0, draw.std) and known.quantity.bound == "positive"
                values[path] = known.value * _drawn(1.0, draw.std, score[draw.name], True, rough)
            else:
                bounded = known.quantity.bound != "any"
                rough = known.quantity.bound == "positive" and known_to_a_factor(path, known.value, draw.std)
                values[path] = _drawn(values.get(path, known.value), draw.std, score[draw.name], bounded, rough)
    return values


def _drawn(value: float, std: float, score: float, bounded: bool, rough: bool) -> float:
    from scipy.special import ndtr, ndtri

    if rough:
        return float(value * np.exp(np.log1p(std / value) * score))
    if bounded and value < 8.0 * std:
        below = ndtr(-value / std)
        score = float(ndtri(below + (1.0 - below) * ndtr(score)))
    return value + std * score
