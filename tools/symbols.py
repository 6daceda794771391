"""Symbols of the adaptive filter: `python -m tools.symbols` lists what is wrong with
docs/reference/symbols.md.

Each symbol on the filter's pages, in its naive twin and in the docstrings of its package has one
line in that table, and is defined in one way only. A symbol is a letter with its accents, primes
and subscript; ⁺, ⁻ and powers are no part of it.
"""

from __future__ import annotations

import ast
import io
import re
import sys
import tokenize
import unicodedata
from collections import Counter
from collections.abc import Iterator, Mapping
from pathlib import Path

ROOT = Path(__file__).parent.parent
TABLE = "docs/reference/symbols.md"
PAGES = (
    "docs/explanation/adaptive.md",
    "docs/explanation/adaptive-state.md",
    "docs/explanation/adaptive-guards.md",
    "docs/explanation/chains.md",
    "docs/reference/adaptive-equations.md",
)
CODE = ("src/distal/estimators/adaptive", "tests/estimators/adaptive")
TWINS = "twin*.py"

GREEK = "α-ωΑ-Ω"
LETTER = f"A-Za-z{GREEK}ℓ"
ACCENT = "\u0300-\u036f"
SIGNS = "₀-₉₊₋"
SYMBOL = re.compile(
    rf"(?<![{LETTER}{ACCENT}_.'’])(dt|[{LETTER}])([{ACCENT}]*)('*)((?:_[{LETTER}{ACCENT}0-9]+|[{SIGNS}]+)?)"
    rf"(?![{LETTER}{ACCENT}0-9_'’])"
)
OPERATOR = re.compile(rf"[ΣΠ]_[{LETTER}{{]+(?=[ (]|$)|Σ")
POWER = re.compile(r"\be(?=\^|[⁰¹²³⁴-⁹⁻])|(?<=\d)e(?=-?\d)")
"""The base of the exponential function, and powers of ten, are no symbols of the filter."""

DEFINED_AFTER = re.compile(r"(?:^|[,;:(.]|\b(?:with|and|by|is))\s*$")
"""What stands before a definition; after "if" or "where" an equation is a condition."""


def plain(text: str) -> str:
    """Return a page without what is no formula: code, targets of links, links to figures."""
    text = re.sub(r"(?s)```.*?```", "", text)
    text = re.sub(r"!\[[^\]]*\]\([^)]*\)", "", text)
    text = re.sub(r"`[^`]*`", "…", text)
    text = re.sub(r"\]\([^)]*\)", "]", text)
    return unicodedata.normalize("NFD", text)


def name_of(match: re.Match[str]) -> str:
    """Return a symbol as the table writes it."""
    return same(unicodedata.normalize("NFC", "".join(match.groups())))


def same(symbol: str) -> str:
    """Return a symbol with figures below the line where it has them behind a _: σ_0 looks like
    σ₀.
    """
    return re.sub(r"_(\d)$", lambda found: chr(ord("₀") + int(found[1])), symbol)


def symbols_of(text: str) -> set[str]:
    """Return the symbols of a text.

    Args:
        text: without code, see `plain`.
    """
    return {name_of(match) for match in SYMBOL.finditer(POWER.sub("", OPERATOR.sub(" ", text)))}


def is_marked(symbol: str) -> bool:
    """Return whether a symbol can be told from a name in code: it is Greek, has an accent or a
    short subscript.
    """
    letter, _, subscript = unicodedata.normalize("NFD", symbol).partition("_")
    signs = re.search(f"[{GREEK}ℓ{ACCENT}{SIGNS}]", letter) is not None
    return len(subscript) <= 3 and (signs or bool(subscript))


def statements(text: str) -> Iterator[str]:
    """Yield the lines of a text, an equation that goes on with what it goes on to; numbers of
    equations are left out.
    """
    lines: list[str] = []
    for line in text.splitlines():
        line = re.sub(r"\s+\(\d+[a-z]?\)$", "", line)
        goes_on = line.startswith("     ") and (
            re.match(r"\s+[+−]", line) or line.strip().startswith("else")
        )
        if lines and goes_on:
            lines[-1] += " " + line.strip()
        else:
            lines.append(line)
    yield from lines


def definitions_of(text: str) -> Iterator[tuple[str, str]]:
    """Yield each symbol that a text defines, "x = …", with the right side; updates, with ⁺ or ←,
    define nothing.

    Args:
        text: without code, see `plain`.
    """
    for line in statements(text):
        for match in SYMBOL.finditer(line):
            after = re.match(r"[²]?(?:\([\w⁺⁻]+\))? = ", line[match.end() :])
            if after is None or not DEFINED_AFTER.search(line[: match.start()]):
                continue
            rest = line[match.end() + after.end() :]
            right, depth = "", 0
            for at, sign in enumerate(rest):
                depth += (sign in "([{") - (sign in ")]}")
                if depth < 0 or (
                    depth == 0
                    and (
                        sign in ";:"
                        or (sign == "|" and line.startswith("|"))
                        or rest[at : at + 3] == "   "
                    )
                ):
                    break
                if (
                    depth == 0
                    and sign in ",."
                    and rest[at + 1 : at + 2] in (" ", "")
                    and not rest[at:].startswith(", else")
                ):
                    break
                right += sign
            right = re.split(r"  | (?:with|where|of|and|at least)\b", right)[0]
            yield name_of(match), unicodedata.normalize("NFC", re.sub(r"\s+", "", right))


def identified_in(source: str) -> str:
    """Return the docstrings and comments of a module, without names of code."""
    texts = [
        token.string.lstrip("#")
        for token in tokenize.generate_tokens(io.StringIO(source).readline)
        if token.type == tokenize.COMMENT
    ]
    for node in ast.walk(ast.parse(source)):
        if (
            isinstance(node, ast.Expr)
            and isinstance(node.value, ast.Constant)
            and isinstance(node.value.value, str)
        ):
            texts.append(node.value.value)
    return plain("\n".join(texts))


def listed(table: str) -> list[str]:
    """Return the symbols of the table, as often as each stands in it."""
    rows = re.findall(r"(?m)^\|([^|]+)\|", table)
    cells = [cell for cell in rows if not re.fullmatch(r"\s*(symbol|[-: ]+)\s*", cell)]
    return [
        same(unicodedata.normalize("NFC", symbol.strip()))
        for cell in cells
        for symbol in cell.split(", ")
    ]


def faults(table: str, pages: Mapping[str, str], code: Mapping[str, str]) -> list[str]:
    """Return what is wrong: symbols that the table lacks, has twice or in vain, and those defined
    in two ways.

    Args:
        table: the page of symbols.
        pages: Markdown by name.
        code: Python by name.
    """
    known, wrong, used = Counter(listed(table)), list[str](), set[str]()
    wrong += [
        f"{TABLE}: {symbol} stands {count} times" for symbol, count in known.items() if count > 1
    ]
    defined = dict[str, tuple[str, str]]()
    texts = {name: plain(text) for name, text in pages.items()} | {
        name: identified_in(text) for name, text in code.items()
    }
    for name, text in texts.items():
        found = {symbol for symbol in symbols_of(text) if name in pages or is_marked(symbol)}
        wrong += [f"{name}: {symbol} is not in {TABLE}" for symbol in sorted(found - set(known))]
        used |= symbols_of(text)
        for symbol, right in definitions_of(text):
            if name in code and not is_marked(symbol):
                continue
            where, first = defined.setdefault(symbol, (name, right))
            if right != first:
                wrong.append(f"{name}: {symbol} = {right}, but {first} in {where}")
    return wrong + [f"{TABLE}: {symbol} is used nowhere" for symbol in known if symbol not in used]


def read() -> tuple[str, dict[str, str], dict[str, str]]:
    """Return the table, the pages and the modules."""
    modules = [*(ROOT / CODE[0]).rglob("*.py"), *(ROOT / CODE[1]).glob(TWINS)]
    names = [path.relative_to(ROOT).as_posix() for path in sorted(modules)]
    texts = {name: (ROOT / name).read_text(encoding="utf-8") for name in (TABLE, *PAGES, *names)}
    return (
        texts[TABLE],
        {name: texts[name] for name in PAGES},
        {name: texts[name] for name in names},
    )


def main() -> None:
    """Print what is wrong; the exit code says whether anything is."""
    wrong = faults(*read())
    print("\n".join(wrong) or "every symbol has one line and one meaning")
    sys.exit(bool(wrong))


if __name__ == "__main__":
    main()
