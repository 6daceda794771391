"""The options of a fit, as one frozen object: all inputs of `learn` beside logs and rig."""

from __future__ import annotations

from dataclasses import dataclass

from distal.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a fit.

    Args:
        free: paths of the parameters to fit, ``*`` for all parts of a kind; empty: every parameter with a std.
        per_log: paths of parameters with one value for each log (pre-tension, zero offsets).
        homing: for how long the reference is used [s]; None: wherever it has values.
        noise: whether noise is fitted too.
        curves: whether the position sensors' systematic curves are learned from logs with truth.
        units: regular expression whose first parenthesis names a log's unit; units are left out as a whole.
        seed: of random starts.
        start: a rig whose values the search begins with; the priors are those of the rig that is fitted.
        workers: threads; the numbers do not depend on them.
        compiled: compile kernels where possible.
    """

    free: tuple[str, ...] = ()
    per_log: tuple[str, ...] = ()
    homing: float | None = None
    noise: bool = True
    curves: bool = False
    units: str | None = None
    seed: int = 0
    start: Rig | None = None
    workers: int = 2
    compiled: bool = True
