"""One number after a fit, and what of it goes into the description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from distal.rig import Number, Rig, named, number, part_at
from distal.rig.quantities import SMALLEST

DIGITS = 7
"""Significant digits of a value in a file: far more than any log tells."""

COMMON = {
    "rad": ("deg", float(np.rad2deg(1.0))),
    "rad/s": ("deg/s", float(np.rad2deg(1.0))),
    "m": ("mm", 1e3),
    "N/m": ("N/mm", 1e-3),
    "N m": ("mN m", 1e3),
    "N m s": ("mN m s", 1e3),
}
"""Unit → the one that people use for sizes of fingers and instruments, and how many of it there
are.
"""

SMALLEST_RELATIVE_STD = 0.002
"""A std in a fitted file is at least this share of its value: no two days are more alike."""


@dataclass(frozen=True)
class FittedParameter:
    """One free number after a fit, as it is in the description, with the `values` of all its
    `paths`.

    Args:
        name: in words.
        si: unit.
        start: where it started, which is the mean of its prior.
        prior_std: NaN where there was no prior.
        error: standard error, the other numbers not being known; NaN where the search did not
            converge.
        identified: whether the logs tell it; else it stays at its prior.
        noise: whether it is a noise.
        held_error: standard error with the numbers that are `held` taken as known; what a file's
            std is made of.
        held: whether the logs tell it only together with others: the file holds it, and the others
            carry what is not known.
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
    held_error: float = float("nan")
    held: bool = False
    per_log: Mapping[str, float] = field(default_factory=dict)
    kept: bool = False

    @property
    def as_it_came(self) -> FittedParameter:
        """The same where the description's own value is kept."""
        starts = tuple(
            self.start * value / self.value if self.value else self.start for value in self.values
        )
        return replace(self, value=self.start, values=starts, identified=False, held=False)

    @property
    def sizes(self) -> tuple[str, str, str]:
        """What it was, what it is with its standard error, and its unit, in a unit that people
        use.
        """
        unit, factor = COMMON.get(self.si, (self.si, 1.0))
        prior = "" if np.isnan(self.prior_std) else f" ± {factor * self.prior_std:.2g}"
        before = f"{factor * self.start:.4g}{prior}"
        if not self.identified:
            return before, "as it was", unit
        error = f" ± {factor * self.error:.2g}" if np.isfinite(self.error) else ""
        return before, f"{factor * self.value:.4g}{error}", unit

    @property
    def origin(self) -> str:
        """Where the value comes from, in a word or two."""
        if self.held:
            return "prior (told only together with others)"
        if not self.identified:
            return "prior (these logs cannot tell)"
        if self.kept and self.value < self.start:
            return "fitted; the file keeps the start"
        return "mean over the logs" if self.per_log else "fitted"


def assignments(
    parameters: Sequence[FittedParameter], start: Rig, hold: bool = False
) -> dict[str, object]:
    """Return path by names → value, with its std where it had one, of what the logs tell beside the
    `start` as it came.

    With `hold` estimators are to take the values as they are.
    """
    changed: dict[str, object] = {}
    for part in parameters:
        if part.held:
            changed |= {
                f"{path}.hold": True for path in part.paths if number(start, path).is_parameter
            }
        if not part.identified:
            continue
        for path, value in zip(part.paths, part.values):
            before = number(start, path)
            rounded = 0.0 if abs(value) < SMALLEST else float(f"{value:.{DIGITS}g}")
            if only_grows(path, start):
                # what these logs did not need, the next may: a filter that trusts its model wholly
                # is not honest
                rounded = max(rounded, before.value)
            if not before.is_parameter or before.std == 0.0:
                changed[path] = rounded
                continue
            share = abs(value / part.value) if part.value else 1.0
            error = part.held_error if np.isfinite(part.held_error) else part.prior_std
            std = max(min(error, part.prior_std) * share, SMALLEST_RELATIVE_STD * abs(value))
            held = {"hold": True} if hold else {}
            changed[path] = {"value": rounded, **_spread(part, before, std, value, start), **held}
    return {named(start, path): value for path, value in changed.items()}


def _spread(
    part: FittedParameter, before: Number, std: float, value: float, start: Rig
) -> dict[str, object]:
    """Return what a file says of how far a value may be off: together with others where all of them
    were varied as one.
    """
    name = before.shared[0] if before.shared is not None else None
    if (
        name is not None
        and before.independent_std == 0.0
        and set(start.sharing()[name]) <= set(part.paths)
    ):
        return {"shared": {"name": name, "std": min(1.0, float(f"{std / abs(value):.3g}"))}}
    return {"std": float(f"{std:.3g}")}


def only_grows(path: str, rig: Rig) -> bool:
    """Return whether a noise is never written smaller than it was: what the model does not know,
    and displacements'.
    """
    positions = [
        f"sensors.{i}.noise"
        for i, sensor in enumerate(rig.sensors)
        if sensor.measures == "position"
    ]
    return path.endswith(".unmodelled") or path in positions


def described(rig: Rig, values: Mapping[str, object]) -> Rig:
    """Return a rig, as it came, with its fitted numbers; a reference sensor that only the fit used
    is left out.
    """
    fitted = {
        path: new
        for path, new in values.items()
        if part_at(rig, ".".join(path.split(".")[:2])) is not None
    }
    return rig.with_values(fitted) if fitted else rig
