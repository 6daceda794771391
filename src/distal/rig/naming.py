"""Names for the numbers of a description: as a path with the names of its parts, and in words."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

KINDS = ("joints", "drives", "tendons", "sensors")
"""Lists of a rig whose items have names."""


def name_in(items: Sequence[object], index: int) -> str | None:
    """Return the name that a path uses for an item of a list, of a crossing the name of its joint;
    None where the item has none or shares it with another.
    """
    names = [_get(item, "name") or _get(item, "joint") for item in items]
    name = names[index] if index < len(names) else None
    return name if isinstance(name, str) and names.count(name) == 1 else None


def index_of(items: Sequence[object], key: str) -> int | None:
    """Return the index of the item that a path names by its index or its name; None where there is
    none.
    """
    if key.isascii() and key.isdigit() and len(key) < 10:
        return int(key) if int(key) < len(items) else None
    return next((i for i in range(len(items)) if name_in(items, i) == key), None)


def names_in(items: Sequence[object]) -> list[str]:
    """Return how a path calls the items of a list: by name where they have one, else by index."""
    return [name_in(items, i) or str(i) for i in range(len(items))]


def named(root: object, path: str) -> str:
    """Return a path with names of parts in place of their indices, where parts have names:
    ``joints.pip`` for ``joints.0``.
    """
    return ".".join(key for key, _ in _steps(root, path))


def part_at(root: object, path: str) -> object:
    """Return what a path of keys, indices and names leads to, None where it leads nowhere."""
    return [part for _, part in _steps(root, path)][-1]


def _steps(root: object, path: str) -> Iterator[tuple[str, object]]:
    """Yield each key of a path, as a name where it has one, with the part to which it leads, of a
    checked or a raw description.
    """
    part = root
    for key in path.split("."):
        if isinstance(part, (list, tuple)):
            index = index_of(part, key)
            name = None if index is None else name_in(part, index)
            part = None if index is None else part[index]
            yield name or key, part
        else:
            part = _get(part, key)
            yield key, part


def in_words(root: object, *paths: str) -> str:
    """Return numbers in plain words, by their paths: "spring stiffness of joint pip" for
    ``joints.0.spring.stiffness``.

    Numbers that differ only in their part are named together, "stiffness of all tendons"; ``*``
    stands for all parts of a kind.
    """
    parts_of: dict[tuple[str, str, str], list[str]] = {}
    for path in paths:
        kind, _, below = named(root, path).partition(".")
        part, _, tail = below.partition(".")
        what, where = _what(tail)
        key = (what, where, kind) if kind in KINDS and tail else (path, "", "")
        parts_of.setdefault(key, []).append(part)
    phrases = []
    for (what, where, kind), parts in parts_of.items():
        listed = _get(root, kind) if kind else ()
        every = len(listed) if isinstance(listed, (list, tuple)) else 0
        if not kind:
            phrases.append(what)
        elif parts == ["*"] or (len(parts) > 1 and len(parts) == every):
            phrases.append(f"{what} of all {kind}{where}")
        else:
            phrases.append(
                f"{what} of {kind if len(parts) > 1 else kind[:-1]} {', '.join(parts)}{where}"
            )
    return "; ".join(phrases)


def _what(tail: str) -> tuple[str, str]:
    """Return what a number below a part is, and where along a tendon: "radius", " at pip" of
    ``crossings.pip.radius``.
    """
    keys = tail.split(".")
    where = ""
    if keys[0] == "crossings" and len(keys) > 2:
        at = keys[1]
        keys = keys[2:]
        where = (
            " at all joints"
            if at == "*"
            else f" at crossing {int(at) + 1}"
            if at.isdigit()
            else f" at {at}"
        )
    return " ".join(keys).replace("_", " "), where


def _get(part: object, key: str) -> object:
    return part.get(key) if isinstance(part, Mapping) else getattr(part, key, None)
