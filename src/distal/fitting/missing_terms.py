"""Physics that a rig may lack: parts that are tried where its equations lack more than its sensors'
noise.
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
"""Parts are tried where some row of the equations has a mean ν²/S above this."""

NAMED = 0.85
"""A part is named where with it the rows' residuals are below this share, in the geometric mean of
all rows.
"""

MOST_NAMED = 2
"""So many parts are candidates each alone, at most."""

NODES = 2
"""Points of friction along a cable (docs/results/fits.md)."""

PLAY = {"slider": 2e-4, "capstan": 0.02}
"""Play of a drive that is tried first [m, rad]; its std is as large."""


@dataclass(frozen=True)
class MissingTerm:
    """A part that a description may lack, added wherever it can be: path → what is put into the
    description.
    """

    name: str
    values: Mapping[str, object]


def terms_of(rig: Rig) -> Iterator[MissingTerm]:
    """Yield the parts that may be added to a rig, one kind at a time."""
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
            # a tendon's arms at several joints move it together: no log tells so much of each
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
    """What came of the parts that were tried, with the numbers of the rig with each.

    Named are those with which the equations lack least, and the first together with another.
    """

    named: tuple[tuple[MissingTerm, ParameterEstimates], ...] = ()
    parameters: tuple[ParameterEstimates, ...] = ()


def tried_parts(
    logs: Sequence[Log], rig: Rig, options: Options, parameters: ParameterEstimates
) -> Tried:
    """Return what comes of the parts that a rig may lack, where its equations lack more than its
    sensors' noise.
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
    """Return what comes of one part more; named are those that leave clearly less, the least
    first.
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
    """Return the parts that the rig can have, with its numbers with each."""
    fits = [(part, parameters_with(part, logs, rig, options, begin)) for part in parts]
    return tuple((part, parameters) for part, parameters in fits if parameters is not None)


def parameters_with(
    part: MissingTerm, logs: Sequence[Log], rig: Rig, options: Options, begin: ParameterEstimates
) -> ParameterEstimates | None:
    """Return the numbers of a rig's equations with a part more, None where the rig, as it came,
    cannot have it.

    The search begins with numbers without the part.
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
        # a search ends with the best so far; the caller has numbers without the part
        raise KeyboardInterrupt
    return parameters


def _residual(parameters: ParameterEstimates) -> float:
    """Return the geometric mean over all rows of √(mean ν²/S), a row within its sensors' noise as
    if it were as large.
    """
    ratios = np.maximum([ratio for ratio in parameters.nis[1] if np.isfinite(ratio)], 1.0)
    return float(np.exp(np.mean(0.5 * np.log(ratios))))
