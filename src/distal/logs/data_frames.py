"""Columns as frames of pandas or polars, where that library is installed."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from types import ModuleType
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalError

if TYPE_CHECKING:
    import pandas
    import polars


def pandas_frame(columns: Mapping[str, NDArray[np.generic]]) -> pandas.DataFrame:
    """Return the columns as a pandas frame; a `DistalError` says where pandas is not installed."""
    copies = {name: np.array(column) for name, column in columns.items()}
    frame: pandas.DataFrame = _library("pandas").DataFrame(copies)
    return frame


def polars_frame(columns: Mapping[str, NDArray[np.generic]]) -> polars.DataFrame:
    """Return the columns as a polars frame; a `DistalError` says where polars is not installed."""
    frame: polars.DataFrame = _library("polars").DataFrame(dict(columns))
    return frame


def _library(name: str) -> ModuleType:
    """Return a library's module, or raise a `DistalError` that says how to install it."""
    try:
        return import_module(name)
    except ImportError:
        raise DistalError(f"{name} is not installed; pip install '.[{name}]'") from None
