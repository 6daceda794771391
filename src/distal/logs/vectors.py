"""Columns that hold vectors, as robot-learning data has them: one column for each of their
numbers.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path

from distal.errors import LogError

INFO = Path("meta") / "info.json"
"""Where a LeRobot dataset says what the numbers of its vectors are."""

ABOVE = 4
"""A file of a dataset is at most so many folders below it."""


def numbered(column: str, names: Sequence[str] | None, length: int) -> list[str]:
    """Return the column of each number of a vector: ``observation.state.NAME`` where it has names,
    else its position.
    """
    usable = names is not None and len(names) == length and len(set(names)) == length
    return [f"{column}.{names[k] if usable and names is not None else k}" for k in range(length)]


def component_names_in(path: Path, column: str) -> list[str] | None:
    """Return the names of a vector's numbers by the dataset that a file is of; None where nothing
    says them.

    Raises:
        LogError: the dataset's description is no JSON.
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
    """Return what a dataset says of itself.

    Raises:
        LogError: it is no JSON object.
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
