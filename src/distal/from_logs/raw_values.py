"""Numbers of a raw description, and the names of columns as a rig file has them."""

from __future__ import annotations

from distal.from_logs.column_units import ColumnRole
from distal.logs import name_and_unit

Raw = dict[str, object]


def column_of(column: ColumnRole) -> str:
    """Return a column as a rig file names it: a unit in square brackets is the log's own, unless
    its scale is assumed.
    """
    return column.header if column.unit_sureness == "assumed" else name_and_unit(column.header)[0]


def number(value: float, unit: str = "") -> object:
    """Return a `value` in its unit, which may be empty, as a rig file has it."""
    return f"{value:.5g} {unit}" if unit else float(f"{value:.5g}")


def about(value: float, share: float, unit: str = "") -> Raw:
    """Return a `value` in its unit with a standard deviation that is a share of it."""
    return {"value": number(value, unit), "std": f"{100 * share:.2g} %"}
