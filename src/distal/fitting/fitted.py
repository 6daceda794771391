"""One number after a fit, and what of it goes into the description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from distal.rig import Number, Rig, number

DIGITS = 7
"""Significant digits of a value in a file: far more than any log tells."""

SMALLEST_STD = 0.002
"""A std in a fitted file is at least this share of its value: no two days are more alike."""


@dataclass(frozen=True)
class Fitted:
    """One free number after a fit.

    Args:
        name: as asked for.
        paths: in the description.
        si: unit.
        start: where it started, which is the mean of its prior.
        prior_std: of the prior; NaN where there was none.
        value: found.
        error: standard error of it.
        identified: whether the logs identify it; else it stays at its prior.
        noise: whether it is a noise.
        values: of all `paths`.
        per_log: value by log, where each log has its own.
        kept: whether the file keeps the start where the fit found less.
    """

    name: str
    paths: tuple[str, ...]
    si: str
    start: float
    prior_std: float
    value: float
    error: float
    identified: bool
    noise: bool
    values: tuple[float, ...]
    per_log: Mapping[str, float] = field(default_factory=dict)
    kept: bool = False

    @property
    def told(self) -> bool:
        """Answer the name that `identified` had in release 0.1."""
        raise AttributeError("Fitted.told is called Fitted.identified now: whether the logs identify the number")

    @property
    def origin(self) -> str:
        """Where the value comes from, in a word or two."""
        if not self.identified:
            return "prior (these logs cannot tell)"
        if self.kept and self.value < self.start:
            return "fitted; the file keeps the start"
        return "mean over the logs" if self.per_log else "fitted"


def assignments(fitted: Sequence[Fitted], start: Rig, left: float = 1.0) -> dict[str, Any]:
    """Return path → value, with its std where it had one, of what the logs identify.

    Args:
        fitted: every free number.
        start: the description as it came.
        left: share of each prior's std that a std keeps at least where the fit is in doubt; 0: estimators are to take the
            values as they are (`hold`).
    """
    changed: dict[str, Any] = {}
    for part in fitted:
        if not part.identified:
            continue
        for path, value in zip(part.paths, part.values):
            before = number(start, path)
            rounded = float(f"{value:.{DIGITS}g}")
            if only_grows(path, start):
                # what these logs did not need, the next may: a filter that trusts its model wholly is not honest
                rounded = max(rounded, before.value)
            if not before.is_parameter or before.std == 0.0:
                changed[path] = rounded
                continue
            share = abs(value / part.value) if part.value else 1.0
            error = part.error if left == 1.0 else min(part.error, left * part.prior_std)
            std = max(error * share, SMALLEST_STD * abs(value))
            changed[path] = {"value": rounded, **_spread(part, before, std, value, start)}
            if left == 0.0:
                changed[path]["hold"] = True
    return changed


def _spread(part: Fitted, before: Number, std: float, value: float, start: Rig) -> dict[str, Any]:
    """Return what a file says of how far a value may be off: together with others where all of them were varied as one."""
    name = before.shared[0] if before.shared is not None else None
    if name is not None and before.own == 0.0 and set(start.sharing()[name]) <= set(part.paths):
        return {"shared": {"name": name, "std": min(1.0, float(f"{std / abs(value):.3g}"))}}
    return {"std": float(f"{std:.3g}")}


def only_grows(path: str, rig: Rig) -> bool:
    """Return whether a noise is never written smaller than it was: what the model does not know, and displacements'.

    Args:
        path: of the number.
        rig: the description.
    """
    places = [f"sensors.{i}.noise" for i, sensor in enumerate(rig.sensors) if sensor.measures == "position"]
    return path.endswith(".unmodelled") or path in places
