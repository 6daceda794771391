"""Write docs/reference/rig-keys.md, scenario-keys.md and study-keys.md from the descriptions
themselves.

`python -m tools.reference` writes the pages; a test checks that they are up to date.
"""

from __future__ import annotations

from pathlib import Path

from pydantic.fields import FieldInfo

from distal.rig import Description, In, Parameter, Rig
from distal.rig.quantities import KEYS
from distal.simulation import Scenario
from distal.simulation.scenario import Signal, SignalIn
from distal.study import Study

DOCS = Path(__file__).parents[1] / "docs" / "reference"


def _inner(field: FieldInfo) -> list[type[Description]]:
    found, stack = [], [field.annotation]
    while stack:
        kind = stack.pop()
        if isinstance(kind, type) and issubclass(kind, Description) and kind is not Parameter:
            found.append(kind)
        stack.extend(reversed(getattr(kind, "__args__", ())))
    return found


def _annotations(field: FieldInfo) -> list[object]:
    found, stack = list(field.metadata), [field.annotation]
    while stack:
        kind = stack.pop()
        found.extend(getattr(kind, "__metadata__", ()))
        stack.extend(getattr(kind, "__args__", ()))
    return found


def _holds(field: FieldInfo, kind: type) -> bool:
    stack = [field.annotation]
    while stack:
        one = stack.pop()
        if one is kind:
            return True
        stack.extend(getattr(one, "__args__", ()))
    return False


def _unit(field: FieldInfo) -> str:
    for part in _annotations(field):
        if isinstance(part, (In, SignalIn)):
            unit = part.si or "–"
            bound = {"positive": ", > 0", "nonnegative": ", ≥ 0"}.get(
                getattr(part, "bound", ""), ""
            )
            kind = (
                ", std"
                if _holds(field, Parameter)
                else ", over time"
                if _holds(field, Signal)
                else ""
            )
            return f"{unit}{bound}{kind}"
    if _inner(field):
        return "table"
    return "number" if _holds(field, float) or _holds(field, int) else "text"


def _default(field: FieldInfo) -> str:
    if field.is_required():
        return "**needed**"
    value = field.get_default(call_default_factory=True, validated_data={})
    if isinstance(value, Parameter):
        return f"{value.value:g}"
    if isinstance(value, Description) or value in ((), {}):
        return "none" if value in ((), {}) else "its defaults"
    return (
        "none" if value in (None, "") else f"{value:g}" if isinstance(value, float) else str(value)
    )


def _rows(model: type[Description]) -> list[str]:
    rows = ["| key | unit | default | what |", "|---|---|---|---|"]
    for name, field in model.model_fields.items():
        if name == "si":
            continue
        what = field.description or {
            "name": "its name: letters, digits, _ and -",
            "kind": "see above",
        }.get(name, "")
        rows.append(f"| `{name}` | {_unit(field)} | {_default(field)} | {what} |")
    return rows


def tables(root: type[Description]) -> str:
    """Return the tables of a description and all its parts."""
    lines, queue, seen = [], [(root, root.__name__)], set()
    while queue:
        model, title = queue.pop(0)
        if model in seen:
            continue
        seen.add(model)
        first = " ".join((model.__doc__ or "").strip().split("\n\n")[0].split())
        lines += [f"## {title}", "", first, "", *_rows(model), ""]
        for name, field in model.model_fields.items():
            queue += [(inner, f"`{name}`: {inner.__name__}") for inner in _inner(field)]
    return "\n".join(lines).rstrip() + "\n"


NUMBER = {
    "value": "the value",
    "std": "standard deviation of what is not known about it; as text also a share of the value",
    "factor": "in place of std: the value may be so many times as large or small",
    "drift": "its random walk per √s; default: 2 % of the std, of a bias none",
    "hold": "true: the std is a prior for fitting only",
    "shared": "name and std of an error that all of this name have in common, as a share of the "
    "value",
}
"""What a number that has a std may be written with."""


def parameters() -> str:
    """Return the table of the keys of a number."""
    if set(NUMBER) != set(KEYS):
        raise ValueError(f"NUMBER has to describe {', '.join(KEYS)}")
    rows = [f"| `{key}` | {NUMBER[key]} |" for key in KEYS]
    return "\n".join(
        [
            "## A number with std",
            "",
            "Where a unit is followed by std.",
            "",
            "| key | what |",
            "|---|---|",
            *rows,
        ]
    )


PAGES = {
    "rig-keys.md": (
        Rig,
        "Keys of a rig file",
        "Every table and key of a [rig file](rig-files.md).",
    ),
    "scenario-keys.md": (
        Scenario,
        "Keys of a scenario",
        "Every table and key of a [scenario](../how-to/simulate.md).",
    ),
    "study-keys.md": (
        Study,
        "Keys of a study",
        "Every table and key of a [study](../how-to/design-study.md).",
    ),
}
"""Page → what is described, title, first sentence."""


def written(page: str) -> str:
    """Return a page as it should be."""
    root, title, first = PAGES[page]
    text = f"# {title}\n\n{first} `python -m tools.reference` writes this page.\n\n{tables(root)}"
    return f"{text}\n{parameters()}\n" if root is Rig else text


if __name__ == "__main__":
    for page in PAGES:
        (DOCS / page).write_text(written(page), encoding="utf-8")
