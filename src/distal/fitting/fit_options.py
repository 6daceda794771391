"""The options of a fit as one frozen object: all its inputs beside the logs and the rig."""

from __future__ import annotations

from dataclasses import dataclass

from distal.rig import Rig


@dataclass(frozen=True, kw_only=True)
class Options:
    """The options of a fit, the arguments of the same names of `fit`; `start` is a rig."""

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
    guessed: bool = False
