"""A rig that is made from other files, and its TOML text, in which comments mark the guessed
values.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import cast

from distal.rig.files import build_rig
from distal.rig.rig import Rig


@dataclass(frozen=True)
class Guess:
    """A value that the files do not give and that is guessed; `of` says in words what it is a value
    of. It has a wide std where it can have one.
    """

    value: object
    of: str


@dataclass(frozen=True)
class Imported:
    """A rig that is made from other files.

    Args:
        text: its rig file, with a comment at each guessed value.
        notes: what was left out, held or fitted, a line each.
        missing: what the files do not say, in words.
    """

    rig: Rig
    text: str
    notes: tuple[str, ...]
    missing: tuple[str, ...]

    @staticmethod
    def of(raw: Mapping[str, object], title: str, source: str, notes: tuple[str, ...]) -> Imported:
        """Return the rig of a raw description that has guesses in it; comments say that these are
        not in the `source`.
        """
        rig = build_rig(cast(dict[str, object], plain_number(dict(raw))), title)
        return Imported(
            rig,
            written(raw, source),
            notes,
            tuple(dict.fromkeys(guess.of for guess in guesses(raw))),
        )


def name_of(name: str, otherwise: str) -> str:
    """Return a name in the form that a rig file allows; `otherwise` where no character of it is
    left.
    """
    name = re.sub(r"[^A-Za-z0-9_-]+", "_", name).strip("_-") or otherwise
    name = name if re.match(r"[A-Za-z_]", name) else f"_{name}"
    return (f"{name}_" if name in ("std", "dot", "base") or name.endswith("_std") else name)[:64]


def plain_number(raw: object) -> object:
    """Return a raw description with each guess replaced by its value."""
    if isinstance(raw, Guess):
        return plain_number(raw.value)
    if isinstance(raw, dict):
        return {key: plain_number(value) for key, value in raw.items()}
    return [plain_number(value) for value in raw] if isinstance(raw, list) else raw


def guesses(raw: object) -> Iterator[Guess]:
    """Yield the guesses in a raw description."""
    if isinstance(raw, Guess):
        yield raw
    elif isinstance(raw, (Mapping, list)):
        for value in raw.values() if isinstance(raw, Mapping) else raw:
            yield from guesses(value)


def written(raw: Mapping[str, object], source: str) -> str:
    """Return the TOML text of a raw description, each guess with a comment that it is not in the
    `source`.
    """
    import tomlkit

    document = tomlkit.document()
    for key, part in raw.items():
        if isinstance(part, list) and part and isinstance(part[0], dict):
            tables = tomlkit.aot()
            for row in part:
                tables.append(_table(row, source))
            document.add(key, tables)
        else:
            document.add(
                key,
                _table(part, source)
                if isinstance(part, dict)
                else tomlkit.item(plain_number(part)),
            )
    return tomlkit.dumps(document)


def _table(raw: dict[str, object], source: str) -> object:
    import tomlkit
    import tomlkit.items

    table = tomlkit.table()
    for key, part in raw.items():
        node = tomlkit.item(_inline(plain_number(part)))
        if isinstance(node, tomlkit.items.Array) and key == "crossings":
            node.multiline(True)
        table.add(key, node)
        of = list(dict.fromkeys(guess.of for guess in guesses(part)))
        if of:
            table[key].comment(f"not in the {source}: {', '.join(of)}")
    return table


def _inline(part: object) -> object:
    import tomlkit

    if isinstance(part, dict):
        table = tomlkit.inline_table()
        for key, inner in part.items():
            table.append(key, _inline(inner))
        return table
    if isinstance(part, list):
        array = tomlkit.array()
        for inner in part:
            array.append(_inline(inner))
        return array
    return part
