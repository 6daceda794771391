"""``--set path=value``: replace one value of a raw description, by its path."""

from __future__ import annotations

import re
import tomllib
from collections.abc import MutableMapping, Sequence
from copy import deepcopy

from distal.errors import DistalError, did_you_mean
from distal.rig.quantities import KEYS
from distal.rig.validation import index_of, names_in

ALL = "*"
"""Key of a path that stands for all items of a list."""

_LOOSE_QUANTITY = re.compile(r"^[-+]?[0-9.][0-9.eE+-]*\s*[A-Za-z%°µμ][^\"'\[\]{}=]*$")


def parse_assignment(text: str, error: type[DistalError]) -> tuple[str, object]:
    """Return path and value of ``path=value``, or raise `error`. The value is read as TOML; a
    quantity whose quotes a shell removed, such as ``8 mm``, is taken as text.
    """
    path, equals, value = text.partition("=")
    path = path.strip()
    value = value.strip()
    if "\n" in value or "\r" in value:
        raise error(f"--set '{path}': the value has more than one line; give one value")
    if not equals or not path or not value:
        raise error(
            f"--set '{text}': write path=value, e.g. --set joints.finger.friction.coefficient=0.4"
        )
    try:
        return path, tomllib.loads(f"value = {value}")["value"]
    except (ValueError, RecursionError):
        if _LOOSE_QUANTITY.match(value):
            return path, value
        raise error(
            f"--set '{text[:80]}': '{value[:60]}' is not TOML; "
            'write a number, "text with a unit", [a list] or { a = table }'
        ) from None


def set_value(raw: object, path: str, value: object, error: type[DistalError]) -> None:
    """Replace the value at `path` in `raw`, in place, or raise `error` where an item of the path
    does not exist.

    A bare value that replaces ``{ value, std }`` keeps the std. Items of a list are named by their
    name or index, crossings by their joint; ``*`` stands for all of them.
    """
    keys = path.split(".")

    def indices(items: Sequence[object], key: str, where: str) -> Sequence[int]:
        """Return which items of a list a key names."""
        if key == ALL:
            return range(len(items))
        index = index_of(items, key)
        if index is None:
            hint = did_you_mean(key, names_in(items))
            raise error(f"--set '{path}': '{where}' has no '{key}'{hint}")
        return [index]

    def replace(parent: object, depth: int, value: object) -> None:
        """Replace the value below the first `depth` keys, which lead to `parent`."""
        key = keys[depth]
        where = ".".join(keys[:depth])
        is_last = depth + 1 == len(keys)
        if key == ALL and (not isinstance(parent, (list, tuple)) or not parent):
            raise error(
                f"--set '{path}': '{where or ALL}' is no list with items that '{ALL}' could stand "
                "for"
            )
        if isinstance(parent, (list, tuple)):
            if is_last and isinstance(parent, tuple):
                raise error(f"--set '{path}': set the whole of '{where}' instead")
            for index in indices(parent, key, where):
                # a table is changed in place: each item gets one of its own
                copied = deepcopy(value) if key == ALL else value
                if not is_last:
                    replace(parent[index], depth + 1, copied)
                elif isinstance(parent, list):
                    parent[index] = _merged(parent[index], copied)
        elif not isinstance(parent, MutableMapping):
            raise error(f"--set '{path}': '{where}' is a plain value and has no '{key}'")
        elif is_last:
            parent[key] = _merged(parent.get(key), value)
        else:
            part = parent.get(key)
            if isinstance(part, tuple) and part and isinstance(part[0], MutableMapping):
                parent[key] = list(part)
            elif isinstance(part, (int, float, str)):
                # `coefficient = 0.5` then `--set …coefficient.std=0.1`: the number becomes a table
                parent[key] = {"value": part}
            elif part is None and keys[depth + 1] != ALL:
                parent[key] = {}
            replace(parent.get(key), depth + 1, value)

    try:
        replace(raw, 0, value)
    except RecursionError:
        raise error(
            f"--set '{path[:40]}…': has {len(keys)} parts; no value of a rig has so many"
        ) from None


def _merged(old: object, new: object) -> object:
    if isinstance(old, MutableMapping) and set(old) <= set(KEYS) and "value" in old:
        if isinstance(new, MutableMapping) and new:
            # a table with a std describes the whole uncertainty
            if "std" in new:
                old.pop("shared", None)
            # in place: a comment that follows the table in a file stays
            old.update(new)
            return old
        old["value"] = new
        return old
    return new
