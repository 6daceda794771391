"""Terms of the physics that a rig may lack, which are tried where the residuals of its equations
are much larger than its sensors' noise.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distal.errors import DistalError
from distal.fitting.fit_options import Options
from distal.fitting.parameter_estimates import ParameterEstimates, by_equations, problem_of
from distal.logs import Log
from distal.rig import Pulley, Rig

UNEXPLAINED = 16.0
"""Mean ν²/S of some row of the equations, from which on terms are tried. Source: judgement."""

NAMED = 0.85
"""Ratio of the residuals with a term to those without, in the geometric mean of all rows, or of the
errors of two filters, below which the term is named, or the other filter taken. Source: judgement.
"""

MOST_NAMED = 2
"""Largest number of terms of which each alone makes a candidate. Source: judgement."""

NODES = 2
"""Number of points of friction along a cable. Source: benchmark (benchmarks/sheaths)."""

PLAY = {"slider": 2e-4, "capstan": 0.02}
"""Kind of a drive → width of the backlash that is tried first [m, rad]; its std is as large.
Source: judgement.
"""


@dataclass(frozen=True)
class MissingTerm:
    """A term that a description may lack: its name, and path → value of what is put into the
    description wherever the term can be added.
    """

    name: str
    values: Mapping[str, object]


def terms_of(rig: Rig) -> Iterator[MissingTerm]:
    """Yield the terms that may be added to a rig: friction along cables, creep, backlash of drives,
    changing moment arms.
    """
    sheaths: dict[str, object] = {}
    for tendon in rig.tendons:
        if tendon.path is None:
            way = {"friction": {"value": 0.1, "std": 0.1}, "wrap": np.pi / 2, "nodes": NODES}
            sheaths[f"tendons.{tendon.name}.path"] = way
        elif tendon.path.nodes == 0:
            sheaths[f"tendons.{tendon.name}.path.nodes"] = NODES
    creep = {"share": {"value": 0.1, "std": 0.1}, "time": {"value": 10.0, "std": 10.0}}
    plays = {
        f"drives.{drive.name}.backlash.width": {"value": PLAY[drive.kind], "std": PLAY[drive.kind]}
        for drive in rig.drives
        if drive.backlash is None
    }
    unknown = {"value": 0.0, "std": 0.2}
    arms = {
        f"tendons.{tendon.name}.{meeting.path}": {
            **meeting.shape.model_dump(exclude_none=True),
            "kind": "linkage",
            "slope": unknown,
            # with several joints a log shows too little of each of the tendon's moment arms
            **({"curvature": unknown} if len(tendon.meetings) == 1 else {}),
        }
        for tendon in rig.tendons
        for meeting in tendon.meetings
        if isinstance(meeting.shape, Pulley)
    }
    yield MissingTerm("friction along the cable", sheaths)
    yield MissingTerm(
        "creep of the tendons",
        {f"tendons.{t.name}.creep": creep for t in rig.tendons if t.creep is None},
    )
    yield MissingTerm("play between drives and tendons", plays)
    yield MissingTerm("moment arms that change with the angle", arms)


@dataclass(frozen=True)
class Tried:
    """The terms that were tried.

    Args:
        named: terms that lower the residuals of the equations clearly, the best first, then the
            best one together with another, each with the parameter estimates of the rig with it.
        parameters: the parameter estimates of all rigs that were tried.
    """

    named: tuple[tuple[MissingTerm, ParameterEstimates], ...] = ()
    parameters: tuple[ParameterEstimates, ...] = ()


def tried_parts(
    logs: Sequence[Log], rig: Rig, options: Options, parameters: ParameterEstimates
) -> Tried:
    """Return the terms that a rig may lack, tried where the residuals of its equations are much
    larger than its sensors' noise.

    Nothing is tried where the parameters are not estimated by equations, or the user chose which
    are free.
    """
    if not parameters.by_equations or options.free:
        return Tried()
    alone = _tried(logs, rig, options, parameters)
    if not alone.named:
        return alone
    first, first_parameters = alone.named[0]
    pairs = _tried(logs, rig.with_values(first.values), options, first_parameters)
    together = tuple(
        (
            MissingTerm(f"{first.name} and {second.name}", {**first.values, **second.values}),
            pair_parameters,
        )
        for second, pair_parameters in pairs.named[:1]
    )
    return Tried((*alone.named[:MOST_NAMED], *together), (*alone.parameters, *pairs.parameters))


def _tried(
    logs: Sequence[Log], rig: Rig, options: Options, parameters: ParameterEstimates
) -> Tried:
    """Return what comes of one term more; named are the terms that leave clearly smaller residuals,
    the smallest first.
    """
    if max(parameters.nis[1], default=0.0) < UNEXPLAINED:
        return Tried()
    fits = with_parts(terms_of(rig), logs, rig, options, parameters)
    limit = NAMED * _residual(parameters)
    named = sorted(
        (fit for fit in fits if _residual(fit[1]) < limit), key=lambda fit: _residual(fit[1])
    )
    return Tried(tuple(named), tuple(part_parameters for _, part_parameters in fits))


def with_parts(
    parts: Iterable[MissingTerm],
    logs: Sequence[Log],
    rig: Rig,
    options: Options,
    begin: ParameterEstimates,
) -> tuple[tuple[MissingTerm, ParameterEstimates], ...]:
    """Return those of the terms that the rig can have, each with the parameter estimates of the rig
    with it.

    The searches begin at the estimates `begin`, without the term.
    """
    fits = [(part, parameters_with(part, logs, rig, options, begin)) for part in parts]
    return tuple((part, parameters) for part, parameters in fits if parameters is not None)


def parameters_with(
    part: MissingTerm, logs: Sequence[Log], rig: Rig, options: Options, begin: ParameterEstimates
) -> ParameterEstimates | None:
    """Return the parameter estimates of a rig's equations with a term more; None where the rig
    cannot have this term.

    The search begins at the estimates `begin`, without the term.
    """
    if not part.values:
        return None
    try:
        parameters = by_equations(
            problem_of(logs, rig.with_values(part.values), options), options, None, begin
        )
    except DistalError:
        return None
    if parameters is not None and parameters.optimum.interrupted:
        # the caller has the estimates without the term
        raise KeyboardInterrupt
    return parameters


def _residual(parameters: ParameterEstimates) -> float:
    """Return the geometric mean over all rows of √(mean ν²/S), where a mean below 1 counts as 1."""
    ratios = np.maximum([ratio for ratio in parameters.nis[1] if np.isfinite(ratio)], 1.0)
    return float(np.exp(np.mean(0.5 * np.log(ratios))))
