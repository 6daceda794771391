"""What is asked of a fit, as one frozen object: all that `learn` goes by beside logs and rig."""

from __future__ import annotations

from dataclasses import dataclass

from distal.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Options:
    """What is asked of a fit.

    Args:
        free: paths of what is varied, ``*`` for all parts of a kind; none for every parameter with a std.
        per_log: paths of which each log has its own (pre-tension, zero offsets).
        homing: for how long the reference is used [s]; None for wherever it is.
        noise: whether noise is varied too.
        curves: whether the position sensors' systematic curves are learned from logs with truth.
        units: regular expression whose first parenthesis names a log's unit; units are left out as a whole.
        seed: of the starts.
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
