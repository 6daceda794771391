"""What the documentation says is there: arguments, commands, keys, examples."""

from __future__ import annotations

import ast
import importlib
import inspect
import pkgutil
import re
from pathlib import Path

import pytest

import distal

ROOT = Path(__file__).parents[1]
MODULES = sorted(module.name for module in pkgutil.walk_packages(distal.__path__, "distal."))


def public_callables(name: str) -> list[tuple[str, object]]:
    module = importlib.import_module(name)
    found: list[tuple[str, object]] = []
    for key, value in vars(module).items():
        if key.startswith("_") or getattr(value, "__module__", None) != name:
            continue
        if inspect.isfunction(value):
            found.append((f"{name}.{key}", value))
        elif inspect.isclass(value):
            found += [
                (f"{name}.{key}.{k}", v)
                for k, v in vars(value).items()
                if inspect.isfunction(v) and not k.startswith("_") and v.__module__ == name
            ]
    return found


@pytest.mark.parametrize("name", [name for name in MODULES if ".cli" not in name])
def test_every_argument_of_the_libraries_public_functions_is_documented(name: str) -> None:
    """Where a function takes more than one argument, or any that its sentence does not name, each has its line."""
    missing = []
    for path, function in public_callables(name):
        doc = inspect.getdoc(function) or ""
        assert doc, f"{path} has no docstring"
        arguments = [a for a in inspect.signature(function).parameters if a not in ("self", "cls")]  # type: ignore[arg-type]
        for argument in arguments:
            if not re.search(rf"(?m)(^\s+{argument}: |\b{argument}\b|`{argument}`)", doc) and len(arguments) > 1:
                missing.append(f"{path}: {argument}")
    assert not missing


def test_package_files_only_re_export() -> None:
    """But for distal's own, which re-exports when a name is first used: see `test_every_public_name_is_found`."""
    for file in (ROOT / "src" / "distal").rglob("*/__init__.py"):
        for node in ast.parse(file.read_text(encoding="utf-8")).body:
            kind = type(node).__name__
            is_all = kind == "Assign" and getattr(node.targets[0], "id", "") == "__all__"  # type: ignore[attr-defined]
            assert kind in ("Expr", "ImportFrom") or is_all, f"{file}: {kind}"


def test_modules_are_short() -> None:
    for file in (ROOT / "src" / "distal").rglob("*.py"):
        assert len(file.read_text(encoding="utf-8").splitlines()) <= 400, file


def test_the_example_of_the_readme_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    (code,) = re.findall(r"```python\n(.*?)```", text, re.S)
    assert len(code.strip().splitlines()) <= 12
    monkeypatch.chdir(tmp_path)
    exec(compile(code, "README.md", "exec"), {})
    assert list(tmp_path.iterdir())


@pytest.mark.parametrize("page", ["estimators.md", "scenarios.md"])
def test_the_examples_of_the_docs_run(page: str) -> None:
    for code in re.findall(r"```python\n(.*?)```", (ROOT / "docs" / page).read_text(encoding="utf-8"), re.S):
        exec(compile(code, page, "exec"), {})


def test_pictures_and_pages_that_are_named_exist() -> None:
    for page in [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]:
        for target in re.findall(r"\]\(([^)#]+)\)", page.read_text(encoding="utf-8")):
            if not target.startswith("http"):
                assert (page.parent / target).exists(), f"{page.name}: {target}"


def keys(model: type, seen: set[type]) -> set[str]:
    """Return every key of a description, nested ones too."""
    from distal.rig.validation import models_in

    if model in seen:
        return set()
    seen.add(model)
    found = set()
    for name, field in model.model_fields.items():  # type: ignore[attr-defined]
        found.add(name)
        for inner in models_in(field):
            found |= keys(inner, seen)
    return found


@pytest.mark.parametrize(("page", "model"), [("rig-files.md", "Rig"), ("scenarios.md", "Scenario")])
def test_every_key_is_in_the_reference(page: str, model: str) -> None:
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    missing = {key for key in keys(getattr(distal, model), set()) if f"`{key}`" not in text}
    assert missing - {"si", "value", "std"} == set()


def test_the_reference_is_up_to_date() -> None:
    from tools.reference import PAGES, updated

    for page, root in PAGES.items():
        assert page.read_text(encoding="utf-8") == updated(page, root), "run python -m tools.reference"
