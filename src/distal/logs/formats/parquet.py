"""Parquet files: only the needed columns are read, after the header says how much memory they
take.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from distal.errors import LogError
from distal.logs.formats.format import Format
from distal.logs.table_cells import (
    WIDEST_VECTOR,
    Cells,
    Column,
    as_column,
    needed,
    numbered,
)
from distal.machine_limits import check_rows


def read_parquet(path: Path, columns: Sequence[str] | None) -> Cells:
    """Return those of the needed columns that a Parquet file has.

    Args:
        columns: names of the columns that are needed; None needs all.

    Raises:
        LogError: the columns take more memory than is allowed, or a column holds vectors of
            different lengths.
    """
    import pyarrow.parquet

    with path.open("rb") as source:
        file = pyarrow.parquet.ParquetFile(source)
        parts = _parts(path, file)
        chosen = {name: part for name, part in parts.items() if needed(name, columns)}
        read = list(dict.fromkeys(column for column, _ in chosen.values()))
        check_rows(file.metadata.num_rows, len(chosen))
        table = file.read(columns=read, use_threads=False)
        held = {name: _column(column, table[column], at) for name, (column, at) in chosen.items()}
    return Cells(held, path, 1, tuple(parts))


def _parts(path: Path, file: Any) -> dict[str, tuple[str, int | None]]:
    """Return the names of all columns → the column of the file, and the position in its vectors,
    None where it holds no vectors.

    The first row's vector says how many numbers there are.
    """
    from pyarrow import types

    plain = dict[str, tuple[str, int | None]]()
    of_vectors = dict[str, tuple[str, int | None]]()
    for column in file.schema_arrow:
        of = getattr(column.type, "value_field", None)  # of a list
        length = 0
        if of is not None and (types.is_floating(of.type) or types.is_integer(of.type)):
            for batch in file.iter_batches(1, columns=[column.name]):
                length = len(batch[0][0].values or ())
                break
        if 0 < length <= WIDEST_VECTOR:
            names = numbered(path, column.name, length)
            of_vectors |= {name: (column.name, k) for k, name in enumerate(names)}
        else:
            plain[column.name] = column.name, None
    return plain | of_vectors


def _column(name: str, column: Any, at: int | None) -> Column:
    """Return the cells of an Arrow column, or the numbers `at` a position of its vectors; whole
    numbers stay whole where none is missing, dates keep their unit.
    """
    import pyarrow.compute

    if at is not None:
        lengths = pyarrow.compute.list_value_length(column)
        if lengths.null_count or len(lengths.unique()) > 1:
            raise LogError(f"column '{name}' holds vectors of different lengths, or misses some")
        column = pyarrow.compute.list_element(column, at)
    return as_column(column.to_numpy())


def write_parquet(columns: Mapping[str, NDArray[np.generic]], file: BinaryIO) -> None:
    """Write columns as a Parquet file, one group of rows after the other."""
    import pyarrow
    import pyarrow.parquet

    table = pyarrow.table({name: np.asarray(column) for name, column in columns.items()})
    pyarrow.parquet.write_table(table, file)


PARQUET = Format(
    "Parquet",
    endings=(".parquet", ".pq"),
    read=read_parquet,
    write=write_parquet,
    package="pyarrow",
)
