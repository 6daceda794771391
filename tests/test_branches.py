"""`learn` is a screen that anyone can follow: few branches, and none hidden in what it calls."""

from __future__ import annotations

import ast
from pathlib import Path

from tools.branches import branches, functions, of_folder

MOST = 12
FOLDER = Path(__file__).parents[1] / "src/distal/fitting"


def test_branches_are_counted() -> None:
    source = """
def one(a, b):
    def inner():
        return 1 if a else 2
    if a and b or a:
        return [x for x in a if x if b]
    for x in a:
        try:
            x()
        except ValueError:
            pass
    return a if b else inner
"""
    counted = {function.name: branches(function) for function in functions(ast.parse(source))}
    # if, and, or; a comprehension with two conditions; for, try, a conditional expression
    assert counted == {"one": 3 + 3 + 3, "inner": 1}


CALLED = ("learn", "judge", "with_terms", "comparisons")


def test_learn_has_few_branches_and_hides_none() -> None:
    tree = ast.parse((FOLDER / "candidates.py").read_text(encoding="utf-8"))
    # what `learn` is made of, and all that these call
    parts = [each for each in functions(tree) if each.name in CALLED]
    called = {
        node.func.id
        for part in parts
        for node in ast.walk(part)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    counted = {name.partition(":")[2]: count for name, count in of_folder(FOLDER).items()}
    assert counted["learn"] <= MOST
    helpers = {name: counted[name] for name in called if name in counted}
    assert len(helpers) >= 8
    assert max(helpers.values()) <= MOST, helpers
    chosen = {
        name: n
        for name, n in of_folder(FOLDER).items()
        if name.startswith(("candidates.py", "lacking"))
    }
    assert len(chosen) > 15
    assert max(chosen.values()) <= MOST, chosen
