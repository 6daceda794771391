"""How many branches each function has: ``python -m tools.branches [FOLDER] [--above N]``.

Counted are if, for, while, try, conditional expressions, comprehensions and each of their
conditions, and each further operand of ``and`` and ``or``. Functions within a function count for
themselves.
"""

from __future__ import annotations

import argparse
import ast
from collections.abc import Iterator
from pathlib import Path

Function = ast.FunctionDef | ast.AsyncFunctionDef


def functions(tree: ast.AST) -> Iterator[Function]:
    """Yield all functions of a module."""
    return (
        node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef)
    )


def branches(function: ast.AST) -> int:
    """Return how many branches a function has, without those of functions within it."""
    count = 0
    for node in ast.iter_child_nodes(function):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            continue
        count += isinstance(node, ast.If | ast.For | ast.While | ast.Try | ast.IfExp)
        count += len(node.values) - 1 if isinstance(node, ast.BoolOp) else 0
        count += 1 + len(node.ifs) if isinstance(node, ast.comprehension) else 0
        count += branches(node)
    return count


def of_folder(folder: Path) -> dict[str, int]:
    """Return file:function → branches, of all modules below a folder."""
    counted = {}
    for path in sorted(folder.rglob("*.py")):
        for function in functions(ast.parse(path.read_text(encoding="utf-8"))):
            counted[f"{path.relative_to(folder)}:{function.name}"] = branches(function)
    return counted


def main() -> None:
    """Print the functions with the most branches first."""
    parser = argparse.ArgumentParser()
    parser.add_argument("folder", nargs="?", type=Path, default=Path("src/distal/fitting"))
    parser.add_argument("--above", type=int, default=12)
    words = parser.parse_args()
    counted = of_folder(words.folder)
    for name, count in sorted(counted.items(), key=lambda one: -one[1]):
        if count > words.above:
            print(f"{count:4d}  {name}")


if __name__ == "__main__":
    main()
