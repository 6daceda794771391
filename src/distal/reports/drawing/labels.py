"""Labels of a drawing: values with convenient units, such as mm, N/mm and degrees."""

from __future__ import annotations

import math

LARGE = {"N/m": (1e3, 1e-3, "N/mm"), "kg": (1.0, 1.0, "kg"), "m": (1.0, 1.0, "m")}
"""SI unit → least value, factor and name of the unit that `label_of` uses for large values."""

SMALL = {
    "m": (1.0, 1e3, "mm"),
    "kg": (1.0, 1e3, "g"),
    "N m/rad": (0.01, 1e3, "mN m/rad"),
    "N m": (0.1, 1e3, "mN m"),
}
"""SI unit → limit, factor and name of the unit that `label_of` uses for values below the limit."""


def label_of(value: float, si: str) -> str:
    """Return a value with its unit to three digits, such as "23 N/mm", "8 mm" or "−20°".

    Args:
        value: value in the SI unit `si`.
    """
    if si == "rad":
        return f"{rounded_label(math.degrees(value))}°"
    if si in LARGE and abs(value) >= LARGE[si][0]:
        _, factor, unit = LARGE[si]
    elif si in SMALL and abs(value) < SMALL[si][0]:
        _, factor, unit = SMALL[si]
    else:
        factor = 1.0
        unit = si
    return f"{rounded_label(factor * value)} {unit.replace('N m', 'N·m')}".rstrip()


def rounded_label(value: float) -> str:
    """Return a value to three digits, with a true minus sign."""
    digits = max(0, 2 - math.floor(math.log10(abs(value)))) if value and abs(value) < 1e3 else 0
    if abs(value) >= 1e5 or digits > 7:
        text = f"{value:.2e}"
    else:
        text = f"{value:.{digits}f}"
        text = text.rstrip("0").rstrip(".") if "." in text else text
    return text.replace("-", "−")
