"""Rigs as built: plants whose parameters are drawn from the stds of a rig's description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from zlib import crc32

import numpy as np

from distal.rig import Rig, known_to_a_factor, named, number, parameters_below


@dataclass(frozen=True)
class Draw:
    """One random number of a rig as built: the error of a parameter, or an error that several
    parameters share.

    Args:
        name: path of the parameter with names of parts, or name of the shared error.
        std: of a parameter in SI, of a shared error as a share of the values.
        paths: of the parameters that it changes.
        common: whether it is a shared error.
    """

    name: str
    std: float
    paths: tuple[str, ...]
    common: bool = False


def draws_of(rig: Rig) -> tuple[Draw, ...]:
    """Return what is drawn for a rig as built: the error of each parameter with a std, and each
    shared error. Nominal forces are not drawn.
    """
    draws = list[Draw]()
    common = dict[str, tuple[float, list[str]]]()
    for kind, components in rig.components.items():
        for i, part in enumerate(components):
            for path, parameter in parameters_below(part, f"{kind}.{i}"):
                if path.endswith(".nominal_force"):  # filters take it where no force is read
                    continue
                if parameter.std > 0.0:
                    draws.append(Draw(named(rig, path), parameter.std, (path,)))
                if parameter.shared is not None and parameter.shared.std > 0.0:
                    common.setdefault(parameter.shared.name, (parameter.shared.std, []))[1].append(
                        path
                    )
    return (*draws, *(Draw(name, std, tuple(paths), True) for name, (std, paths) in common.items()))


def scores(draws: Sequence[Draw], seed: Sequence[int]) -> dict[str, float]:
    """Return by how many standard deviations each draw is off: name → standard normal number. The
    number depends on the draw's name and the seed alone.
    """
    keys = ([*seed, crc32(draw.name.encode())] for draw in draws)
    return {draw.name: float(np.random.default_rng(key).normal()) for draw, key in zip(draws, keys)}


def built_values(rig: Rig, draws: Sequence[Draw], score: Mapping[str, float]) -> dict[str, float]:
    """Return path → value [SI] of a rig as built.

    p = value (1 + σ z) + σ_own ε. A parameter that cannot be negative is drawn from the normal
    distribution cut at zero; one that is known to a factor only (`known_to_a_factor`) is drawn from
    the log-normal distribution, as filters assume.

    Args:
        score: name of a draw → its standard normal number, z or ε.
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
