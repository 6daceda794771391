"""How much code there is: `python -m tools.size [--at COMMIT] [--largest N] [--check | --ratchet]`.

Size is counted in tokens of `tokenize`, without comments, docstrings, line ends and indentation. A
string counts its words, one at least, and so does each other file of the package that holds text
which is shown or compiled (`TEMPLATES`). Broken lines and long names so cost nothing, and neither
packing nor moving text into a string makes it less.

`tools/size.txt` holds the largest size that the package may have: tokens, modules, and constants
that were chosen by hand. `--check`, which `make lint` runs, fails above any of them. `--ratchet`
writes smaller ones, never larger ones: whoever needs more edits the file, in a commit whose message
says for which feature.
"""

from __future__ import annotations

import argparse
import ast
import io
import subprocess
import sys
import tokenize
from collections.abc import Iterator, Mapping
from pathlib import Path

from tools.constants import chosen, inside_functions

ROOT = Path(__file__).parents[1]
LIMITS = Path(__file__).with_name("size.txt")
SOURCE = "src"
TEMPLATES = (".js", ".css", ".html", ".c", ".h")
"""Endings of files whose words count as those of strings do."""

UNCOUNTED = {
    tokenize.COMMENT,
    tokenize.NL,
    tokenize.NEWLINE,
    tokenize.INDENT,
    tokenize.DEDENT,
    tokenize.ENDMARKER,
}
MODULE_GOAL = 6000
"""Modules have up to so many tokens."""


def tokens_of(text: str) -> int:
    """Return the size of a Python module [tokens]."""
    docs = _lines_of_docstrings(text)
    total = 0
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type in UNCOUNTED or token.start[0] in docs:
            continue
        total += _words(token.string.strip("\"'")) if token.type == tokenize.STRING else 1
    return total


def size_of(name: str, text: str) -> int:
    """Return the size of a file [tokens]; of one that is no Python, its words."""
    return tokens_of(text) if name.endswith(".py") else _words(text)


def sizes(commit: str | None = None) -> dict[str, int]:
    """Return the size of each file of the package [tokens], in the work tree or at a commit."""
    files = _in_work_tree() if commit is None else _at(commit)
    return {name: size_of(name, text) for name, text in files}


def counted() -> dict[str, int]:
    """Return what the ratchet holds: what is counted → how many there are in the work tree."""
    found = sizes()
    return {
        "tokens": sum(found.values()),
        "modules": sum(name.endswith(".py") for name in found),
        "constants chosen by hand": chosen(),
        "numbers inside functions": inside_functions(),
    }


def read_limits(path: Path = LIMITS) -> dict[str, int]:
    """Return what is counted → the most that there may be."""
    lines = path.read_text(encoding="utf-8").splitlines()
    return {what: int(most) for most, _, what in (line.partition(" ") for line in lines)}


def exceeded(now: Mapping[str, int], limits: Mapping[str, int]) -> list[str]:
    """Return a line for each count that is above its limit."""
    return [
        f"{now[what]} {what}, {most} are allowed: delete before you add, or raise the number in "
        "tools/size.txt in a commit that says for which feature"
        for what, most in limits.items()
        if now[what] > most
    ]


def tighten(now: Mapping[str, int], path: Path = LIMITS) -> None:
    """Write limits that are smaller than before; none becomes larger."""
    limits = {what: min(now[what], most) for what, most in read_limits(path).items()}
    path.write_text("".join(f"{n} {what}\n" for what, n in limits.items()), encoding="utf-8")


def _lines_of_docstrings(text: str) -> set[int]:
    """Return the lines of strings that stand alone: docstrings, and those of constants."""
    lines: set[int] = set()
    for node in ast.walk(ast.parse(text)):
        said = node.value if isinstance(node, ast.Expr) else None
        if isinstance(said, ast.Constant) and isinstance(said.value, str):
            lines.update(range(said.lineno, (said.end_lineno or said.lineno) + 1))
    return lines


def _words(text: str) -> int:
    return max(1, len(text.split()))


def _counts(name: str) -> bool:
    return name.endswith((".py", *TEMPLATES))


def _in_work_tree() -> Iterator[tuple[str, str]]:
    for path in sorted((ROOT / SOURCE).rglob("*")):
        if path.is_file() and _counts(path.name):
            yield path.relative_to(ROOT).as_posix(), path.read_text(encoding="utf-8")


def _at(commit: str) -> Iterator[tuple[str, str]]:
    listing = _git("ls-tree", "-r", "--name-only", commit, SOURCE)
    for name in listing.splitlines():
        if _counts(name):
            yield name, _git("show", f"{commit}:{name}")


def _git(*words: str) -> str:
    done = subprocess.run(
        ["git", *words], cwd=ROOT, check=True, capture_output=True, text=True, encoding="utf-8"
    )
    return done.stdout


def main() -> None:
    """Print the size of the package, and its largest modules."""
    parser = argparse.ArgumentParser(prog="python -m tools.size", description=__doc__)
    parser.add_argument("--at", metavar="COMMIT", help="count a commit, not the work tree")
    parser.add_argument("--largest", type=int, default=8, help="how many modules to list")
    way = parser.add_mutually_exclusive_group()
    way.add_argument("--check", action="store_true", help="fail above the limits")
    way.add_argument("--ratchet", action="store_true", help="write smaller limits")
    arguments = parser.parse_args()
    if arguments.check:
        sys.exit("\n".join(exceeded(counted(), read_limits())) or 0)
    if arguments.ratchet:
        tighten(counted())
    found = sizes(arguments.at)
    modules = {name: size for name, size in found.items() if name.endswith(".py")}
    total, of_modules = sum(found.values()), sum(modules.values())
    print(f"{total} tokens, of them {of_modules} in {len(modules)} modules")
    print(f"{sum(size > MODULE_GOAL for size in modules.values())} modules above {MODULE_GOAL}:")
    for name in sorted(modules, key=lambda name: -modules[name])[: arguments.largest]:
        print(f"{modules[name]:6} {name}")


if __name__ == "__main__":
    main()
