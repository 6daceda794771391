"""Where is what: `python -m tools.files [WORD]` prints the modules of the package with the first
sentence of each.

With a word, only the modules whose name, sentence, functions, classes or constants have it, and
below each of them which.
"""

from __future__ import annotations

import ast
import re
import sys
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "distal"


def sentences(word: str = "") -> Iterator[str]:
    """Yield a line for each module, its path and its first sentence, and with a `word` what in it
    has the word.
    """
    for path in sorted(SOURCE.rglob("*.py")):
        if path.name != "__init__.py":
            tree = ast.parse(path.read_text(encoding="utf-8"))
            line = f"{path.relative_to(SOURCE).as_posix():46} {_first(ast.get_docstring(tree))}"
            inside = [f"    {found}" for found in _named(tree) if _has(found, word)] if word else []
            if inside or _has(line, word):
                yield "\n".join([line, *inside])


def _named(tree: ast.Module) -> Iterator[str]:
    """Yield functions, classes and documented constants of a module with their first sentences."""
    for node, after in zip(tree.body, [*tree.body[1:], ast.Pass()]):
        if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
            yield f"{node.name}: {_first(ast.get_docstring(node))}"
            if isinstance(node, ast.ClassDef):
                yield from (f"{node.name}.{each}" for each in _named(ast.Module(node.body, [])))
        elif isinstance(node, (ast.Assign, ast.AnnAssign)) and isinstance(after, ast.Expr):
            said = after.value.value if isinstance(after.value, ast.Constant) else ""
            names = [
                each.id
                for each in ast.walk(node)
                if isinstance(each, ast.Name) and isinstance(each.ctx, ast.Store)
            ]
            yield f"{', '.join(names)}: {_first(str(said))}"


def _first(text: str | None) -> str:
    return " ".join((text or "").split("\n\n")[0].split())


def _has(text: str, word: str) -> bool:
    return re.search(rf"(?<![a-z]){re.escape(word)}", text, re.I) is not None


if __name__ == "__main__":
    print("\n".join(sentences(" ".join(sys.argv[1:]))))
