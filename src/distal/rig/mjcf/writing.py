"""The TOML text of an imported model: guesses are written with what they are as a comment."""

from __future__ import annotations

from collections.abc import Iterator

from distal.rig.mjcf.guesses import Guess


def plain(raw: object) -> object:
    """Return a raw description with the guesses' values."""
    if isinstance(raw, Guess):
        return plain(raw.value)
    if isinstance(raw, dict):
        return {key: plain(value) for key, value in raw.items()}
    return [plain(value) for value in raw] if isinstance(raw, list) else raw


def guesses(raw: object) -> Iterator[Guess]:
    """Return the guesses in a raw description."""
    if isinstance(raw, Guess):
        yield raw
    elif isinstance(raw, (dict, list)):
        for value in raw.values() if isinstance(raw, dict) else raw:
            yield from guesses(value)


def written(raw: dict[str, object]) -> str:
    """Return the TOML text of a raw description, each guess with a comment."""
    import tomlkit

    document = tomlkit.document()
    for key, part in raw.items():
        if isinstance(part, list) and part and isinstance(part[0], dict):
            tables = tomlkit.aot()
            for row in part:
                tables.append(_table(row))
            document.add(key, tables)
        else:
            document.add(key, _table(part) if isinstance(part, dict) else tomlkit.item(plain(part)))
    return tomlkit.dumps(document)


def _table(raw: dict[str, object]) -> object:
    import tomlkit
    import tomlkit.items

    table = tomlkit.table()
    for key, part in raw.items():
        node = tomlkit.item(_inline(plain(part)))
        if isinstance(node, tomlkit.items.Array) and key == "crossings":
            node.multiline(True)
        table.add(key, node)
        of = list(dict.fromkeys(guess.of for guess in guesses(part)))
        if of:
            table[key].comment(f"not in the model: {', '.join(of)}")
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
