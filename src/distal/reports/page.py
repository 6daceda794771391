"""A self-contained HTML page of text, tables and figures, which fetches nothing."""

from __future__ import annotations

from collections.abc import Sequence
from html import escape
from importlib import resources
from typing import TYPE_CHECKING

from distal.results import (
    BAD,
    BLACK,
    COLOURS,
    FAINT,
    GOOD,
    INK,
    SOFT,
    WHITE,
    band_colour,
    figure_bytes,
)

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_COLOURS = {
    "paper": WHITE,
    "ink": INK,
    "soft": SOFT,
    "line": FAINT,
    "yes": GOOD,
    "no": BAD,
    "curve": COLOURS[0],
    "band": band_colour(),
    "truth": BLACK,
    "naive": COLOURS[3],
}
"""Name of a colour in style sheets → the colour."""


def resource(name: str, package: str = "distal.reports") -> str:
    """Return the text of a file that lies in a package: a script, a style sheet or a template."""
    return resources.files(package).joinpath(name).read_text(encoding="utf-8")


def page(title: str, lead: str, parts: Sequence[str]) -> str:
    """Return the HTML of a page.

    Args:
        lead: plain text below the title.
        parts: the page's content as HTML.
    """
    colours = " ".join(f"--{name}: {colour};" for name, colour in _COLOURS.items())
    return (
        "<!doctype html>\n<html lang='en'>\n<head>\n<meta charset='utf-8'>\n"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>\n"
        f"<title>{escape(title)}</title>\n<style>:root {{ color-scheme: light; {colours} }}\n"
        f"{resource('page.css')}</style>\n</head>\n<body>\n"
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


def svg_of(figure: Figure, description: str) -> str:
    """Return a figure as an SVG element, with a description for readers who cannot see it."""
    text = figure_bytes(figure, "page.svg").decode()
    label = f"<svg role='img' aria-label='{escape(description)}' "
    return text[text.index("<svg") :].replace("<svg ", label, 1)


def picture(svg: str, caption: str) -> str:
    """Return the HTML of a figure with its caption.

    Args:
        svg: an SVG element, or the text of an SVG file.
    """
    return f"<figure>{svg[svg.index('<svg') :]}<figcaption>{escape(caption)}</figcaption></figure>"
