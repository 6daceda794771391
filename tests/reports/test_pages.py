"""Pages and figures of reports: they hold what they should, and nothing from elsewhere."""

from __future__ import annotations

from distal.reports.page import page, paragraph, picture
from distal.results import Html, html_table


def test_text_is_never_markup() -> None:
    text = page(
        "a <b> & c",
        "<i>",
        [
            paragraph("<p>"),
            html_table(["<x>"], [[Html("<em>cell</em>")], ["<td>"]]),
            picture("<svg/>", "<c>"),
        ],
    )
    for escaped in (
        "a &lt;b&gt; &amp; c",
        "&lt;i&gt;",
        "<p>&lt;p&gt;</p>",
        "<th>&lt;x&gt;</th>",
        "<figcaption>&lt;c&gt;",
        "<td>&lt;td&gt;</td>",
    ):
        assert escaped in text
    assert "<em>cell</em>" in text  # a cell that is HTML
