"""Rig files: TOML in, `Rig` out, and the shipped ones by name."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Any, TypeVar

from pydantic import BaseModel, ValidationError

from distal.errors import DistalError, RigError, did_you_mean
from distal.rig.overrides import parse_assignment, set_value
from distal.rig.rig import Rig

Checked = TypeVar("Checked", bound=BaseModel)


def shipped_rigs() -> tuple[str, ...]:
    """Return the names of the rigs that come with distal."""
    files = resources.files("distal.rig").joinpath("library").iterdir()
    return tuple(sorted(f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")))


def rig_text(name: str | Path) -> tuple[str, str]:
    """Return the text of a rig file and what to call it in messages.

    Args:
        name: a shipped rig's name, or a path.

    Raises:
        RigError: neither a shipped rig nor a readable file.
    """
    shipped = shipped_rigs()
    if str(name) in shipped:
        file = resources.files("distal.rig").joinpath("library", f"{name}.toml")
        return file.read_text(encoding="utf-8"), str(name)
    path = Path(name)
    if path.suffix != ".toml" and not path.exists():
        raise RigError(f"unknown rig '{name}'{did_you_mean(str(name), shipped)}; or give the path of a .toml file")
    return read_text(path, RigError), str(path)


def read_text(path: Path, error: type[DistalError]) -> str:
    """Return the text of a file (UTF-8), or raise `error` with the reason in plain words.

    Args:
        path: the file.
        error: the kind of error to raise.
    """
    try:
        return path.read_text(encoding="utf-8-sig")
    except UnicodeDecodeError:
        raise error(f"{path}: not a text file (UTF-8 is expected)") from None
    except OSError as problem:
        raise error(f"{path}: cannot be read ({problem.strerror or problem})") from None


def parse_toml(text: str, source: str, error: type[DistalError]) -> dict[str, Any]:
    """Return the tables of a TOML text, or raise `error` naming the source, line and column."""
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as problem:
        raise error(f"{source}: not valid TOML: {str(problem) or 'nested too deeply'}") from None


def load_rig(name: str | Path, assignments: Sequence[str] = ()) -> Rig:
    """Load a rig by name or from a TOML file.

    Args:
        name: a shipped rig's name (see `shipped_rigs`) or a path.
        assignments: ``path=value`` each, as ``--set`` on the command line; the value is TOML.

    Raises:
        RigError: the rig is unknown, cannot be read, or its description is wrong.
    """
    text, source = rig_text(name)
    raw = parse_toml(text, source, RigError)
    for assignment in assignments:
        path, value = parse_assignment(assignment, RigError)
        set_value(raw, path, value, RigError)
    return build_rig(raw, source)


def edited_text(name: str | Path, assignments: Sequence[str] = ()) -> str:
    """Return the text of a rig file with some values replaced; its comments stay.

    Args:
        name: a shipped rig's name or a path.
        assignments: ``path=value`` each.

    Raises:
        RigError: as `load_rig`.
    """
    text, source = rig_text(name)
    raw = parse_toml(text, source, RigError)
    for assignment in assignments:
        set_value(raw, *parse_assignment(assignment, RigError), RigError)
    build_rig(raw, source)
    if not assignments:
        return text
    import tomlkit

    document = tomlkit.parse(text)
    for assignment in assignments:
        path, value = parse_assignment(assignment, RigError)
        set_value(document, path, value, RigError)
    return tomlkit.dumps(document)


def template_text() -> str:
    """Return a commented template of a rig file."""
    return resources.files("distal.rig").joinpath("template.toml").read_text(encoding="utf-8")


def build_rig(raw: Mapping[str, Any], source: str) -> Rig:
    """Check a raw description and return the rig; `source` names it in messages.

    Raises:
        RigError: something is wrong; one line that says where, what came and what is allowed.
    """
    return validated(Rig, raw, source, RigError)


def validated(kind: type[Checked], raw: Mapping[str, Any], source: str, error: type[DistalError]) -> Checked:
    """Check a raw description of some kind; what is wrong is one line in an error of the kind's own.

    Args:
        kind: of description.
        raw: as parsed.
        source: its name in messages.
        error: to raise.
    """
    try:
        return kind.model_validate(raw)
    except ValidationError as problem:
        raise error(explain(problem, source, kind)) from None
    except RecursionError:
        raise error(f"{source}: nested too deeply") from None


def explain(problem: ValidationError, source: str, root: type[BaseModel]) -> str:
    """Return one line for pydantic's findings: the first few in full, the number of others.

    Args:
        problem: what pydantic found.
        source: what to call the description.
        root: the description's model.
    """
    findings = problem.errors(include_url=False)
    line = f"{source}: " + "; also ".join(_finding(finding, root) for finding in findings[:SHOWN])
    others = len(findings) - SHOWN
    return line + (f" (and {others} more problem{'s' if others > 1 else ''})" if others > 0 else "")


SHOWN = 3
"""How many problems of a description are said at once."""


def _finding(finding: Any, root: type[BaseModel]) -> str:
    tags = {"slider", "capstan", "pinned", "pulley", "linkage", "m", "rad", "N", "N m", "SliderServo", "CapstanServo"}
    location = list(finding["loc"])
    # a tag of a union follows an index or stands for the union itself; it is no key of the user's
    keys = [k for i, k in enumerate(location) if not (k in tags and i > 0)]
    path = ".".join(str(key) for key in keys)
    kind, context = finding["type"], finding.get("ctx", {})
    given = finding.get("input")
    if kind == "extra_forbidden":
        known = _known_keys(root, location[:-1])
        return f"{path}: unknown key '{location[-1]}'{did_you_mean(str(location[-1]), known)}"
    if kind == "missing":
        return f"{path}: is missing"
    if kind == "value_error":
        text = str(context["error"])
        # a list's own check starts with the index and key that it refuses
        joint = "." if re.match(r"\d+(\.\w+)?: ", text) else ": "
        return f"{path}{joint}{text}" if path else text
    if kind == "literal_error":
        return f"{path}: must be {context['expected']}, {given!r} came"
    if kind == "union_tag_invalid":
        key = str(context["discriminator"]).strip("'")
        return f"{path}.{key}: must be {context['expected_tags']}, '{context['tag']}' came"
    if kind == "union_tag_not_found":
        return f"{path}: '{str(context['discriminator']).strip(chr(39))}' is missing"
    if kind in ("tuple_type", "list_type"):
        return f"{path}: must be a list, {given!r} came"
    if kind in ("dict_type", "model_type", "model_attributes_type"):
        return f"{path}: must be a table, {given!r} came"
    if kind == "too_short":
        return f"{path}: at least one is needed"
    return f"{path}: {finding['msg'][0].lower()}{finding['msg'][1:]}, {given!r} came"


def _known_keys(root: type[BaseModel], location: Sequence[Any]) -> list[str]:
    """Return the keys allowed at a location, by walking the field types along it."""
    models: list[type[BaseModel]] = [root]
    for key in location:
        if isinstance(key, int):
            continue
        inner = [m for model in models for m in _models_in(model.model_fields.get(key))]
        tagged = [m for m in models if any(_tag(m, name) == key for name in ("kind", "si"))]
        models = inner or tagged or models
    return sorted({name for model in models for name in model.model_fields if name != "si"})


def _models_in(field: Any) -> list[type[BaseModel]]:
    if field is None:
        return []
    found: list[type[BaseModel]] = []
    stack = [field.annotation]
    while stack:
        kind = stack.pop()
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            found.append(kind)
        stack.extend(getattr(kind, "__args__", ()))
    return found


def _tag(model: type[BaseModel], name: str) -> object:
    field = model.model_fields.get(name)
    return getattr(field.annotation, "__args__", (None,))[0] if field is not None else None
