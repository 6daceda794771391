"""Constants of the package with their values, units and sources: `python -m tools.constants
[--without]`.

A source is what the text under a constant names, best as its last sentence, such as
`Source: physics (what).` Without that, a page or a benchmark that chose it, a reference with its
year, or rounding count.
`judgement` says that a number was chosen by hand. `--without` prints those that name none.

Defaults of a frozen dataclass are constants too: the class's text says where they come from, else
they were chosen by hand. Numbers that stand inside functions are only counted.
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
SAID = r"Source: .*"
SOURCES = {
    "benchmark": r"docs/\w+|benchmarks?\b",
    "reference": r"\b(19|20)\d\d\b|Equation|\(\d+\w?\)",
    "rounding": r"divided by zero|rounding|underflow|overflow",
}


@dataclass(frozen=True)
class Constant:
    """A number that a module or a class of settings names, with the text under it."""

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


def settings(package: Path = PACKAGE) -> Iterator[Constant]:
    """Yield the numbers that are defaults of frozen dataclasses, but for 0 and 1, in the order of
    the files.
    """
    for path in sorted(package.rglob("*.py")):
        module = path.relative_to(package).with_suffix("").as_posix()
        for found in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(found, ast.ClassDef):
                continue
            if not (found.name.isupper() or "dataclass" in _decorators(found)):
                continue
            # other numbers of a class's text are not where its defaults come from
            of_class = "".join(re.findall(SAID, " ".join((ast.get_docstring(found) or "").split())))
            for field, after in zip(found.body, [*found.body[1:], None]):
                if not isinstance(field, (ast.Assign, ast.AnnAssign)) or field.value is None:
                    continue
                if _is_number(field.value) and _numbers(field.value) - {0, 1}:
                    target = field.targets[0] if isinstance(field, ast.Assign) else field.target
                    name = f"{found.name}.{ast.unparse(target)}"
                    text = _text(after) or of_class
                    yield Constant(name, module, ast.unparse(field.value), text)


def inside_functions(package: Path = PACKAGE) -> int:
    """Return how many numbers stand inside functions, but for whole ones, a half, those that shift
    digits and those that only keep rounding errors off.
    """
    count = 0
    for path in sorted(package.rglob("*.py")):
        functions = (
            found
            for found in ast.walk(ast.parse(path.read_text(encoding="utf-8")))
            if isinstance(found, ast.FunctionDef)
        )
        at = {
            (part.lineno, part.col_offset)
            for function in functions
            for part in ast.walk(function)
            if isinstance(part, ast.Constant)
            and type(part.value) is float
            and not part.value.is_integer()
            and part.value not in (0.5, 1e-3)
            and part.value > ROUNDING
        }
        count += len(at)
    return count


ROUNDING = 1e-5
"""Number inside a function below which it only keeps rounding errors off."""


def _decorators(found: ast.ClassDef) -> str:
    return " ".join(ast.unparse(decorator) for decorator in found.decorator_list)


def _numbers(value: ast.expr) -> set[float]:
    """Return the numbers in an expression."""
    parts = (part.value for part in ast.walk(value) if isinstance(part, ast.Constant))
    return {number for number in parts if type(number) in (int, float)}


def _is_number(value: ast.expr) -> bool:
    words = [p for p in ast.walk(value) if isinstance(p, ast.Constant) and isinstance(p.value, str)]
    return bool(_numbers(value)) and not words


def _text(statement: ast.stmt | None) -> str:
    if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
        return " ".join(str(statement.value.value).split())
    return ""


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--without", action="store_true", help="only those without a source")
    arguments = parser.parse_args()
    every = [*constants(), *settings()]
    without = [constant for constant in every if not constant.source]
    for constant in without if arguments.without else every:
        row = (constant.module, constant.name, constant.value, constant.unit, constant.source)
        print(" | ".join(row))
    print(f"{len(every)} constants, {len(without)} without a source, {chosen()} chosen by hand")
    print(f"{inside_functions()} numbers inside functions")


def chosen() -> int:
    """Return how many constants were chosen by hand: by judgement, or as a default without a
    source.
    """
    judged = sum(constant.source == "judgement" for constant in constants())
    return judged + sum(each.source in ("judgement", "") for each in settings())


if __name__ == "__main__":
    main()
