"""Write docs/reference/rig-keys.md, scenario-keys.md and study-keys.md from the descriptions
themselves.

`python -m tools.reference` writes the pages; a test checks that they are up to date. The kinds of a
part (slider and capstan) and what is derived from them are a family: they share a table, so that
what they have in common is said once.
"""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from pathlib import Path

from pydantic.fields import FieldInfo

from distal.rig import Description, In, Parameter, Rig
from distal.rig.values_with_stds import KEYS
from distal.simulation import Scenario
from distal.simulation.scenario import Signal, SignalIn
from distal.study import Study

DOCS = Path(__file__).parents[1] / "docs" / "reference"

Model = type[Description]
Family = list[Model]


def _parts(kind: object) -> Iterator[object]:
    """Yield a type, what annotates it, and the same of the types within it."""
    yield kind
    yield from getattr(kind, "__metadata__", ())
    for inner in getattr(kind, "__args__", ()):
        yield from _parts(inner)


def _is_table(kind: object) -> bool:
    return isinstance(kind, type) and issubclass(kind, Description) and kind is not Parameter


def _inner(field: FieldInfo) -> list[Model]:
    return [kind for kind in _parts(field.annotation) if _is_table(kind)]  # type: ignore[misc]


def _unit(field: FieldInfo) -> str:
    parts = [*field.metadata, *_parts(field.annotation)]
    units = [part.si.replace(" ", "·") for part in parts if isinstance(part, (In, SignalIn))]
    marks = {Parameter: "±", Signal: "over time"}
    return " ".join(
        word
        for word in (*units[:1], *(mark for kind, mark in marks.items() if kind in parts))
        if word
    )


def _default(field: FieldInfo) -> str:
    """Return what a key is by default, where it is not zero, empty or absent."""
    default = None if field.is_required() else field.get_default(call_default_factory=True)
    if isinstance(default, Parameter):
        default = default.value
    if isinstance(default, Description) or not default or default == (0.0, 0.0, 0.0):
        return ""
    if isinstance(default, tuple):
        return f"default [{', '.join(f'{number:g}' for number in default)}]"
    if isinstance(default, str):
        return f'default "{default}"'
    return f"default {str(default).lower() if default is True else format(default, 'g')}"


def families(root: Model) -> dict[str, Family]:
    """Return title → descriptions that share a table, of a description and all its parts."""
    found, keys, kinds = [root], dict[Model, list[str]](), list[list[Model]]()
    for model in found:  # grows
        for key, field in model.model_fields.items():
            inner = _inner(field)
            kinds.append(inner)
            for part in inner:
                keys.setdefault(part, []).append(key)
                found += [part] if part not in found else []
    kinds += [[base for base in model.__mro__ if base in found] for model in found]
    shared = [[model] for model in found]
    for together in kinds:
        touched = [family for family in shared if set(family) & set(together)]
        if len(touched) > 1:
            merged = [model for family in touched for model in family]
            shared[shared.index(touched[0])] = sorted(merged, key=lambda model: len(model.__mro__))
            shared = [family for family in shared if family not in touched[1:]]
    titles = [
        ", ".join(dict.fromkeys(f"`{key}`" for model in family for key in keys.get(model, [])))
        for family in shared
    ]
    return {
        f"{title}: {family[0].__name__}".lstrip(": ")
        if len(family) == 1 or titles.count(title) > 1
        else title: family
        for title, family in zip(titles, shared)
    }


def _anchor(title: str) -> str:
    return re.sub(r"[-\s]+", "-", re.sub(r"[^\w\s-]", "", title).strip().lower())


def _first(model: Model) -> str:
    """Return the first paragraph of a description's docstring."""
    return " ".join((model.__doc__ or "").strip().split("\n\n")[0].split())


def holders(models: Sequence[Model], family: Family) -> str:
    """Return the fewest names that say which `models` of a family have a key; "" where all have
    it.
    """
    bases = {
        base
        for model in models
        for base in model.__mro__
        if _is_table(base) and base is not Description
    }
    below = {base: {model for model in family if issubclass(model, base)} for base in bases}
    if set(models) == set(family):
        return ""
    exact = [base.__name__ for base in bases if below[base] == set(models)]
    roots = [model for model in models if not any(base in models for base in model.__mro__[1:])]
    return min(exact, default="") or ", ".join(model.__name__ for model in roots)


def _link(parts: Sequence[Model], anchors: dict[Model, str]) -> str:
    """Return a link to the table of `parts`, which are of one family."""
    kinds = " or ".join(part.__name__ for part in parts)
    text = kinds if len(parts) < 3 else f"one of {len(parts)} kinds"
    return f"[{text}](#{anchors[parts[0]]})"


def rows(family: Family, anchors: dict[Model, str]) -> Iterator[str]:
    """Yield the rows of a family's table."""
    shared = dict[tuple[str, str, str], dict[Model, FieldInfo]]()
    for model in family:
        for key, field in model.model_fields.items():
            if key != "si":
                row = (key, field.description or "", _default(field))
                shared.setdefault(row, {})[model] = field
    keys = list(dict.fromkeys(key for key, *_ in shared))
    for key, *texts in sorted(shared, key=lambda row: keys.index(row[0])):
        fields = shared[key, texts[0], texts[1]]
        field = next(iter(fields.values()))
        units = list(dict.fromkeys(_unit(each) for each in fields.values()))
        unit = " or ".join(units) if len(units) < 3 else "as measured" + " ±" * ("±" in units[0])
        parts = list(dict.fromkeys(part for each in fields.values() for part in _inner(each)))
        table = _link(parts, anchors) if parts else ""
        if key == "kind":
            texts = [f'"{each.annotation.__args__[0]}"' for each in fields.values()]  # type: ignore[union-attr]
            texts = [" or ".join(dict.fromkeys(texts))]
        what = "; ".join(text for text in (table, *texts) if text)
        who = "" if key == "kind" else holders(list(fields), family)
        name = f"**`{key}`**" if field.is_required() else f"`{key}`"
        yield f"|{name}|{unit}|{': '.join(text for text in (who, what) if text)}|"


def tables(root: Model) -> str:
    """Return the tables of a description and all its parts."""
    titles = families(root)
    anchors = {model: _anchor(title) for title, family in titles.items() for model in family}
    lines = []
    for title, family in titles.items():
        said = [_first(model) for model in family]
        if len(family) > 1:
            said = [f"* {model.__name__}: {first}" for model, first in zip(family, said)]
        head = ["", "|key|unit|what|", "|---|---|---|"]
        lines += [f"## {title}", "", *said, *head, *rows(family, anchors), ""]
    return "\n".join(lines)


PAGES = {
    "rig-keys.md": (Rig, "Keys of a rig file", "Every key of a [rig file](rig-files.md)."),
    "scenario-keys.md": (
        Scenario,
        "Keys of a scenario",
        "Every key of a [scenario](../how-to/simulate.md).",
    ),
    "study-keys.md": (
        Study,
        "Keys of a study",
        "Every key of a [study](../how-to/design-study.md).",
    ),
}
"""Page → what is described, title, first sentence."""

READ = (
    "Bold keys are needed; others are zero or absent where no default is said. A `name` has "
    "letters, digits, _ and -. "
    "`python -m tools.reference` writes this page."
)
NUMBERS = (
    "Where ± follows a unit, the number [may have](rig-files.md#numbers) "
    f"{', '.join(f'`{key}`' for key in KEYS[1:])}."
)


def written(page: str) -> str:
    """Return a page as it should be."""
    root, title, first = PAGES[page]
    numbers = f" {NUMBERS}" if root is Rig else ""
    return f"# {title}\n\n{first} {READ}{numbers}\n\n{tables(root)}"


if __name__ == "__main__":
    for page in PAGES:
        (DOCS / page).write_text(written(page), encoding="utf-8")
