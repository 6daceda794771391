"""Errors of a sensor that are written in the unit in which its log counts, counts of an encoder or
amperes of a motor, and their size in SI.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping

from distal.errors import UnitError
from distal.units import to_si

COUNTS = frozenset({"count", "counts", "tick", "ticks"})
"""Names of the unit of an encoder that counts."""

ERRORS = ("noise", "linearity", "resolution", "bias")
"""Keys of the errors of a sensor, which may be written in the unit of the log."""


def errors_in_si(
    raw: Mapping[str, object], counting: Callable[[Mapping[str, object]], tuple[str, float] | None]
) -> object:
    """Return a raw sensor with its errors in SI, where they are text in the unit in which its log
    counts.

    Args:
        counting: returns this unit and its size in SI, or None where the log does not count.
    """
    try:
        scale = counting(raw)
        gear = to_si(raw.get("gear", 1.0), "") if scale is not None and scale[0] == "count" else 1.0
    except (UnitError, ZeroDivisionError):
        # the wrong field is refused later; until then the unit of the errors is not known
        return {key: value for key, value in raw.items() if key not in ERRORS}
    if scale is None:
        return raw
    unit, unit_size = scale
    if unit == "count" and raw.get("unit") in COUNTS and "resolution" not in raw:
        raw = {**raw, "resolution": unit_size * gear}  # one count is the smallest step

    def converted(error: object, size: float) -> object:
        if isinstance(error, Mapping):
            spreads = ("value", "std", "drift")
            return {
                key: converted(part, size) if key in spreads else part
                for key, part in error.items()
            }
        return _of_text(error, unit, size) if isinstance(error, str) else error

    sizes = {key: unit_size * (gear if key == "resolution" else 1.0) for key in ERRORS}
    return {**raw, **{key: converted(raw[key], size) for key, size in sizes.items() if key in raw}}


def _of_text(text: str, unit: str, size: float) -> object:
    """Return the size in SI of a text such as ``2 count`` or ``20 mA``; a text in another unit is
    returned as it is.
    """
    number, _, suffix = text.strip().rpartition(" ")
    try:
        if unit == "count":
            return to_si(number.strip(), "") * size if suffix in COUNTS else text
        return to_si(text, unit) * size
    except UnitError:
        return text
