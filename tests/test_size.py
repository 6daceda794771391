"""`python -m tools.size` counts what packing cannot hide."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest
from tools.size import ROOT, SOURCE, counted, exceeded, read_limits, size_of, tighten


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


def packed(source: str) -> int:
    """Return how many assignments of a module give several values to several names."""
    statements = ast.walk(ast.parse(source))
    assignments = [statement for statement in statements if isinstance(statement, ast.Assign)]
    return sum(
        isinstance(assignment.value, ast.Tuple)
        and any(isinstance(target, ast.Tuple) for target in assignment.targets)
        for assignment in assignments
    )


def test_one_statement_is_one_assignment() -> None:
    """But for swaps, and where values depend on names that are given anew."""
    assert packed("a, b = b, a\nc, d = f()\ne = 1, 2") == 1
    modules = (ROOT / SOURCE / "distal").rglob("*.py")
    assert sum(packed(module.read_text(encoding="utf-8")) for module in modules) <= 20


@pytest.mark.more
def test_one_line_too_many_is_seen() -> None:
    """`make lint` fails on it; the numbers of the package itself are `tools/size.txt`'s."""
    limits = read_limits()
    assert set(limits) == set(counted())
    assert exceeded(limits, limits) == []
    for what in limits:
        (line,) = exceeded({**limits, what: limits[what] + 1}, limits)
        assert line.startswith(f"{limits[what] + 1} {what}, {limits[what]} are allowed")


def test_limits_only_become_smaller(tmp_path: Path) -> None:
    path = tmp_path / "size.txt"
    path.write_text("100 tokens\n7 modules\n")
    tighten({"tokens": 90, "modules": 8}, path)
    assert path.read_text() == "90 tokens\n7 modules\n"
