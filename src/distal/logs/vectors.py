"""Columns that hold vectors, as in robot-learning datasets, become one column for each number."""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from distal.errors import LogError

INFO = Path("meta") / "info.json"
"""Path of a LeRobot dataset's description in its folder; it names the numbers of vectors."""

WIDEST_VECTOR = 256
"""Longest vector per row of a table that is read as columns; a longer one is an image or the like.
Source: judgement.
"""

ABOVE = 4
"""How many folders above a file its dataset is looked for. Source: judgement."""


def numbered(column: str, names: Sequence[str] | None, length: int) -> list[str]:
    """Return the names of the columns for the numbers of a vector.

    They are, for example, ``observation.state.NAME``; where the `names` do not fit, a position from
    0 stands for each.

    Args:
        length: how many numbers the vector has.
    """
    usable = names is not None and len(names) == length and len(set(names)) == length
    return [f"{column}.{names[k] if usable and names is not None else k}" for k in range(length)]


def component_names_in(path: Path, column: str) -> list[str] | None:
    """Return the names of the numbers of a vector, from the description of the dataset that holds
    the file.

    The result is None where there is no dataset, or it gives no names.

    Raises:
        LogError: the dataset's description is no JSON object.
    """
    folder = next(
        (parent for parent in list(path.absolute().parents)[:ABOVE] if (parent / INFO).is_file()),
        None,
    )
    if folder is None:
        return None
    identified = dataset_info(folder)
    features = identified.get("features")
    feature = features.get(column) if isinstance(features, dict) else None
    names = feature.get("names") if isinstance(feature, dict) else None
    if isinstance(names, dict):  # by group: {"motors": [...]}
        names = [
            name
            for group in names.values()
            for name in (group if isinstance(group, list) else [group])
        ]
    return [str(name) for name in names] if isinstance(names, list) else None


def dataset_info(folder: Path) -> dict[str, object]:
    """Return the description of a dataset, the content of its `INFO`.

    Raises:
        LogError: the description cannot be read, or is no JSON object.
    """
    try:
        identified = json.loads((folder / INFO).read_text(encoding="utf-8"))
    except (OSError, ValueError) as problem:
        raise LogError(
            f"{folder / INFO}: cannot be read ({str(problem)[:120]}); is the dataset half written?"
        ) from None
    if not isinstance(identified, dict):
        raise LogError(f"{folder / INFO}: does not describe a dataset")
    return identified
