"""One parameter after a fit, and what is written of it into the description."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from distal.rig import Number, Rig, named, number, part_at
from distal.rig.quantities import SMALLEST

DIGITS = 7
"""Number of significant digits of a value in a file: far more than any log tells. Source:
judgement.
"""

COMMON = {
    "rad": ("deg", float(np.rad2deg(1.0))),
    "rad/s": ("deg/s", float(np.rad2deg(1.0))),
    "m": ("mm", 1e3),
    "N/m": ("N/mm", 1e-3),
    "N m": ("mN m", 1e3),
    "N m s": ("mN m s", 1e3),
}
"""SI unit → the unit in which people give sizes of fingers and instruments, and the factor to it.
Source: definition (unit conversions).
"""

SMALLEST_RELATIVE_STD = 0.002
"""Least std in a fitted file, as a share of the value, since a rig differs that much from day to
day. Source: judgement.
"""


@dataclass(frozen=True)
class FittedParameter:
    """One free parameter after a fit, with its value in the description.

    Args:
        name: name in words.
        paths: paths of all values in the description that vary together with it.
        si: SI unit.
        start: value where it started, which is the mean of its prior.
        prior_std: std of its prior, NaN where there was none.
        value: fitted value of the first path, or the mean over the logs.
        error: standard error, the other parameters not being known; NaN where the search did not
            converge.
        identified: whether the logs identify it; else it stays at its prior.
        noise: whether it is the size of a noise.
        values: the values at all `paths`.
        held_error: standard error if the parameters that are `held` are taken as known; the std in
            the file comes from it.
        held: whether the logs identify it only together with others: the file then holds it, and
            the others' stds carry what is unknown.
        per_log: name of a log → value, where each log has its own.
        kept: whether the file keeps the start where the fitted value is smaller.
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
        """The same parameter with its original value."""
        starts = tuple(
            self.start * value / self.value if self.value else self.start for value in self.values
        )
        return replace(self, value=self.start, values=starts, identified=False, held=False)

    @property
    def sizes(self) -> tuple[str, str, str]:
        """The original value, the fitted value with its standard error, and their unit, as text in
        a common unit.
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
        """The origin of the value, in a word or two."""
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
    """Return path by names → value, with its std where it had one, of all that the logs identify.

    Args:
        parameters: the parameters after the fit.
        start: the original rig.
        hold: whether estimators are to take the values as exactly known.
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
                # these logs did not need so much noise, others may: without it the filter's band
                # would be too narrow
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
    """Return the std of a value as a file holds it: shared with others where all of them were
    varied by one factor.
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
    """Return whether a noise is never written smaller than it was: an unmodelled torque, or the
    noise of a position sensor.
    """
    positions = [
        f"sensors.{i}.noise"
        for i, sensor in enumerate(rig.sensors)
        if sensor.measures == "position"
    ]
    return path.endswith(".unmodelled") or path in positions


def described(rig: Rig, values: Mapping[str, object]) -> Rig:
    """Return a rig with fitted values by their paths, those of reference sensors that only the fit
    has left out.
    """
    fitted = {
        path: new
        for path, new in values.items()
        if part_at(rig, ".".join(path.split(".")[:2])) is not None
    }
    return rig.with_values(fitted) if fitted else rig
