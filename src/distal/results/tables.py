"""Tables: a row on each joint of an estimate, and rows as HTML."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
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


class Html(str):
    """A cell of a table that is HTML already."""


def verdict(word: str, good: bool) -> Html:
    """Return a word as a cell, in the colour of what is well or is not."""
    return Html(f"<span class='{'yes' if good else 'no'}'>{escape(word)}</span>")


def html_table(
    columns: Iterable[str],
    rows: Iterable[Sequence[object]],
    values: Sequence[int] = (),
    name: str = "",
) -> str:
    """Return the HTML of a table.

    Args:
        rows: cells, text or HTML; other numbers are written to four digits.
        values: indices of the columns that hold numbers.
        name: class of the table in style sheets.
    """
    names = [escape(column) for column in columns]
    mark = [" class='n'" if i in values else "" for i in range(len(names))]
    # on a narrow screen each row is a block of lines, and each cell tells its column
    label = [f" data-of='{text}'" if text and i else "" for i, text in enumerate(names)]
    head = "".join(f"<th{mark[i]}>{text}</th>" for i, text in enumerate(names))
    body = "".join(
        f"<tr>{''.join(f'<td{mark[i]}{label[i]}>{_cell(cell)}</td>' for i, cell in enumerate(row))}"
        "</tr>\n"
        for row in rows
    )
    opened = f"<table class='{name}'>" if name else "<table>"
    table = f"{opened}<thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f"<div class='scroll'>{table}</div>"


def _cell(cell: object) -> str:
    if isinstance(cell, Html):
        return cell
    return escape(f"{cell:.4g}" if isinstance(cell, float) else str(cell))
