"""Write the tables of keys in docs/rig-files.md and docs/scenarios.md from the descriptions themselves.

`python -m tools.reference` rewrites what stands between the markers; a test checks that it is up to date.
"""

from __future__ import annotations

import re
from pathlib import Path

from pydantic.fields import FieldInfo

from distal.rig import Description, In, Parameter, Rig
from distal.simulation import Scenario
from distal.simulation.signals import Signal, SignalIn

DOCS = Path(__file__).parents[1] / "docs"


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
            bound = {"positive": ", > 0", "nonnegative": ", ≥ 0"}.get(getattr(part, "bound", ""), "")
            kind = ", std" if _holds(field, Parameter) else ", over time" if _holds(field, Signal) else ""
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
    return "none" if value in (None, "") else f"{value:g}" if isinstance(value, float) else str(value)


def _rows(model: type[Description]) -> list[str]:
    rows = ["| key | unit | default | what |", "|---|---|---|---|"]
    for name, field in model.model_fields.items():
        if name == "si":
            continue
        what = field.description or {"name": "its name: letters, digits, _ and -", "kind": "see above"}.get(name, "")
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
        first = (model.__doc__ or "").strip().splitlines()[0]
        lines += [f"### {title}", "", first, "", *_rows(model), ""]
        for name, field in model.model_fields.items():
            queue += [(inner, f"`{name}`: {inner.__name__}") for inner in _inner(field)]
    return "\n".join(lines).rstrip() + "\n"


def updated(page: Path, root: type[Description]) -> str:
    """Return the page with its tables as they are now."""
    text = page.read_text(encoding="utf-8")
    marker = r"(<!-- keys: [^\n]* -->\n).*?(<!-- end of keys -->)"
    return re.sub(marker, lambda m: m[1] + "\n" + tables(root) + "\n" + m[2], text, flags=re.S)


PAGES = {DOCS / "rig-files.md": Rig, DOCS / "scenarios.md": Scenario}

if __name__ == "__main__":
    for page, root in PAGES.items():
        page.write_text(updated(page, root), encoding="utf-8")
