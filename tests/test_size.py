"""`python -m tools.size` counts what packing cannot hide."""

from __future__ import annotations

import pytest
from tools.size import size_of


@pytest.mark.parametrize(
    ("text", "tokens"),
    [
        ("a = 1\n", 3),
        ("a, b = 1, 2\n", 7),
        ("a = 1  # why\n\n\n", 3),
        ('"""A module."""\n\na = 1\n"""What it is."""\n', 3),
        ("if a:\n    b()\n", 6),
        ('a = "four words in it"\n', 6),
        ('a = ""\n', 3),
        ('a = (\n    "four words "\n    "in it"\n)\n', 8),
    ],
)
def test_tokens_are_counted_by_what_is_said(text: str, tokens: int) -> None:
    assert size_of("module.py", text) == tokens


def test_a_template_counts_its_words() -> None:
    assert size_of("page.html", "<p>two words</p>\n") == 2
