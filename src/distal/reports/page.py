"""A self-contained HTML page of text, tables and figures, which fetches nothing."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping, Sequence
from html import escape
from typing import TYPE_CHECKING

from distal.results import BAD, FAINT, GOOD, INK, SOFT, WHITE

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = (
    f"""
:root {{ color-scheme: light;
  --paper: {WHITE}; --ink: {INK}; --soft: {SOFT}; --line: {FAINT}; --yes: {GOOD}; --no: {BAD}; }}
"""
    + """\
body { font: 16px/1.55 system-ui, sans-serif; color: var(--ink); max-width: 64rem;
  margin: 2.5rem auto;
  padding: 0 1.2rem; background: var(--paper); }
h1, h2 { font-family: system-ui, sans-serif; line-height: 1.25; }
h1 { font-size: 1.7rem; margin-bottom: .3rem; }
h2 { font-size: 1.2rem; margin-top: 2.4rem; }
h3 { font-size: 1rem; margin: 1.6rem 0 .3rem; }
.lead { color: var(--soft); font-size: 1.05rem; }
figure { margin: 1.4rem 0; } figure svg { width: 100%; height: auto; }
figcaption { color: var(--soft); font-size: .92rem; }
table { border-collapse: collapse; width: 100%; font: .86rem/1.4 system-ui, sans-serif;
  margin: 1rem 0; }
th { text-align: left; border-bottom: 2px solid var(--ink); padding: .35rem .5rem; }
td { border-bottom: 1px solid var(--line); padding: .35rem .5rem; vertical-align: top; }
td.n, th.n { text-align: right; font-variant-numeric: tabular-nums; white-space: nowrap; }
.yes { color: var(--yes); } .no { color: var(--no); }
.verdict { font-weight: 600; display: inline-block; min-width: 8rem; }
.why { color: var(--soft); } code { font-size: .9em; } .scroll { overflow-x: auto; }
@media (max-width: 40rem) {
  .scroll { overflow-x: visible; } thead { display: none; } tr { display: block; margin: .9rem 0; }
  td, td.n { display: block; text-align: left; white-space: normal; border: 0; padding: .1rem 0; }
  tr { border-bottom: 1px solid var(--line); padding-bottom: .5rem; } td:empty { display: none; }
  td[data-of]::before { content: attr(data-of) ": "; color: var(--soft); } }
@media print { body { margin: 0; max-width: none; } h2 { break-after: avoid; }
  figure, tr { break-inside: avoid; } }
"""
)


def page(title: str, lead: str, parts: Sequence[str]) -> str:
    """Return the HTML of a page.

    Args:
        lead: plain text below the title.
        parts: the page's content as HTML.
    """
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n"
        f"<h1>{escape(title)}</h1>\n<p class='lead'>{escape(lead)}</p>\n"
        + "\n".join(parts)
        + "\n</body>\n</html>\n"
    )


def heading(text: str, level: int = 2) -> str:
    """Return the HTML of a heading, of level 2 for a section or 3 for a part of one."""
    return f"<h{level}>{escape(text)}</h{level}>"


def paragraph(text: str) -> str:
    """Return the HTML of a paragraph of plain text."""
    return f"<p>{escape(text)}</p>"


def svg_of(figure: Figure, description: str = "") -> str:
    """Return a figure as an SVG element, with a description for readers who cannot see it."""
    buffer = io.StringIO()
    figure.savefig(buffer, format="svg", metadata={"Date": None})
    text = buffer.getvalue()
    label = f"role='img' aria-label='{escape(description)}' " if description else ""
    return text[text.index("<svg") :].replace("<svg ", f"<svg {label}", 1)


def picture(svg: str, caption: str) -> str:
    """Return the HTML of a figure with its caption.

    Args:
        svg: an SVG element, or the text of an SVG file.
    """
    return f"<figure>{svg[svg.index('<svg') :]}<figcaption>{escape(caption)}</figcaption></figure>"


def html_table(
    columns: Sequence[str], rows: Sequence[Sequence[str]], values: Sequence[int] = ()
) -> str:
    """Return the HTML of a table.

    Args:
        rows: cells as HTML.
        values: indices of the columns that hold numbers.
    """
    mark = [" class='n'" if i in values else "" for i in range(len(columns))]
    head = "".join(f"<th{mark[i]}>{escape(name)}</th>" for i, name in enumerate(columns))
    # on a narrow screen each row is a block of lines, and each cell tells its column
    label = [
        f" data-of='{escape(name, quote=True)}'" if name and i else ""
        for i, name in enumerate(columns)
    ]
    body = "".join(
        "<tr>"
        + "".join(f"<td{mark[i]}{label[i]}>{cell}</td>" for i, cell in enumerate(row))
        + "</tr>\n"
        for row in rows
    )
    table = f"<table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>"
    return f"<div class='scroll'>{table}</div>"


def script_with(name: str, table: Mapping[str, object], script: str) -> str:
    """Return the HTML of a script and of the data that it reads, which stand as JSON in an element
    called `name`.
    """
    packed = json.dumps(table, separators=(",", ":")).replace("<", "\\u003c")
    return (
        f"<script type='application/json' id='{name}'>{packed}</script>\n<script>{script}</script>"
    )
