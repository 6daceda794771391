from __future__ import annotations

import contextlib
import math
import subprocess
import sys

import pytest
from hypothesis import given
from hypothesis import strategies as st

from distal.errors import UnitError
from distal.units import USUAL, _factor_by_pint, base_powers, to_si, unit_factor


@pytest.mark.parametrize(
    ("text", "si", "value"),
    [
        ("4.239e-4 kg m^2", "kg m^2", 4.239e-4),
        ("4.239e-4 kg m²", "kg m^2", 4.239e-4),
        ("9.53 mm", "m", 9.53e-3),
        ("3°", "rad", math.radians(3)),
        ("0.1 Nm", "N m", 0.1),
        ("1 mNm", "N m", 1e-3),
        ("2 kg·m²·s⁻²", "N m", 2.0),
        ("1 m/s**2", "m/s^2", 1.0),
        ("8e-3 N m s", "N m s/rad", 8e-3),
        ("1 N/mm", "N/m", 1e3),
        ("20.06 1/mm", "1/m", 20060.0),
        ("0.5 1 / (m)", "1/m", 0.5),
        ("30:1", "", 30.0),
        ("5 µm", "m", 5e-6),
        ("10 %", "", 0.1),
        ("-0.5", "", -0.5),
        (3, "N", 3.0),
    ],
)
def test_quantities_become_si(text: object, si: str, value: float) -> None:
    assert to_si(text, si) == pytest.approx(value, rel=1e-12)


@pytest.mark.parametrize(
    ("text", "si", "said"),
    [
        ("1,5 N", "N", "decimal comma"),
        ("1 ± 0.1 N", "N", "std"),
        ("5 N", "m", "wrong dimension"),
        ("5", "m", "no unit"),
        ("5 deg", "", "is an angle"),
        ("5 mm", "rad", "is no angle"),
        ("5 foo", "m", "not known"),
        ("5 degC", "K", "not proportional"),
        ("mm", "m", "does not start with a number"),
        ("1 2 m", "m", "unit '2 m' is not known"),
        ("30:0", "", "not known"),
        ("5 %", "m", "no unit"),
        (None, "m", "not a quantity"),
        (float("nan"), "m", "not finite"),
        ("1e999 m", "m", "not finite"),
    ],
)
def test_what_is_not_a_quantity_is_refused(text: object, si: str, said: str) -> None:
    with pytest.raises(UnitError, match=said):
        to_si(text, si)


@given(st.floats(allow_nan=False, allow_infinity=False, width=32))
def test_a_unit_scales_and_does_nothing_else(number: float) -> None:
    assert to_si(f"{number!r} mm", "m") == pytest.approx(
        number * unit_factor("mm", "m"), rel=1e-15, abs=0
    )
    assert to_si(number, "m") == number


@given(st.text(max_size=30))
def test_any_text_is_a_quantity_or_a_unit_error(text: str) -> None:
    with contextlib.suppress(UnitError):
        assert math.isfinite(to_si(text, "m"))


@pytest.mark.parametrize(
    ("unit", "powers"),
    [
        ("N m", {"kg": 1, "m": 2, "s": -2}),
        ("rad/s", {"rad": 1, "s": -1}),
        ("m/s^2", {"m": 1, "s": -2}),
        ("s", {"s": 1}),
    ],
)
def test_a_unit_as_powers_of_base_units(unit: str, powers: dict[str, int]) -> None:
    """An FMU declares its units so; a kilogram is one, not a thousand grams."""
    assert base_powers(unit) == powers


@pytest.mark.parametrize("si", USUAL)
def test_usual_units_are_those_of_pint(si: str) -> None:
    assert USUAL[si] == {unit: _factor_by_pint(unit, si) for unit in USUAL[si]}


def test_a_rig_of_usual_units_does_not_load_pint() -> None:
    """It takes as long as the rest of a short command."""
    code = "import sys, distal; distal.load_rig('finger-2n'); assert 'pint' not in sys.modules"
    subprocess.run([sys.executable, "-c", code], check=True)
