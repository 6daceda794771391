"""Names that say nothing: `python -m tools.words` counts how often `src` binds each; `--where
PACKAGE` lists the places.
"""

from __future__ import annotations

import argparse
import ast
import re
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

SOURCE = Path(__file__).parent.parent / "src" / "distal"
FILLERS = ("one", "own", "found", "known", "each", "there", "said", "rest", "made", "told", "whole")
"""Words that stand for any thing; a noun of the field says which."""
OTHERS = (
    *(
        "item",
        "value",
        "thing",
        "single",
        "data",
        "result",
        "info",
        "entry",
        "element",
        "object",
        "stuff",
    ),
    *(
        "other",
        "others",
        "given",
        "kept",
        "now",
        "here",
        "what",
        "this",
        "that",
        "ones",
        "both",
        "it",
        "many",
        "much",
    ),
)
"""Words that must not take their place."""


GLOSSARY = Path(__file__).parent.parent / "docs" / "reference" / "glossary.md"


def retired() -> tuple[str, ...]:
    """Return the words that the glossary marks as retired in names and keys."""
    line = next(
        line
        for line in GLOSSARY.read_text(encoding="utf-8").splitlines()
        if line.startswith("Retired in names and keys: ")
    )
    return tuple(line.removeprefix("Retired in names and keys: ").rstrip(".").split(", "))


def words_of(name: str) -> list[str]:
    """Return the words of a name, in lower case; what is written or replaced `in_place` stays."""
    parts = re.findall(
        r"[A-Z]+(?=[A-Z][a-z])|[A-Z]?[a-z0-9]+|[A-Z0-9]+", name.replace("in_place", "")
    )
    return [part.lower() for part in parts]


def bindings(path: Path) -> Iterator[tuple[int, str]]:
    """Yield line and name of each variable, argument and function that a module binds."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store):
            yield node.lineno, node.id
        elif isinstance(node, ast.arg):
            yield node.lineno, node.arg
        elif isinstance(node, (ast.ExceptHandler, ast.FunctionDef, ast.ClassDef)) and node.name:
            yield node.lineno, node.name


def counted(folder: Path = SOURCE) -> Counter[str]:
    """Return how often the modules of a folder bind each of these words."""
    counts = Counter(name for path in folder.rglob("*.py") for _, name in bindings(path))
    return Counter({word: counts[word] for word in (*FILLERS, *OTHERS)})


def main() -> None:
    """Print the counts, or the places in a package."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--where", help="a package or module of src/distal, such as logs")
    where = parser.parse_args().where
    if where is not None:
        at = SOURCE / where
        for path in sorted(at.rglob("*.py")) if at.is_dir() else [at]:
            for line, name in sorted(bindings(path)):
                if name in FILLERS:
                    print(f"{path.relative_to(SOURCE.parent.parent)}:{line}: {name}")
        return
    counts = counted()
    for words in (FILLERS, OTHERS):
        print(
            ", ".join(f"{word} {counts[word]}" for word in words),
            "–",
            sum(counts[word] for word in words),
            "in all",
        )


if __name__ == "__main__":
    main()
