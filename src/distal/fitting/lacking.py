"""Physics that a rig may lack: parts that are tried where its equations lack more than its sensors' noise."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from distal.errors import DistalError
from distal.fitting.numbers import Numbers, by_equations, problem_of
from distal.fitting.options import Options
from distal.logs import Log
from distal.rig import Pulley, Rig

UNEXPLAINED = 16.0
"""Parts are tried where some row of the equations has a mean ν²/S above this."""

NAMED = 0.85
"""A part is named where with it the rows' residuals are below this share, in the geometric mean of all rows."""

MOST_PARTS = 2
"""So many parts are added at most."""

NODES = 2
"""Points of friction along a cable (docs/results/fits.md)."""

PLAY = {"slider": 2e-4, "capstan": 0.02}
"""Play of a drive that is tried first [m, rad]; its std is as large."""


@dataclass(frozen=True)
class Part:
    """A part that a description may lack, added wherever it can be.

    Args:
        name: in words.
        values: path → what is put into the description.
    """

    name: str
    values: Mapping[str, object]

    def and_(self, other: Part) -> Part:
        """Return both as one part.

        Args:
            other: that is added after it.
        """
        return Part(f"{self.name} and {other.name}", {**self.values, **other.values})


def parts_of(rig: Rig) -> Iterator[Part]:
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
    yield Part("friction along the cable", sheaths)
    yield Part("creep of the tendons", {f"tendons.{t.name}.creep": creep for t in rig.tendons if t.creep is None})
    yield Part("play between drives and tendons", plays)
    yield Part("moment arms that change with the angle", arms)


def named_parts(logs: Sequence[Log], rig: Rig, options: Options, numbers: Numbers) -> list[tuple[Part, Numbers]]:
    """Return the part with which a rig's equations lack least along some logs, and it together with a second one.

    Args:
        rig: the description as it came.
    """
    found = list[tuple[Part, Numbers]]()
    while numbers.by_equations and len(found) < MOST_PARTS and not options.free:
        named = _named(logs, rig, options, numbers)
        if named is None:
            break
        part, numbers = named
        rig = rig.with_values(part.values)
        found.append((part if not found else found[-1][0].and_(part), numbers))
    return found


def _named(logs: Sequence[Log], rig: Rig, options: Options, numbers: Numbers) -> tuple[Part, Numbers] | None:
    if max(numbers.nis[1], default=0.0) < UNEXPLAINED:
        return None
    best, least = None, NAMED * _residual(numbers)
    for part in parts_of(rig):
        found = numbers_with(part, logs, rig, options, numbers)
        if found is not None and _residual(found) < least:
            best, least = (part, found), _residual(found)
    return best


def numbers_with(part: Part, logs: Sequence[Log], rig: Rig, options: Options, begin: Numbers) -> Numbers | None:
    """Return the numbers of a rig's equations with a part more, None where the rig cannot have it.

    Args:
        rig: the description as it came.
        begin: numbers without the part, where the search begins.
    """
    if not part.values:
        return None
    try:
        found = by_equations(problem_of(logs, rig.with_values(part.values), options), options, None, begin)
    except DistalError:
        return None
    if found is not None and found.found.interrupted:
        raise KeyboardInterrupt  # a search ends with the best so far; the caller has numbers without the part
    return found


def _residual(numbers: Numbers) -> float:
    """Return the geometric mean over all rows of √(mean ν²/S), a row within its sensors' noise as if it were as large."""
    ratios = np.maximum([ratio for ratio in numbers.nis[1] if np.isfinite(ratio)], 1.0)
    return float(np.exp(np.mean(0.5 * np.log(ratios))))
