"""HDF5 files: each data set with a number or a vector per row gives columns named by its path."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from distal.errors import LogError
from distal.logs.formats.format import Format
from distal.logs.table_cells import WIDEST_VECTOR, Cells, Column, needed
from distal.machine_limits import check_memory


def read_hdf5(path: Path, columns: Sequence[str] | None) -> Cells:
    """Return columns of an HDF5 file; those of a vector are ``group/name.0``, ``group/name.1`` and
    so on.

    Args:
        columns: names of the columns that are needed; None needs all.

    Raises:
        LogError: its columns have different lengths, or take more memory than is allowed.
    """
    import h5py

    with h5py.File(path, "r") as file:
        parts = dict[str, Any]()
        file.visititems(parts.__setitem__)
        sets = {name: part for name, part in parts.items() if _is_column(part)}
        groups = {name.rpartition("/")[0] for name in sets}
        if len(groups) == 1:  # a group of all adds nothing to their names
            sets = {name.rpartition("/")[2]: part for name, part in sets.items()}
        every = [column for name, part in sets.items() for column in _columns(name, part)]
        chosen = [column for column in every if needed(column[0], columns)]
        size = sum(part.dtype.itemsize * len(part) for _, part, _ in chosen)
        check_memory(size, f"it holds {len(chosen)} columns of that")
        held: dict[str, Column] = {name: np.asarray(part[at]) for name, part, at in chosen}
    lengths = {len(column) for column in held.values()}
    if len(lengths) > 1:
        raise LogError(
            f"its columns have different lengths: {', '.join(map(str, sorted(lengths)))} "
            "rows. Are these several episodes? Write each into a file of its own"
        )
    return Cells(held, path, 1, tuple(name for name, _, _ in every))


def _is_column(part: Any) -> bool:
    """Return whether a member of a file is a data set with one number or a vector of at most
    `WIDEST_VECTOR` in each row.
    """
    shape = getattr(part, "shape", None)
    if shape is None or part.dtype.kind not in "iuf" or len(shape) not in (1, 2):
        return False
    return len(shape) == 1 or 0 < shape[1] <= WIDEST_VECTOR


def _columns(name: str, part: Any) -> list[tuple[str, Any, Any]]:
    """Return name, data set, and position in it of each column of a data set."""
    if len(part.shape) == 1:
        return [(name, part, ...)]
    return [(f"{name}.{k}", part, (..., k)) for k in range(part.shape[1])]


HDF5 = Format("HDF5", endings=(".h5", ".hdf5"), read=read_hdf5)
