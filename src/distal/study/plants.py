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
        std: of a number in SI, of what is common as a share.
        common: whether it is what several err by together.
    """

    name: str
    std: float
    paths: tuple[str, ...]
    common: bool = False


def draws_of(rig: Rig) -> tuple[Draw, ...]:
    """Return what is drawn of a rig: every number with a std, and what several err by together."""
    draws = list[Draw]()
    common = dict[str, tuple[float, list[str]]]()
    for kind in KINDS:
        for i, part in enumerate(getattr(rig, kind)):
            for path, parameter in parameters_below(part, f"{kind}.{i}"):
                if path.endswith(".nominal_force"):  # what filters take where they measure none
                    continue
                if parameter.std > 0.0:
                    draws.append(Draw(named(rig, path), parameter.std, (path,)))
                if parameter.shared is not None and parameter.shared.std > 0.0:
                    common.setdefault(parameter.shared.name, (parameter.shared.std, []))[1].append(
                        path
                    )
    return (*draws, *(Draw(name, std, tuple(paths), True) for name, (std, paths) in common.items()))


def scores(draws: Sequence[Draw], seed: Sequence[int]) -> dict[str, float]:
    """Return how many standard deviations each draw is off; a draw's number depends on its name and
    the seed alone.
    """
    keys = ([*seed, crc32(draw.name.encode())] for draw in draws)
    return {draw.name: float(np.random.default_rng(key).normal()) for draw, key in zip(draws, keys)}


def built_values(rig: Rig, draws: Sequence[Draw], score: Mapping[str, float]) -> dict[str, float]:
    """Return path → value of a rig as built, where `score` says how many standard deviations each
    draw is off.

    p = value (1 + σ z) + σ_own ε; what cannot be negative is drawn from the normal distribution cut
    at zero, and what is known to a factor only from the log-normal one, as filters take them.
    """
    values: dict[str, float] = {}
    for draw in sorted(draws, key=lambda draw: not draw.common):
        for path in draw.paths:
            nominal = number(rig, path).value
            bound = number(rig, path).quantity.bound
            rough = bound == "positive" and known_to_a_factor(
                path, 1.0 if draw.common else nominal, draw.std
            )
            if draw.common:
                values[path] = nominal * _drawn(1.0, draw.std, score[draw.name], True, rough)
            else:
                mean = values.get(path, nominal)
                values[path] = _drawn(mean, draw.std, score[draw.name], bound != "any", rough)
    return values


def _drawn(mean: float, std: float, score: float, bounded: bool, rough: bool) -> float:
    from scipy.special import ndtr, ndtri

    if rough:
        return float(mean * np.exp(np.log1p(std / mean) * score))
    if bounded and mean < 8.0 * std:
        below = ndtr(-mean / std)
        score = float(ndtri(below + (1.0 - below) * ndtr(score)))
    return mean + std * score
