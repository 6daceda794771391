"""Constants of the package with their values, units and sources: `python -m tools.constants
[--without]`.

A source is what the text under a constant names, best as its last sentence, such as
`Source: physics (what).` Without that, a page or a benchmark that chose it, a reference with its
year, or rounding count.
`judgement` says that a number was chosen by hand. `--without` prints those that name none.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

PACKAGE = Path(__file__).parents[1] / "src" / "distal"
NAMED = r"Source: (physics|definition|reference|benchmark|rounding|layout|judgement)\b"
SOURCES = {
    "benchmark": r"docs/\w+|benchmarks?\b",
    "reference": r"\b(19|20)\d\d\b|Equation|\(\d+\w?\)",
    "rounding": r"divided by zero|rounding|underflow|overflow",
}


@dataclass(frozen=True)
class Constant:
    """A number that a module names, with the text under it."""

    name: str
    module: str
    value: str
    text: str

    @property
    def unit(self) -> str:
        """Its unit, as its text has it in brackets."""
        units = re.findall(r"\[([^\]]+)\]", self.text)
        return ", ".join(units)

    @property
    def source(self) -> str:
        """What kind of source its text names, empty where it names none."""
        named = re.search(NAMED, self.text)
        if named:
            return named[1]
        kinds = (kind for kind, pattern in SOURCES.items() if re.search(pattern, self.text))
        return next(kinds, "")


def constants(package: Path = PACKAGE) -> Iterator[Constant]:
    """Yield the numbers that modules of a package name, in the order of the files."""
    for path in sorted(package.rglob("*.py")):
        statements = ast.parse(path.read_text(encoding="utf-8")).body
        for statement, after in zip(statements, [*statements[1:], None]):
            if not isinstance(statement, ast.Assign) or not _is_number(statement.value):
                continue
            text = _text(after)
            for target in statement.targets:
                if isinstance(target, ast.Name) and target.id.isupper():
                    module = path.relative_to(package).with_suffix("").as_posix()
                    yield Constant(target.id, module, ast.unparse(statement.value), text)


def _is_number(value: ast.expr) -> bool:
    parts = list(ast.walk(value))
    numbers = [p for p in parts if isinstance(p, ast.Constant) and type(p.value) in (int, float)]
    words = [p for p in parts if isinstance(p, ast.Constant) and isinstance(p.value, str)]
    return bool(numbers) and not words


def _text(statement: ast.stmt | None) -> str:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return " ".join(str(statement.value.value).split())
    return ""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--without", action="store_true", help="only those without a source")
    arguments = parser.parse_args()
    every = list(constants())
    without = [constant for constant in every if not constant.source]
    for constant in without if arguments.without else every:
        row = (constant.module, constant.name, constant.value, constant.unit, constant.source)
        print(" | ".join(row))
    judged = sum(constant.source == "judgement" for constant in every)
    print(f"{len(every)} constants, {len(without)} without a source, {judged} chosen by hand")


if __name__ == "__main__":
    main()
