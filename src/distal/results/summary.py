"""A row on each joint of an estimate: its range, its band and its errors."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from html import escape
from typing import TypedDict

SummaryRow = TypedDict(
    "SummaryRow",
    {
        "joint": str,
        "least [deg]": float,
        "greatest [deg]": float,
        "median band [deg]": float,
        "RMS error [deg]": float | None,
        "largest error [deg]": float | None,
        "inside band": float | None,
    },
)
"""The row of `Estimate.summary` on one joint."""


def html_rows(rows: Sequence[Mapping[str, object]]) -> str:
    """Return rows as an HTML table, with numbers to four digits."""
    written = (
        [f"{cell:.4g}" if isinstance(cell, float) else str(cell) for cell in row.values()]
        for row in rows
    )
    lines = ("".join(f"<td>{escape(cell)}</td>" for cell in line) for line in (rows[0], *written))
    return f"<table>{''.join(f'<tr>{line}</tr>' for line in lines)}</table>"
