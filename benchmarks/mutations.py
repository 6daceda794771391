"""One-place changes of Python source text: where a sign, an operator, a constant or a slice bound
can be changed.

Places come from the syntax tree, changes are made in the text: exactly the characters of the place
are replaced, the rest of the file stays as it is. Docstrings, annotations, imports, decorators,
`raise`, `assert`, text and f-strings are left alone.
"""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

SIGNS = {ast.Add: ("+", ("-",)), ast.Sub: ("-", ("+",))}
FACTORS = {ast.Mult: ("*", ("/",)), ast.Div: ("/", ("*",))}
COMPARISONS = {
    ast.Lt: ("<", ("<=", ">")),
    ast.Gt: (">", (">=", "<")),
    ast.LtE: ("<=", ("<", ">=")),
    ast.GtE: (">=", (">", "<=")),
    ast.Eq: ("==", ("!=",)),
    ast.NotEq: ("!=", ("==",)),
}
TWINS = (
    ("fmin", "fmax"),
    ("sin", "cos"),
    ("min", "max"),
    ("minimum", "maximum"),
    ("argmin", "argmax"),
    ("logic_and", "logic_or"),
    ("logical_and", "logical_or"),
)
"""Functions of which one is easily taken for the other."""

OTHER_NAME = {**dict(TWINS), **{b: a for a, b in TWINS}}
BRANCHES = {"if_else", "where"}
"""Functions (condition, one, other)."""

SCALES = (1.05, 0.95, 2.0)
WHOLE = {
    "arange",
    "eye",
    "full",
    "ones",
    "range",
    "repmat",
    "reshape",
    "round",
    "split",
    "sym",
    "zeros",
    "enumerate",
}
"""Functions whose numbers are whole: shapes, counts, places."""

TYPES = {
    "Annotated",
    "Callable",
    "Literal",
    "Mapping",
    "NDArray",
    "Sequence",
    "dict",
    "list",
    "set",
    "tuple",
}
"""What has square brackets in a type, as in `cast(tuple[int, int], x)`."""

LEFT_ALONE = (
    ast.Import,
    ast.ImportFrom,
    ast.Raise,
    ast.Assert,
    ast.JoinedStr,
    ast.Global,
    ast.Nonlocal,
)


@dataclass(frozen=True)
class Position:
    """A place in a file that can be changed.

    Args:
        kind: of the change: sign, operator, constant, bound or branches.
        start: first byte of what is replaced, in UTF-8.
        end: the byte after it.
        before: what stands there.
        after: what may stand there instead.
    """

    kind: str
    start: int
    end: int
    before: str
    after: tuple[str, ...]


@dataclass(frozen=True)
class Mutant:
    """A file with one change.

    Args:
        file: its path within the project.
        line: of the change, from 1.
        kind: of the change.
        before: the line as it was, without its indentation.
        after: the same, changed; several lines are joined by ⏎.
        text: of the whole file with the change.
    """

    file: Path
    line: int
    kind: str
    before: str
    after: str
    text: str


def changed(source: str, position: Position, after: str) -> str:
    """Return the source with one place replaced.

    Args:
        source: of a module.
        place: in it.
        after: what stands there instead.
    """
    data = source.encode()
    return (data[: position.start] + after.encode() + data[position.end :]).decode()


def mutant(file: Path, source: str, position: Position, after: str) -> Mutant:
    """Return a file with one change.

    Args:
        file: its path within the project.
        source: its text.
        place: what is replaced.
        after: by what.
    """
    data, text = source.encode(), changed(source, position, after)
    line = data.count(b"\n", 0, position.start)
    behind = data.count(b"\n", position.end)

    def lines(of: str) -> str:
        rows = of.split("\n")
        return " ⏎ ".join(row.strip() for row in rows[line : len(rows) - behind])

    return Mutant(file, line + 1, position.kind, lines(source), lines(text), text)


def positions(source: str) -> list[Position]:
    """Return every place of a module that can be changed, in the order of the text.

    Args:
        source: of the module.
    """
    finder = _Finder(source)
    finder.visit(ast.parse(source))
    return sorted(
        set(finder.found), key=lambda position: (position.start, position.end, position.kind)
    )


class _Finder(ast.NodeVisitor):
    def __init__(self, source: str) -> None:
        self.data, self.found = source.encode(), list[Position]()
        lines = source.splitlines(keepends=True)
        self.starts = [0]
        for line in lines:
            self.starts.append(self.starts[-1] + len(line.encode()))
        self.tokens = []
        for token in tokenize.generate_tokens(io.StringIO(source).readline):
            if token.type in (tokenize.OP, tokenize.NAME):
                row, column = token.start
                start = self.starts[row - 1] + len(lines[row - 1][:column].encode())
                self.tokens.append((start, token.string))
        self.whole = False  # within an index or a shape
        self.signed = False  # an operand whose sign is changed at a place of its own

    def start(self, node: ast.expr) -> int:
        return self.starts[node.lineno - 1] + node.col_offset

    def end(self, node: ast.expr) -> int:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.starts[node.end_lineno - 1] + node.end_col_offset

    def text(self, node: ast.expr) -> str:
        return self.data[self.start(node) : self.end(node)].decode()

    def add(self, kind: str, start: int, before: str, *after: str) -> None:
        end = start + len(before.encode())
        assert self.data[start:end].decode() == before
        self.found.append(Position(kind, start, end, before, after))

    def between(self, left: int, right: int, desired: str) -> int:
        """Return where a token stands between two bytes."""
        return next(at for at, text in self.tokens if left <= at < right and text == desired)

    def visit(self, node: ast.AST) -> None:
        if isinstance(node, LEFT_ALONE):
            return
        super().visit(node)

    def generic_visit(self, node: ast.AST) -> None:
        # a sign is only told to the operand itself
        self.signed = False
        super().generic_visit(node)

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        for default in (
            *node.args.defaults,
            *(each for each in node.args.kw_defaults if each is not None),
        ):
            before, self.whole = self.whole, True
            self.visit(default)
            self.whole = before
        for statement in node.body:
            self.visit(statement)

    def visit_Lambda(self, node: ast.Lambda) -> None:
        self.visit(node.body)

    def visit_ClassDef(self, node: ast.ClassDef) -> None:
        for statement in node.body:
            self.visit(statement)

    def visit_AnnAssign(self, node: ast.AnnAssign) -> None:
        if node.value is not None:
            self.visit(node.value)

    def visit_Assign(self, node: ast.Assign) -> None:
        names = [target.id for target in node.targets if isinstance(target, ast.Name)]
        if "__all__" in names:
            return
        # a whole number under a name of its own is a count
        before = self.whole
        self.whole = any(name.isupper() for name in names) and isinstance(node.value, ast.Constant)
        for target in node.targets:
            self.visit(target)
        self.visit(node.value)
        self.whole = before

    def visit_AugAssign(self, node: ast.AugAssign) -> None:
        if not _is_sequence(node.value):
            for kind, table in (("sign", SIGNS), ("operator", FACTORS)):
                if type(node.op) in table:
                    sign, after = table[type(node.op)]
                    at = self.between(self.end(node.target), self.start(node.value), f"{sign}=")
                    self.add(kind, at, f"{sign}=", *(f"{each}=" for each in after))
        self.generic_visit(node)

    def visit_BinOp(self, node: ast.BinOp) -> None:
        signed, operation = self.signed, type(node.op)
        parameters = not (_is_sequence(node.left) or _is_sequence(node.right))
        left, right = self.end(node.left), self.start(node.right)
        if operation in SIGNS and parameters:
            sign, after = SIGNS[operation]
            if not _is_number(node.right, 0):  # x + 0 is x − 0
                self.add("sign", self.between(left, right, sign), sign, *after)
        elif operation in FACTORS and parameters:
            sign, after = FACTORS[operation]
            if not _is_number(node.right, 1):  # x * 1 is x / 1
                self.add("operator", self.between(left, right, sign), sign, *after)
        # a minus before the first of a sum or a product; in a sum, before each other operand is the
        # sign itself
        additive = operation in SIGNS
        first = (
            isinstance(node.left, (ast.Name, ast.Attribute, ast.Call, ast.Subscript))
            and not self.whole
        )
        if parameters and first and (additive or (operation in FACTORS and not signed)):
            self.add(
                "sign", self.start(node.left), self.text(node.left), f"-{self.text(node.left)}"
            )
        whole = self.whole
        for operand, identified in ((node.left, signed and not additive), (node.right, True)):
            self.signed = identified and isinstance(operand, ast.BinOp)
            # a power with a fraction has no value for a negative base: seen at once, and no mistake
            # that people make
            self.whole = whole or (operation is ast.Pow and operand is node.right)
            self.visit(operand)
        self.signed, self.whole = False, whole

    def visit_UnaryOp(self, node: ast.UnaryOp) -> None:
        if isinstance(node.op, ast.USub) and not self.whole:
            self.add("sign", self.start(node), "-", "")
            self.signed = isinstance(node.operand, ast.BinOp)
        self.visit(node.operand)
        self.signed = False

    def visit_Compare(self, node: ast.Compare) -> None:
        left = node.left
        for operation, right in zip(node.ops, node.comparators):
            if type(operation) in COMPARISONS and not (_is_text(left) or _is_text(right)):
                sign, after = COMPARISONS[type(operation)]
                self.add(
                    "operator", self.between(self.end(left), self.start(right), sign), sign, *after
                )
            left = right
        self.generic_visit(node)

    def visit_BoolOp(self, node: ast.BoolOp) -> None:
        word, other = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
        for left, right in zip(node.values, node.values[1:]):
            self.add("operator", self.between(self.end(left), self.start(right), word), word, other)
        self.generic_visit(node)

    def visit_Call(self, node: ast.Call) -> None:
        name = getattr(node.func, "id", getattr(node.func, "attr", ""))
        if name in OTHER_NAME:
            self.add("operator", self.end(node.func) - len(name.encode()), name, OTHER_NAME[name])
        if name in BRANCHES and len(node.args) == 3:
            _, one, other = node.args
            middle = self.data[self.end(one) : self.start(other)].decode()
            before = f"{self.text(one)}{middle}{self.text(other)}"
            if self.text(one) != self.text(other) and "(" not in middle and ")" not in middle:
                self.add(
                    "branches",
                    self.start(one),
                    before,
                    f"{self.text(other)}{middle}{self.text(one)}",
                )
        if name in ("warn", "cast"):
            return
        self.visit(node.func)
        whole, self.whole, self.signed = self.whole, name in WHOLE, False
        for argument in (*node.args, *(keyword.value for keyword in node.keywords)):
            self.visit(argument)
        self.whole = whole

    def visit_Tuple(self, node: ast.Tuple) -> None:
        # whole numbers side by side are a shape or places
        whole, self.signed = self.whole, False
        for element in node.elts:
            self.whole = whole or isinstance(element, ast.Constant)
            self.visit(element)
        self.whole = whole

    def visit_Subscript(self, node: ast.Subscript) -> None:
        if isinstance(node.value, ast.Name) and node.value.id in TYPES:
            return
        self.signed = False
        self.visit(node.value)
        whole, self.whole = self.whole, True
        self.visit(node.slice)
        self.whole = whole

    def visit_Slice(self, node: ast.Slice) -> None:
        for bound in (node.lower, node.upper):
            if bound is None:
                continue
            text = self.text(bound)
            if isinstance(bound, ast.Constant) and isinstance(bound.value, int):
                self.add(
                    "bound", self.start(bound), text, *(str(bound.value + step) for step in (1, -1))
                )
                continue
            held = text if isinstance(bound, SIMPLE) else f"({text})"
            self.add("bound", self.start(bound), text, f"{held} + 1", f"{held} - 1")
            self.visit(bound)
        if node.step is not None:
            self.visit(node.step)

    def visit_Constant(self, node: ast.Constant) -> None:
        self.signed = False
        value = node.value
        if isinstance(value, bool) or not isinstance(value, (int, float)):
            return
        whole = [
            f"{number}"
            for number in ((1,) if value == 0 else (0, 2) if value == 1 else (int(value) + 1,))
        ]
        scaled = [] if value == 0 else [f"{value * scale:.12g}" for scale in SCALES]
        if isinstance(value, float):
            after = [f"{each}.0" for each in whole] if value in (0.0, 1.0) else []
            after += scaled
        else:
            after = whole if self.whole else whole + scaled
        text = self.text(node)
        different = list(
            {float(each): each for each in reversed(after) if float(each) != value}.values()
        )[::-1]
        if different:
            self.add("constant", self.start(node), text, *different)


SIMPLE = (ast.Name, ast.Attribute, ast.Call, ast.Subscript, ast.Constant, ast.UnaryOp)


def _is_sequence(node: ast.expr) -> bool:
    """Return whether a list, tuple or text stands here, which + joins and * repeats."""
    if isinstance(node, ast.BinOp):
        return _is_sequence(node.left) or _is_sequence(node.right)
    return isinstance(node, (ast.List, ast.Tuple, ast.ListComp, ast.JoinedStr)) or _is_text(node)


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, ast.Constant) and isinstance(node.value, (str, bytes))


def _is_number(node: ast.expr, value: float) -> bool:
    return (
        isinstance(node, ast.Constant)
        and not isinstance(node.value, (str, bool))
        and node.value == value
    )


def every_mutant(file: Path, source: str) -> Iterator[Mutant]:
    """Yield every change of a file.

    Args:
        file: its path within the project.
        source: its text.
    """
    for position in positions(source):
        for after in position.after:
            yield mutant(file, source, position, after)
