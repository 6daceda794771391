"""A description from raw values: checked by pydantic, with all its problems in one line."""

from __future__ import annotations

import re
import reprlib
from collections.abc import Mapping, Sequence
from typing import TypeVar

from pydantic import BaseModel, ValidationError
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails

from distal.errors import DistalError
from distal.rig.insertions import KINDS as INSERTIONS
from distal.rig.naming import named
from distal.rig.sensors import UNITS, one_number_each
from distal.suggestions import did_you_mean

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
        raise error(explain(problem, source, kind, raw)) from None
    except RecursionError:
        raise error(f"{source}: nested too deeply") from None


_BRIEFLY = reprlib.Repr()
"""It shortens what a user wrote, for messages: a table may be nested a thousand times."""
_BRIEFLY.maxlevel = 3
_BRIEFLY.maxstring = 60
_BRIEFLY.maxother = 60


def explain(
    problem: ValidationError, source: str, root: type[BaseModel], raw: Mapping[str, object]
) -> str:
    """Return pydantic's findings as one line that begins with the `source`: the first `SHOWN` in
    words, and the number of the others.
    """
    findings = problem.errors(include_url=False)
    # a list whose items are all wrong is not short of items
    inner = [finding["loc"] for finding in findings if finding["type"] != "too_short"]
    findings = [
        finding
        for finding in findings
        if finding["type"] != "too_short"
        or not any(loc[: len(finding["loc"])] == finding["loc"] for loc in inner)
    ]
    if isinstance(sensors := raw.get("sensors"), list):
        raw = {**raw, "sensors": one_number_each(sensors)}
    line = f"{source}: " + "; also ".join(
        _by_name(_finding(finding, root), raw) for finding in findings[:SHOWN]
    )
    others = len(findings) - SHOWN
    return line + (f" (and {others} more problem{'s' if others > 1 else ''})" if others > 0 else "")


def _by_name(message: str, raw: Mapping[str, object]) -> str:
    """Return a message with names of parts in the path at its beginning."""
    path, colon, text = message.partition(": ")
    return message if " " in path else f"{named(raw, path)}{colon}{text}"


def _finding(finding: ErrorDetails, root: type[BaseModel]) -> str:
    tags = {"slider", "capstan", *INSERTIONS, *UNITS, "SliderServo", "CapstanServo"}
    location = list(finding["loc"])
    # a tag of a union follows an index or stands for the union itself; it is no key of the user's
    keys = [k for i, k in enumerate(location) if not (k in tags and i > 0)]
    path = ".".join(str(key) for key in keys)
    kind = finding["type"]
    context = finding.get("ctx", {})
    shown = _BRIEFLY.repr(finding.get("input"))
    if kind == "extra_forbidden":
        allowed = _known_keys(root, location[:-1])
        return f"{path}: unknown key '{location[-1]}'{did_you_mean(str(location[-1]), allowed)}"
    if kind == "missing":
        return f"{path}: is missing"
    if kind == "value_error":
        text = str(context["error"])
        # a list's own check starts with the index and key that it refuses
        joint = "." if re.match(r"\d+(\.\w+)?: ", text) else ": "
        return f"{path}{joint}{text}" if path else text
    if kind == "literal_error":
        return f"{path}: must be {context['expected']}, {shown} came"
    if kind == "union_tag_invalid":
        key = str(context["discriminator"]).strip("'")
        return f"{path}.{key}: must be {context['expected_tags']}, '{context['tag']}' came"
    if kind == "union_tag_not_found":
        return f"{path}: '{str(context['discriminator']).strip(chr(39))}' is missing"
    if kind in ("tuple_type", "list_type"):
        return f"{path}: must be a list, {shown} came"
    if kind in ("dict_type", "model_type", "model_attributes_type"):
        return f"{path}: must be a table, {shown} came"
    if kind == "too_short":
        return f"{path}: at least one is needed"
    return f"{path}: {finding['msg'][0].lower()}{finding['msg'][1:]}, {shown} came"


def _known_keys(root: type[BaseModel], location: Sequence[int | str]) -> list[str]:
    """Return the keys allowed at a location, by walking the field types along it."""
    models: list[type[BaseModel]] = [root]
    for key in location:
        if isinstance(key, int):
            continue
        inner = [m for model in models for m in models_in(model.model_fields.get(key))]
        tagged = [m for m in models if any(_tag(m, name) == key for name in ("kind", "si"))]
        models = inner or tagged or models
    return sorted({name for model in models for name in model.model_fields if name != "si"})


def models_in(field: FieldInfo | None) -> list[type[BaseModel]]:
    """Return the classes of descriptions that a field of a description can hold; none for None."""
    models: list[type[BaseModel]] = []
    stack = [] if field is None else [field.annotation]
    while stack:
        kind = stack.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            models.append(kind)
        stack.extend(getattr(kind, "__args__", ()))
    return models


def _tag(model: type[BaseModel], name: str) -> object:
    field = model.model_fields.get(name)
    return getattr(field.annotation, "__args__", (None,))[0] if field is not None else None
