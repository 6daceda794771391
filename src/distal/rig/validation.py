"""A description from raw values: checked by pydantic, with all its problems in one line; ``--set
path=value``, which replaces one of them by its path; and names for its numbers: as a path with
the names of its parts, in words, and as columns of estimates.
"""

from __future__ import annotations

import re
import reprlib
import tomllib
from collections.abc import Iterable, Iterator, Mapping, MutableMapping, Sequence
from copy import deepcopy
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError
from pydantic_core import ErrorDetails

from distal.errors import DistalError, did_you_mean
from distal.rig.components import KINDS as INSERTIONS
from distal.rig.sensors import UNITS
from distal.rig.values_with_stds import KEYS


def angle_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints' angles: ``theta`` for one joint, else ``theta_JOINT``.

    A standard deviation has ``_std`` behind it (`std_name`), a speed ``_dot`` (`speed_names`).
    """
    return _names_of("theta", joints)


def _names_of(quantity: str, joints: Sequence[str]) -> tuple[str, ...]:
    return (quantity,) if len(joints) == 1 else tuple(f"{quantity}_{joint}" for joint in joints)


def speed_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the joints' speeds: ``theta_dot``, or ``theta_JOINT_dot``."""
    return tuple(f"{name}_dot" for name in angle_names(joints))


def torque_names(joints: Sequence[str]) -> tuple[str, ...]:
    """Return the names of the external torques on the joints: ``external_torque``, or
    ``external_torque_JOINT``.
    """
    return _names_of("external_torque", joints)


def std_name(name: str) -> str:
    """Return the name of the std of what is called `name`: ``theta_std``, ``std of inertia of joint
    pip``.
    """
    return f"std of {name}" if " " in name else f"{name}_std"


def tendon_angle_name(tendon: str) -> str:
    """Return the name of the joint angle that a kinematic estimator computes from one tendon alone:
    ``tendon_angle_TENDON``.
    """
    return f"tendon_angle_{tendon}"


KINDS = ("joints", "drives", "tendons", "sensors")
"""Lists of a rig whose items have names."""


def index_of(items: Sequence[object], key: str) -> int | None:
    """Return the index of the item that a path names by its index or its name; None where there is
    none.
    """
    if key.isascii() and key.isdigit() and len(key) < 10:
        return int(key) if int(key) < len(items) else None
    names = names_in(items)
    return names.index(key) if key in names else None


def names_in(items: Sequence[object]) -> list[str]:
    """Return how a path calls the items of a list: by name (of a crossing that of its joint) where
    they have one of their own, else by index.
    """
    names = [_get(item, "name") or _get(item, "joint") for item in items]
    return [
        name if isinstance(name, str) and names.count(name) == 1 else str(i)
        for i, name in enumerate(names)
    ]


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
            key = key if index is None else names_in(part)[index]
            part = None if index is None else part[index]
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
        listed = _get(root, kind)
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
        _, at, *keys = keys
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


Checked = TypeVar("Checked", bound=BaseModel)

SHOWN = 3
"""Largest number of problems of a description that one message lists [1]. Source: layout."""


def validated(
    kind: type[Checked], raw: Mapping[str, object], source: str, error: type[DistalError]
) -> Checked:
    """Return a raw description as one of class `kind`, or raise `error` with all its problems in
    one line.

    Args:
        source: name of the description, with which the line begins.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as problem:
        raise error(explain(problem, source, raw)) from None
    except RecursionError:
        raise error(f"{source}: nested too deeply") from None


WORDED = {
    "missing": "is missing",
    "union_tag_not_found": "is missing",
    "too_short": "at least one is needed",
}
"""Kind of problem by pydantic → what is said of it."""

NEEDED = {"tuple_type": "a list", "list_type": "a list"} | dict.fromkeys(
    ("dict_type", "model_type", "model_attributes_type"), "a table"
)
"""Kind of problem by pydantic → what is needed in place of what came."""

_BRIEFLY = reprlib.Repr()
"""It shortens what a user wrote, for messages: a table may be nested a thousand times."""
_BRIEFLY.maxlevel = 3
_BRIEFLY.maxstring = 60
_BRIEFLY.maxother = 60


def explain(problem: ValidationError, source: str, raw: Mapping[str, object]) -> str:
    """Return pydantic's findings as one line that begins with the `source`: the first `SHOWN` in
    words, and the number of the others.
    """
    every = problem.errors(include_url=False)
    # a list whose items are all wrong is not short of items
    findings = [finding for finding in every if finding["type"] != "too_short"] or every
    line = f"{source}: " + "; also ".join(_finding(finding, raw) for finding in findings[:SHOWN])
    others = len(findings) - SHOWN
    return line + (f" (and {others} more problem{'s' if others > 1 else ''})" if others > 0 else "")


def _finding(finding: ErrorDetails, raw: Mapping[str, object]) -> str:
    """Return a finding in words, after the path of what it is of, with names of parts."""
    tags = {"slider", "capstan", *INSERTIONS, *UNITS}
    # a tag of a union follows an index or stands for the union itself; it is no key of the user's
    keys = [str(key) for i, key in enumerate(finding["loc"]) if i == 0 or key not in tags]
    kind = finding["type"]
    context = finding.get("ctx", {})
    if "discriminator" in context:
        keys.append(context["discriminator"].strip("'"))
    needed = context.get("expected") or context.get("expected_tags") or NEEDED.get(kind)
    came = _BRIEFLY.repr(context.get("tag", finding["input"]))
    if kind == "value_error":
        text = str(context["error"])
        # a check of several values says first which of them it refuses
        match = re.match(r"([\w.-]+): ", text)
        if match is not None:
            keys.append(match[1])
            text = text[match.end() :]
    elif kind in WORDED:
        text = WORDED[kind]
    elif needed:
        text = f"must be {needed}, {came} came"
    else:
        text = f"{finding['msg'][0].lower()}{finding['msg'][1:]}, {came} came"
    path = ".".join(keys)
    return f"{named(raw, path)}: {text}" if path else text


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
    parents: list[Any] = [raw]
    for depth, key in enumerate(keys):
        below = list[object]()
        for parent in parents:
            where = ".".join(keys[:depth])
            for index in _keys_for(parent, key, f"--set '{path}': '{where}' has no '{key}'", error):
                old = parent[index] if isinstance(parent, list) else parent.get(index)
                if depth + 1 == len(keys):
                    # a table is changed in place: each item gets one of its own
                    parent[index] = _merged(old, deepcopy(value))
                elif isinstance(old, (int, float, str)):
                    # `coefficient = 0.5` then `--set …coefficient.std=0.1`: it becomes a table
                    parent[index] = {"value": old}
                elif old is None:
                    parent[index] = {}
                below.append(parent[index])
        parents = below


def _keys_for(parent: object, key: str, missing: str, error: type[DistalError]) -> Iterable[Any]:
    """Return the indices or the key for which a `key` of a path stands, or raise `error` with what
    is `missing`.
    """
    if isinstance(parent, MutableMapping) and key != ALL:
        return [key]
    items = parent if isinstance(parent, list) else []
    if key == ALL and items:
        return range(len(items))
    at = index_of(items, key)
    if at is None:
        raise error(f"{missing}{did_you_mean(key, names_in(items))}")
    return [at]


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
