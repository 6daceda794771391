"""Columns as frames, where the library for that is installed."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from distal.errors import DistalError

if TYPE_CHECKING:
    import pandas
    import polars


def pandas_frame(columns: Mapping[str, NDArray[np.generic]]) -> pandas.DataFrame:
    """Return the columns as a pandas frame.

    Raises:
        DistalError: pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise DistalError("pandas is not installed; `pip install 'distal[pandas]'`") from None
    return pandas.DataFrame({name: np.array(values) for name, values in columns.items()})


def polars_frame(columns: Mapping[str, NDArray[np.generic]]) -> polars.DataFrame:
    """Return the columns as a polars frame.

    Raises:
        DistalError: polars is not installed.
    """
    try:
        import polars
    except ImportError:
        raise DistalError("polars is not installed; `pip install 'distal[polars]'`") from None
    return polars.DataFrame(dict(columns))
