"""What mypy cannot see through: `python -m tools.untyped` lists it, with what it is for.

A `getattr` with a variable name, a `cast` and `Any` are of any type, so that a fault such as a
friction that is not there passes the type check. Each function that has one stands in
`tools/untyped.txt` with its reason; `make lint` fails (`--check`) where one does not, and where a
line there is of nothing.
"""

from __future__ import annotations

import argparse
import ast
import sys
from collections.abc import Iterator
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src" / "distal"
REASONS = Path(__file__).with_name("untyped.txt")


def untyped(text: str) -> Iterator[str]:
    """Yield ``FUNCTION KIND`` for each function of a module, and ``module KIND`` for what is in
    none, that has a kind: getattr, cast or Any.
    """

    def below(node: ast.AST, within: str) -> Iterator[str]:
        for child in ast.iter_child_nodes(node):
            inside = within
            if isinstance(child, (ast.FunctionDef, ast.ClassDef)):
                inside = child.name if within == "module" else f"{within}.{child.name}"
            kind = kind_of(child)
            if kind is not None:
                yield f"{inside} {kind}"
            yield from below(child, inside)

    yield from dict.fromkeys(below(ast.parse(text), "module"))


def kind_of(node: ast.AST) -> str | None:
    """Return "getattr", "cast" or "Any" where a node is one that hides a type, else None."""
    if isinstance(node, ast.Name) and node.id == "Any":
        return "Any"
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id == "cast":
            return "cast"
        if node.func.id == "getattr" and not isinstance(node.args[1], ast.Constant):
            return "getattr"
    return None


def found(package: Path = PACKAGE) -> list[str]:
    """Return ``MODULE FUNCTION KIND`` for all that a package has, sorted."""
    return sorted(
        f"{path.relative_to(package).with_suffix('').as_posix()} {line}"
        for path in package.rglob("*.py")
        for line in untyped(path.read_text(encoding="utf-8"))
    )


def reasons(path: Path = REASONS) -> dict[str, str]:
    """Return ``MODULE FUNCTION KIND`` → why it is there."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return {where: why for where, _, why in (line.partition(": ") for line in lines)}


def problems(there: list[str], explained: dict[str, str]) -> list[str]:
    """Return a line for each place without a reason, and for each reason without a place."""
    without = [f"{where}: say its type, or why not" for where in there if not explained.get(where)]
    return [*without, *(f"{where}: is not there" for where in explained if where not in there)]


def main() -> None:
    """Print the list, or fail where reasons are missing."""
    parser = argparse.ArgumentParser(prog="python -m tools.untyped", description=__doc__)
    parser.add_argument("--check", action="store_true", help="fail where a reason is missing")
    if parser.parse_args().check:
        sys.exit("\n".join(problems(found(), reasons())) or 0)
    explained = reasons()
    for where in found():
        print(f"{where}: {explained.get(where, '?')}")


if __name__ == "__main__":
    main()
