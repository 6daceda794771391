"""Each module of the package with the first sentence of its docstring: `python -m tools.files [WORD ...]`.

With words only the modules whose name or sentence has one of them.
"""

from __future__ import annotations

import ast
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

SOURCE = Path(__file__).parents[1] / "src" / "distal"


def sentences(words: Sequence[str] = ()) -> Iterator[str]:
    """Yield a line for each module, its path and its first sentence; all modules without `words`."""
    for path in sorted(SOURCE.rglob("*.py")):
        text = (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").split("\n")[0]
        line = f"{path.relative_to(SOURCE).as_posix():46} {text}"
        if path.name != "__init__.py" and (not words or any(word.lower() in line.lower() for word in words)):
            yield line


if __name__ == "__main__":
    print("\n".join(sentences(sys.argv[1:])))
