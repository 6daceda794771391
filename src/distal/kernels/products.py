"""C of products: dense, with one sparse factor, of rank one."""

from __future__ import annotations

from typing import Any

from distal.kernels.dialects import CodeError
from distal.kernels.layout import Value
from distal.kernels.lifetimes import Lifetimes

UNROLLED_PRODUCT = 8
"""A sparse factor of at most so many numbers is written number by number."""


class Products(Lifetimes):
    """What is added up."""

    def _product(self, k: int, node: Any, inputs: list[Value]) -> list[str]:
        """z + x y, dense or with one sparse factor."""
        z, x, y = (node.dep(i) for i in range(3))
        rows, inner, columns = x.size1(), x.size2(), y.size2()
        if not z.is_dense():
            raise CodeError("a sparse product has no C here")
        if x.is_dense() and y.is_dense():
            self.count += 2 * rows * inner * columns
            return self._dense_product(k, inputs, rows, inner, columns)
        if not x.is_dense() and not y.is_dense():
            raise CodeError("the product of two sparse matrices has no C here")
        row, column = _triplets((x if y.is_dense() else y).sparsity())
        if not y.is_dense() and len(row) <= UNROLLED_PRODUCT:
            self.count += 2 * len(row) * rows
            return self._columns(k, inputs, rows, columns, list(zip(row, column)))
        to, lines = self._started(k, inputs[0])
        if y.is_dense():
            self.count += 2 * len(row) * columns
            factor, among = inputs[1], f" + {inner} * j" if columns > 1 else ""
            where = self.at(inputs[2], f"{self.indices(column)}[k]{among}")
            below = f" + {rows} * j" if columns > 1 else ""
            target = self.at(to, f"{self.indices(row)}[k]{below}" if rows > 1 else ("j" if columns > 1 else 0))
            loop = f"for (j = 0; j < {columns}; ++j) " if columns > 1 else ""
            return [*lines, f"  {loop}for (k = 0; k < {len(row)}; ++k) {target} += {self.at(factor, 'k')} * {where};"]
        self.count += 2 * len(row) * rows
        target = self.at(to, f"i + {rows} * {self.indices(column)}[k]" if columns > 1 else "i")
        where = self.at(inputs[1], f"i + {rows} * {self.indices(row)}[k]")
        return [
            *lines,
            f"  for (k = 0; k < {len(row)}; ++k) for (i = 0; i < {rows}; ++i) "
            f"{target} += {where} * {self.at(inputs[2], 'k')};",
        ]

    def _columns(
        self, k: int, inputs: list[Value], rows: int, columns: int, entries: list[tuple[int, int]]
    ) -> list[str]:
        """z + x y with few numbers in y: each column of the result as one sum of columns of x."""
        base, x, y = inputs
        zero = base.home is None and not any(base.numbers)
        if zero:
            to, lines = self._made(k, base.size), list[str]()
        else:
            to, lines = self._started(k, base)
        for column in range(columns):
            target = self.at(to, _sum("i", rows * column))
            terms = [
                f"{self.at(x, _sum('i', rows * row))} * {self.at(y, number)}"
                for number, (row, at) in enumerate(entries)
                if at == column
            ]
            start = [] if zero else [target]
            if terms or zero:
                total = " + ".join([*start, *terms]) or self.dialect.constant(0.0)
                lines.append(f"  for (i = 0; i < {rows}; ++i) {target} = {total};")
        return lines

    def _dense_product(self, k: int, inputs: list[Value], rows: int, inner: int, columns: int) -> list[str]:
        base, x, y = inputs
        zero = base.home is None and not any(base.numbers)
        if zero:
            to, lines = self._made(k, base.size), list[str]()
            start = self.dialect.constant(0.0)
        else:
            to, lines = self._started(k, base)
            start = self.at(to, f"i + {rows} * j")
        total = (
            f"{self.dialect.type} s = {start}; for (k = 0; k < {inner}; ++k) "
            f"s += {self.at(x, f'i + {rows} * k')} * {self.at(y, f'k + {inner} * j')}; "
            f"{self.at(to, f'i + {rows} * j')} = s;"
        )
        return [*lines, f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {{ {total} }}"]

    def _rank_one(self, k: int, node: Any, inputs: list[Value]) -> list[str]:
        base, alpha, x, y = inputs
        rows, columns = node.size1(), node.size2()
        self.count += 2 * rows * columns
        to, lines = self._started(k, base)
        if alpha.home is None and alpha.numbers[0] == -1.0:
            change = f"-= {self.at(x, 'i')} * {self.at(y, 'j')}"
        else:
            change = f"+= {self.at(alpha, 0)} * {self.at(x, 'i')} * {self.at(y, 'j')}"
        return [
            *lines,
            f"  for (j = 0; j < {columns}; ++j) for (i = 0; i < {rows}; ++i) {self.at(to, f'i + {rows} * j')} {change};",
        ]

    def _dot(self, k: int, inputs: list[Value]) -> list[str]:
        n = inputs[0].size
        self.count += 2 * n
        to = self._made(k, 1)
        total = f"s += {self.at(inputs[0], 'i')} * {self.at(inputs[1], 'i')};"
        start = f"{self.dialect.type} s = {self.dialect.constant(0.0)};"
        return [f"  {{ {start} for (i = 0; i < {n}; ++i) {total} {self.at(to, 0)} = s; }}"]


def _sum(index: str, offset: int) -> str:
    return f"{index} + {offset}" if offset else index


def _triplets(sparsity: Any) -> tuple[list[int], list[int]]:
    rows, columns = sparsity.get_triplet()
    return [int(i) for i in rows], [int(i) for i in columns]
