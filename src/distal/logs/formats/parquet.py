"""Parquet files: only the needed columns are read, after the header says how much memory they
take.
"""

from __future__ import annotations

import io
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.cells import Cells, Column, in_memory
from distal.logs.formats.format import Format
from distal.logs.header_units import needed
from distal.logs.memory_limit import check_memory
from distal.logs.vectors import component_names_in, numbered

WIDEST = 16
"""Assumed size of a cell whose size the header does not say, such as text [bytes]. Source:
judgement.
"""

COPIES = 3
"""Copies of a column that are in memory while it is read and turned into numbers. Source:
judgement.
"""

TEXTS = ("string", "large_string", "string_view")
"""Names of Arrow's types of text."""


def read_parquet(path: Path, columns: Sequence[str] | None) -> Cells:
    """Return those of the needed columns that a Parquet file has.

    Args:
        columns: names of the columns that are needed; None needs all.

    Raises:
        LogError: the file is not Parquet, the columns take more memory than is allowed or hold
            neither numbers nor dates nor text, or pyarrow is missing.
    """
    try:
        import pyarrow
        import pyarrow.parquet
    except ImportError:
        raise LogError(
            f"{path}: Parquet needs the package pyarrow (pip install '.[parquet]')"
        ) from None
    try:
        source = path.open("rb")
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None
    with source:
        try:
            file = pyarrow.parquet.ParquetFile(source)
            schema = file.schema_arrow
            rows = file.metadata.num_rows
            vectors = _vectors(path, file)
            inside = {name: position for name, position in vectors.items() if needed(name, columns)}
            chosen = [
                name
                for name in schema.names
                if needed(name, columns) or name in dict(inside.values())
            ]
            chosen = [
                name
                for name in chosen
                if name not in dict(vectors.values()) or name in dict(inside.values())
            ]
            kinds = {name: schema.field(name).type for name in chosen}
            size = rows * sum(_bytes_of(kind) for kind in kinds.values())
            check_memory(
                path, COPIES * size, f"its header says {rows:,} rows of {len(chosen)} columns"
            )
            # a text that many rows share is then held in memory once
            texts = [name for name, kind in kinds.items() if str(kind) in TEXTS]
            file = pyarrow.parquet.ParquetFile(source, read_dictionary=texts)
            table = file.read(columns=chosen, use_threads=False)
            whole = [name for name in chosen if name not in dict(inside.values())]
            held: dict[str, Column] = {name: _column(path, name, table[name]) for name in whole}
            for name, (column, k) in inside.items():
                held[name] = _of_vectors(path, column, table[column], k)
            return in_memory(
                held,
                path,
                1,
                [*(n for n in schema.names if n not in dict(vectors.values())), *vectors],
            )
        except MemoryError:  # Arrow's memory error is one of both kinds
            raise
        except (pyarrow.ArrowException, OSError, KeyError, UnicodeDecodeError) as problem:
            raise LogError(
                f"{path}: is not a Parquet file ({(str(problem).splitlines() or [''])[0][:160]})"
            ) from None


def _vectors(path: Path, file: Any) -> dict[str, tuple[str, int]]:
    """Return, for each number of each column of vectors, its name → the column and the number's
    position.

    The first row's vector says how many numbers there are.
    """
    from pyarrow import types

    found = dict[str, tuple[str, int]]()
    for column in file.schema_arrow:
        kind = column.type
        if not (types.is_list(kind) or types.is_large_list(kind) or types.is_fixed_size_list(kind)):
            continue
        if not types.is_floating(kind.value_type) and not types.is_integer(kind.value_type):
            continue
        batch = next(file.iter_batches(1, columns=[column.name]), None)
        first = None if batch is None or not batch.num_rows else batch.column(0)[0].as_py()
        if first:
            names = numbered(column.name, component_names_in(path, column.name), len(first))
            found |= {name: (column.name, k) for k, name in enumerate(names)}
    return found


def _of_vectors(path: Path, name: str, column: Any, position: int) -> Column:
    """Return the number at one position of each vector of a column."""
    import pyarrow.compute

    chunks = column.combine_chunks()
    lengths = np.asarray(
        pyarrow.compute.list_value_length(chunks).to_numpy(zero_copy_only=False), dtype=np.float64
    )
    if len(lengths) and (np.isnan(lengths).any() or np.ptp(lengths) > 0.0):
        raise LogError(
            f"{path}: column '{name}' holds vectors of different lengths, or misses some"
        )
    return np.asarray(pyarrow.compute.list_element(chunks, position).to_numpy(zero_copy_only=False))


def _bytes_of(kind: Any) -> int:
    """Return the least size of a cell of an Arrow type [bytes]."""
    try:
        return max(int(kind.bit_width) // 8, 1)
    except ValueError:
        return WIDEST


def _column(path: Path, name: str, column: Any) -> Column:
    """Return the cells of an Arrow column; whole numbers stay whole where none is missing, dates
    keep their unit.
    """
    import pyarrow.compute
    from pyarrow import types

    kind = column.type
    if types.is_dictionary(kind) and str(kind.value_type) in TEXTS:
        parts = [(chunk.dictionary, chunk.indices) for chunk in column.chunks]
        length = 0
        for texts, positions in parts:
            lengths = pyarrow.compute.binary_length(texts).take(positions)
            length += pyarrow.compute.sum(lengths).as_py() or 0
        check_memory(path, COPIES * length, f"its column {name} holds {length:,} bytes of text")
        read = ((texts.to_pylist(), positions.to_pylist()) for texts, positions in parts)
        return [
            "" if position is None else texts[position] or ""
            for texts, positions in read
            for position in positions
        ]
    if types.is_decimal(kind):
        column = column.cast("float64")
    elif not (
        types.is_integer(kind)
        or types.is_floating(kind)
        or types.is_timestamp(kind)
        or types.is_date(kind)
    ):
        raise LogError(f"{path}: column '{name}' holds {kind}; numbers are expected")
    return np.asarray(column.to_numpy())


def write_parquet(columns: Mapping[str, NDArray[np.generic]]) -> bytes:
    """Return columns as the content of a Parquet file."""
    import pyarrow
    import pyarrow.parquet

    buffer = io.BytesIO()
    table = pyarrow.table({name: np.asarray(column) for name, column in columns.items()})
    pyarrow.parquet.write_table(table, buffer)
    return buffer.getvalue()


PARQUET = Format(
    endings=(".parquet", ".pq"),
    read=read_parquet,
    write=write_parquet,
    package=("pyarrow", "parquet"),
)
