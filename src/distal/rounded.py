"""Numbers as people read them: so many significant digits, and no exponent for what is large."""


def rounded(value: float, digits: int = 2) -> str:
    """Return a `value` of any unit with so many significant digits; a larger whole number keeps all
    of its digits.
    """
    if abs(value) >= 10.0**digits - 0.5:
        return f"{value:.0f}"
    return f"{value:.{digits}g}"
