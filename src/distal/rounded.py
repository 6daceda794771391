"""Numbers as text for people: a given number of significant digits, and no exponent for large
numbers.
"""


def rounded(value: float, digits: int = 2) -> str:
    """Return a `value` of any unit as text with so many significant `digits`; a number with more
    digits before the point keeps all of these.
    """
    if abs(value) >= 10.0**digits - 0.5:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"
