"""Parquet files: the columns that are asked for, after a look at what their header says they take."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from distal.errors import LogError
from distal.logs.headers import name_and_unit
from distal.logs.memory import check_memory

if TYPE_CHECKING:
    import polars

WIDEST = 16
"""Bytes of a cell whose size the header does not say, such as text."""

COPIES = 3
"""Times that a column is in memory while it is read and turned into numbers."""


def read_parquet(path: Path, columns: Sequence[str] | None) -> tuple[polars.DataFrame, list[str]]:
    """Return columns of a Parquet file as far as it has them, and the names of all.

    Args:
        path: of the file; a name, not a pattern of names.
        columns: that are read; None reads all.

    Raises:
        LogError: it is not such a file, or what is asked for takes more memory than is allowed.
    """
    import polars

    try:
        lazy = polars.scan_parquet(path, glob=False, hive_partitioning=False)
        schema = lazy.collect_schema()
        names = list(schema)
        chosen = names if columns is None else [n for n in names if {n, name_and_unit(n)[0]}.intersection(columns)]
        rows = int(lazy.select(polars.len()).collect().item())
        cells = sum(_bytes_of(schema[name]) for name in chosen)
        check_memory(path, COPIES * rows * cells, f"its header says {rows:,} rows of {len(chosen)} columns")
        frame = polars.read_parquet(path, columns=chosen, glob=False, hive_partitioning=False)
        texts = [name for name, kind in frame.schema.items() if kind == polars.String]
        # a text that is the same in all rows is held once here, and once for each row where it is turned into numbers
        length = sum(int(frame[name].str.len_bytes().sum() or 0) for name in texts)
        check_memory(path, COPIES * length, f"its columns {', '.join(texts)} hold {length:,} bytes of text")
        return frame, names
    except OSError as problem:
        raise LogError(f"{path}: cannot be read ({problem.strerror or problem})") from None
    except polars.exceptions.PolarsError as problem:
        raise LogError(f"{path}: is not a Parquet file ({str(problem).splitlines()[0][:160]})") from None


def _bytes_of(kind: Any) -> int:
    """Return how many bytes a cell of a column takes at least."""
    import polars

    sizes: dict[int, tuple[Any, ...]] = {
        1: (polars.Boolean, polars.Int8, polars.UInt8),
        2: (polars.Int16, polars.UInt16),
        4: (polars.Int32, polars.UInt32, polars.Float32, polars.Date),
        8: (polars.Int64, polars.UInt64, polars.Float64),
    }
    return next((size for size, kinds in sizes.items() if kind in kinds), WIDEST)
