"""Numbers and text: text with a unit, such as ``"4.239e-4 kg m^2"``, becomes a float in SI where
data enter, and everything else is in SI; numbers become text for people, with a given number of
significant digits and units of convenient size.
"""

from __future__ import annotations

import math
import re
from functools import lru_cache
from math import degrees
from numbers import Real
from typing import TYPE_CHECKING

from distal.errors import UnitError

if TYPE_CHECKING:
    import pint


_NUMBER = r"[-+]?(?:\d+(?:\.\d*)?|\.\d+)(?:[eE][-+]?\d+)?"
_QUANTITY = re.compile(rf"^\s*({_NUMBER})\s*(.*?)\s*$")
_RATIO = re.compile(rf"^\s*({_NUMBER})\s*:\s*({_NUMBER})\s*$")
_PER = re.compile(r"1\s*/\s*(?=[A-Za-zµμΩ°(])")
_POWER = re.compile(r"(?:\^|\*\*)\s*\(?[-+]?\d{1,2}\)?|[⁻⁺]?[⁰¹²³⁴⁵⁶⁷⁸⁹]")
_POWER_TOWER = re.compile(r"(?:\^|\*\*)[^A-Za-z]*(?:\^|\*\*)")
_UNIT_CHARACTERS = re.compile(r"[A-Za-zµμΩ°%·⋅*/() _]+")
_DECIMAL_COMMA = re.compile(r"\d,\d")
_ANGLE_WORDS = re.compile(
    r"(?<![a-zA-Z])"
    r"(rad|radian|radians|mrad|urad|deg|degree|degrees|°|turn|turns|rev|revolution)"
    r"(?![a-zA-Z])"
)


USUAL = {
    "m": {"cm": 0.01, "mm": 1e-3, "um": 1e-6},
    "rad": {"deg": math.pi / 180},
    "s": {"ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "kg": {"g": 1e-3},
    "N": {"mN": 1e-3},
    "A": {"mA": 1e-3},
    "N m": {"mN m": 1e-3},
    "N/m": {"N/mm": 1e3},
    "N m/A": {"mN m/A": 1e-3},
    "N m s/rad": {"N m s": 1.0},
}
"""SI unit → usual units → factors to SI, as pint gives them; they stand here because pint takes 0.3
s to load.
"""


@lru_cache(maxsize=1)
def _registry() -> pint.UnitRegistry[float]:
    import pint

    registry: pint.UnitRegistry[float] = pint.UnitRegistry(
        cache_folder=None, on_redefinition="ignore"
    )
    # roboticists write Nm; pint alone knows only N m
    registry.define("newton_metre = newton * metre = Nm")
    registry.define("@alias turn = rev = revs")
    return registry


@lru_cache(maxsize=4096)
def unit_factor(unit: str, si: str) -> float:
    """Return the factor from a `unit` to the SI unit `si`, e.g. ``"m"``; ``""`` stands for a plain
    number.

    Raises:
        UnitError: the unit is unknown, has an offset, or its dimension is not that of `si`.
    """
    usual = 1.0 if unit == si else USUAL.get(si, {}).get(unit)
    return _factor_by_pint(unit, si) if usual is None else usual


def _factor_by_pint(unit: str, si: str) -> float:
    import pint

    desired = f"a unit like '{si}'" if si else "a plain number without a unit"
    if not _is_plain(unit):
        raise UnitError(f"unit '{unit[:40]}' is not known; {desired} is allowed here")
    text = unit.replace("·", " * ").replace("⋅", " * ").replace("°", "deg").strip()
    is_angle = _ANGLE_WORDS.search(text) is not None
    if is_angle and "rad" not in si:
        raise UnitError(f"unit '{unit}' is an angle; {desired} is allowed here")
    if si == "rad" and not is_angle:
        raise UnitError(f"unit '{unit}' is no angle; write 'rad' or 'deg'")
    registry = _registry()
    try:
        # a temperature-like or logarithmic unit has no single factor; zero must map to zero
        factor, zero = (
            registry.Quantity(size, text).to(si or "dimensionless").magnitude for size in (1.0, 0.0)
        )
    except pint.DimensionalityError:
        raise UnitError(
            f"unit '{unit}' has the wrong dimension; {desired} is allowed here"
        ) from None
    except Exception as error:  # pint, its parser and Python's tokenizer raise many kinds
        raise UnitError(
            f"unit '{unit}' is not known ({type(error).__name__}); {desired} is allowed here"
        ) from None
    if zero != 0.0 or not math.isfinite(factor) or factor <= 0.0:
        raise UnitError(f"unit '{unit}' is not proportional to '{si}'; {desired} is allowed here")
    return float(factor)


@lru_cache(maxsize=64)
def base_powers(si: str) -> dict[str, int]:
    """Return an SI unit as powers of base units and radians by their symbols: N m → kg 1, m 2, s
    −2.
    """
    registry = _registry()
    powers = registry.Quantity(1.0, si).to_base_units().unit_items()
    return {registry.get_symbol(name): round(float(str(power))) for name, power in powers}


def _is_plain(unit: str) -> bool:
    """Return whether a unit is names joined by products, quotients and small powers: pint would
    evaluate anything.
    """
    if len(unit) > 60 or _POWER_TOWER.search(unit):
        return False
    return _UNIT_CHARACTERS.fullmatch(_POWER.sub("", _PER.sub("", unit, count=1))) is not None


def to_si(value: object, si: str) -> float:
    """Return `value` as a float in SI: a bare number is SI already, text such as ``"9.53 mm"`` a
    number and a unit.

    Raises:
        UnitError: the value is neither, is not finite, has a decimal comma or ±, or its unit does
            not have the dimension of `si`.
    """
    example = f"a number in SI ({si}) or text like '0.1 {si}'" if si else "a plain number"
    if isinstance(value, bool) or not isinstance(value, (Real, str)):
        raise UnitError(f"{_shown(value)} is not a quantity; {example} is allowed")
    if not isinstance(value, str):
        try:
            return _finite(float(value), value)
        except OverflowError:
            raise UnitError(f"{_shown(value)} is too large; give a finite number") from None
    if "±" in value or "+/-" in value or "+-" in value:
        raise UnitError(
            f"'{value}' has a ±; give a standard deviation instead: {{ value = …, std = … }}"
        )
    if _DECIMAL_COMMA.search(value):
        raise UnitError(f"'{value}' has a decimal comma; write a decimal point")
    ratio = _RATIO.match(value)
    if ratio is not None and not si and float(ratio[2]) != 0.0:  # a gear of 30:1
        return _finite(float(ratio[1]) / float(ratio[2]), value)
    match = _QUANTITY.match(value)
    if match is None:
        raise UnitError(f"'{value}' does not start with a number; {example} is allowed")
    number = float(match[1])
    unit = match[2]
    divisor = {"": 1.0, "%": 100.0, "percent": 100.0}.get(unit)
    if divisor is not None:
        if si:
            raise UnitError(f"'{value}' has no unit; {example} is allowed")
        return _finite(number / divisor, value)
    return _finite(number * unit_factor(unit, si), value)


def _finite(number: float, value: object) -> float:
    if not math.isfinite(number):
        raise UnitError(f"{_shown(value)} is not finite; give a finite number")
    return number


def _shown(value: object) -> str:
    try:
        text = repr(value)
    except ValueError:  # Python refuses to write out thousands of digits
        text = f"a number of type {type(value).__name__}"
    return text if len(text) <= 60 else text[:57] + "…"


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
