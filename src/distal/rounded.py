"""Numbers as text for people: a given number of significant digits, no exponent for large numbers,
and units of convenient size.
"""

from math import degrees

SMALLER = {"m": (1e3, " mm"), "kg": (1e3, " g"), "rad": (degrees(1.0), "°"), "": (1.0, "")}
"""SI unit → factor and name of the unit in which its values are written; others have a prefix by
their size.
"""


def rounded(value: float, digits: int = 2) -> str:
    """Return a `value` of any unit as text with so many significant `digits`; a number with more
    digits before the point keeps all of these.
    """
    if abs(value) >= 10.0**digits - 0.5:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"


def plain_number(value: float) -> str:
    """Return a `value` of any unit to three digits, with a minus that is as long as a plus."""
    return rounded(value, 3).replace("-", "−")


def quantity(value: float, si: str) -> str:
    """Return a value with a unit of convenient size to three digits, such as "8 mm" or "−20°".

    Args:
        value: value in the SI unit `si`.
    """
    from matplotlib.ticker import EngFormatter

    if si in SMALLER:
        factor, unit = SMALLER[si]
        return f"{plain_number(factor * value)}{unit}"
    text: str = EngFormatter(si.replace("N m", "N·m"))(float(f"{value:.3g}"))
    return text
